"""How well the detector finds people near the centre of the image and far from it, and on all sides of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.evaluation.rotated import evaluate_rings
from tsuiseki.tracking.fisheye.view import as_unturned
from tsuiseki.tracking.formats.rotated import RotatedBoxes
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.trainers.experiments.fisheye.observations import Observed

# Angles between the camera's axis and the middle of a box that part the rings, degrees.
ANGLES = (20, 40, 60)
# Less visible people are not asked for.
VISIBLE = 0.3
# About the image's centre, the first from +x on towards +y.
SECTORS = 8


def ring_names() -> list[str]:
    """As in a table."""
    return [f"{low} to {high}°" for low, high in zip((0, *ANGLES), (*ANGLES, 90), strict=True)]


def rings_of(lens: OmnidirectionalLens) -> Callable[[FloatArray], IntArray]:
    """Pixels ``(N, 2)`` to rings ``(N,)``; what lies beyond the lens's rim belongs to the last."""

    def ring_of(pixels: FloatArray) -> IntArray:
        away = np.degrees(np.arccos(np.clip(np.asarray(lens.rays(pixels))[:, 2], -1, 1)))
        return np.asarray(np.searchsorted(np.array(ANGLES), np.nan_to_num(away, nan=180.0), side="right"))

    return ring_of


def sectors_of(lens: OmnidirectionalLens) -> Callable[[FloatArray], IntArray]:
    """Pixels ``(N, 2)`` to eight sectors ``(N,)`` about the lens's centre."""

    def sector_of(pixels: FloatArray) -> IntArray:
        x, y = (pixels - lens.centre).T
        return np.asarray(np.floor(np.arctan2(y, x) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS)

    return sector_of


def by_part(
    truth: Mapping[str, RotatedBoxes],
    found: Mapping[str, RotatedBoxes],
    part_of: Callable[[str, FloatArray], IntArray],
    names: Sequence[str],
    least_score: float,
) -> list[dict[str, Any]]:
    """Labelled boxes, AP50, and recall and precision from a score on, of each named part of the images."""
    rows = []
    for name, scores in zip(names, evaluate_rings(truth, found, part_of, len(names)), strict=True):
        if scores is None:
            continue
        row: dict[str, Any] = {"part": name, "boxes": scores.boxes, "ap50": scores.average_precision}
        kept = int((scores.scores >= least_score).sum())
        row["recall"] = float(scores.recall[kept - 1]) if kept else 0.0
        row["precision"] = float(scores.precision[kept - 1]) if kept else None
        rows.append(row)
    return rows


def detections_by_part(
    sequences: Sequence[Observed], lens: OmnidirectionalLens, least_score: float
) -> list[dict[str, Any]]:
    """`by_part` of upright boxes, by rings and then by sectors, over sequences whose cameras have one lens."""
    truth, found = {}, {}
    for number, observed in enumerate(sequences):
        seen = observed.truth.visibility >= VISIBLE
        for frame in range(len(observed.found) // observed.rate):
            name, detections = f"{number} {frame}", observed.found[frame * observed.rate].detections
            labels = observed.truth.boxes[seen & (observed.truth.frames == frame)]
            truth[name] = _upright(labels, np.ones(len(labels)))
            found[name] = _upright(detections.boxes, detections.scores)
    ring_of, sector_of = rings_of(lens), sectors_of(lens)
    sectors = [f"sector {k + 1} of {SECTORS}" for k in range(SECTORS)]
    return [
        *by_part(truth, found, lambda _, pixels: ring_of(pixels), ring_names(), least_score),
        *by_part(truth, found, lambda _, pixels: sector_of(pixels), sectors, least_score),
    ]


def _upright(boxes: FloatArray, scores: FloatArray) -> RotatedBoxes:
    return RotatedBoxes(as_unturned(boxes), np.full(len(boxes), -1), scores)
