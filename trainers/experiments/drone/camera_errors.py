"""How far the estimated motion of the camera is off, over every step of a generated flight.

What the tracker needs is that no step is far off: one that is moves every person out of its gate. So of each flight the
largest error over all steps counts, and not a mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
from tsuiseki.datamodules.scenes.render.ground import ground_homography
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.types import FloatArray

PLACES = 5  # to each side
LEAST_PLACES = 3


@dataclass(frozen=True)
class FlightErrors:
    """Largest errors over all steps of a flight, pixels.

    Attributes:
        median: of the median over places in the picture.
        worst: of the worst place.
        best: of the worst place, of the similarity that fits the true motion of the ground best.
        step: by how far the ground moved in the picture, median over places.
        unknown: steps of which the estimate says that nothing is known; they are in no error.
        steps: in all.
    """

    median: float
    worst: float
    best: float
    step: float
    unknown: int
    steps: int


def flight_errors(scene: DroneSceneSettings, seed: int, steps: Sequence[CameraStep | None]) -> FlightErrors:
    """Errors on the ground at 5 x 5 places in the picture, those of them that stay in view.

    Args:
        scene: that was drawn.
        seed: of the clip.
        steps: estimated, one a frame; that of the first frame is not used.
    """
    size = np.array([scene.width, scene.height], dtype=np.float64)
    grid = np.linspace(1 / 6, 5 / 6, PLACES)
    places = np.array([(x, y) for x in grid for y in grid]) * size
    cameras = plan_drone(scene, seed).cameras
    rows, unknown = [], 0
    for before, after, step in zip(cameras, cameras[1:], steps[1:], strict=False):
        exact = _moved(ground_homography(before, after), places)
        inside = ((exact > 0) & (exact < size)).all(axis=1)
        inside |= inside.sum() < LEAST_PLACES
        if step is None or not np.isfinite(step.deviation):
            unknown += 1
            continue
        off, least = (
            np.linalg.norm(_moved(matrix, places) - exact, axis=1)[inside]
            for matrix in (step.similarity, _best_similarity(places[inside], exact[inside]))
        )
        moved_by = np.linalg.norm(exact - places, axis=1)
        rows.append((np.median(off), off.max(), least.max(), np.median(moved_by)))
    largest = np.array(rows).max(axis=0) if rows else np.full(4, np.nan)
    median, worst, best, way = largest.tolist()
    return FlightErrors(median, worst, best, way, unknown, len(rows) + unknown)


def _moved(matrix: FloatArray, places: FloatArray) -> FloatArray:
    """``(N, 2)`` places by a similarity ``(2, 3)`` or a homography ``(3, 3)``."""
    moved = np.column_stack([places, np.ones(len(places))]) @ matrix.T
    return np.asarray(moved[:, :2] / moved[:, 2:] if len(matrix) == 3 else moved)


def _best_similarity(places: FloatArray, moved: FloatArray) -> FloatArray:
    """``(2, 3)`` by least squares."""
    (x, y), one, none = places.T, np.ones(len(places)), np.zeros(len(places))
    across, down = np.stack([x, -y, one, none], 1), np.stack([y, x, none, one], 1)
    a, b, tx, ty = np.linalg.lstsq(np.concatenate([across, down]), moved.T.ravel(), rcond=None)[0]
    return np.array([[a, -b, tx], [b, a, ty]])
