"""Detections of a ceiling camera before tracking: boxes, rotated boxes, floor positions, appearance features."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tsuiseki.tracking.cameras.person_model import FloorCamera, PersonModel, PersonTable
from tsuiseki.tracking.cameras.rectification import standing_crops, upright_crops
from tsuiseki.tracking.features.networks.exported import Describe
from tsuiseki.tracking.formats.rotated import about_bodies
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.types.floor import FloorDetections

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
