"""Which end of an animal is its head: by how animals of this video walk, and without turning round between frames.

An animal walks towards its head most of the time, and its contrast and outline are not the same at both ends. How they
differ is learnt from the frames in which animals walk; then each animal's ends are chosen together for all frames
(Viterbi), since between two frames no animal turns by more than a right angle.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

WALKING = 0.25
"""Lengths of itself that an animal moves within `SPAN`, from which it walks."""
SPAN = 0.4
"""Seconds."""
KNOWN = 100.0
"""Evidence of a head that is known, not found."""
TURNED_ROUND = 50.0
"""Cost of a right angle between two frames; a frame of walking the other way costs up to 1."""


def heads(places: FloatArray, poses: list[AnimalPose], signs: FloatArray, frame_rate: float) -> FloatArray:
    """``(T,)`` headings in radians of one animal in frames that follow each other.

    Args:
        places: ``(T, 2)`` pixels.
        poses: ``T`` of them; their axes point either way.
        signs: ``(2,)`` see `head_signs`.
        frame_rate: frames a second.
    """
    axes = np.array([pose.axis for pose in poses])
    votes = _walk(places, poses, frame_rate) + 0.5 * np.tanh(_asymmetries(poses) * signs).sum(axis=1)
    votes = np.where([pose.headed for pose in poses], KNOWN, votes)
    flips = _chosen(axes, votes)
    return np.asarray(np.angle(np.exp(1j * (axes + np.pi * flips))))


def head_signs(tracks: list[tuple[FloatArray, list[AnimalPose]]], frame_rate: float) -> FloatArray:
    """``(2,)`` how each asymmetry tells the head, from animals that walk: its sign and strength; 0 where it does not.

    Args:
        tracks: places ``(T, 2)`` and poses of each animal.
        frame_rate: frames a second.
    """
    walks = np.concatenate([_walk(places, poses, frame_rate) for places, poses in tracks] or [np.empty(0)])
    found = np.concatenate([_asymmetries(poses) for _, poses in tracks] or [np.empty((0, 2))])
    walking = np.abs(walks) > 0.5
    if walking.sum() < 2:
        return np.zeros(2)
    agree = np.sign(walks[walking])[:, None] * found[walking]
    # The mean over its deviation: an asymmetry that is now here, now there says little.
    scale = np.maximum(np.sqrt(np.mean(agree**2, axis=0)), 1e-9)
    share = agree.mean(axis=0) / scale
    return np.asarray(np.where(np.abs(share) > 0.2, share, 0.0) / scale)


def seconds_of_walking(tracks: list[tuple[FloatArray, list[AnimalPose]]], frame_rate: float) -> float:
    """For how long animals clearly walk, all together: heads are known by that.

    Args:
        tracks: places ``(T, 2)`` and poses of each animal.
        frame_rate: frames a second.
    """
    return sum(int((np.abs(_walk(*track, frame_rate)) > 0.5).sum()) for track in tracks) / frame_rate


def _asymmetries(poses: list[AnimalPose]) -> FloatArray:
    return np.array([pose.asymmetry for pose in poses]).reshape(-1, 2)


def _walk(places: FloatArray, poses: list[AnimalPose], frame_rate: float) -> FloatArray:
    """``(T,)`` in [-1, 1]: how clearly an animal walks where its axis points, or the other way."""
    half = max(1, round(SPAN * frame_rate / 2))
    last = len(places) - 1
    first, second = np.clip(np.arange(last + 1) - half, 0, last), np.clip(np.arange(last + 1) + half, 0, last)
    step = places[second] - places[first]
    axes = np.array([pose.axis for pose in poses])
    lengths = np.array([max(pose.length, 1.0) for pose in poses])
    along = (step[:, 0] * np.cos(axes) + step[:, 1] * np.sin(axes)) / (WALKING * lengths)
    return np.asarray(np.clip(along, -1.0, 1.0) * (np.abs(along) > 0.3))


def _chosen(axes: FloatArray, votes: FloatArray) -> IntArray:
    """``(T,)`` 1 where the axis points to the tail: the cheapest way through all frames."""
    own = np.stack([-votes, votes], axis=1)
    back = np.zeros((len(axes), 2), dtype=np.int64)
    total = own[0].copy()
    for t in range(1, len(axes)):
        same = np.cos(axes[t] - axes[t - 1])
        # Rows: before, columns: now. The more the head turns, the dearer.
        turn = TURNED_ROUND * np.maximum(0.0, 1 - np.array([[same, -same], [-same, same]]))
        way = total[:, None] + turn
        back[t] = way.argmin(axis=0)
        total = way.min(axis=0) + own[t]
    flips = np.zeros(len(axes), dtype=np.int64)
    flips[-1] = int(total.argmin())
    for t in range(len(axes) - 1, 0, -1):
        flips[t - 1] = back[t, flips[t]]
    return flips


def stretches_of(frames: IntArray, longest: int) -> list[IntArray]:
    """Indices of the stretches of frames ``(T,)`` without a gap longer than ``longest``."""
    breaks: BoolArray = np.diff(frames) > longest
    return [np.asarray(part, dtype=np.int64) for part in np.split(np.arange(len(frames)), np.flatnonzero(breaks) + 1)]
