"""What the tables say of the tracks: scores by room, differences of rows, where parts help, milliseconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.room_clip import Room
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.trainers.experiments.fisheye.distances import detections_by_part
from tsuiseki.trainers.experiments.fisheye.observations import STAGES, CpuTimes, Observed
from tsuiseki.trainers.experiments.fisheye.rendered import Sequence as Clip
from tsuiseki.trainers.experiments.fisheye.rendered import plan
from tsuiseki.trainers.experiments.fisheye.rows import GATED, UNGATED, Choice, pair_of, run_row, score, world_errors
from tsuiseki.trainers.experiments.fisheye.selection import row_named
from tsuiseki.trainers.experiments.fisheye.tables import interval

IMAGE_ROWS = ("baseline", "SORT", "DeepSORT")
# By how much both parts beat the best image-space row and DeepSORT at 1 frame a second, points of MOTA.
MARGINS: dict[Room, tuple[float, float]] = {"large": (3.3, 16.0), "small": (2.3, 22.4)}
DIFFERENCES = (
    ("both", "baseline"), ("both", "SORT"), ("both", "DeepSORT"), ("both", "DeepSORT, filtered boxes"),
    (GATED, "baseline"), (GATED, "DeepSORT"), (GATED, "both"),
    ("rectification", "baseline"), ("world", "SORT"), ("world", "baseline"), ("both", "rectification"),
    ("both, standing crops", "both"), ("DeepSORT", "DeepSORT, filtered boxes"),
    ("flow: baseline", "baseline"), ("flow: SORT", "SORT"), ("flow: DeepSORT", "DeepSORT"),
    ("flow: rectification", "rectification"), ("flow: world", "world"), ("flow: both", "both"),
    ("flow: both", "flow: DeepSORT"), ("track fisheye", UNGATED), ("track fisheye", "both"),
    ("track fisheye, flow", "track fisheye"), ("track fisheye", "baseline"), ("track fisheye", "DeepSORT"),
)  # fmt: skip


@dataclass(frozen=True)
class Found:
    """Everything of one room and rate: the test sequences by seed, and their tracks by row."""

    sequences: dict[int, list[Observed]]
    tracks: dict[str, dict[int, list[list[FloorTrack]]]]


def by_seed(found: Found, name: str, where: Any = None) -> list[Any]:
    """Scores of a row for each seed."""
    return [
        score([pair_of(str(k), o, t, where) for k, (o, t) in enumerate(zip(each, found.tracks[name][s], strict=True))])
        for s, each in found.sequences.items()
    ]


def row_values(found: Found) -> dict[str, Any]:
    """The scores of each row by seed, and its world errors over all of them."""
    result = {}
    for name in found.tracks:
        scores = by_seed(found, name)
        errors = np.concatenate(
            [
                world_errors(o, t)
                for s, each in found.sequences.items()
                for o, t in zip(each, found.tracks[name][s], strict=True)
            ]
        )
        result[name] = {
            **{k: [100 * getattr(s, k) for s in scores] for k in ("mota", "idf1", "hota")},
            "id_switches": [s.id_switches for s in scores],
            "recall": [100 * s.recall for s in scores],
            "precision": [100 * s.precision for s in scores],
            "world_error_median": float(np.median(errors)) if len(errors) else None,
            "world_error_mean": float(np.mean(errors)) if len(errors) else None,
            "world_error_90": float(np.percentile(errors, 90)) if len(errors) else None,
        }
    return result


def margins(rows: Mapping[str, Any], room: Room) -> dict[str, Any]:
    """By how much both parts beat the best image-space row, chosen over all seeds, and DeepSORT; MOTA and IDF1.

    Args:
        rows: of `row_values`.
        room: whose margins are asked.
    """
    result: dict[str, Any] = {"asked": MARGINS[room]}
    for measure in ("mota", "idf1"):
        best = max(IMAGE_ROWS, key=lambda name: np.mean(rows[name][measure]))
        for against, label in ((best, "best image row"), ("DeepSORT", "DeepSORT")):
            result[f"{measure} over {label}"] = _gain(rows, "both", against, measure)
    return result


def differences(rows: Mapping[str, Any]) -> list[dict[str, Any]]:
    """By how much one row is ahead of another, for `DIFFERENCES`."""
    return [
        {"row": ours, **{measure: _gain(rows, ours, theirs, measure) for measure in ("mota", "idf1")}}
        for ours, theirs in DIFFERENCES
    ]


def _gain(rows: Mapping[str, Any], ours: str, theirs: str, measure: str) -> dict[str, Any]:
    gains = (np.array(rows[ours][measure]) - np.array(rows[theirs][measure])).tolist()
    return {"row": theirs, "by_seed": gains, "interval": interval(gains)}


def where_parts_help(found: Found) -> dict[str, Any]:
    """Table 4.4: gains of each part alone, in points of MOTA, by direction and distance from the image's middle."""

    def polar(boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = ((boxes[:, :2] + boxes[:, 2:]) / 2 - [640, 480]).T
        return np.arctan2(y, x), np.hypot(x, y)

    def aligned(boxes: FloatArray) -> BoolArray:
        quarter = np.abs((polar(boxes)[0] + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        return np.asarray(quarter <= np.pi / 8)

    def oblique(boxes: FloatArray) -> BoolArray:
        return ~aligned(boxes)

    def centre(boxes: FloatArray) -> BoolArray:
        return np.asarray(polar(boxes)[1] <= 200)

    def rim(boxes: FloatArray) -> BoolArray:
        radius = polar(boxes)[1]
        return np.asarray((radius > 300) & (radius <= 500))

    cases = (("aligned", aligned, "rectification", "baseline"), ("oblique", oblique, "rectification", "baseline"),
             ("centre", centre, "world", "SORT"), ("rim", rim, "world", "SORT"))  # fmt: skip
    result = {}
    for label, where, ours, theirs in cases:
        pairs = zip(by_seed(found, ours, where), by_seed(found, theirs, where), strict=True)
        gains = [100 * (a.mota - b.mota) for a, b in pairs]
        result[label] = {"row": ours, "against": theirs, "by_seed": gains, "interval": interval(gains)}
    return result


def detections_found(found: Found, room: Room, calibration: Path | None, least: float) -> list[dict[str, Any]]:
    """The detections by angle to the camera's axis and by side; all cameras have one lens."""
    lens = plan(Clip(room, 0, 0, 1, 1, calibration)).cameras[0].lens
    return detections_by_part([o for each in found.sequences.values() for o in each], lens, least)


def stage_milliseconds(found: Found, choice: Choice, least: float) -> dict[str, float]:
    """Milliseconds a frame of each stage in the first sequence, both parts with ``choice``."""
    observed = next(iter(found.sequences.values()))[0]
    frames = len(observed.found)
    times = CpuTimes()
    with times.measure("associate"):
        run_row(row_named("both"), observed, choice, least)
    result = {stage: 1000 * observed.seconds[stage] / frames for stage in STAGES}
    result["associate"] = 1000 * times.seconds["associate"] / frames
    result["people"] = observed.persons / frames
    return result
