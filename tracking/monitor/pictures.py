"""Pictures of a run for whoever watches it: people drawn with their ids, or hidden."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.scene_drawing import draw_scene
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.geometry import clip_boxes, iou_matrix
from tsuiseki.tracking.hiding.places import HOLD, SAME, paint, widened
from tsuiseki.tracking.report.overlay import Overlay
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Targets, Track


@dataclass(frozen=True)
class Hidden:
    """Who is hidden in pictures, and how those are found who have no track.

    Attributes:
        detect: a sensitive detector of people.
        heads: heads alone.
        visible: ids of people who stay as they are.
    """

    detect: Detect
    heads: bool = False
    visible: frozenset[int] = frozenset()


class PictureMaker:
    """Draws people and the scene into the pictures of cameras; hides people first, where that is asked for.

    Hidden are the boxes of all tracks, widened by their doubt and held for a second, as `tsuiseki hide` does it; and
    whatever a second, more sensitive detection finds in that very picture.
    """

    def __init__(self, hidden: Hidden | None = None, scene: Scene | None = None) -> None:
        self._hidden, self._scene = hidden, scene
        # By camera and id: seconds, box and score of the last frame.
        self._recent: dict[int, dict[int, tuple[float, FloatArray, float]]] = {}
        self._lock = threading.Lock()
        self._made: dict[int, tuple[Frame, ImageArray]] = {}

    def note(self, camera: int, frame: Frame, people: Targets) -> None:
        """Remember where people are: whoever is missed in the next frames is hidden there still."""
        if self._hidden is None:
            return
        recent = {n: known for n, known in self._recent.get(camera, {}).items() if known[0] >= frame.time - HOLD}
        rows = zip(people.ids.tolist(), people.boxes, np.nan_to_num(people.scores).tolist(), strict=True)
        self._recent[camera] = recent | {number: (frame.time, box, score) for number, box, score in rows}

    def picture(
        self, camera: int, frame: Frame, people: Targets, counts: Mapping[str, str] = MappingProxyType({})
    ) -> ImageArray:
        """The image of a frame with its people, ``(H, W, 3)`` uint8 RGB; asked again for a frame it is made once.

        ``counts`` stand beside the names of the scene, see `draw_scene`.
        """
        with self._lock:
            made = self._made.get(camera)
            if made is None or made[0] is not frame:
                image = frame.image if self._hidden is None else self._without_people(camera, frame, self._hidden)
                made = self._made[camera] = frame, drawn(Frame(frame.index, frame.time, image), people)
                if self._scene is not None:
                    draw_scene(made[1], self._scene, counts)
            return made[1]

    def _without_people(self, camera: int, frame: Frame, hidden: Hidden) -> ImageArray:
        height, width = frame.image.shape[:2]
        known = self._recent.get(camera, {})
        tracked = places(known, frame.time, hidden.visible, hidden.heads)
        ((_, detections),) = stream([frame], hidden.detect)
        visible = [box for number, (_, box, _) in known.items() if number in hidden.visible]
        boxes = detections.boxes
        if visible and len(boxes):
            boxes = boxes[iou_matrix(boxes, np.array(visible)).max(axis=1) < SAME]
        found = widened(boxes, np.zeros(len(boxes)), np.zeros(len(boxes)), hidden.heads)
        return paint(
            frame.image, clip_boxes(np.concatenate([tracked, found]), width, height), "pixelated", hidden.heads
        )


def places(
    known: Mapping[int, tuple[float, FloatArray, float]], seconds: float, visible: frozenset[int], heads: bool
) -> FloatArray:
    """``(N, 4)`` where to hide people who are known by their last time, box and score."""
    rows = [row for number, row in known.items() if number not in visible]
    boxes = np.array([box for _, box, _ in rows]).reshape(-1, 4)
    ages = np.abs([seconds - time for time, _, _ in rows])
    return widened(boxes, np.clip([score for _, _, score in rows], 0, 1), ages, heads)


def drawn(frame: Frame, people: Targets) -> ImageArray:
    """The image of a frame with a box and the id of each person, ``(H, W, 3)`` uint8 RGB."""
    people = people.select(people.status != "lost")
    tracks = [
        Track(person.id, np.array([frame.index]), person.box[None], np.ones(1), np.array([person.status == "tracking"]))
        for person in people
    ]
    return Overlay(tracks, 1.0, trail_seconds=0.0).draw(frame)
