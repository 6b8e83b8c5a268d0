"""Thesis chapter 4 on generated rooms: Tables 4.3, 4.4 and 4.5, Figures 4.4 and 4.5 (`reproduce omnidirectional`).

Every row gets the same detections, and is scored on the boxes of those that it puts into tracks. Its settings are the
ones of the best mean of MOTA and IDF1, or of the best MOTA, on validation rooms, which are not in the tables; the
lowest score of a detection is chosen there too, once for all rows. Two more rows show what the boxes of SORT's and
DeepSORT's Kalman filters cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.rooms.ceiling import CAMERAS, Room
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import PeopleScores
from tsuiseki.tracking.pipelines.fisheye.looking import DETECTORS, CeilingLook
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, at_least_one
from tsuiseki.trainers.experiments.fisheye.distances import detections_by_part
from tsuiseki.trainers.experiments.fisheye.observations import (
    STAGES,
    CpuTimes,
    Networks,
    Observed,
    observe,
    read_observed,
)
from tsuiseki.trainers.experiments.fisheye.pictures import switch_pictures
from tsuiseki.trainers.experiments.fisheye.rendered import Sequence as Clip
from tsuiseki.trainers.experiments.fisheye.rendered import plan, render
from tsuiseki.trainers.experiments.fisheye.rows import (
    ROWS,
    Choice,
    Rule,
    pair_of,
    run_row,
    score,
    select,
    validated,
    world_errors,
    worth,
)
from tsuiseki.trainers.experiments.fisheye.tables import PAPER, interval, notes, tables

ROOMS: tuple[Room, ...] = ("large", "small")
VALIDATION_SEEDS = (900, 901)
LEAST_SCORES = (0.2, 0.3, 0.4, 0.5, 0.6)
IMAGE_ROWS = ("baseline", "SORT", "DeepSORT")
# By how much both parts beat the best image-space row and DeepSORT at 1 frame a second, points of MOTA.
MARGINS: dict[Room, tuple[float, float]] = {"large": (3.3, 16.0), "small": (2.3, 22.4)}


@dataclass(frozen=True)
class _Found:
    """Everything of one room and rate: the test sequences by seed, and their tracks by row."""

    sequences: dict[int, list[Observed]]
    tracks: dict[str, dict[int, list[list[FloorTrack]]]]


def reproduce(
    bench: Bench,
    seeds: int = 6,
    first_seed: int = 0,
    seconds: int = 60,
    fast_seeds: int = 3,
    fast_seconds: int = 10,
    calibration: Path | None = None,
    detector: Path | None = None,
    view: CeilingLook = "unrolled",
    appearance: Path | None = None,
    simulated_detections: bool = False,
    chosen_by: Rule = "mota-and-idf1",
    full: bool = False,
) -> Outcome:
    """People under ceiling fisheye cameras, at 1 and 15 frames a second: what upright crops and floor places bring.

    DIR gets results.json, tables.md, prevented.jpg and remaining.jpg like Figs. 4.4 and 4.5.

    Args:
        bench: where it works.
        seeds: rooms of each size, two cameras each.
        first_seed: of these rooms.
        seconds: of each sequence at 1 frame a second.
        fast_seeds: of these rooms, looked at 15 frames a second, too; 0 leaves them out.
        fast_seconds: of each sequence at 15 frames a second.
        calibration: lens of the cameras, any that tsuiseki calibrate convert reads; by default an equidistant one.
        detector: exported detector; by default the shipped one for the view.
        view: what it looks at, see tsuiseki track fisheye.
        appearance: exported appearance network; by default the shipped one.
        simulated_detections: draw faulty detections from the truth instead of running a detector.
        chosen_by: the score of the validation rooms that settings are chosen by: the mean of MOTA and IDF1, or MOTA.
        full: 5 seeds of 180 seconds at both rates, as many frames as the thesis has and more.

    Raises:
        RequestError: a number below 1 (`fast_seeds`: below 0), or a file that cannot be read.
    """
    at_least_one(seeds=seeds, seconds=seconds, fast_seconds=fast_seconds)
    if fast_seeds < 0:
        raise RequestError(f"`fast_seeds`: expected 0 or more, got {fast_seeds}")
    if full:
        seeds, seconds, fast_seeds, fast_seconds = 5, 180, 5, 180
    tested = range(first_seed, first_seed + seeds)
    if first_seed < 0 or set(tested) & set(VALIDATION_SEEDS):
        raise RequestError(
            f"`first_seed`: expected rooms that settings are not chosen on ({VALIDATION_SEEDS[0]}, "
            f"{VALIDATION_SEEDS[1]}), from 0 on, got {first_seed} to {tested[-1]}"
        )
    found_by = None if simulated_detections else detector or shipped(DETECTORS[view])
    networks = Networks(found_by, appearance or shipped("appearance_people"), view)

    def seen(room: Room, seed: int, length: int, rate: Literal[1, 15]) -> list[Observed]:
        clips = [Clip(room, seed, camera, length, rate, calibration) for camera in range(CAMERAS)]
        return [
            read_observed(
                bench.store.made("observed", observe, clip, bench.store.made("frames", render, clip), networks)
            )
            for clip in clips
        ]

    jobs: list[tuple[Room, int, int, Literal[1, 15]]] = [
        (room, seed, seconds, 1) for room in ROOMS for seed in (*VALIDATION_SEEDS, *tested)
    ]
    jobs += [(room, seed, fast_seconds, 15) for seed in tested[:fast_seeds] for room in ROOMS]
    observed = {(room, seed, rate): seen(room, seed, length, rate)
                for room, seed, length, rate in bench.watch.over(jobs, "rooms", len(jobs))}  # fmt: skip
    validation = [o for seed in VALIDATION_SEEDS for room in ROOMS for o in observed[room, seed, 1]]
    least, chosen, scores = _selected(bench, validation, chosen_by)
    found = {
        (room, rate): _tracked({s: o for (r, s, k), o in observed.items() if (r, k) == (room, rate)}, chosen, least)
        for room in ROOMS
        for rate in ((1, 15) if fast_seeds > 0 else (1,))
    }
    values: dict[str, Any] = {
        "seeds": seeds,
        "first_seed": first_seed,
        "validation_seeds": list(VALIDATION_SEEDS),
        "seconds": seconds,
        "fast_seeds": fast_seeds,
        "fast_seconds": fast_seconds,
        "least_score": least,
        "chosen_by": chosen_by,
        "chosen": {
            name: {"settings": choice, "validation_mota": scores[name].mota, "validation_idf1": scores[name].idf1}
            for name, choice in chosen.items()
        },
        "rows": {f"{room} {rate} fps": _row_values(each) for (room, rate), each in found.items()},
        "margins": {room: _margins(found[room, 1], room) for room in ROOMS},
        "where": _where(found["large", 1]),
        "detector": {room: _found_where(found[room, 1], room, calibration, least) for room in ROOMS},
        "milliseconds": {room: _stages(found[room, 1], chosen, least) for room in ROOMS},
    }
    pictures = switch_pictures(found["large", 1].sequences, found["large", 1].tracks, seconds, calibration)
    files = {name: cv2.imencode(".jpg", image[:, :, ::-1])[1].tobytes() for name, image in pictures.items()}
    return Outcome(values, tables(values), files=files, notes=notes(values))


def _selected(
    bench: Bench, validation: Sequence[Observed], rule: Rule
) -> tuple[float, dict[str, Choice], dict[str, PeopleScores]]:
    """The lowest score, each row's settings, and their scores on the validation rooms."""
    trials = [(row, list(row.choices())) for row in ROWS if row.name in PAPER]

    def mean_worth(least: float) -> float:
        # By the middle of each row's grid, so that the score suits no row better than the others.
        middles = [validated(row, validation, some[len(some) // 2], least) for row, some in trials]
        return float(np.mean([worth(scores, rule) for scores in middles]))

    least = max(LEAST_SCORES, key=mean_worth)
    chosen, found = dict[str, Choice](), dict[str, PeopleScores]()
    for row in bench.watch.over(ROWS, "settings", len(ROWS)):
        if row.like:
            chosen[row.name], found[row.name] = chosen[row.like], found[row.like]
        else:
            chosen[row.name], found[row.name] = select(row, validation, least, rule)
    return least, chosen, found


def _tracked(sequences: dict[int, list[Observed]], chosen: Mapping[str, Choice], least: float) -> _Found:
    tests = {seed: each for seed, each in sequences.items() if seed not in VALIDATION_SEEDS}
    tracks: dict[str, dict[int, list[list[FloorTrack]]]] = {}
    for row in ROWS:
        if any(row.crops not in (*o.features, "none") for each in tests.values() for o in each):
            continue
        tracks[row.name] = {s: [run_row(row, o, chosen[row.name], least) for o in each] for s, each in tests.items()}
    return _Found(tests, tracks)


def _by_seed(found: _Found, name: str, where: Any = None) -> list[Any]:
    """Scores of a row for each seed."""
    return [
        score([pair_of(str(k), o, t, where) for k, (o, t) in enumerate(zip(each, found.tracks[name][s], strict=True))])
        for s, each in found.sequences.items()
    ]


def _row_values(found: _Found) -> dict[str, Any]:
    result = {}
    for name in found.tracks:
        scores = _by_seed(found, name)
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


def _margins(found: _Found, room: Room) -> dict[str, Any]:
    """By how much both parts beat the best image-space row, chosen over all seeds, and DeepSORT; MOTA and IDF1."""
    rows = {name: _by_seed(found, name) for name in (*IMAGE_ROWS, "both")}
    result: dict[str, Any] = {"asked": MARGINS[room]}
    for measure in ("mota", "idf1"):
        best = max(IMAGE_ROWS, key=lambda name: np.mean([getattr(s, measure) for s in rows[name]]))
        for against, label in ((best, "best image row"), ("DeepSORT", "DeepSORT")):
            gains = [100 * (getattr(a, measure) - getattr(b, measure)) for a, b in zip(rows["both"], rows[against],
                                                                                       strict=True)]  # fmt: skip
            result[f"{measure} over {label}"] = {"row": against, "by_seed": gains, "interval": interval(gains)}
    return result


def _where(found: _Found) -> dict[str, Any]:
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
        pairs = zip(_by_seed(found, ours, where), _by_seed(found, theirs, where), strict=True)
        gains = [100 * (a.mota - b.mota) for a, b in pairs]
        result[label] = {"row": ours, "against": theirs, "by_seed": gains, "interval": interval(gains)}
    return result


def _found_where(found: _Found, room: Room, calibration: Path | None, least: float) -> list[dict[str, Any]]:
    """The detections by angle to the camera's axis and by side; all cameras have one lens."""
    lens = plan(Clip(room, 0, 0, 1, 1, calibration)).cameras[0].lens
    return detections_by_part([o for each in found.sequences.values() for o in each], lens, least)


def _stages(found: _Found, chosen: Mapping[str, Choice], least: float) -> dict[str, float]:
    """Milliseconds a frame of each stage in the first sequence."""
    observed = next(iter(found.sequences.values()))[0]
    frames = len(observed.found)
    row = next(row for row in ROWS if row.name == "both")
    times = CpuTimes()
    with times.measure("associate"):
        run_row(row, observed, chosen["both"], least)
    result = {stage: 1000 * observed.seconds[stage] / frames for stage in STAGES}
    result["associate"] = 1000 * times.seconds["associate"] / frames
    result["people"] = observed.persons / frames
    return result
