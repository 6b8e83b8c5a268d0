"""Thesis chapter 4 on generated rooms: Tables 4.3, 4.4 and 4.5, Figures 4.4 and 4.5 (`reproduce omnidirectional`).

Every row gets the same detections, and is scored on the boxes of those that it puts into tracks. Its settings are the
ones of the best MOTA on validation rooms, which are not in the tables; the lowest score of a detection is chosen there
too, once for all rows. Two more rows show what the boxes of SORT's and DeepSORT's Kalman filters cost.
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
from tsuiseki.tracking.pipelines.fisheye.tracking import DETECTORS, CeilingLook
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments import intervals
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
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
from tsuiseki.trainers.experiments.fisheye.rendered import render
from tsuiseki.trainers.experiments.fisheye.rows import (
    ROWS,
    Choice,
    pair_of,
    run_row,
    score,
    select,
    world_errors,
)

ROOMS: tuple[Room, ...] = ("large", "small")
VALIDATION_SEEDS = (900, 901)
LEAST_SCORES = (0.2, 0.3, 0.4, 0.5, 0.6)
IMAGE_ROWS = ("baseline", "SORT", "DeepSORT")
# MOTA of Table 4.3 at 1 and 15 frames a second: large, small, large, small.
PAPER: dict[str, tuple[float, float, float, float]] = {
    "baseline": (8.4, 51.0, -3.5, 48.7),
    "SORT": (-10.5, 24.5, -1.4, 49.9),
    "DeepSORT": (-4.3, 30.9, 6.0, 52.3),
    "rectification": (10.2, 51.8, -3.4, 48.5),
    "world": (8.1, 53.1, -1.1, 49.7),
    "both": (11.7, 53.3, 6.6, 52.0),
}
# By how much both parts beat the best image-space row and DeepSORT at 1 frame a second, points of MOTA.
MARGINS: dict[Room, tuple[float, float]] = {"large": (3.3, 16.0), "small": (2.3, 22.4)}
PAPER_STAGES = {"detect": (18.8, 19.9), "look up": (0.3, 0.4), "describe": (64.4, 46.5), "associate": (2.1, 1.0)}
PAPER_GAINS = {"aligned": 0.011, "oblique": 0.031, "centre": 17.703, "rim": 1.757}
# Where these people are in an image of 1280x960, by the middle of their upright boxes.
REGIONS = {
    "aligned": "aligned, at most 22.5° from the image's axes",
    "oblique": "oblique, the others",
    "centre": "centre, at most 200 px from the image's middle",
    "rim": "rim, 300 to 500 px from it",
}


@dataclass(frozen=True)
class _Found:
    """Everything of one room and rate: the test sequences by seed, and their tracks by row."""

    sequences: dict[int, list[Observed]]
    tracks: dict[str, dict[int, list[list[FloorTrack]]]]


def reproduce(
    bench: Bench,
    seeds: int = 6,
    seconds: int = 60,
    fast_seeds: int = 3,
    fast_seconds: int = 10,
    calibration: Path | None = None,
    detector: Path | None = None,
    view: CeilingLook = "unrolled",
    appearance: Path | None = None,
    simulated_detections: bool = False,
    full: bool = False,
) -> Outcome:
    """People under ceiling fisheye cameras, at 1 and 15 frames a second: what upright crops and floor places bring.

    DIR gets results.json, tables.md, prevented.jpg and remaining.jpg like Figs. 4.4 and 4.5.

    Args:
        bench: where it works.
        seeds: rooms of each size, two cameras each.
        seconds: of each sequence at 1 frame a second.
        fast_seeds: of these rooms, looked at 15 frames a second, too; 0 leaves them out.
        fast_seconds: of each sequence at 15 frames a second.
        calibration: lens of the cameras, any that tsuiseki calibrate convert reads; by default an equidistant one.
        detector: exported detector; by default the shipped one for the view.
        view: what it looks at, see tsuiseki track fisheye.
        appearance: exported appearance network; by default the shipped one.
        simulated_detections: draw faulty detections from the truth instead of running a detector.
        full: 5 seeds of 180 seconds at both rates, as many frames as the thesis has and more.

    Raises:
        RequestError: a number below 1 (`fast_seeds`: below 0), or a file that cannot be read.
    """
    at_least_one(seeds=seeds, seconds=seconds, fast_seconds=fast_seconds)
    if fast_seeds < 0:
        raise RequestError(f"`fast_seeds`: expected 0 or more, got {fast_seeds}")
    if full:
        seeds, seconds, fast_seeds, fast_seconds = 5, 180, 5, 180
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
        (room, seed, seconds, 1) for room in ROOMS for seed in (*VALIDATION_SEEDS, *range(seeds))
    ]
    jobs += [(room, seed, fast_seconds, 15) for seed in range(min(fast_seeds, seeds)) for room in ROOMS]
    observed = {(room, seed, rate): seen(room, seed, length, rate)
                for room, seed, length, rate in bench.watch.over(jobs, "rooms", len(jobs))}  # fmt: skip
    validation = [o for seed in VALIDATION_SEEDS for room in ROOMS for o in observed[room, seed, 1]]
    least, chosen, motas = _selected(bench, validation)
    found = {
        (room, rate): _tracked({s: o for (r, s, k), o in observed.items() if (r, k) == (room, rate)}, chosen, least)
        for room in ROOMS
        for rate in ((1, 15) if fast_seeds > 0 else (1,))
    }
    values: dict[str, Any] = {
        "seeds": seeds,
        "seconds": seconds,
        "fast_seeds": fast_seeds,
        "fast_seconds": fast_seconds,
        "least_score": least,
        "chosen": {name: {"settings": choice, "validation_mota": motas[name]} for name, choice in chosen.items()},
        "rows": {f"{room} {rate} fps": _row_values(each) for (room, rate), each in found.items()},
        "margins": {room: _margins(found[room, 1], room) for room in ROOMS},
        "where": _where(found["large", 1]),
        "milliseconds": {room: _stages(found[room, 1], chosen, least) for room in ROOMS},
    }
    pictures = switch_pictures(found["large", 1].sequences, found["large", 1].tracks, seconds, calibration)
    files = {name: cv2.imencode(".jpg", image[:, :, ::-1])[1].tobytes() for name, image in pictures.items()}
    return Outcome(values, _tables(values), files=files, notes=_notes(values))


def _selected(bench: Bench, validation: Sequence[Observed]) -> tuple[float, dict[str, Choice], dict[str, float]]:
    """The lowest score, each row's settings, and their MOTA on the validation rooms."""
    by_name = {row.name: row for row in ROWS}
    trial = by_name["world"]
    least = max(LEAST_SCORES, key=lambda s: select(trial, validation, s)[1])
    chosen, motas = dict[str, Choice](), dict[str, float]()
    for row in bench.watch.over(ROWS, "settings", len(ROWS)):
        if row.like:
            chosen[row.name], motas[row.name] = chosen[row.like], motas[row.like]
        else:
            chosen[row.name], motas[row.name] = select(row, validation, least)
    return least, chosen, motas


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
        }
    return result


def interval(values: Sequence[float]) -> tuple[float, float | None, float | None]:
    """Mean over rooms and the ends of its 95 % interval by Student's t; no ends where there is one room."""
    if len(values) == 1:
        return values[0], None, None
    return intervals.interval(np.asarray(values, dtype=np.float64))


def _shown(found: tuple[float, float | None, float | None], asked: float | None = None) -> str:
    """An `interval` for a table or a note, and the thesis's value beside it."""
    mean, low, high = found
    around = "one room" if low is None or high is None else f"{low:.1f} to {high:.1f}"
    return f"{mean:.1f} ({around}{'' if asked is None else f', asked {asked:g}'})"


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


def _tables(values: Mapping[str, Any]) -> list[Table]:
    tables = []
    for k, (label, rows) in enumerate(values["rows"].items()):
        column = {"large 1 fps": 0, "small 1 fps": 1, "large 15 fps": 2, "small 15 fps": 3}[label]
        lines = []
        for name, row in rows.items():
            paper = f"{PAPER[name][column]:g}" if name in PAPER else ""
            world = "" if row["world_error_median"] is None else f"{row['world_error_median']:.2f}"
            lines.append([name, paper, _shown(interval(row["mota"])), f"{np.mean(row['idf1']):.1f}",
                          f"{np.mean(row['hota']):.1f}", f"{np.mean(row['id_switches']):.0f}", world])  # fmt: skip
        title = f"{'Table 4.3: ' if k == 0 else ''}{label}"
        columns = ("row", "MOTA, thesis", "MOTA", "IDF1", "HOTA", "switches", "world error, m (median)")
        tables.append(Table(title, columns, lines))
    lines = [
        [
            REGIONS[label],
            row["row"],
            row["against"],
            f"{PAPER_GAINS[label]:g}",
            _shown(row["interval"]),
        ]
        for label, row in values["where"].items()
    ]
    tables.append(Table("Table 4.4: points of MOTA gained, large room, 1 fps",
                        ("people", "row", "against", "thesis", "here"), lines))  # fmt: skip
    stages = values["milliseconds"]
    names = [*STAGES, "associate"]
    lines = [
        [n, *(f"{v:g}" for v in PAPER_STAGES.get(n, ("", ""))), *(f"{stages[room][n]:.2f}" for room in ROOMS)]
        if n in PAPER_STAGES else [n, "", "", *(f"{stages[room][n]:.2f}" for room in ROOMS)]
        for n in names
    ]  # fmt: skip
    headings = ("stage", "large, thesis", "small, thesis", "large", "small")
    tables.append(Table("Table 4.5: milliseconds of the processor a frame", headings, lines))
    return tables


def _notes(values: Mapping[str, Any]) -> list[str]:
    seeds = " and ".join(map(str, VALIDATION_SEEDS))
    notes = [f"lowest score {values['least_score']:g}, chosen with all settings on rooms of seeds {seeds}"]
    for room, margins in values["margins"].items():
        asked = margins["asked"]
        for measure in ("mota", "idf1"):
            for label, least in (("best image row", asked[0]), ("DeepSORT", asked[1])):
                gain = margins[f"{measure} over {label}"]
                told = _shown(gain["interval"], least if measure == "mota" else None)
                notes.append(f"{room}: {measure.upper()} of both over {label} ({gain['row']}): {told}")
    return notes
