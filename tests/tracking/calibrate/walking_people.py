"""People who walk over a floor, and their boxes in cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, Track

SIZE = (1280, 720)


def walks(seed: int, people: int, seconds: float) -> list[FloatArray]:
    """For each person rows of time, x, y and height: from goal to goal on a floor of 12 m by 12 m at a walking pace."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(people):
        speed, start = rng.normal(1.3, 0.15), rng.uniform(0, 0.6 * seconds)
        goals = rng.uniform(0, 12, (8, 2))
        along = np.insert(np.cumsum(np.hypot(*np.diff(goals, axis=0).T)), 0, 0) / speed
        times = np.arange(0, min(along[-1], rng.uniform(20, 40)), 0.1)
        place = [np.interp(times, along, goals[:, k]) for k in (0, 1)]
        found.append(np.column_stack([start + times, *place, np.full(len(times), 1.7)]))
    return found


def across(seed: int, people: int) -> list[FloatArray]:
    """People who walk straight on, everywhere and in all directions, each for ten seconds."""
    rng, times, found = np.random.default_rng(seed), np.arange(0, 10, 0.1), []
    for angle in rng.uniform(0, 2 * np.pi, people):
        place = rng.uniform(1, 11, 2) + 1.3 * np.outer(times - 5, [np.cos(angle), np.sin(angle)])
        found.append(np.column_stack([rng.uniform(0, 40) + times, place, np.full(len(times), 1.7)]))
    return found


def filmed(
    camera: PinholeCamera,
    walked: Sequence[FloatArray],
    rate: float = 5.0,
    noise: float = 0.0,
    offset: float = 0.0,
    drift: float = 0.0,
    seed: int = 0,
) -> Result[Track]:
    """What a camera sees whose clock shows ``t`` at the time ``t (1 + drift) + offset``."""
    rng, tracks = np.random.default_rng(seed), []
    for rows in walked:
        frames = np.arange(max(np.ceil((rows[0, 0] - offset) * rate), 0), (rows[-1, 0] - offset) * rate)
        times = frames / rate * (1 + drift) + offset
        foot = np.column_stack([*(np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2)), np.zeros(len(times))])
        low, high = (camera.project(np.add(foot, [0, 0, up]))[0] for up in (0, rows[0, 3]))
        tall = low[:, 1] - high[:, 1]
        boxes = np.column_stack([low[:, 0], high[:, 1], high[:, 0], low[:, 1]])
        boxes[:, [0, 2]] = boxes[:, [0, 2]].mean(axis=1)[:, None] + 0.17 * np.outer(tall, [-1, 1])
        boxes += noise * tall[:, None] * rng.normal(size=boxes.shape)
        with np.errstate(invalid="ignore"):
            inside = (boxes[:, :2] > 0).all(axis=1) & (boxes[:, 2:] < SIZE).all(axis=1)
        parts = np.split(np.flatnonzero(inside), np.flatnonzero(np.diff(np.flatnonzero(inside)) > 1) + 1)
        for part in (part for part in parts if len(part) > 5):
            number = len(tracks) + 1
            tracks.append(Track(number, frames[part].astype(np.int64), boxes[part], np.ones(len(part))))
    return Result(tracks, f"{camera.position[0]:.0f}.mp4", rate, SIZE)


def looking(seed: int, focal: float = 1100.0) -> PinholeCamera:
    """A camera beside the floor that looks at its middle."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi)
    position = np.array([6 + 10 * np.cos(angle), 6 + 10 * np.sin(angle), rng.uniform(3, 5)])
    return PinholeCamera.look_at(position, np.array([6.0, 6, 0]), focal, *SIZE, roll=0.02)
