"""Learning a body from silhouettes: a mean outline and its main bending modes (`tsuiseki train body`).

Outlines are centred, sampled evenly by arc length, and aligned: each is turned, and its first point is chosen. With
points as complex numbers both follow from the peak of a circular correlation. The principal components of what is left
are the bending modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydantic import Field, PositiveInt

from tsuiseki.tracking.bodies.body import LearntBody, write_body
from tsuiseki.tracking.bodies.contour import Extraction
from tsuiseki.tracking.bodies.settings import Odd
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.formats.body_states import FOLDER, MOST_BODIES, read_silhouettes, silhouette_of
from tsuiseki.tracking.runs.options import PlottedFile
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

# Regions smaller than this are specks, in pixels.
SMALLEST_AREA = 40.0
# Whole bodies have about the area of the largest region of a usual frame, within these shares; others are specks,
# parts, or several bodies at once.
USUAL_AREA = (0.7, 1.4)


@dataclass(frozen=True)
class Outline:
    """The outline of one body in one frame.

    Attributes:
        frame: 0-based.
        identity: of the body in its clip; 0 where that is not known.
        points: ``(P, 2)`` pixels x, y along the border.
        area: of the silhouette, pixels.
        step: ``(2,)`` pixels that its centre moves until the next frame; zero where that is not known.
    """

    frame: int
    identity: int
    points: FloatArray
    area: float
    step: tuple[float, float] = (0.0, 0.0)

    @property
    def centre(self) -> FloatArray:
        """Mean of the border points ``(2,)``."""
        return np.asarray(self.points.mean(axis=0))


def outlines_of(source: Path, extraction: Extraction | None) -> list[Outline]:
    """Outlines of the whole bodies in a clip.

    Args:
        source: a clip with a folder of silhouettes, or any video or folder of images.
        extraction: what belongs to the bodies in an image; not needed with silhouettes.

    Raises:
        RequestError: there is neither, or no body is found.
    """
    if (source / FOLDER).is_dir():
        outlines = _from_silhouettes(read_silhouettes(source))
    elif extraction is not None:
        frames = open_source(source).frames()
        outlines = [
            outline for frame in frames for outline in _outlines(frame.index, 0, extraction.pixels(frame.image))
        ]
    else:
        raise RequestError(f"{source}: expected a folder {FOLDER} in it, found none; or give the bodies' `colour`")
    if not outlines:
        raise RequestError(f"{source}: expected silhouettes of whole bodies, found none")
    largest: dict[int, float] = {}
    for outline in outlines:
        largest[outline.frame] = max(outline.area, largest.get(outline.frame, 0.0))
    usual = float(np.median(list(largest.values())))
    return _with_steps([o for o in outlines if USUAL_AREA[0] * usual < o.area < USUAL_AREA[1] * usual])


def _from_silhouettes(silhouettes: ImageArray) -> list[Outline]:
    outlines = []
    for frame, picture in enumerate(silhouettes):
        for identity in range(1, MOST_BODIES + 1):
            outlines += _outlines(frame, identity, silhouette_of(picture, identity).astype(np.uint8))[:1]
    return outlines


def _outlines(frame: int, identity: int, mask: ImageArray) -> list[Outline]:
    """Those of the regions of a mask that do not touch the image's border, the largest first."""
    lines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    last = np.array([mask.shape[1] - 1, mask.shape[0] - 1])
    outlines = []
    for line in lines:
        points = line[:, 0].astype(np.float64)
        area = float(cv2.contourArea(line)) if len(line) > 2 else 0.0
        if area >= SMALLEST_AREA and points.min() > 0 and np.all(points.max(axis=0) < last):
            # A pixel's centre lies half a pixel behind its corner.
            outlines.append(Outline(frame, identity, points + 0.5, area))
    return sorted(outlines, key=lambda outline: -outline.area)


def _with_steps(outlines: list[Outline]) -> list[Outline]:
    """The outlines with their steps: to the same body of the next frame, or to the nearest near one."""
    by_frame: dict[int, list[Outline]] = {}
    for outline in outlines:
        by_frame.setdefault(outline.frame, []).append(outline)
    return [replace(outline, step=_step(outline, by_frame.get(outline.frame + 1, []))) for outline in outlines]


def _step(outline: Outline, later: list[Outline]) -> tuple[float, float]:
    same = [candidate for candidate in later if candidate.identity == outline.identity]
    steps = [candidate.centre - outline.centre for candidate in same]
    nearest = min(steps, key=lambda step: float(np.linalg.norm(step)), default=np.zeros(2))
    reach = np.sqrt(outline.area)
    return (float(nearest[0]), float(nearest[1])) if np.linalg.norm(nearest) < reach else (0.0, 0.0)


# Outlines to learn a body from, at least.
FEWEST = 10
# Outlines are lined up on this many times the points that are kept.
FINER = 4
# Times that outlines are lined up with their mean, which they change.
ROUNDS = 8
# Bends beyond those in the data are allowed by this share.
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
    residual = rows - mean - bends @ directions
    curves = np.linalg.lstsq(curved, residual, rcond=None)[0]
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
    return BodyFit(body, states, explained, spread, _distance(residual - curved @ curves))


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


# Bends that are drawn, standard deviations.
SHOWN_BENDS = (-2.0, -1.0, 0.0, 1.0, 2.0)


def plot_body(path: Path, fit: BodyFit) -> None:
    """Draws one panel for each mode: the outline at bends of -2 to 2 standard deviations, the heading to the right."""
    count = len(fit.body.modes)
    figure = Figure(figsize=(4.6 * count + 0.8, 2.7), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, count, squeeze=False, sharex=True, sharey=True)[0]
    for mode, axes in enumerate(panels):
        for bend in SHOWN_BENDS:
            state = np.zeros((1, len(fit.body.fields)))
            state[0, 3 + mode] = bend
            outline = fit.body.contour(state)[0]
            closed = np.concatenate([outline, outline[:1]])
            colour = "0.2" if bend == 0 else colormaps["coolwarm"](0.5 + bend / 5)
            width = 2.0 if bend == 0 else 1.2
            axes.plot(*closed.T, color=colour, linewidth=width, label=f"{bend:+.0f}" if bend else "0")
        axes.plot(0, 0, "+", color="0.5")
        axes.set_title(f"{fit.body.fields[3 + mode]}: {100 * fit.explained[mode]:.0f} % of the variance", fontsize=10)
        axes.set_aspect("equal")
        axes.set_xlabel("pixels, heading to the right")
    panels[0].invert_yaxis()
    figure.legend(*panels[0].get_legend_handles_labels(), title="bend", loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=100, facecolor="white")


def train_body(
    clips: list[Path],
    *,
    output: PlottedFile,
    colour: str | None = None,
    smooth: Odd = 5,
    modes: PositiveInt = 1,
    points: Annotated[int, Field(ge=8)] = 48,
) -> None:
    """Learn a body from silhouettes: its mean outline and how it bends.

    tsuiseki track deformable --body FILE.json takes the result.

    Args:
        clips: folders with silhouettes/000001.png and so on, as tsuiseki simulate goldfish makes them; with --colour
            any videos or folders of images, in which each body is mostly alone and whole.
        output.out: file to write, JSON.
        colour: of the bodies: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with
            hues in degrees.
        smooth: side in pixels of the median filter of the colour's regions, odd; 1 leaves it out.
        modes: bends that the body has, the most important ones.
        points: of the contour.
        output.plot: also draw the mean outline and the modes into this file (PNG, SVG or PDF).
    """
    extraction = Extraction(parse_colour(colour), smooth) if colour is not None else None
    outlines = [outline for clip in clips for outline in outlines_of(clip, extraction)]
    fit = learn_body(outlines, modes, points, output.out.stem)
    output.write(output.out, lambda path: write_body(path, fit.body))
    output.draw(lambda path: plot_body(path, fit))
    shares = ", ".join(f"{100 * share:.0f}" for share in fit.explained)
    print(
        f"learnt from {len(outlines)} silhouettes, which vary by {fit.spread:.1f} pixels; the modes ({shares} %) "
        f"leave {fit.residual:.1f}: {output.out}"
    )
