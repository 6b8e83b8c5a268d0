"""Detections of a ceiling camera before tracking: boxes, rotated boxes, floor positions, appearance features.

Beside them: the gate that leaves out detections outside the floor, and two watchers of what passes through. One keeps
the rotated boxes to write them, the other the best score, to explain why no track started.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from tsuiseki.tracking.cameras.person_model import FloorCamera, PersonModel, PersonTable
from tsuiseki.tracking.cameras.rectification import standing_crops, upright_crops
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.formats.rotated import RotatedBoxes, about_bodies, half_turned
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source

Crops = Literal["image", "upright", "standing"]
# Height and width of a crop, pixels: what the shipped appearance network takes.
CROP = (128, 64)


@dataclass(frozen=True)
class CeilingView:
    """A camera, its table of boxes and the appearance model.

    Attributes:
        camera: with its pose.
        table: gives the rotated box and the floor position of an upright box.
        person: the model that the table was made with.
        appearance: the appearance model; None uses no appearance.
        crops: its input: the upright box as it is in the ``image``, the rotated box turned ``upright``, or the
            person as on a ``standing`` screen, which evens out perspective.
    """

    camera: FloorCamera
    table: PersonTable
    person: PersonModel
    appearance: Describe | None = None
    crops: Crops = "upright"

    def looking(self, appearance: Describe | None, crops: Crops) -> CeilingView:
        """The same view with another appearance model and other crops."""
        return replace(self, appearance=appearance, crops=crops)

    def locate(self, found: Detections, times: StageTimes | None = None) -> FloorDetections:
        """Rotated boxes and places of detected boxes; ``times`` gets the stage ``look up``."""
        times = times or StageTimes()
        with times.measure("look up"):
            if found.angles is None:
                rotated, places = self.table.look_up(found.boxes)
            else:
                found, rotated, places = self._turned(found, found.angles)
        return FloorDetections(found, rotated, places)

    def _turned(self, found: Detections, angles: FloatArray) -> tuple[Detections, FloatArray, FloatArray]:
        """Boxes that a network has turned itself, with the feet's end and the place of the upright box about each."""
        given = np.column_stack([as_unturned(found.boxes)[:, :4], angles])
        upright = about_bodies(given)
        looked_up, places = self.table.look_up(upright)
        # Labels and networks tell the body's line, not which of its ends is up: the model does.
        flipped = np.cos(looked_up[:, 4] - angles) < 0
        rotated = given.copy()
        rotated[:, 4] = (angles + np.pi * flipped + np.pi) % (2 * np.pi) - np.pi
        return replace(found, boxes=upright, angles=None), rotated, places

    def describe(self, image: ImageArray, found: FloorDetections, times: StageTimes | None = None) -> FloorDetections:
        """``found`` with appearance features; ``times`` gets the stages ``rectify`` and ``describe``."""
        if self.appearance is None or not len(found):
            return found
        times = times or StageTimes()
        with times.measure("rectify"):
            crops = self._cut_out(image, found)
        with times.measure("describe"):
            # An appearance model takes an image and boxes: the crops are stacked to one image.
            rows = np.arange(len(crops))[:, None] * CROP[0]
            cells = np.concatenate([0 * rows, rows, 0 * rows + CROP[1], rows + CROP[0]], axis=1).astype(np.float64)
            features = self.appearance.describe(crops.reshape(-1, CROP[1], 3), cells)
        return FloorDetections(found.detections.with_features(features), found.rotated, found.places)

    def _cut_out(self, image: ImageArray, found: FloorDetections) -> ImageArray:
        height, width = CROP
        if self.crops == "standing":
            return standing_crops(image, self.camera, found.places, self.person, height, width)
        boxes = found.rotated if self.crops == "upright" else as_unturned(found.detections.boxes)
        return upright_crops(image, boxes, height, width)


def as_unturned(boxes: FloatArray) -> FloatArray:
    """``(N, 5)`` rotated boxes of angle 0 from ``(N, 4)`` x1, y1, x2, y2."""
    centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    return np.concatenate([centre, size, np.zeros((len(boxes), 1))], axis=1)


# How far outside somebody may seem to stand, metres, and besides as a share of the distance: boxes are not exact.
MARGIN, SHARE = 1.0, 0.15


@dataclass
class FloorGate:
    """Keeps who stands on the floor, and counts the others.

    Attributes:
        camera: over the floor.
        floor: ``(4,)`` x1, y1, x2, y2, metres.
        middle: height of the middle of a person, metres.
        left_out: detections so far that belong to nobody on the floor.
    """

    camera: FloorCamera
    floor: FloatArray
    middle: float
    left_out: int = 0

    def keep(self, found: Detections) -> Detections:
        """The detections of those on the floor."""
        inside = self.inside(found.boxes)
        self.left_out += int((~inside).sum())
        return found if inside.all() else found.select(inside)

    def inside(self, boxes: FloatArray) -> BoolArray:
        """``(N,)`` whether the middles of ``(N, 4)`` boxes are those of people on the floor."""
        places = self.camera.ground((boxes[:, :2] + boxes[:, 2:]) / 2, self.middle)[:, :2]
        allowed = MARGIN + SHARE * np.linalg.norm(places - self.camera.position[:2], axis=1, keepdims=True)
        # A pixel at or above the horizon has no place: every comparison with it is False.
        return np.asarray(((places >= self.floor[:2] - allowed) & (places <= self.floor[2:] + allowed)).all(axis=1))


@dataclass
class FoundBoxes:
    """Keeps what passes through.

    Attributes:
        source: of the frames; the images of a folder are named as their files without suffix, other frames by their
            number from 1.
        boxes: by the image's name.
    """

    source: Source
    boxes: dict[str, RotatedBoxes] = field(default_factory=dict)

    def watched(self, people: Iterable[FloorDetections]) -> Iterator[FloorDetections]:
        """The same, frame by frame."""
        images = self.source.images if isinstance(self.source, ImageFolder) else ()
        for index, each in enumerate(people):
            name = images[index].stem if images else str(index + 1)
            rows = each.rotated.copy()
            rows[:, 4] = half_turned(rows[:, 4])
            self.boxes[name] = RotatedBoxes(rows, np.full(len(rows), -1), each.detections.scores)
            yield each


@dataclass
class BestScore:
    """Watches the scores of what passes through.

    Attributes:
        frames: so far.
        number: of detections so far.
        best: the highest score so far; infinite where a detection has none, for it may always start a track.
    """

    frames: int = 0
    number: int = 0
    best: float = -np.inf

    def watched(self, people: Iterable[FloorDetections]) -> Iterator[FloorDetections]:
        """The same, frame by frame."""
        for each in people:
            scores = each.detections.scores
            self.frames += 1
            self.number += len(scores)
            self.best = max(self.best, float(np.nan_to_num(scores, nan=np.inf).max(initial=-np.inf)))
            yield each

    def too_low(self, start_score: float) -> str:
        """What to tell where no detection starts a track from ``start_score`` on; empty where one does."""
        if self.number == 0 or self.best >= start_score:
            return ""
        return (
            f"; none of {self.number} detections scores {start_score:g}, from which a track starts: the best has "
            f"{self.best:.2f}; give a lower `hungarian.start_score`, or `method` flow"
        )
