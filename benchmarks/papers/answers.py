"""Counts, occupancy and stays against the truth of generated streets and labelled video (`answers`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from operator import call
from pathlib import Path
from typing import Any

import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt

from benchmarks.papers import association
from benchmarks.papers.association import DetectedSequence
from benchmarks.papers.outcome import Outcome
from benchmarks.papers.peers import Peer, find_peer, skipped
from benchmarks.papers.store import Cached
from benchmarks.papers.tables import Column, median_only, share_of_all, tabulated, values_of
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track

FIRST_SEED = 1000
"""Of the streets; smaller seeds, and those from 1100 on, fitted the intervals."""
WIDE = 0.4
"""Width of a person's box, in heights."""
DITHER = 0.2
"""Heights from a line or border within which going to and fro is no crossing."""
FINDINGS: Mapping[str, Mapping[str, float]] = {
    "all boxes": {},
    "boxes of the visible": {"hidden": 0.3},
    "a good detector": {"missed": 0.08, "hidden": 0.3, "noise": 0.03, "false": 0.2},
    "a poor detector": {"missed": 0.25, "hidden": 0.5, "noise": 0.06, "false": 0.6},
}
"""What detectors make of a street, see `simulated_boxes`."""
COLUMNS = (
    Column("median error of a line", "errors", ".1f", show=median_only),
    Column("mean", "errors"),
    # The share of all crossings together: a street without any has none of its own.
    Column("of its crossings, %", lambda case: [sum(case["errors"]), sum(case["true"])], ".1f", show=share_of_all),
    Column("occupancy", "occupancy", ".3f"),
    Column("dwell, s", "dwell"),
    Column("intervals of crossings that hold, %", "covered", ".0f", 100),
    Column("of people in a second", "seconds", ".0f", 100),
    Column("of mean people", "means.0", ".0f", 100),
    Column("of the mean stay", "means.1", ".0f", 100),
)


def reproduce(
    *,
    store: Cached,
    data: Path = Path("../shared/data"),
    streets: NonNegativeInt = 20,
    frames: PositiveInt = 750,
    peer: str | None = None,
) -> Outcome:
    """Crossings, occupancy and stays on generated streets and labelled video, beside supervision's zones.

    The lines and the zone are the same shares of every picture. DIR gets results.json and tables.md.

    Args:
        store: of what was computed.
        data: folder that holds mot/mot17-val-half; without it only the streets are counted.
        streets: number of generated streets, each with all true boxes, with those of who is visible, and with those of
            a good and a poor detector; and of lines on which people dither.
        frames: length of a street.
        peer: python of an environment with the packages supervision and trackers; by default this one, if it has them.

    Raises:
        RequestError: a python without the packages.
    """
    environment = find_peer(peer, "counts")
    rows: dict[str, Callable[[Unit], dict[str, Any]]] = {"ours": measure}
    if environment is not None:
        rows |= {
            "LineZone, PolygonZone on our tracks": partial(measure, peer=environment),
            "on its ByteTrack": partial(measure, peer=environment, own_tracks=True),
            "on its ByteTrack, all corners": partial(measure, peer=environment, own_tracks=True, corners=True),
        }
    seeds = range(FIRST_SEED, FIRST_SEED + streets)
    videos: dict[str, tuple[str, Sequence[Unit]]] = {
        name: (f"{streets} streets, {name}", [partial(street, seed, frames, finding) for seed in seeds])
        for name, finding in FINDINGS.items()
    }
    videos["dithering"] = (f"{streets} lines on which people dither", [partial(dithering, seed) for seed in seeds])
    sets = association.find_sets(store, data, ["mot17"]).values() if data.is_dir() else ()
    labelled_videos = [partial(labelled, sequence) for sequences in sets for sequence in sequences]
    videos["mot17"] = ("MOT17 val-half, given detections", labelled_videos)
    notes = [] if labelled_videos else ["MOT17 val-half: not in the data, passed over"]
    measured = {name: store.study(rows, units, title) for name, (title, units) in videos.items() if units}
    tables = [tabulated(of, COLUMNS, ("counted by",), videos[name][0]) for name, of in measured.items()]
    notes += [] if environment else [skipped("counts")]
    return Outcome({name: values_of(of) for name, of in measured.items()}, tables, notes=notes)


@dataclass(frozen=True, eq=False)
class Case:
    """A video with its truth.

    Attributes:
        detections: of each frame.
        tracks: ours over them.
        scene: of the video.
        truth: see `true_answers`.
        rate: frames a second.
    """

    detections: Sequence[Detections]
    tracks: Sequence[Track]
    scene: Scene
    truth: Mapping[str, Any]
    rate: float


Unit = Callable[[], Case]
"""What makes a case."""


def street(seed: int, length: int, finding: Mapping[str, float]) -> Case:
    """A generated street of so many frames; ``finding`` says what a detector makes of it."""
    settings = StreetSettings(frames=length, people=6 + seed % 12, occluders=0, samples=1)
    size = settings.width, settings.height
    clip, true = StreetClip(settings, seed), list[Track]()
    for number, walker in enumerate(clip.walkers, start=1):
        feet, depth = clip.camera.project(np.insert(walker.positions, 2, 0.0, axis=1))
        heads, _ = clip.camera.project(np.insert(walker.positions, 2, walker.person.build.height, axis=1))
        tall = np.maximum(feet[:, 1] - heads[:, 1], 1.0)
        half = 0.5 * WIDE * tall
        boxes = np.column_stack([feet[:, 0] - half, feet[:, 1] - tall, feet[:, 0] + half, feet[:, 1]])
        frames = walker.first + np.arange(len(boxes))
        middle = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        # Somebody is there who is at least half in the picture.
        there = (middle >= 0).all(axis=1) & (middle < size).all(axis=1)
        there &= (depth > 0.5) & (frames >= 0) & (frames < length)
        if there.any():
            true.append(Track(number, frames[there], boxes[there], np.ones(int(there.sum()))))
    return _case(true, simulated_boxes(true, length, seed, **finding), settings.frame_rate, size)


def labelled(sequence: DetectedSequence) -> Case:
    """Labelled video with its given detections."""
    labels = association.sequence_labels(sequence)
    labels = labels.select(labels.evaluated)
    parts = {int(number): labels.ids == number for number in np.unique(labels.ids)}
    true = [Track(n, labels.frames[rows], labels.boxes[rows], np.ones(int(rows.sum()))) for n, rows in parts.items()]
    return _case(true, association.sequence_detections(sequence), sequence.rate, sequence.size)


def dithering(seed: int) -> Case:
    """20 people, by their true tracks, who come up to the line ``level`` of `scene_in`, go to and fro on it, and go on.

    Every other one turns back. What they sway and what a detector errs stays within `DITHER` of the line.
    """
    rng, size, people, frames, height, come = np.random.default_rng([seed, 11]), (640, 480), 20, 600, 80.0, 60
    swaying, half, true = frames - 2 * come, 0.15 * height, list[Track]()
    for number in range(people):
        sway = 0.6 * DITHER * height * np.sin(np.arange(swaying) / rng.uniform(5, 25) + rng.uniform(0, 6))
        sway += np.clip(rng.normal(0, 0.1 * DITHER * height, swaying), -0.3 * DITHER * height, 0.3 * DITHER * height)
        away = 90.0 if number % 2 else -90.0
        y = 0.65 * size[1] + np.concatenate([np.linspace(-90, 0, come), sway, np.linspace(0, away, come)])
        x = (0.08 + 0.84 * (number + 0.5) / people) * size[0] + np.zeros(frames)
        boxes = np.column_stack([x - half, y - height, x + half, y])
        true.append(Track(number + 1, np.arange(frames), boxes, np.ones(frames)))
    detections = [Detections(np.array([t.boxes[k] for t in true]), np.ones(people)) for k in range(frames)]
    scene = scene_in(size)
    return Case(detections, true, scene, true_answers(true, scene, frames, 25.0), 25.0)


def _case(true: list[Track], detections: list[Detections], rate: float, size: tuple[int, int]) -> Case:
    scene, tracks = scene_in(size), association.tracks_over(detections, rate, size)
    return Case(detections, tracks, scene, true_answers(true, scene, len(detections), rate), rate)


cached_case: Callable[[Unit], Case] = lru_cache(maxsize=1)(call)
"""Makes a case, which is kept for the next row on it."""


def measure(unit: Unit, peer: Peer | None = None, own_tracks: bool = False, corners: bool = False) -> dict[str, Any]:
    """How far the answers on one video are from the truth.

    Args:
        unit: makes the video.
        peer: that counts, over our tracks or its own; None is ours.
        own_tracks: the peer tracks, too.
        corners: all corners of a box must cross for the peer, as is its default; or the middle of the lower edge.

    Returns:
        ``errors``, absolute, of each line and direction; ``true`` crossings of each; ``covered``, 1 where the interval
        of 90 % holds the true number, likewise, NaN without intervals; ``seconds``, likewise, of the people in the zone
        in each second; ``means``, likewise, of the mean number of people there and of the mean stay; ``occupancy``,
        mean absolute error over frames, people; ``people``, the mean true one; ``dwell``, absolute error of the mean
        stay, seconds.
    """
    case = cached_case(unit)
    scene, truth, length = case.scene, case.truth, len(case.detections)
    true, n = [float(number) for number in truth["crossings"]], np.array(truth["occupancy"])
    if peer is None:
        counts = count(Result(case.tracks, "", case.rate, scene.size, frames={"frame": range(length)}), scene)
        table, occupancies, zone = (counts.tables[name] for name in ("lines", "occupancy", "zones"))
        stays = dict[int, float]()
        for who, stay in zip(counts.tables["stays"]["id"], counts.tables["stays"]["seconds"], strict=True):
            stays[who] = stays.get(who, 0.0) + stay
        numbers, occupancy, dwell = table["count"], counts.occupancy[scene.zones[0].name], _mean(list(stays.values()))
        covered = _held(table["low"], true, table["high"])
        edges = np.rint(np.array(occupancies["time"]) * case.rate).astype(np.int64)
        true_means = np.add.reduceat(n, edges) / np.diff(np.append(edges, length))
        seconds = _held(occupancies["low"], true_means, occupancies["high"])
        both = {"people": float(n.mean()), "stay": truth["stay"]}
        means = [_held(zone[f"{name}_low"], [value], zone[f"{name}_high"])[0] for name, value in both.items()]
    else:
        rows = np.column_stack(boxes_of_tracks(case.tracks)[:4])
        if own_tracks:
            boxes = rows_of(case.detections, 0, 0)
            rows = np.column_stack([boxes.frames, np.full(len(boxes.frames), -1), boxes.boxes, boxes.scores])
        job = {
            "rows": rows.tolist(),
            "track": own_tracks,
            "lines": [line.ends.tolist() for line in scene.lines],
            "zone": scene.zones[0].corners.tolist(),
            "length": length,
            "rate": case.rate,
            "corners": corners,
        }
        reply = peer.answer(job)
        numbers = [number for both in reply["crossings"] for number in both]
        occupancy, dwell, covered = reply["occupancy"], reply["dwell"], [float("nan")] * len(true)
        seconds, means = [float("nan")], [float("nan")] * 2
    return {
        "errors": [abs(a - b) for a, b in zip(numbers, true, strict=True)],
        "true": true,
        "covered": covered,
        "seconds": seconds,
        "means": means,
        "occupancy": float(np.abs(np.asarray(occupancy) - n).mean()),
        "people": float(n.mean()),
        "dwell": abs(dwell - truth["dwell"]),
    }


def _held(low: Sequence[float], true: Iterable[float], high: Sequence[float]) -> list[float]:
    """1 for each interval that holds its true number to three digits, else 0."""
    return [float(a - 5e-4 <= n <= b + 5e-4) for a, n, b in zip(low, true, high, strict=True)]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def _visible(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """Share of each box that no box of a nearer person covers, by 8 x 8 points of it."""
    shares = np.ones(len(boxes))
    grid = (np.arange(8) + 0.5) / 8
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        x1, y1, x2, y2 = boxes[here].T
        x, y = (low[:, None] + grid * (high - low)[:, None] for low, high in ((x1, x2), (y1, y2)))
        across = (x[:, None] > x1[None, :, None]) & (x[:, None] < x2[None, :, None])
        down = (y[:, None] > y1[None, :, None]) & (y[:, None] < y2[None, :, None])
        nearer = y2 > y2[:, None]
        covered = ((across & nearer[..., None])[..., None, :] & down[..., None]).any(axis=1)
        shares[here] = 1 - covered.mean(axis=(1, 2))
    return shares


def simulated_boxes(
    tracks: Sequence[Track],
    length: int,
    seed: int,
    missed: float = 0.0,
    hidden: float = 0.0,
    noise: float = 0.0,
    false: float = 0.0,
) -> list[Detections]:
    """What a detector finds of true boxes in each of so many frames; who is less visible scores less.

    Args:
        tracks: the true boxes.
        length: number of frames.
        seed: of the errors.
        missed: share of visible boxes that it misses.
        hidden: visible share of a box below which it is missed.
        noise: of a box's sides, in heights.
        false: false boxes a frame.
    """
    rng = np.random.default_rng([seed, 7])
    frames = np.concatenate([track.frames for track in tracks])
    boxes = np.concatenate([track.boxes for track in tracks])
    visible = _visible(frames, boxes)
    detected = (visible >= hidden) & (rng.random(len(frames)) >= missed * (2 - visible))
    frames, boxes, visible = frames[detected], boxes[detected], visible[detected]
    tall = boxes[:, 3] - boxes[:, 1]
    boxes = boxes + noise * tall[:, None] * rng.normal(size=boxes.shape) * [0.4, 1, 0.4, 1]
    scores = np.clip(0.5 + 0.45 * visible + 0.1 * noise * rng.normal(size=len(boxes)), 0.05, 0.99)
    count = rng.poisson(false, length)
    sampled = rng.integers(len(boxes), size=int(count.sum()))
    moved = boxes[sampled] + np.tile(rng.uniform(-200, 200, (len(sampled), 2)), 2)
    frames = np.append(frames, np.repeat(np.arange(length), count))
    boxes, scores = np.vstack([boxes, moved]), np.append(scores, rng.uniform(0.1, 0.6, len(sampled)))
    order = np.argsort(frames, kind="stable")
    order = order[(boxes[order, 2:] > boxes[order, :2] + 1).all(axis=1)]
    parts = np.split(order, np.searchsorted(frames[order], np.arange(1, length)))
    return [Detections(boxes[part], scores[part]) for part in parts]


def scene_in(size: tuple[int, int]) -> Scene:
    """Two lines and a zone, the same shares of every picture: they are not tuned on the counts."""
    upright, level = np.array([[(0.4, 0.2), (0.4, 1.0)], [(0.05, 0.65), (0.95, 0.65)]]) * size
    middle = np.array([(0.45, 0.4), (0.85, 0.4), (0.85, 0.9), (0.45, 0.9)]) * size
    return Scene([SceneLine("upright", upright), SceneLine("level", level)], [SceneZone("middle", middle)], size)


def true_answers(tracks: list[Track], scene: Scene, length: int, frame_rate: float) -> dict[str, Any]:
    """The answers by true boxes, one step after the other.

    Returns:
        ``crossings``: number of each line and direction; ``occupancy``: people in the zone in each frame; ``dwell``:
        mean seconds in the zone, over all who stayed there, see `true_stays`, 0 where none did; ``stay``: mean seconds
        of a stay, likewise.
    """
    counts = np.zeros((len(scene.lines), 2), dtype=np.int64)
    occupancy, stays = np.zeros(length, dtype=np.int64), list[list[float]]()
    low, high = scene.zones[0].corners.min(axis=0), scene.zones[0].corners.max(axis=0)
    for track in tracks:
        feet = np.column_stack([0.5 * (track.boxes[:, 0] + track.boxes[:, 2]), track.boxes[:, 3]])
        depths = np.column_stack([feet - low, high - feet]).min(axis=1)
        occupancy[track.frames[depths > 0]] += 1
        heights = track.boxes[:, 3] - track.boxes[:, 1]
        here = true_stays(depths, heights)
        stays += [[(last - first + 1) / frame_rate for first, last in here]] if here else []
        for line, directions in zip(scene.lines, counts, strict=True):
            for _, side in true_crossings(feet, heights, line.ends):
                directions[0 if side > 0 else 1] += 1
    dwell = _mean([sum(seconds) for seconds in stays])
    stay = _mean([stay_seconds for seconds in stays for stay_seconds in seconds])
    return {"crossings": counts.ravel().tolist(), "occupancy": occupancy.tolist(), "dwell": dwell, "stay": stay}


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
