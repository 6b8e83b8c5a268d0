"""How a drone flies: it drifts, pans and climbs slowly, trembles, and now and then a gust or a stick jerks it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import FloatArray

Strength = Literal["still", "calm", "violent"]
STEEPEST = math.radians(89.5)


@dataclass(frozen=True)
class Motion:
    """How much a camera moves; angles in degrees.

    Attributes:
        drift: standard deviation of the slow sideways movement, in altitudes.
        climb: standard deviation of the slow change of the altitude, relative.
        pan: standard deviation of the slow turns.
        tremble: standard deviation of the quick tremble.
        jerks: a second, on average.
        jerk: standard deviation of a jerk's turn.
        jerk_frames: (fewest, most) frames that a jerk's turn takes.
    """

    drift: float
    climb: float
    pan: float
    tremble: float
    jerks: float
    jerk: float
    jerk_frames: tuple[int, int]


MOTIONS: dict[Strength, Motion] = {
    "still": Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (1, 1)),
    "calm": Motion(0.04, 0.03, 2.0, 0.02, 0.2, 0.6, (4, 9)),
    "violent": Motion(0.08, 0.10, 4.0, 0.10, 1.2, 3.5, (1, 4)),
}


@dataclass(frozen=True)
class Viewpoint:
    """Where a flight is about: the camera looks at the origin of the ground from there.

    Attributes:
        altitude: metres.
        tilt: radians under the horizon.
        bearing: direction that the camera looks in, radians.
        focal: pixels.
    """

    altitude: float
    tilt: float
    bearing: float
    focal: float


def fly(
    rng: np.random.Generator,
    view: Viewpoint,
    motion: Motion,
    frames: int,
    frame_rate: float,
    size: tuple[int, int],
    altitudes: tuple[float, float],
) -> list[PinholeCamera]:
    """The camera of every frame.

    Args:
        rng: draws the movements.
        view: that the camera moves about.
        motion: how much.
        frames: how long.
        frame_rate: frames per second.
        size: width and height of the image, pixels.
        altitudes: lowest and highest, metres; the camera keeps within them.
    """
    slow = np.stack([_wander(rng, frames, frame_rate, 2.0) for _ in range(6)])
    fast = np.stack([_wander(rng, frames, frame_rate, 0.05) for _ in range(3)])
    turns = np.radians(motion.pan) * slow[:3] + np.radians(motion.tremble) * fast
    turns += np.radians(_jerks(rng, motion, frames, frame_rate))
    altitude = np.clip(view.altitude * (1 + motion.climb * slow[3]), *altitudes)
    drift = motion.drift * view.altitude * slow[4:6]
    cameras = []
    for t in range(frames):
        # A tremble rolls the camera less than it turns it.
        bearing = view.bearing + turns[0, t] / max(math.cos(view.tilt), 0.35)
        tilt = float(np.clip(view.tilt + turns[1, t], np.radians(45), STEEPEST))
        back = view.altitude / math.tan(view.tilt)
        position = np.array(
            [
                drift[0, t] - back * math.cos(view.bearing),
                drift[1, t] - back * math.sin(view.bearing),
                altitude[t],
            ]
        )
        forward = np.array([math.cos(tilt) * math.cos(bearing), math.cos(tilt) * math.sin(bearing), -math.sin(tilt)])
        cameras.append(PinholeCamera.look_at(position, position + forward, view.focal, *size, 0.5 * turns[2, t]))
    return cameras


def _wander(rng: np.random.Generator, frames: int, frame_rate: float, seconds: float) -> FloatArray:
    """``(frames,)`` smooth noise of unit deviation that changes within about ``seconds``."""
    sigma = max(seconds * frame_rate / 2, 0.3)
    margin = int(4 * sigma) + 1
    noise = gaussian_filter1d(rng.standard_normal(frames + 2 * margin), sigma)[margin : margin + frames]
    # Of white noise so smoothed.
    return np.asarray(noise * math.sqrt(2 * sigma * math.sqrt(math.pi)))


def _jerks(rng: np.random.Generator, motion: Motion, frames: int, frame_rate: float) -> FloatArray:
    """``(3, frames)`` degrees: sudden turns that swing back slowly, as the drone's control has it."""
    turns = np.zeros((3, frames))
    for _ in range(int(rng.poisson(motion.jerks * frames / frame_rate))):
        start, rise = int(rng.integers(frames)), int(rng.integers(motion.jerk_frames[0], motion.jerk_frames[1] + 1))
        away = motion.jerk * rng.normal(size=3) * [1.0, 1.0, 0.7]
        t = np.arange(frames - start)
        up = np.clip(t / rise, 0, 1)
        back = np.exp(-np.maximum(t - rise, 0) / (0.35 * frame_rate))
        swing = np.cos(2 * np.pi * np.maximum(t - rise, 0) / (0.8 * frame_rate))
        turns[:, start:] += away[:, None] * up * back * swing
    return turns


def ground_homography(before: PinholeCamera, after: PinholeCamera) -> FloatArray:
    """``(3, 3)``: takes pixels of the ground in the image of ``before`` to those of ``after``."""
    matrix = ground_to_pixels(after) @ np.linalg.inv(ground_to_pixels(before))
    return np.asarray(matrix / matrix[2, 2])


def ground_to_pixels(camera: PinholeCamera) -> FloatArray:
    """``(3, 3)``: takes homogeneous metres x, y, 1 of the ground to homogeneous pixels."""
    intrinsics = np.array(
        [
            [camera.focal[0], 0, camera.principal_point[0]],
            [0, camera.focal[1], camera.principal_point[1]],
            [0, 0, 1],
        ]
    )
    moved = np.column_stack([np.eye(3)[:, :2], -camera.position])
    return np.asarray(intrinsics @ camera.rotation @ moved)
