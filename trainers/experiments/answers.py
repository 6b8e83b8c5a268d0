"""Counts, occupancy and stays against the truth of generated streets and labelled video (`reproduce answers`)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings, plan_street
from tsuiseki.tracking.answers.counting import Answers, count
from tsuiseki.tracking.answers.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track
from tsuiseki.trainers.experiments import given_sequences, study
from tsuiseki.trainers.experiments.given_sequences import GivenSequence
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.study import Bench, Column, Outcome, Study, Table

PROGRAM = Path(__file__).with_name("answers_peers.py")
PACKAGE = "the packages supervision and trackers"
FIRST_SEED = 1000
"""Of the streets; smaller seeds, and those from 1100 on, fitted the intervals."""
WIDE = 0.4
"""Width of a person's box, in heights."""


@dataclass(frozen=True)
class Finding:
    """What a simulated detector makes of true boxes.

    Attributes:
        missed: share of visible boxes that it misses.
        hidden: visible share of a box below which it is missed.
        noise: of a box's sides, in heights.
        false: false boxes a frame.
    """

    missed: float = 0.0
    hidden: float = 0.0
    noise: float = 0.0
    false: float = 0.0


FINDINGS = {
    "all boxes": Finding(),
    "boxes of the visible": Finding(hidden=0.3),
    "a good detector": Finding(0.08, 0.3, 0.03, 0.2),
    "a poor detector": Finding(0.25, 0.5, 0.06, 0.6),
}


@dataclass(frozen=True)
class CountedBy:
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
        seconds: likewise, of the people in the zone in each second.
        means: likewise, of the mean number of people there, and of the mean stay.
        occupancy: mean absolute error over frames, people.
        people: mean true occupancy.
        dwell: absolute error of the mean stay, seconds.
    """

    errors: tuple[float, ...]
    true: tuple[float, ...]
    covered: tuple[float, ...]
    seconds: tuple[float, ...]
    means: tuple[float, ...]
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
    study.at_least_one(streets=streets, frames=frames)
    environment = find_peer(peer, PROGRAM, PACKAGE)
    rows = {"ours": CountedBy()}
    if environment is not None:
        rows |= {
            "LineZone, PolygonZone on our tracks": CountedBy(environment),
            "on its ByteTrack": CountedBy(environment, own_tracks=True),
            "on its ByteTrack, all corners": CountedBy(environment, own_tracks=True, corners=True),
        }
    seeds = [FIRST_SEED + number for number in range(streets)]
    videos: dict[str, tuple[str, Sequence[Any]]] = {
        name: (f"{streets} streets, {name}", [StreetUnit(seed, finding, frames) for seed in seeds])
        for name, finding in FINDINGS.items()
    }
    videos["dithering"] = (f"{streets} lines on which people dither", seeds)
    sets = given_sequences.find_sets(data, ["mot17"]).values() if data.is_dir() else ()
    if sequences := [one for some in sets for one in some]:
        videos["mot17"] = ("MOT17 val-half, given detections", sequences)
    notes = [] if sequences else ["MOT17 val-half: not in the data, passed over"]
    found = {name: Study(rows, units, measure, title).run(bench) for name, (title, units) in videos.items()}
    tables = [_table(of, videos[name][0]) for name, of in found.items()]
    if environment is None:
        notes.append(f"peers: skipped, {PACKAGE} are not installed here; name a python that has them as peer")
    return Outcome({name: study.values_of(of) for name, of in found.items()}, tables, notes=notes)


def _table(found: dict[str, list[Counted]], title: str) -> Table:
    columns = [
        Column("median error of a line", lambda one: np.array(one.errors), ".1f", show=study.median_only),
        Column("mean", lambda one: np.array(one.errors)),
        # The share of all crossings together: a street without any has none of its own.
        Column("of its crossings, %", lambda one: [sum(one.errors), sum(one.true)], ".1f", show=study.share_of_all),
        Column("occupancy", "occupancy", ".3f"),
        Column("dwell, s", "dwell"),
        Column("intervals of crossings that hold, %", lambda one: np.array(one.covered), ".0f", 100),
        Column("of people in a second", lambda one: np.array(one.seconds), ".0f", 100),
        Column("of mean people", lambda one: np.array(one.means[0]), ".0f", 100),
        Column("of the mean stay", lambda one: np.array(one.means[1]), ".0f", 100),
    ]
    return study.tabulated(found, columns, ("counted by",), title)


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


@lru_cache(maxsize=1)
def _case(unit: StreetUnit | GivenSequence | int) -> _Case:
    """A generated street; labelled video with its given detections; people who dither by their true tracks."""
    if isinstance(unit, int):
        size, rate = (640, 480), 25.0
        tracks = dithering_people(unit, size)
        length = len(tracks[0])
        found = [Detections(np.array([t.boxes[k] for t in tracks]), np.ones(len(tracks))) for k in range(length)]
    elif isinstance(unit, StreetUnit):
        crowd = 6 + unit.seed % 12
        settings = StreetSettings(frames=unit.frames, people=crowd, occluders=0, samples=1)
        size, rate = (settings.width, settings.height), settings.frame_rate
        tracks = plan_boxes(settings, unit.seed)
        found = simulated_boxes(tracks, unit.frames, unit.finding, unit.seed)
    else:
        size, rate, found = unit.size, unit.rate, given_sequences.given_detections(unit)
        labels = given_sequences.given_labels(unit)
        labels = labels.select(labels.evaluated)
        tracks = [
            Track(int(number), labels.frames[own], labels.boxes[own], np.ones(int(own.sum())))
            for number in np.unique(labels.ids)
            for own in [labels.ids == number]
        ]
    scene = scene_in(size)
    ours = tracks if isinstance(unit, int) else given_sequences.tracks_over(found, rate, size)
    return _Case(found, ours, scene, true_answers(tracks, scene, len(found), rate), rate)


def measure(way: CountedBy, unit: StreetUnit | GivenSequence | int) -> Counted:
    """The answers on one video."""
    case = _case(unit)
    scene, truth, length = case.scene, case.truth, len(case.detections)
    true = [float(n) for line in scene.lines for n in truth.crossings[line.name].values()]
    if way.peer is None:
        found = count(Result(case.tracks, "", case.rate, scene.size, frames={"frame": range(length)}), scene)
        table = found.tables["lines"]
        numbers, occupancy, dwell = table["count"], found.occupancy[scene.zones[0].name], _mean_stay(found)
        covered = _held(table["low"], true, table["high"])
        each, zone, n = found.tables["occupancy"], found.tables["zones"], np.array(truth.occupancy)
        edges = np.rint(np.array(each["time"]) * case.rate).astype(np.int64)
        seconds = _held(each["low"], np.add.reduceat(n, edges) / np.diff(np.append(edges, length)), each["high"])
        both = {"people": float(n.mean()), "stay": truth.stay}
        means = [_held(zone[f"{name}_low"], [value], zone[f"{name}_high"])[0] for name, value in both.items()]
    else:
        reply = way.peer.answer(PROGRAM, _job(way, case))
        numbers = [n for both in reply["crossings"] for n in both]
        occupancy, dwell, covered = np.array(reply["occupancy"]), reply["dwell"], [float("nan")] * len(true)
        seconds, means = [float("nan")], [float("nan")] * 2
    return Counted(
        tuple(abs(a - b) for a, b in zip(numbers, true, strict=True)),
        tuple(true),
        tuple(covered),
        tuple(seconds),
        tuple(means),
        float(np.abs(np.asarray(occupancy) - truth.occupancy).mean()),
        float(np.mean(truth.occupancy)),
        abs(dwell - truth.dwell),
    )


def _held(low: Sequence[float], true: Iterable[float], high: Sequence[float]) -> list[float]:
    """1 for each interval that holds its true number to three digits, else 0."""
    return [float(a - 5e-4 <= n <= b + 5e-4) for a, n, b in zip(low, true, high, strict=True)]


def _mean_stay(found: Answers) -> float:
    """Mean seconds in the zone over all who were in it."""
    seconds = dict[int, float]()
    for who, stay in zip(found.tables["stays"]["id"], found.tables["stays"]["seconds"], strict=True):
        seconds[who] = seconds.get(who, 0.0) + stay
    return float(np.mean(list(seconds.values()))) if seconds else 0.0


def _job(way: CountedBy, case: _Case) -> dict[str, Any]:
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


def plan_boxes(settings: StreetSettings, seed: int) -> list[Track]:
    """The boxes of everybody in a planned street, who are at least half in the picture."""
    clip = plan_street(settings, seed)
    size = (settings.width, settings.height)
    tracks = []
    for number, walker in enumerate(clip.walkers):
        boxes, ahead = _boxes(clip, walker.positions, walker.person.build.height)
        frames = walker.first + np.arange(len(boxes))
        middle = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        there = ahead & (middle >= 0).all(axis=1) & (middle < size).all(axis=1)
        there &= (frames >= 0) & (frames < settings.frames)
        if there.any():
            tracks.append(Track(number + 1, frames[there], boxes[there], np.ones(int(there.sum()))))
    return tracks


def _boxes(clip: StreetClip, places: FloatArray, height: float) -> tuple[FloatArray, BoolArray]:
    """``(T, 4)`` boxes of a person at ``(T, 2)`` places, and which are before the camera."""
    feet, depth = clip.camera.project(np.insert(places, 2, 0.0, axis=1))
    heads, _ = clip.camera.project(np.insert(places, 2, height, axis=1))
    tall = np.maximum(feet[:, 1] - heads[:, 1], 1.0)
    half = 0.5 * WIDE * tall
    return np.column_stack([feet[:, 0] - half, feet[:, 1] - tall, feet[:, 0] + half, feet[:, 1]]), depth > 0.5


def _visible(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """Share of each box that no box of a nearer person covers, by 8 x 8 points of it."""
    shares = np.ones(len(boxes))
    grid = (np.arange(8) + 0.5) / 8
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        own = boxes[here]
        x = own[:, 0, None] + grid * (own[:, 2] - own[:, 0])[:, None]
        y = own[:, 1, None] + grid * (own[:, 3] - own[:, 1])[:, None]
        across = (x[:, None] > own[None, :, 0, None]) & (x[:, None] < own[None, :, 2, None])
        down = (y[:, None] > own[None, :, 1, None]) & (y[:, None] < own[None, :, 3, None])
        nearer = own[None, :, 3] > own[:, None, 3]
        covered = ((across & nearer[..., None])[..., None, :] & down[..., None]).any(axis=1)
        shares[here] = 1 - covered.mean(axis=(1, 2))
    return shares


def simulated_boxes(tracks: Sequence[Track], length: int, finding: Finding, seed: int) -> list[Detections]:
    """What a detector finds in each of so many frames; who is less visible scores less."""
    rng = np.random.default_rng([seed, 7])
    frames = np.concatenate([track.frames for track in tracks])
    boxes = np.concatenate([track.boxes for track in tracks])
    visible = _visible(frames, boxes)
    kept = (visible >= finding.hidden) & (rng.random(len(frames)) >= finding.missed * (2 - visible))
    frames, boxes, visible = frames[kept], boxes[kept], visible[kept]
    tall = boxes[:, 3] - boxes[:, 1]
    boxes = boxes + finding.noise * tall[:, None] * rng.normal(size=boxes.shape) * [0.4, 1, 0.4, 1]
    scores = np.clip(0.5 + 0.45 * visible + 0.1 * finding.noise * rng.normal(size=len(boxes)), 0.05, 0.99)
    count = rng.poisson(finding.false, length)
    some = rng.integers(len(boxes), size=int(count.sum()))
    moved = boxes[some] + np.tile(rng.uniform(-200, 200, (len(some), 2)), 2)
    frames = np.append(frames, np.repeat(np.arange(length), count))
    boxes, scores = np.vstack([boxes, moved]), np.append(scores, rng.uniform(0.1, 0.6, len(some)))
    order = np.argsort(frames, kind="stable")
    edges = np.searchsorted(frames[order], np.arange(length + 1))
    good = (boxes[:, 2] > boxes[:, 0] + 1) & (boxes[:, 3] > boxes[:, 1] + 1)
    parts = [order[a:b][good[order[a:b]]] for a, b in pairwise(edges)]
    return [Detections(boxes[part], scores[part]) for part in parts]


def scene_in(size: tuple[int, int]) -> Scene:
    """Two lines and a zone, the same shares of every picture: they are not tuned on the counts."""
    w, h = size

    def at(*places: tuple[float, float]) -> FloatArray:
        return np.array(places) * [w, h]

    lines = [SceneLine("upright", at((0.4, 0.2), (0.4, 1.0))), SceneLine("level", at((0.05, 0.65), (0.95, 0.65)))]
    return Scene(lines, [SceneZone("middle", at((0.45, 0.4), (0.85, 0.4), (0.85, 0.9), (0.45, 0.9)))], size)


@dataclass(frozen=True)
class TrueAnswers:
    """What is true of a street.

    Attributes:
        crossings: number by line and direction.
        occupancy: people in the zone in each frame.
        dwell: mean seconds in the zone, over all who stayed there, see `true_stays`; 0 where none did.
        stay: mean seconds of a stay, likewise.
    """

    crossings: dict[str, dict[str, int]]
    occupancy: list[int]
    dwell: float
    stay: float


DITHER = 0.2
"""Heights from a line or border within which going to and fro is no crossing."""


def dithering_people(seed: int, size: tuple[int, int] = (640, 480), people: int = 20, frames: int = 600) -> list[Track]:
    """People who come up to the line ``level`` of `scene_in`, go to and fro on it for most of the time, and go on.

    Every other one turns back. What they sway and what a detector errs stays within `DITHER` of the line.
    """
    rng, height, line = np.random.default_rng([seed, 11]), 80.0, 0.65 * size[1]
    come, rest = 60, frames - 120
    tracks = []
    for number in range(people):
        sway = 0.6 * DITHER * height * np.sin(np.arange(rest) / rng.uniform(5, 25) + rng.uniform(0, 6))
        sway += np.clip(rng.normal(0, 0.1 * DITHER * height, rest), -0.3 * DITHER * height, 0.3 * DITHER * height)
        away = 90.0 if number % 2 else -90.0
        y = line + np.concatenate([np.linspace(-90, 0, come), sway, np.linspace(0, away, come)])
        x = (0.08 + 0.84 * (number + 0.5) / people) * size[0] + np.zeros(frames)
        half = 0.15 * height
        tracks.append(
            Track(number + 1, np.arange(frames), np.column_stack([x - half, y - height, x + half, y]), np.ones(frames))
        )
    return tracks


def true_answers(tracks: list[Track], scene: Scene, length: int, frame_rate: float) -> TrueAnswers:
    """The answers by true boxes, one step after the other."""
    counts = {line.name: dict.fromkeys(line.directions, 0) for line in scene.lines}
    occupancy, stays = np.zeros(length, dtype=np.int64), list[list[float]]()
    (x1, y1), (x2, y2) = scene.zones[0].corners.min(axis=0), scene.zones[0].corners.max(axis=0)
    for track in tracks:
        feet = np.column_stack([0.5 * (track.boxes[:, 0] + track.boxes[:, 2]), track.boxes[:, 3]])
        within = (feet[:, 0] > x1) & (feet[:, 0] < x2) & (feet[:, 1] > y1) & (feet[:, 1] < y2)
        occupancy[track.frames[within]] += 1
        heights = track.boxes[:, 3] - track.boxes[:, 1]
        own = true_stays(np.column_stack([feet - [x1, y1], [x2, y2] - feet]).min(axis=1), heights)
        stays += [[(last - first + 1) / frame_rate for first, last in own]] if own else []
        for line in scene.lines:
            for _, side in true_crossings(feet, heights, line.ends):
                counts[line.name][line.directions[0 if side > 0 else 1]] += 1
    dwell, stay = (
        float(np.mean(some)) if stays else 0.0
        for some in ([sum(own) for own in stays], [one for own in stays for one in own])
    )
    return TrueAnswers(counts, occupancy.tolist(), dwell, stay)


def true_stays(depths: FloatArray, heights: FloatArray) -> list[tuple[int, int]]:
    """First and last row of each stay of a way in a zone.

    Somebody is in the zone, or has left it, once they are further than `DITHER` from its border; a visit that gets no
    further is none, and where a way begins or ends its side counts at any distance. The definition of `tsuiseki.count`.

    Args:
        depths: ``(T,)`` from the border, above 0 inside.
        heights: ``(T,)`` of the person.
    """
    stays, settled, begin, turned = list[tuple[int, int]](), False, 0, 0
    for t in range(len(depths)):
        here = bool(depths[t] > 0)
        if t and here != (depths[t - 1] > 0):
            turned = t
        if abs(depths[t]) > DITHER * heights[t] or t in (0, len(depths) - 1):
            if here and not settled:
                begin = turned
            elif settled and not here:
                stays.append((begin, turned - 1))
            settled = here
    return [*stays, (begin, len(depths) - 1)] if settled else stays


def true_crossings(feet: FloatArray, heights: FloatArray, ends: FloatArray) -> list[tuple[int, int]]:
    """Row and side, 1 or -1, of each time that a way of feet meets a line for good."""
    (ax, ay), (bx, by) = ends.tolist()
    long = np.hypot(bx - ax, by - ay)
    far = ((bx - ax) * (feet[:, 1] - ay) - (by - ay) * (feet[:, 0] - ax)) / long
    met = list[tuple[int, int]]()
    for t in range(1, len(far)):
        if (far[t - 1] > 0) != (far[t] > 0):
            place = feet[t - 1] + far[t - 1] / (far[t - 1] - far[t]) * (feet[t] - feet[t - 1])
            share = ((place[0] - ax) * (bx - ax) + (place[1] - ay) * (by - ay)) / long**2
            if 0 <= share <= 1:
                side = 1 if far[t] > 0 else -1
                since = met[-1][0] if met else 0
                if met and met[-1][1] == -side and (np.abs(far[since:t]) <= DITHER * heights[since:t]).all():
                    met.pop()
                else:
                    met.append((t, side))
    return met
