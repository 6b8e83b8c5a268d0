"""Thesis chapter 4 on generated rooms: Tables 4.3, 4.4 and 4.5, Figures 4.4 and 4.5 (`reproduce omnidirectional`).

Every row gets the same detections, and is scored on the boxes of those that it puts into tracks. Its settings are the
ones of the best MOTA, or of the best mean of MOTA and IDF1, on validation rooms, which are not in the tables; the
lowest score of a detection is chosen there too, once for all rows. Two more rows show what the boxes of SORT's and
DeepSORT's Kalman filters cost.

Pictures, what networks say of them, settings and tracks are kept in the result store, in parts: a run that was stopped
goes on, and other rooms take the settings that a run before them has chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2

from tsuiseki.datamodules.scenes.room_clip import CAMERAS, Room
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, CeilingLook
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, at_least_one
from tsuiseki.trainers.experiments.fisheye.measures import (
    Found,
    detections_found,
    differences,
    margins,
    row_values,
    stage_milliseconds,
    where_parts_help,
)
from tsuiseki.trainers.experiments.fisheye.observations import Networks, Observed, observe, read_observed
from tsuiseki.trainers.experiments.fisheye.pictures import switch_pictures
from tsuiseki.trainers.experiments.fisheye.rendered import Sequence as Clip
from tsuiseki.trainers.experiments.fisheye.rendered import frames_of, parts_of, render
from tsuiseki.trainers.experiments.fisheye.rows import ROWS
from tsuiseki.trainers.experiments.fisheye.selection import RULES, Graded, Rule, lowest_score, select, tracked
from tsuiseki.trainers.experiments.fisheye.tables import PAPER, notes, tables

ROOMS: tuple[Room, ...] = ("large", "small")
VALIDATION_SEEDS = (900, 901)
Rate = Literal[1, 15]
# Of one core for a picture that is rendered, looked at and described; measured on a machine of 2026.
PICTURE_SECONDS = 0.26


@dataclass(frozen=True)
class _Seen:
    """The cameras of one room at one rate: the folders of each camera's parts, and what is in them."""

    folders: list[list[Path]]
    observed: list[Observed]


@dataclass(frozen=True)
class _Settings:
    """The lowest score of a detection, and the settings of each row."""

    least: float
    rows: dict[str, Graded]


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
    chosen_by: Rule = "mota",
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
        chosen_by: the score of the validation rooms that settings are chosen by: MOTA, or the mean of MOTA and IDF1.
            Scores at 1 frame a second are told for both.
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

    jobs: list[tuple[Room, int, int, Rate]] = [
        (room, seed, seconds, 1) for room in ROOMS for seed in (*VALIDATION_SEEDS, *tested)
    ]
    jobs += [(room, seed, fast_seconds, 15) for seed in tested[:fast_seeds] for room in ROOMS]

    def clips_of(room: Room, seed: int, length: int, rate: Rate) -> list[Clip]:
        return [Clip(room, seed, camera, length, rate, calibration) for camera in range(CAMERAS)]

    _tell_time(bench, [part for job in jobs for clip in clips_of(*job) for part in parts_of(clip)], networks)

    def looked(part: Clip) -> Path:
        return bench.store.made("observed", observe, part, bench.store.made("frames", render, part), networks)

    def seen(room: Room, seed: int, length: int, rate: Rate) -> _Seen:
        folders = [[looked(part) for part in parts_of(clip)] for clip in clips_of(room, seed, length, rate)]
        return _Seen(folders, [read_observed(parts) for parts in folders])

    rooms = {(room, seed, rate): seen(room, seed, length, rate)
             for room, seed, length, rate in bench.watch.over(jobs, "rooms", len(jobs))}  # fmt: skip
    validation = [parts for seed in VALIDATION_SEEDS for room in ROOMS for parts in rooms[room, seed, 1].folders]
    settings = {rule: _selected(bench, validation, rule) for rule in RULES}
    chosen = settings[chosen_by]

    def found(room: Room, rate: Rate, rule: Rule) -> Found:
        tests = {s: each for (r, s, k), each in rooms.items() if (r, k) == (room, rate) and s not in VALIDATION_SEEDS}
        return _tracked(bench, tests, settings[rule])

    slow = {(room, rule): found(room, 1, rule) for rule in RULES for room in ROOMS}
    large, small = (slow[room, chosen_by] for room in ROOMS)
    fast = {room: found(room, 15, chosen_by) for room in ROOMS if fast_seeds > 0}
    by_rule = {rule: {room: row_values(slow[room, rule]) for room in ROOMS} for rule in RULES}
    rows = {f"{room} 1 fps": by_rule[chosen_by][room] for room in ROOMS}
    values: dict[str, Any] = {
        "seeds": seeds,
        "first_seed": first_seed,
        "validation_seeds": list(VALIDATION_SEEDS),
        "seconds": seconds,
        "fast_seeds": fast_seeds,
        "fast_seconds": fast_seconds,
        "chosen_by": chosen_by,
        "chosen": {rule: _chosen_values(each) for rule, each in settings.items()},
        "rows": rows | {f"{room} 15 fps": row_values(each) for room, each in fast.items()},
        "rows_by_rule": by_rule,
        "margins": {rule: {room: margins(each[room], room) for room in ROOMS} for rule, each in by_rule.items()},
        "differences": {room: differences(by_rule[chosen_by][room]) for room in ROOMS},
        "where": where_parts_help(large),
        "detector": {
            room: detections_found(each, room, calibration, chosen.least)
            for room, each in zip(ROOMS, (large, small), strict=True)
        },
        "milliseconds": {
            room: stage_milliseconds(each, chosen.rows["both"].choice, chosen.least)
            for room, each in zip(ROOMS, (large, small), strict=True)
        },
    }
    pictures = switch_pictures(large.sequences, large.tracks, seconds, calibration)
    files = {name: cv2.imencode(".jpg", image[:, :, ::-1])[1].tobytes() for name, image in pictures.items()}
    return Outcome(values, tables(values), files=files, notes=notes(values))


def _tell_time(bench: Bench, parts: Sequence[Clip], networks: Networks) -> None:
    """Say how long the pictures take that are not in the store yet."""

    def there(part: Clip) -> bool:
        if not bench.store.has_made("frames", render, part):
            return False
        return bench.store.has_made("observed", observe, part, bench.store.made("frames", render, part), networks)

    pictures = sum(len(frames_of(part)) for part in parts if not there(part))
    if pictures:
        minutes = pictures * PICTURE_SECONDS / 60
        bench.watch.say(
            f"{pictures} pictures to be rendered and looked at, about {minutes:.0f} minutes of one core; what is done "
            "is kept, and the same command goes on"
        )


def _selected(bench: Bench, validation: Sequence[Sequence[Path]], rule: Rule) -> _Settings:
    """The lowest score and each row's settings, from the store where an earlier run chose them."""
    least = lowest_score(bench.store, list(PAPER), validation, rule)
    chosen = dict[str, Graded]()
    for row in bench.watch.over(ROWS, f"settings by {rule}", len(ROWS)):
        if row.like:
            chosen[row.name] = chosen[row.like]
        else:
            chosen[row.name] = select(bench.store, row, validation, least, rule)
    return _Settings(least, chosen)


def _tracked(bench: Bench, tests: dict[int, _Seen], settings: _Settings) -> Found:
    """The tracks of every row in the test rooms; rows whose crops were not taken at that rate are left out."""
    rows = [row for row in ROWS if all(row.crops in (*o.features, "none") for s in tests.values() for o in s.observed)]
    tracks: dict[str, dict[int, list[Any]]] = {row.name: {} for row in rows}
    for seed, seen in bench.watch.over(tests.items(), "rooms tracked", len(tests)):
        for row in rows:
            choice = settings.rows[row.name].choice
            tracks[row.name][seed] = [
                bench.store.recall(tracked, row.name, parts, choice, settings.least) for parts in seen.folders
            ]
    return Found({seed: seen.observed for seed, seen in tests.items()}, tracks)


def _chosen_values(settings: _Settings) -> dict[str, Any]:
    rows = {
        name: {"settings": each.choice, "validation_mota": each.mota, "validation_idf1": each.idf1}
        for name, each in settings.rows.items()
    }
    return {"least_score": settings.least, "rows": rows}
