"""Labelled video and generated streets with the tracks of the flow, and what is true of their people."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.evaluation.coverage import owners_of
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

WIDE, HIGH = 640, 480
# Width and lower and upper edge of what hides people, heights of a person: a pole, a sign, a car, a board, a box.
HIDING = ((0.12, 0, 2.0), (0.6, 0.7, 1.9), (1.5, 0, 0.8), (0.5, 0, 1.6), (0.35, 0.3, 1.6))
# Least and greatest of each fault of a detector; false alarms are drawn by their logarithm.
FAULTS = {
    "jitter": (0.02, 0.045), "steady": (0.7, 0.9), "missed": (0.03, 0.35), "hidden": (0.5, 0.95),
    "persistence": (0.5, 0.97), "doubled": (0.0, 0.06),
}  # fmt: skip


@dataclass(frozen=True)
class Labelled:
    """A result with its network, the detections' boxes and the labels of its video."""

    result: Result[Any]
    labels: GroundTruth

    @classmethod
    def of(cls, detections: Sequence[Detections], labels: GroundTruth, rate: float, size: tuple[int, int]) -> Labelled:
        known = size if min(size) > 0 else None
        tracker = FlowTracker(frame_rate=rate, size=known)
        for boxes in detections:
            tracker.update(boxes)
        tracks, network = tracker.tracks(), tracker.network()
        frames = {"frame": list(range(len(detections)))}
        return cls(Result(tracks, "", rate, known, frames=frames, network=lambda: network), labels)


def detected_people(video: Labelled) -> int:
    """How many different labelled people were detected for a second or more."""
    network = video.result.network()
    owners = owners_of(network.frames, network.boxes, video.labels)
    return int((np.bincount(owners[owners >= 0]) >= max(2, video.result.frame_rate)).sum())


def changes(video: Labelled) -> list[tuple[int, int, int]]:
    """Number of the track, last frame on one person and first on the next, of each change of 0.4 s or more on both.

    Who was under the box stays so as long as their label overlaps it by half, as for switches of CLEAR MOT.
    """
    labels, tracks = video.labels, list(video.result)
    rows = {key: n for n, key in enumerate(zip(labels.frames.tolist(), labels.ids.tolist(), strict=True))}
    numbers = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    frames, boxes = (np.concatenate([getattr(track, name) for track in tracks]) for name in ("frames", "boxes"))
    order = np.argsort(frames, kind="stable")
    owner = np.empty(len(frames), np.int64)
    owner[order] = owners_of(frames[order], boxes[order], labels)
    owner[~np.concatenate([track.observed for track in tracks])] = -1
    least, happened = max(3, round(0.4 * video.result.frame_rate)), list[tuple[int, int, int]]()
    for number in range(len(tracks)):
        mine, runs = np.flatnonzero(numbers == number), list[tuple[int, int, int]]()
        who = _steady(owner[mine], frames[mine], boxes[mine], rows, labels)
        known = np.flatnonzero(who >= 0)
        for run in np.split(known, np.flatnonzero(np.diff(who[known])) + 1):
            if len(run) >= least:
                same = bool(runs) and runs[-1][0] == who[run[0]]
                begin = runs.pop()[1] if same else int(frames[mine[run[0]]])
                runs.append((int(who[run[0]]), begin, int(frames[mine[run[-1]]])))
        happened += [(number, a[2], b[1]) for a, b in itertools.pairwise(runs)]
    return happened


def _steady(
    who: IntArray, frames: IntArray, boxes: FloatArray, rows: dict[tuple[int, int], int], labels: GroundTruth
) -> IntArray:
    who, previous = who.copy(), -1
    for n, frame in enumerate(frames.tolist()):
        row = rows.get((frame, previous))
        if previous >= 0 and row is not None and who[n] not in (previous, -1):
            overlap = iou_pairs(boxes[n : n + 1], labels.boxes[row : row + 1])[0]
            who[n] = previous if overlap >= 0.5 else who[n]
        previous = int(who[n]) if who[n] >= 0 else previous
    return who


def labelled_street(seed: int) -> Labelled:
    """A street of 15 to 45 seconds with signs, poles and cars, some of whose people stand; the camera may move."""
    rng = np.random.default_rng([seed, 66])
    rate, seconds = float(rng.choice([7, 10, 14, 25, 30])), rng.uniform(15, 45)
    length = int(rate * seconds)
    people = _people(rng, seed, rate, length)
    hiding, frames = _hiding(rng, people), people[:, 0].astype(np.int64)
    moving = rng.random() < 0.3
    visible = _visible(frames, people[:, 2:], hiding)
    boxes = _from_moving_camera(rng, people[:, 2:], frames, length, rate) if moving else people[:, 2:]
    inside = boxes.clip(0, [WIDE, HIGH] * 2)
    share = np.diff(inside[:, ::2])[:, 0] / np.diff(boxes[:, ::2])[:, 0]
    kept = (inside[:, 2:] - inside[:, :2] > 2).all(axis=1) & (share > 0.3)
    counted = np.ones(int(kept.sum()), np.bool_)
    labels = GroundTruth(frames[kept], people[kept, 1].astype(np.int64), inside[kept], counted, ~counted, visible[kept])
    drawn = {name: float(rng.uniform(*ends)) for name, ends in FAULTS.items()}
    faults = DetectorFaults(**drawn, false_alarms=float(np.exp(rng.uniform(np.log(0.02), np.log(1.5)))))
    return Labelled.of(simulate_detections(rng, labels, length, WIDE, HIGH, faults), labels, rate, (WIDE, HIGH))


def _people(rng: np.random.Generator, seed: int, rate: float, length: int) -> FloatArray:
    """``(N, 6)`` frame, id and box of everybody, by frame."""
    settings = StreetSettings(WIDE, HIGH, length, rate, int(rng.integers(4, 16)), 0, (20.0, 200.0), 1)
    clip, ways = StreetClip(settings, seed), list[FloatArray]()
    for number, walker in enumerate(clip.walkers, start=1):
        feet, depth = clip.camera.project(np.insert(walker.positions, 2, 0.0, axis=1))
        heads, _ = clip.camera.project(np.insert(walker.positions, 2, walker.person.build.height, axis=1))
        tall = np.maximum(feet[:, 1] - heads[:, 1], 1.0)
        boxes = np.column_stack([feet[:, 0] - 0.2 * tall, feet[:, 1] - tall, feet[:, 0] + 0.2 * tall, feet[:, 1]])
        frames, middle = walker.first + np.arange(len(boxes)), 0.5 * (boxes[:, :2] + boxes[:, 2:])
        there = (middle >= 0).all(axis=1) & (middle < (WIDE, HIGH)).all(axis=1)
        there &= (depth > 0.5) & (frames >= 0) & (frames < length)
        if there.any():
            ways.append(np.column_stack([frames, np.full(len(frames), number), boxes])[there])
    if rng.random() < 0.5:
        share = rng.uniform(0.2, 0.7)
        ways = [_standing(rng, way, rate, length) if rng.random() < share else way for way in ways]
    people = np.concatenate(ways)
    return people[np.argsort(people[:, 0], kind="stable")]


def _standing(rng: np.random.Generator, way: FloatArray, rate: float, length: int) -> FloatArray:
    """Somebody who stands at a place of their way, all the time or a part of it."""
    row, whole = way[int(rng.integers(len(way)))], rng.random() < 0.5
    first, last = (0, length) if whole else sorted(rng.integers(0, length, 2).tolist())
    sway = np.cumsum(rng.normal(0, 0.004, (length, 2)), axis=0) * (row[5] - row[3])
    sway -= np.linspace(0, 1, length)[:, None] * sway[-1]
    still = np.column_stack([np.arange(length), np.full(length, row[1]), row[2:] + np.tile(sway, 2)])
    return still[first:last] if last - first > rate else way


def _hiding(rng: np.random.Generator, people: FloatArray) -> FloatArray:
    """``(M, 5)`` boxes of what hides people, and where it stands in the picture."""
    things = list[tuple[float, ...]]()
    for _ in range(int(rng.integers(0, 7))):
        _, _, x1, y1, x2, y2 = people[int(rng.integers(len(people)))].tolist()
        tall, (wide, low, high) = y2 - y1, HIDING[int(rng.integers(len(HIDING)))]
        half, middle, foot = 0.5 * wide * rng.uniform(0.6, 1.6) * tall, 0.5 * (x1 + x2), y2 + 0.3 * tall
        things.append((middle - half, foot - high * tall, middle + half, foot - low * tall, foot))
    return np.array(things).reshape(-1, 5)


def _visible(frames: IntArray, boxes: FloatArray, hiding: FloatArray) -> FloatArray:
    """``(N,)`` share of each box that neither a nearer person nor a thing covers, by 8 x 8 points of it."""
    shares, grid = np.ones(len(boxes)), (np.arange(8) + 0.5) / 8
    for here in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames)) + 1):
        x1, y1, x2, y2 = np.vstack([boxes[here], hiding[:, :4]]).T
        foot, count = np.append(boxes[here, 3], hiding[:, 4]), len(here)
        x, y = (low[:count, None] + grid * (high - low)[:count, None] for low, high in ((x1, x2), (y1, y2)))
        across = (x[:, None] > x1[None, :, None]) & (x[:, None] < x2[None, :, None])
        down = (y[:, None] > y1[None, :, None]) & (y[:, None] < y2[None, :, None])
        nearer = foot > foot[:count, None]
        covered = ((across & nearer[..., None])[..., None, :] & down[..., None]).any(axis=1)
        shares[here] = 1 - covered.mean(axis=(1, 2))
    return shares


def _from_moving_camera(
    rng: np.random.Generator, boxes: FloatArray, frames: IntArray, length: int, rate: float
) -> FloatArray:
    """Boxes as a camera sees them that pans and comes nearer."""
    time = np.arange(length) / rate
    pan = rng.uniform(100, 350) * np.sin(2 * np.pi * time * rng.uniform(0.01, 0.08) + rng.uniform(0, 6))
    pan += np.cumsum(rng.normal(0, 1.0, length))
    zoom = (np.exp(rng.uniform(0, 0.02) * time) * rng.uniform(1.2, 1.8))[frames, None]
    middle = np.array([320.0, 200.0, 320.0, 200.0])
    moved = (boxes - middle) * zoom + middle
    moved[:, ::2] += pan[frames, None]
    return moved
