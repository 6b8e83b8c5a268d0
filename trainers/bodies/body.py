"""Learning a body from silhouettes: a mean outline and its main bending modes (`tsuiseki train body`).

Outlines are centred, sampled evenly by arc length, and aligned: each is turned, and its first point is chosen. With
points as complex numbers both follow from the peak of a circular correlation. The principal components of what is left
are the bending modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.bodies.learnt import LearntBody
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.bodies.outlines import Outline

FEWEST = 10
# Outlines are lined up on this many times the points that are kept.
FINER = 4
ROUNDS = 8
# Bends beyond those seen are allowed by this share.
BEYOND = 0.15
# A body whose outline varies by less than this, in pixels, is rigid: what varies is where pixels fall.
RIGID = 0.5

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class BodyFit:
    """What was learnt, and how well.

    Attributes:
        body: the body.
        states: ``(S, 3 + M)`` of each outline: centroid, heading, bends.
        explained: ``(M,)`` share of the variance of the outlines by each mode.
        spread: root mean square distance of outline points from their mean, pixels.
        residual: likewise from the body's contour.
    """

    body: LearntBody
    states: FloatArray
    explained: FloatArray
    spread: float
    residual: float


def learn_body(outlines: Sequence[Outline], modes: int = 1, points: int = 48, name: str = "learnt") -> BodyFit:
    """A body from the outlines of its silhouettes.

    Args:
        outlines: of one kind of body, of one size.
        modes: bends to keep.
        points: of the contour.
        name: of the body; files of motion learnt with it carry it.

    Raises:
        RequestError: there are fewer than 10 outlines, too few for the modes, or they do not bend.
    """
    if len(outlines) < max(FEWEST, 2 * modes + 2):
        needed = max(FEWEST, 2 * modes + 2)
        raise RequestError(f"expected at least {needed} whole silhouettes for {modes} modes, got {len(outlines)}")
    sampled = np.array([evenly_sampled(outline.points, points * FINER) for outline in outlines])
    centroids = area_centroids(sampled)
    aligned, turns = line_up(sampled - centroids[:, None])
    steps = np.array([complex(*outline.step) for outline in outlines])
    heading = _heading(aligned.mean(axis=0), steps * np.exp(-1j * turns))
    aligned, turns = aligned * np.exp(-1j * heading), turns + heading
    aligned = np.roll(aligned, -int(aligned.real.mean(axis=0).argmax()), axis=1)[:, ::FINER]  # from the nose on
    rows = np.concatenate([aligned.real, aligned.imag], axis=1)
    mean = rows.mean(axis=0)
    spread = _distance(rows - mean)
    if spread < RIGID:
        raise RequestError(f"expected silhouettes that bend, got outlines that vary by {spread:.2f} pixels only")
    directions, bends, explained = _principal_bends(rows - mean, mean, modes)
    curved = bends**2 - 1
    rest = rows - mean - bends @ directions
    curves = np.linalg.lstsq(curved, rest, rcond=None)[0]
    low, high = bends.min(axis=0), bends.max(axis=0)
    margin = BEYOND * (high - low)
    body = LearntBody(
        name,
        _points(mean[None])[0],
        _points(directions),
        _points(curves),
        np.stack([low - margin, high + margin], axis=1),
    )
    states = np.column_stack([centroids.real, centroids.imag, np.angle(np.exp(1j * turns)), bends])
    return BodyFit(body, states, explained, spread, _distance(rest - curved @ curves))


def evenly_sampled(points: FloatArray, count: int) -> Complex:
    """``(count,)`` places x + iy evenly spaced by arc length on the closed line through points ``(P, 2)``."""
    line = points[:, 0] + 1j * points[:, 1]
    closed = np.append(line, line[0])
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(closed)))])
    return np.asarray(np.interp(np.arange(count) * way[-1] / count, way, closed))


def area_centroids(lines: Complex) -> Complex:
    """Centroids ``(S,)`` of the areas inside closed lines ``(S, P)``."""
    following = np.roll(lines, -1, axis=1)
    cross = lines.real * following.imag - following.real * lines.imag
    return np.asarray(((lines + following) * cross).sum(axis=1) / (3 * cross.sum(axis=1)))


def line_up(lines: Complex) -> tuple[Complex, FloatArray]:
    """Closed lines ``(S, P)`` turned and slid onto their common mean, and the turns ``(S,)`` that they had.

    With ``c_k = sum_n conj(mean_n) line_(n + k)``, sliding by ``k`` and turning back by the phase of ``c_k`` leaves the
    squared distance ``|line|^2 + |mean|^2 - 2 |c_k|``.
    """
    aligned, turns = lines, np.zeros(len(lines))
    mean = lines[0]
    for _ in range(ROUNDS):
        spectrum = np.conj(np.fft.fft(mean)) * np.fft.fft(aligned, axis=1)
        correlation = np.fft.ifft(spectrum, axis=1)
        slide = np.abs(correlation).argmax(axis=1)
        turn = np.angle(correlation[np.arange(len(lines)), slide])
        index = (np.arange(lines.shape[1]) + slide[:, None]) % lines.shape[1]
        aligned = np.take_along_axis(aligned, index, axis=1) * np.exp(-1j * turn)[:, None]
        turns = turns + turn
        mean = aligned.mean(axis=0)
    return aligned, turns


def _heading(mean: Complex, steps: Complex) -> float:
    """Direction of the long axis of the mean outline, to the side to which the body moves.

    Without motion the heavier end is ahead, as in fish.
    """
    axis = 0.5 * float(np.angle(np.sum(mean**2)))
    ahead = float((steps * np.exp(-1j * axis)).real.sum())
    if not abs(ahead) > 0.05 * float(np.abs(steps).sum()):
        ahead = -float(((mean * np.exp(-1j * axis)).real ** 3).sum())
    return axis if ahead > 0 else axis + np.pi


def _principal_bends(rows: FloatArray, mean: FloatArray, modes: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Modes ``(M, 2K)`` in pixels for a unit bend, bends ``(S, M)`` and explained shares ``(M,)``.

    A positive bend moves the hindmost point towards growing angles.
    """
    scores, lengths, directions = np.linalg.svd(rows, full_matrices=False)
    half = len(mean) // 2
    hindmost = half + int(np.argmin(mean[:half]))
    sign = np.where(directions[:modes, hindmost] < 0, -1.0, 1.0)
    unit = np.sqrt(len(rows))
    bends = scores[:, :modes] * unit * sign
    return (
        directions[:modes] * (lengths[:modes] / unit * sign)[:, None],
        bends,
        lengths[:modes] ** 2 / np.sum(lengths**2),
    )


def _points(rows: FloatArray) -> FloatArray:
    """``(M, 2K)`` rows of all x and then all y as ``(M, K, 2)``."""
    return np.asarray(np.stack(np.split(rows, 2, axis=1), axis=2))


def _distance(rows: FloatArray) -> float:
    """Root mean square length of the vectors in ``(S, 2K)`` rows."""
    return float(np.sqrt(2.0 * np.mean(rows**2)))
