"""Leaves out detections that belong to nobody on the floor: the look-up would put them at its edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.cameras.person_model import FloorCamera
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray

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
