"""Thesis chapter 4 on generated rooms: Tables 4.3, 4.4 and 4.5, Figures 4.4 and 4.5 (`reproduce omnidirectional`).

Every row gets the same detections, and is scored on the boxes of those that it puts into tracks. Its settings have the
best MOTA on validation rooms, which are not in the tables; the lowest score of a detection is chosen there too, once
for all rows. Pictures, observations, settings and tracks are kept in the store, in parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.room_clip import CAMERAS, Room
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.tracking.fisheye.unrolled import DETECTORS
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.report.overlay import draw_label, track_colour
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.fisheye_rooms import (
    RATE,
    STAGES,
    CeilingClip,
    CeilingModels,
    CpuTimes,
    Observed,
    observe,
    parts_of,
    plan,
    read_observed,
    render,
)
from tsuiseki.trainers.experiments.fisheye_rows import (
    ROWS,
    Clips,
    Graded,
    lowest_score,
    pair_of,
    run_row,
    score,
    select,
    tracked,
    world_errors,
)
from tsuiseki.trainers.experiments.study import (
    Bench,
    Column,
    Name,
    Outcome,
    Table,
    at_least_one,
    tabulated,
    with_interval,
)

ROOMS: tuple[Room, ...] = ("large", "small")
VALIDATION_SEEDS = (900, 901)
Rate = Literal[1, 15]
# MOTA of Table 4.3 at 1 and 15 frames a second: large, small, large, small.
PAPER: dict[str, tuple[float, float, float, float]] = {
    "baseline": (8.4, 51.0, -3.5, 48.7),
    "SORT": (-10.5, 24.5, -1.4, 49.9),
    "DeepSORT": (-4.3, 30.9, 6.0, 52.3),
    "rectification": (10.2, 51.8, -3.4, 48.5),
    "world": (8.1, 53.1, -1.1, 49.7),
    "both": (11.7, 53.3, 6.6, 52.0),
}
LABELS = ("large 1 fps", "small 1 fps", "large 15 fps", "small 15 fps")
# Table 4.5, large and small room.
PAPER_STAGES = {"detect": (18.8, 19.9), "look up": (0.3, 0.4), "describe": (64.4, 46.5), "associate": (2.1, 1.0)}
# Table 4.4; the first two are printed as 0.011 and 0.031, which is shares: the whole gain of that row is 1.8 points.
PAPER_GAINS = {"aligned": 1.1, "oblique": 3.1, "centre": 17.703, "rim": 1.757}
# Where these people are in an image of 1280x960, by the middle of their upright boxes.
REGIONS = {
    "aligned": "aligned, at most 22.5° from the image's axes",
    "oblique": "oblique, the others",
    "centre": "centre, at most 200 px from the image's middle",
    "rim": "rim, 300 to 500 px from it",
}
# Pixels of a picture of a switch, to each side.
SIDE = 320
# Id of the track on a labelled person, by frame and person.
Named = dict[tuple[int, int], int]


@dataclass(frozen=True)
class FloorResults:
    """Everything of one room and rate: the test sequences by seed, and their tracks by row."""

    sequences: dict[int, list[Observed]]
    tracks: dict[str, dict[int, list[list[FloorTrack]]]]


CHOSEN_ON = "all settings have the best MOTA on rooms of seeds 900 and 901"
# A room, its seed, the length of its sequence in seconds and its rate.
Job = tuple[Room, int, int, Rate]


def reproduce(
    bench: Bench,
    seeds: int = 6,
    first_seed: int = 0,
    seconds: int = 60,
    fast_seeds: int = 3,
    fast_seconds: int = 10,
    calibration: Path | None = None,
    detector: Path | None = None,
    appearance: Path | None = None,
    simulated_detections: bool = False,
    full: bool = False,
) -> Outcome:
    """People under ceiling fisheye cameras, at 1 and 15 frames a second: what upright crops and floor places bring.

    DIR gets results.json, tables.md, prevented.jpg and remaining.jpg like Figs. 4.4 and 4.5.

    Args:
        bench: where it works.
        seeds: rooms of each size, two cameras each.
        first_seed: of these rooms.
        seconds: of each sequence at 1 frame a second.
        fast_seeds: of these rooms, tracked at 15 frames a second, too; 0 leaves them out.
        fast_seconds: of each sequence at 15 frames a second.
        calibration: lens of the cameras, any that tsuiseki calibrate convert reads; by default an equidistant one.
        detector: exported detector for unrolled views; by default the shipped one.
        appearance: exported appearance network; by default the shipped one.
        simulated_detections: draw faulty detections from the truth instead of running a detector.
        full: 5 seeds of 180 seconds at both rates, as many frames as the thesis has and more.

    Raises:
        RequestError: a number below 1 (`fast_seeds`: below 0), or a file that cannot be read.
    """
    at_least_one(seeds=seeds, seconds=seconds, fast_seconds=fast_seconds)
    if full:
        seeds, seconds, fast_seeds, fast_seconds = 5, 180, 5, 180
    tested = _tested(first_seed, seeds, fast_seeds)
    found_by = None if simulated_detections else detector or shipped(DETECTORS["unrolled"])
    models = CeilingModels(found_by, appearance or shipped("appearance_people"))
    slow: list[Job] = [(room, seed, seconds, 1) for room in ROOMS for seed in (*VALIDATION_SEEDS, *tested)]
    fast: list[Job] = [(room, seed, fast_seconds, 15) for seed in tested[:fast_seeds] for room in ROOMS]
    folders = _observed(bench, [*slow, *fast], calibration, models)
    chosen, least = _chosen(bench, [p for seed in VALIDATION_SEEDS for room in ROOMS for p in folders[room, seed, 1]])

    scored: list[tuple[Room, Rate]] = [("large", 1), ("small", 1), *((room, 15) for room in ROOMS if fast_seeds)]
    results = [_tracked(bench, _tests(folders, tested, *each), chosen, least) for each in scored]
    large, small = results[:2]
    values: dict[str, Any] = {
        "seeds": seeds,
        "first_seed": first_seed,
        "seconds": seconds,
        "fast_seeds": fast_seeds,
        "fast_seconds": fast_seconds,
        "chosen": {"least_score": least, "rows": {name: asdict(each) for name, each in chosen.items()}},
        "rows": {label: row_values(each) for label, each in zip(LABELS, results, strict=False)},
        "where": where_parts_help(large),
        "milliseconds": _milliseconds((large, small), chosen["both"], least),
    }
    files = _jpegs(switch_pictures(large, seconds, calibration))
    return Outcome(values, tables(values), files=files, notes=[f"{CHOSEN_ON}; lowest score of a detection {least:g}"])


def _tests(
    folders: Mapping[tuple[Room, int, Rate], list[list[Path]]], tested: range, room: Room, rate: Rate
) -> dict[int, list[list[Path]]]:
    """What was observed in the rooms of one size and rate that are scored, by seed."""
    return {s: each for (r, s, k), each in folders.items() if (r, k) == (room, rate) and s in tested}


def _chosen(bench: Bench, validation: Clips) -> tuple[dict[str, Graded], float]:
    """The settings of each row and the lowest score of a detection, chosen on rooms that are not scored."""
    least = lowest_score(bench.store, list(PAPER), validation)
    chosen = dict[str, Graded]()
    for name, row in bench.watch.over(ROWS.items(), "settings", len(ROWS)):
        chosen[name] = chosen[row.like] if row.like else select(bench.store, row, validation, least)
    return chosen, least


def _milliseconds(found: Sequence[FloorResults], both: Graded, least: float) -> dict[str, Any]:
    return {room: stage_milliseconds(each, both, least) for room, each in zip(ROOMS, found, strict=True)}


def _jpegs(pictures: Mapping[str, ImageArray]) -> dict[str, bytes]:
    return {name: cv2.imencode(".jpg", image[:, :, ::-1])[1].tobytes() for name, image in pictures.items()}


def _tested(first: int, seeds: int, fast_seeds: int) -> range:
    """The rooms that are scored, none of which settings were chosen on."""
    if fast_seeds < 0:
        raise RequestError(f"`fast_seeds`: expected 0 or more, got {fast_seeds}")
    tested = range(first, first + seeds)
    if first < 0 or set(tested) & set(VALIDATION_SEEDS):
        raise RequestError(
            f"`first_seed`: expected rooms that settings are not chosen on ({VALIDATION_SEEDS[0]}, "
            f"{VALIDATION_SEEDS[1]}), from 0 on, got {first} to {tested[-1]}"
        )
    return tested


def _observed(
    bench: Bench, jobs: Sequence[Job], calibration: Path | None, models: CeilingModels
) -> dict[tuple[Room, int, Rate], list[list[Path]]]:
    """The observations of each camera of each room, by room, seed and rate."""
    return {
        (room, seed, rate): [
            _observed_folders(bench, CeilingClip(room, seed, camera, length, rate, calibration), models)
            for camera in range(CAMERAS)
        ]
        for room, seed, length, rate in bench.watch.over(jobs, "rooms", len(jobs))
    }


def _observed_folders(bench: Bench, clip: CeilingClip, models: CeilingModels) -> list[Path]:
    """The folders of what was observed in each part of a clip."""
    made = bench.store.made
    return [made("observed", observe, part, made("frames", render, part), models) for part in parts_of(clip)]


def _tracked(
    bench: Bench, tests: Mapping[int, Sequence[Sequence[Path]]], chosen: Mapping[str, Graded], least: float
) -> FloorResults:
    """The tracks of every row in the test rooms, by seed the folders of each camera's parts."""
    tracks: dict[str, dict[int, list[list[FloorTrack]]]] = {name: {} for name in ROWS}
    for seed, each in bench.watch.over(tests.items(), "rooms tracked", len(tests)):
        for name, by_seed in tracks.items():
            choice = chosen[name].choice
            by_seed[seed] = [bench.store.recall(tracked, name, parts, choice, least) for parts in each]
    return FloorResults({seed: [read_observed(parts) for parts in each] for seed, each in tests.items()}, tracks)


def _scores(found: FloorResults, name: str, where: Any = None) -> list[Any]:
    """Scores of a row for each seed; ``where`` keeps some boxes."""
    return [
        score([pair_of(str(k), o, t, where) for k, (o, t) in enumerate(zip(each, found.tracks[name][s], strict=True))])
        for s, each in found.sequences.items()
    ]


def row_values(found: FloorResults) -> dict[str, Any]:
    """The scores of each row by seed, and its world errors over all of them."""
    result = {}
    for name, tracks in found.tracks.items():
        scores = _scores(found, name)
        pairs = [pair for s, each in found.sequences.items() for pair in zip(each, tracks[s], strict=True)]
        errors = np.concatenate([world_errors(*pair) for pair in pairs])
        result[name] = {
            **{k: [100 * getattr(s, k) for s in scores] for k in ("mota", "idf1", "hota", "recall", "precision")},
            "id_switches": [s.id_switches for s in scores],
            "world_error_median": float(np.median(errors)) if len(errors) else None,
            "world_error_mean": float(np.mean(errors)) if len(errors) else None,
            "world_error_90": float(np.percentile(errors, 90)) if len(errors) else None,
        }
    return result


def where_parts_help(found: FloorResults) -> dict[str, Any]:
    """Table 4.4: gains of each part alone, in points of MOTA, by direction and distance from the image's middle."""

    def polar(boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = ((boxes[:, :2] + boxes[:, 2:]) / 2 - [640, 480]).T
        return np.arctan2(y, x), np.hypot(x, y)

    def aligned(boxes: FloatArray) -> BoolArray:
        quarter = np.abs((polar(boxes)[0] + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        return np.asarray(quarter <= np.pi / 8)

    def within(boxes: FloatArray, low: float, high: float) -> BoolArray:
        radius = polar(boxes)[1]
        return np.asarray((radius > low) & (radius <= high))

    cases = (("aligned", aligned, "rectification", "baseline"),
             ("oblique", lambda boxes: ~aligned(boxes), "rectification", "baseline"),
             ("centre", partial(within, low=-1, high=200), "world", "SORT"),
             ("rim", partial(within, low=300, high=500), "world", "SORT"))  # fmt: skip
    result = {}
    for label, where, ours, theirs in cases:
        pairs = zip(_scores(found, ours, where), _scores(found, theirs, where), strict=True)
        gains = [100 * (a.mota - b.mota) for a, b in pairs]
        result[label] = {"row": ours, "against": theirs, "by_seed": gains}
    return result


def stage_milliseconds(found: FloorResults, chosen: Graded, least: float) -> dict[str, float]:
    """Milliseconds a frame of each stage in the first sequence, both parts with the chosen settings."""
    observed = next(iter(found.sequences.values()))[0]
    frames = len(observed.found)
    times = CpuTimes()
    with times.measure("associate"):
        run_row(ROWS["both"], observed, chosen.choice, least)
    result = {stage: 1000 * observed.seconds[stage] / frames for stage in STAGES}
    return {**result, "associate": 1000 * times.seconds["associate"] / frames, "people": observed.persons / frames}


def tables(values: Mapping[str, Any]) -> list[Table]:
    """Tables 4.3, 4.4 and 4.5 beside the thesis's."""
    result = [_people_table(label, LABELS.index(label), rows) for label, rows in values["rows"].items()]
    lines = [
        [REGIONS[label], row["row"], row["against"], f"{PAPER_GAINS[label]:g}",
         with_interval(np.array(row["by_seed"]), ".1f")]
        for label, row in values["where"].items()
    ]  # fmt: skip
    columns = ("people", "row", "against", "thesis", "here")
    result.append(Table("Table 4.4: points of MOTA gained, large room, 1 fps", columns, lines))
    stages = values["milliseconds"]
    lines = [
        [name, *map(str, PAPER_STAGES.get(name, ("", ""))), *(f"{stages[room][name]:.2f}" for room in stages)]
        for name in (*STAGES, "associate")
    ]
    columns = ("stage", "large, thesis", "small, thesis", "large", "small")
    return [*result, Table("Table 4.5: milliseconds of the processor a frame", columns, lines)]


def _people_table(label: str, place: int, rows: Mapping[str, Mapping[str, Any]]) -> Table:
    """Table 4.3 of a room and rate: scores over seeds, and by how much each row is ahead of both parts."""
    names = ("mota", "idf1", "hota", "id_switches")
    found = {name: [dict(zip(names, one, strict=True)) for one in zip(*(row[n] for n in names), strict=True)]
             for name, row in rows.items()}  # fmt: skip
    paper: dict[Name, float] = {name: line[place] for name, line in PAPER.items()}
    columns = (
        Column("MOTA", "mota", ".1f", show=with_interval, paper=paper, gain=with_interval),
        Column("IDF1", "idf1", ".1f", gain=with_interval),
        Column("HOTA", "hota", ".1f"),
        Column("switches", "id_switches", ".0f"),
    )
    table = tabulated(found, columns, ("row",), f"Table 4.3: {label}", "both")
    errors = [[row[f"world_error_{name}"] for name in ("median", "mean", "90")] for row in rows.values()]
    world = ["" if each[0] is None else ", ".join(f"{error:.2f}" for error in each) for each in errors]
    lines = [[*line, cell] for line, cell in zip(table.rows, world, strict=True)]
    return Table(table.title, [*table.columns, "world error, m (median, mean, 90 %)"], lines)


def switch_pictures(found: FloorResults, seconds: int, calibration: Path | None) -> dict[str, ImageArray]:
    """``prevented.jpg``: DeepSORT above, both parts below; ``remaining.jpg`` likewise. Missing where there is none."""
    pictures = {}
    for name, switching, keeping in (("prevented.jpg", "DeepSORT", "both"), ("remaining.jpg", "both", None)):
        for seed, each in found.sequences.items():
            for camera, observed in enumerate(each):
                theirs, ours = (named(observed, found.tracks[row][seed][camera]) for row in ("DeepSORT", "both"))
                spot = first_switch({"DeepSORT": theirs, "both": ours}[switching], ours if keeping else None)
                if spot is not None and name not in pictures:
                    clip = CeilingClip("large", seed, camera, seconds, 1, calibration)
                    pictures[name] = _strip(clip, observed, spot, theirs, ours)
    return pictures


def named(observed: Observed, tracks: Sequence[FloorTrack]) -> Named:
    """The id that tracks give to each labelled person, by frame and person; no box stands for two."""
    found: Named = {}
    for frame in np.unique(observed.truth.frames).tolist():
        rows = np.flatnonzero(observed.truth.frames == frame)
        here = [(t, int(k)) for t in tracks for k in np.flatnonzero(t.track.frames == frame)]
        if not here:
            continue
        overlaps = iou_matrix(observed.truth.boxes[rows], np.array([t.track.boxes[k] for t, k in here]))
        for row, column in zip(*assign_overlaps(overlaps, MATCH_OVERLAP), strict=True):
            found[frame, int(observed.truth.ids[rows[row]])] = here[int(column)][0].track.id
    return found


def first_switch(switching: Named, keeping: Named | None) -> tuple[int, int] | None:
    """Frame and person of a switch between two frames in a row, which ``keeping`` does not have."""
    for frame, person in sorted(switching):
        before = switching.get((frame - 1, person))
        if before is None or before == switching[frame, person] or (frame - 2, person) not in switching:
            continue
        if keeping is None or (
            (frame - 2, person) in keeping
            and len({keeping.get((f, person)) for f in (frame - 2, frame - 1, frame)}) == 1
        ):
            return frame, person
    return None


def _strip(clip: CeilingClip, observed: Observed, spot: tuple[int, int], theirs: Named, ours: Named) -> ImageArray:
    """Three frames up to a switch, DeepSORT's ids above and those of both parts below, cut out around the person."""
    frame, person = spot
    room = plan(clip)
    view = room.view(clip.camera)
    rows: list[list[ImageArray]] = [[], []]
    for at in range(frame - 2, frame + 1):
        image, _ = room.draw_frame(view, at * RATE)
        which = np.flatnonzero(observed.truth.frames == at)
        ids, boxes = observed.truth.ids[which], observed.truth.boxes[which]
        for row, named in zip(rows, (theirs, ours), strict=True):
            row.append(_drawn(image, ids.tolist(), boxes, named, at, person))
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


def _drawn(image: ImageArray, ids: list[int], boxes: FloatArray, named: Named, frame: int, person: int) -> ImageArray:
    drawn = image.copy()
    centre = np.array([image.shape[1], image.shape[0]]) / 2
    for number, box in zip(ids, boxes, strict=True):
        identity = named.get((frame, number))
        colour = (128, 128, 128) if identity is None else track_colour(identity)
        x1, y1, x2, y2 = np.round(box).astype(int).tolist()
        cv2.rectangle(drawn, (x1, y1), (x2, y2), colour, 2, cv2.LINE_AA)
        draw_label(drawn, "missed" if identity is None else str(identity), (x1, y1 - 2), colour)
        if number == person:
            centre = (box[:2] + box[2:]) / 2
            size = int(0.6 * max(x2 - x1, y2 - y1)) + 8
            cv2.circle(drawn, tuple(np.round(centre).astype(int).tolist()), size, (255, 255, 255), 2, cv2.LINE_AA)
    low = np.clip(np.round(centre - SIDE / 2), 0, [image.shape[1] - SIDE, image.shape[0] - SIDE]).astype(int)
    part = drawn[low[1] : low[1] + SIDE, low[0] : low[0] + SIDE]
    draw_label(part, f"#{frame + 1}", (4, SIDE - 4), (60, 60, 60))
    return np.ascontiguousarray(part)
