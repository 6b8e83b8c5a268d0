"""Counts, occupancy and stays against the truth of generated streets and labelled video (`reproduce answers`)."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetSettings
from tsuiseki.tracking.answers.counting import Answers, count
from tsuiseki.tracking.answers.scene import Scene
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.people.tracking import track_people
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.experiments.answers_streets import (
    Finding,
    TrueAnswers,
    dithering_people,
    found_boxes,
    plan_boxes,
    scene_in,
    true_answers,
)
from tsuiseki.trainers.experiments.given_sequences import GivenSequence, find_sets, given_detections, given_labels
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.study import (
    Bench,
    Column,
    Outcome,
    Study,
    Table,
    at_least_one,
    median_only,
    tabulated,
    values_of,
)

PROGRAM = Path(__file__).with_name("answers_peers.py")
PACKAGE = "the packages supervision and trackers"
FIRST_SEED = 1000
"""Of the streets; smaller seeds, and those from 1100 on, fitted the intervals."""
FINDINGS = {
    "all boxes": Finding(),
    "boxes of the visible": Finding(hidden=0.3),
    "a good detector": Finding(0.08, 0.3, 0.03, 0.2),
    "a poor detector": Finding(0.25, 0.5, 0.06, 0.6),
}


@dataclass(frozen=True)
class Way:
    """A way to count.

    Attributes:
        peer: that counts, over our tracks or its own; None is ours.
        own_tracks: the peer tracks, too.
        corners: all corners of a box must cross for the peer, as is its default; or the middle of the lower edge.
    """

    peer: Peer | None = None
    own_tracks: bool = False
    corners: bool = False


@dataclass(frozen=True)
class StreetUnit:
    """A generated street as a detector sees it.

    Attributes:
        seed: of the street.
        finding: what the detector makes of it.
        frames: its length.
    """

    seed: int
    finding: Finding
    frames: int


@dataclass(frozen=True)
class Counted:
    """How far the answers of one way are from the truth of one video.

    Attributes:
        errors: absolute, of each line and direction.
        true: crossings of each.
        covered: 1 where the interval of 90 % holds the true number, likewise; NaN without intervals.
        occupancy: mean absolute error over frames, people.
        people: mean true occupancy.
        dwell: absolute error of the mean stay, seconds.
    """

    errors: tuple[float, ...]
    true: tuple[float, ...]
    covered: tuple[float, ...]
    occupancy: float
    people: float
    dwell: float


def reproduce(
    bench: Bench, data: Path = Path("../shared/data"), streets: int = 20, frames: int = 750, peer: str | None = None
) -> Outcome:
    """Crossings, occupancy and stays on generated streets and labelled video, beside supervision's zones.

    The lines and the zone are the same shares of every picture. DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half; without it only the streets are counted.
        streets: number of generated streets, each with all true boxes, with those of who is visible, and with those of
            a good and a poor detector; and of lines on which people dither.
        frames: length of a street.
        peer: python of an environment with the packages supervision and trackers; by default this one, if it has them.

    Raises:
        RequestError: a number below 1, or a python without the packages.
    """
    at_least_one(streets=streets, frames=frames)
    environment = find_peer(peer, PROGRAM, PACKAGE)
    rows = {"ours": Way()}
    if environment is not None:
        rows |= {
            "LineZone, PolygonZone on our tracks": Way(environment),
            "on its ByteTrack": Way(environment, own_tracks=True),
            "on its ByteTrack, all corners": Way(environment, own_tracks=True, corners=True),
        }
    tables, values, notes = [], {}, []
    seeds = [FIRST_SEED + number for number in range(streets)]
    for name, finding in FINDINGS.items():
        units = [StreetUnit(seed, finding, frames) for seed in seeds]
        found = Study(rows, units, measure_street, name).run(bench)
        tables.append(_table(found, f"{streets} streets, {name}"))
        values[name] = values_of(found)
    found = Study(rows, seeds, measure_dithering, "dithering people").run(bench)
    tables.append(_table(found, f"{streets} lines on which people dither"))
    values["dithering"] = values_of(found)
    sequences = [one for some in find_sets(data, ["mot17"]).values() for one in some] if data.is_dir() else []
    if sequences:
        found = Study(rows, sequences, measure_labelled, "labelled video").run(bench)
        tables.append(_table(found, "MOT17 val-half, given detections"))
        values["mot17"] = values_of(found)
    else:
        notes.append("MOT17 val-half: not in the data, passed over")
    if environment is None:
        notes.append(f"peers: skipped, {PACKAGE} are not installed here; name a python that has them as peer")
    return Outcome(values, tables, notes=notes)


def _table(found: dict[str, list[Counted]], title: str) -> Table:
    columns = [
        Column("median error of a line", lambda one: np.array(one.errors), ".1f", show=median_only),
        Column("mean", lambda one: np.array(one.errors)),
        Column("of its crossings, %", "people"),
        Column("occupancy", "occupancy", ".3f"),
        Column("dwell, s", "dwell"),
        Column("intervals that hold, %", lambda one: np.array(one.covered), ".0f", 100),
    ]
    table = tabulated(found, columns, ("counted by",), title)
    # The share of all crossings together: a street without any has none of its own.
    shares = {
        name: 100 * sum(sum(one.errors) for one in all_) / max(sum(sum(one.true) for one in all_), 1)
        for name, all_ in found.items()
    }
    return replace(table, rows=[[*row[:3], f"{shares[row[0]]:.1f}", *row[4:]] for row in table.rows])


@dataclass(frozen=True, eq=False)
class _Case:
    """A video with its truth.

    Attributes:
        detections: of each frame.
        tracks: ours over them.
        scene: of the video.
        truth: the answers.
        rate: frames a second.
    """

    detections: Sequence[Detections]
    tracks: Sequence[Track]
    scene: Scene
    truth: TrueAnswers
    rate: float


def measure_street(way: Way, unit: StreetUnit) -> Counted:
    """The answers on a generated street."""
    return _measured(way, _street(unit))


def measure_dithering(way: Way, seed: int) -> Counted:
    """The answers on people who go to and fro on a line, by their true tracks."""
    return _measured(way, _dithering(seed))


def measure_labelled(way: Way, given: GivenSequence) -> Counted:
    """The answers on labelled video, from its given detections."""
    return _measured(way, _labelled(given))


@lru_cache(maxsize=1)
def _street(unit: StreetUnit) -> _Case:
    crowd = 6 + unit.seed % 12
    street = plan_boxes(StreetSettings(frames=unit.frames, people=crowd, occluders=0, samples=1), unit.seed)
    scene, rate = scene_in(street.size), street.frame_rate
    truth = true_answers(street.tracks, scene, street.length, rate)
    detections = found_boxes(street, unit.finding, unit.seed)
    return _Case(detections, _tracked(detections, scene, rate), scene, truth, rate)


@lru_cache(maxsize=1)
def _dithering(seed: int) -> _Case:
    size, rate = (640, 480), 25.0
    tracks, scene = dithering_people(seed, size), scene_in(size)
    length = len(tracks[0])
    detections = [Detections(np.array([t.boxes[k] for t in tracks]), np.ones(len(tracks))) for k in range(length)]
    return _Case(detections, tracks, scene, true_answers(tracks, scene, length, rate), rate)


@lru_cache(maxsize=1)
def _labelled(given: GivenSequence) -> _Case:
    labels = given_labels(given)
    labels = labels.select(labels.evaluated)
    tracks = [
        Track(int(number), labels.frames[own], labels.boxes[own], np.ones(int(own.sum())))
        for number in np.unique(labels.ids)
        for own in [labels.ids == number]
    ]
    scene, detections = scene_in(given.size), given_detections(given)
    truth = true_answers(tracks, scene, len(detections), given.rate)
    return _Case(detections, _tracked(detections, scene, given.rate), scene, truth, given.rate)


def _measured(way: Way, case: _Case) -> Counted:
    scene, truth, length = case.scene, case.truth, len(case.detections)
    true = [float(n) for line in scene.lines for n in truth.crossings[line.name].values()]
    if way.peer is None:
        found = count(Result(case.tracks, "", case.rate, scene.size, frames={"frame": range(length)}), scene)
        table = found.tables["lines"]
        numbers, occupancy, dwell = table["count"], found.occupancy[scene.zones[0].name], _mean_stay(found)
        covered = [float(a <= n <= b) for a, n, b in zip(table["low"], true, table["high"], strict=True)]
    else:
        told = way.peer.answer(PROGRAM, _job(way, case))
        numbers = [n for both in told["crossings"] for n in both]
        occupancy, dwell, covered = np.array(told["occupancy"]), told["dwell"], [float("nan")] * len(true)
    return Counted(
        tuple(abs(a - b) for a, b in zip(numbers, true, strict=True)),
        tuple(true),
        tuple(covered),
        float(np.abs(np.asarray(occupancy) - truth.occupancy).mean()),
        float(np.mean(truth.occupancy)),
        abs(dwell - truth.dwell),
    )


def _mean_stay(found: Answers) -> float:
    """Mean seconds in the zone over all who were in it."""
    seconds = dict[int, float]()
    for who, stay in zip(found.tables["stays"]["id"], found.tables["stays"]["seconds"], strict=True):
        seconds[who] = seconds.get(who, 0.0) + stay
    return float(np.mean(list(seconds.values()))) if seconds else 0.0


def _tracked(detections: Sequence[Detections], scene: Scene, rate: float) -> list[Track]:
    """Our tracks over given boxes."""
    assert scene.size is not None
    with tempfile.TemporaryDirectory() as folder:
        write_sequence_info(Path(folder), "given", rate, len(detections), *scene.size)
        return list(track_people(folder, "flow", detections=detections))


def _job(way: Way, case: _Case) -> dict[str, Any]:
    if way.own_tracks:
        parts = [
            np.column_stack([np.full(len(d), frame), np.full(len(d), -1), d.boxes, d.scores])
            for frame, d in enumerate(case.detections)
        ]
    else:
        parts = [np.column_stack([t.frames, np.full(len(t), t.id), t.boxes, t.scores]) for t in case.tracks]
    rows = np.concatenate([np.empty((0, 7)), *parts])
    return {
        "rows": rows[np.argsort(rows[:, 0], kind="stable")].tolist(),
        "track": way.own_tracks,
        "corners": way.corners,
        "lines": [line.ends.tolist() for line in case.scene.lines],
        "zone": case.scene.zones[0].corners.tolist(),
        "length": len(case.detections),
        "rate": case.rate,
    }
