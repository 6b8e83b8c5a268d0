"""Streets for `reproduce answers`: planned crowds as boxes, a simulated detector's view of them, and exact answers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings, plan_street
from tsuiseki.tracking.answers.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Track

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


@dataclass(frozen=True)
class StreetOfBoxes:
    """A street without pictures.

    Attributes:
        tracks: true boxes of everybody, by id.
        visible: visible share of each box, one array a track.
        size: of the picture, pixels.
        frame_rate: frames a second.
        length: frames.
    """

    tracks: list[Track]
    visible: list[FloatArray]
    size: tuple[int, int]
    frame_rate: float
    length: int


def plan_boxes(settings: StreetSettings, seed: int) -> StreetOfBoxes:
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
    return StreetOfBoxes(tracks, _visible(tracks, settings.frames), size, settings.frame_rate, settings.frames)


def _boxes(clip: StreetClip, places: FloatArray, height: float) -> tuple[FloatArray, BoolArray]:
    """``(T, 4)`` boxes of a person at ``(T, 2)`` places, and which are before the camera."""
    feet, depth = clip.camera.project(np.insert(places, 2, 0.0, axis=1))
    heads, _ = clip.camera.project(np.insert(places, 2, height, axis=1))
    tall = np.maximum(feet[:, 1] - heads[:, 1], 1.0)
    half = 0.5 * WIDE * tall
    return np.column_stack([feet[:, 0] - half, feet[:, 1] - tall, feet[:, 0] + half, feet[:, 1]]), depth > 0.5


def _visible(tracks: list[Track], length: int) -> list[FloatArray]:
    """Share of each box that no box of a nearer person covers, by 8 x 8 points of it."""
    shares = [np.ones(len(track)) for track in tracks]
    rows = [(n, t) for n, track in enumerate(tracks) for t in range(len(track))]
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)])
    grid = (np.arange(8) + 0.5) / 8
    for frame in range(length):
        here = np.flatnonzero(frames == frame)
        own = boxes[here]
        x = own[:, 0, None] + grid * (own[:, 2] - own[:, 0])[:, None]
        y = own[:, 1, None] + grid * (own[:, 3] - own[:, 1])[:, None]
        across = (x[:, None] > own[None, :, 0, None]) & (x[:, None] < own[None, :, 2, None])
        down = (y[:, None] > own[None, :, 1, None]) & (y[:, None] < own[None, :, 3, None])
        nearer = own[None, :, 3] > own[:, None, 3]
        covered = ((across & nearer[..., None])[..., None, :] & down[..., None]).any(axis=1)
        for row, share in zip(here.tolist(), 1 - covered.mean(axis=(1, 2)), strict=True):
            shares[rows[row][0]][rows[row][1]] = share
    return shares


def found_boxes(street: StreetOfBoxes, finding: Finding, seed: int) -> list[Detections]:
    """What a detector finds in each frame; who is less visible scores less."""
    rng = np.random.default_rng([seed, 7])
    frames = np.concatenate([track.frames for track in street.tracks])
    boxes = np.concatenate([track.boxes for track in street.tracks])
    visible = np.concatenate(street.visible)
    kept = (visible >= finding.hidden) & (rng.random(len(frames)) >= finding.missed * (2 - visible))
    frames, boxes, visible = frames[kept], boxes[kept], visible[kept]
    tall = boxes[:, 3] - boxes[:, 1]
    boxes = boxes + finding.noise * tall[:, None] * rng.normal(size=boxes.shape) * [0.4, 1, 0.4, 1]
    scores = np.clip(0.5 + 0.45 * visible + 0.1 * finding.noise * rng.normal(size=len(boxes)), 0.05, 0.99)
    count = rng.poisson(finding.false, street.length)
    some = rng.integers(len(boxes), size=int(count.sum()))
    moved = boxes[some] + np.tile(rng.uniform(-200, 200, (len(some), 2)), 2)
    frames = np.append(frames, np.repeat(np.arange(street.length), count))
    boxes, scores = np.vstack([boxes, moved]), np.append(scores, rng.uniform(0.1, 0.6, len(some)))
    order = np.argsort(frames, kind="stable")
    edges = np.searchsorted(frames[order], np.arange(street.length + 1))
    good = (boxes[:, 2] > boxes[:, 0] + 1) & (boxes[:, 3] > boxes[:, 1] + 1)
    parts = [order[a:b][good[order[a:b]]] for a, b in pairwise(edges)]
    return [Detections(boxes[part], scores[part]) for part in parts]


def scene_in(size: tuple[int, int]) -> Scene:
    """Two lines and a zone, the same shares of every picture: they were chosen before any count was looked at."""
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
        dwell: mean seconds in the zone, over all who were in it; 0 where nobody was.
    """

    crossings: dict[str, dict[str, int]]
    occupancy: list[int]
    dwell: float


DITHER = 0.2
"""Heights from a line within which going to and fro is no crossing."""


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
    occupancy, seconds = np.zeros(length, dtype=np.int64), []
    (x1, y1), (x2, y2) = scene.zones[0].corners.min(axis=0), scene.zones[0].corners.max(axis=0)
    for track in tracks:
        feet = np.column_stack([0.5 * (track.boxes[:, 0] + track.boxes[:, 2]), track.boxes[:, 3]])
        within = (feet[:, 0] > x1) & (feet[:, 0] < x2) & (feet[:, 1] > y1) & (feet[:, 1] < y2)
        occupancy[track.frames[within]] += 1
        seconds += [float(within.sum()) / frame_rate] if within.any() else []
        for line in scene.lines:
            for _, side in true_crossings(feet, track.boxes[:, 3] - track.boxes[:, 1], line.ends):
                counts[line.name][line.directions[0 if side > 0 else 1]] += 1
    return TrueAnswers(counts, occupancy.tolist(), float(np.mean(seconds)) if seconds else 0.0)


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
