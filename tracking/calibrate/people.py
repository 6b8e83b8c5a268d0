"""Cameras from the people who walk in them, and what these people say of cameras that there are.

See `cameras.people_fit` and `cameras.people_bundle`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, Placed, read_cameras, write_cameras
from tsuiseki.tracking.cameras.people_bundle import placed, refined
from tsuiseki.tracking.cameras.people_fit import HEIGHT_SPREAD, fit_view
from tsuiseki.tracking.cameras.people_views import (
    DRIFT,
    OFFSET,
    STEP,
    PeopleView,
    align,
    feet,
    on_floor,
    picture,
    pinhole,
    places_at,
    view_of,
)
from tsuiseki.tracking.errors import InputWarning, RequestError, a_path
from tsuiseki.tracking.people.tracks_of_source import boxes_of, frame_times, name_of, rates_of, tracked
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Source: TypeAlias = str | Path | Result[Track]
# Metres to the farthest places that are matched and shown.
FARTHEST = 60.0
# Metres of error from which on a camera is said to be wrong.
WRONG = 0.3
# Metres of floor around the people.
ROOM = 1.0
# Half the width of a normal interval of 95 %, standard deviations.
NORMAL_95 = 1.96
UNITS = {"focal": " px", "height": " m", "x": " m", "y": " m", "offset": " s"} | dict.fromkeys(
    ("tilt", "roll", "turn"), "°"
)


@dataclass(frozen=True)
class PeopleCalibration:
    """Cameras over one floor, below the first of them and ahead of it along +y.

    Attributes:
        views: the people in each of C cameras.
        numbers: ``(C, 11)``, see `people_views.NUMBERS`.
        deviations: ``(C, 11)`` standard deviations.
        errors: ``(C,)`` median metres between a camera's people and the others'; NaN for a single camera.
        height: of people on average, metres.
        frame_rates: frames a second of each source, where the user says them.
    """

    views: Sequence[PeopleView]
    numbers: FloatArray
    deviations: FloatArray
    errors: FloatArray
    height: float
    frame_rates: Sequence[float | None] = ()

    @property
    def cameras(self) -> list[CameraOverFloor]:
        """For `cameras.yaml`; the floor is where people walk."""
        places = np.concatenate([self.places(k) for k in range(len(self.views))])
        places = places[np.abs(places - np.median(places.real) - 1j * np.median(places.imag)) < FARTHEST]
        low, high = (np.array([np.percentile(v, q) for v in (places.real, places.imag)]) for q in (1, 99))
        floor = np.round(np.concatenate([low - ROOM, high + ROOM]), 1)
        cameras: list[CameraOverFloor] = []
        for k, (view, camera) in enumerate(zip(self.views, self.numbers, strict=True)):
            rate = self.frame_rates[k] if self.frame_rates else None
            if camera[DRIFT]:
                rate = view.frame_rate / (1 + camera[DRIFT])
            cameras.append(Placed(view.name, pinhole(camera, view.size), rate, float(camera[OFFSET]), floor))
        return cameras

    def places(self, camera: int) -> FloatArray:
        """``(N,)`` complex metres where the people of a camera are."""
        return on_floor(self.numbers[camera], self.views[camera].boxes, self.height)

    def _rows(self, camera: int) -> list[tuple[str, float, float]]:
        """Name, value and half width of the 95 % interval of each value of a camera; metres, degrees, pixels, s."""
        x, half = self.numbers[camera].copy(), NORMAL_95 * self.deviations[camera]
        x[[0, 5]] = np.exp(x[[0, 5]])
        half[[0, 5]] *= x[[0, 5]]
        x[[3, 4, 6]], half[[3, 4, 6]] = np.degrees(x[[3, 4, 6]]), np.degrees(half[[3, 4, 6]])
        columns = {"focal": 0, "height": 5, "tilt": 3, "roll": 4}
        if len(self.views) > 1:
            columns |= {"x": 7, "y": 8, "offset": OFFSET, "turn": 6}
        return [(name, float(x[k]), float(half[k])) for name, k in columns.items()]

    def described(self) -> list[str]:
        """A line for each camera."""
        lines = []
        for k, view in enumerate(self.views):
            values = ", ".join(
                f"{name} {v:.{digits(w)}f} ± {w:.{digits(w)}f}{UNITS[name]}" for name, v, w in self._rows(k)
            )
            error = f", {self.errors[k]:.2f} m from the others' people" if np.isfinite(self.errors[k]) else ""
            lines.append(f"{view.name}: {view.count} people, {values}{error}")
        return lines

    def plan(self) -> Figure:
        """The floor from above: cameras, their directions, and paths of people."""
        from matplotlib.figure import Figure

        from tsuiseki.tracking.report.plots import COLOURS

        figure = Figure(figsize=(7, 7), layout="constrained")
        axes = figure.subplots()
        for k, (view, camera) in enumerate(zip(self.views, self.numbers, strict=True)):
            colour, paths = COLOURS[k % len(COLOURS)], self.places(k)
            paths = np.where(np.abs(paths - camera[7] - 1j * camera[8]) < FARTHEST, paths, np.nan)
            ends = np.flatnonzero(np.diff(view.people)) + 1
            broken = np.insert(paths, ends, np.nan)
            axes.plot(broken.real, broken.imag, color=colour, linewidth=0.6, alpha=0.6)
            ahead = 1j * np.exp(1j * camera[6])
            axes.plot(camera[7], camera[8], "o", color=colour, label=view.name)
            axes.annotate("", (camera[7] + 2 * ahead.real, camera[8] + 2 * ahead.imag), (camera[7], camera[8]),
                          arrowprops={"arrowstyle": "->", "color": colour})  # fmt: skip
        axes.set_aspect("equal")
        axes.set_xlabel("metres to the right of the first camera")
        axes.set_ylabel("metres ahead of it")
        axes.legend(frameon=False)
        return figure

    def write(self, path: Path) -> None:
        """`cameras.yaml`, with the intervals beside each camera."""
        rows = [self._rows(k) for k in range(len(self.views))]
        halves = [{"interval_95": {name: round(half, 4) for name, _, half in values}} for values in rows]
        write_cameras(path, self.cameras, halves)


def digits(width: float) -> int:
    """After the point, for a value with an interval of this half width."""
    return int(np.clip(1 - np.floor(np.log10(max(width, 1e-9))), 0, 3))


def calibrate_people(
    sources: Sequence[Source],
    person_height: float = 1.7,
    reach: float = 30.0,
    frame_rates: Sequence[float] | None = None,
    image_size: tuple[int, int] | None = None,
) -> PeopleCalibration:
    """Where cameras are and how they see, from the people who walk in them.

    Args:
        sources: one a camera, see `people.tracks_of_source.tracked`.
        person_height: of people on average, metres.
        reach: largest difference of two clocks, seconds.
        frame_rates: frames a second, of all sources or of each, where a source does not say.
        image_size: width and height of the pictures, where a source does not say.

    Raises:
        RequestError: a source cannot be read, two are the same, too few people or only at one distance, or a
            camera sees too few together with the others.
    """
    if not 0.3 < person_height < 3:
        raise RequestError(f"expected a person's height in metres, got {person_height}")
    if not sources:
        raise RequestError("expected a source or more, got none")
    rates = rates_of(frame_rates, len(sources))
    names = [name_of(source) for source in sources]
    if len({*names}) < len(names):
        names = [f"{k + 1} {name}" for k, name in enumerate(names)]
    views = [_view(*row, image_size) for row in zip(names, sources, rates, strict=True)]
    for a, b in combinations(views, 2):
        if len(a.boxes) and a.boxes.shape == b.boxes.shape and np.allclose(a.boxes, b.boxes):
            raise RequestError(f"expected a source for each camera, got the same people in {a.name} and {b.name}")
    numbers, deviations = map(np.stack, zip(*(fit_view(view, person_height) for view in views), strict=True))
    errors = np.full(len(views), np.nan)
    if len(views) > 1:
        together = _together(views, numbers, person_height, reach)
        numbers, deviations, errors = refined(views, together, person_height)
    calibration = PeopleCalibration(views, numbers, deviations, errors, person_height, rates)
    _warn(calibration)
    return calibration


def _view(
    name: str, source: str | Path | Result[Track], rate: float | None, size: tuple[int, int] | None
) -> PeopleView:
    result = tracked(source)
    rate = rate or result.frame_rate
    size = result.size or size
    if not rate:
        raise RequestError(f"{name}: expected its frames a second, which the source does not say; give `fps`")
    if size is None:
        raise RequestError(
            f"{name}: expected the size of its pictures, which the source does not say; give `image_size`"
        )
    return view_of(name, boxes_of(result), size, rate, frame_times(result, rate))


def _together(views: Sequence[PeopleView], numbers: FloatArray, height: float, reach: float) -> FloatArray:
    """The cameras over one floor, by aligning each two of them."""
    clocks = [view.times for view in views]
    length = min(np.ptp(clock) for clock in clocks)
    lags = int(min(reach, length / 2) / STEP)
    times = np.arange(min(map(np.min, clocks)), max(map(np.max, clocks)) + lags * STEP + STEP, STEP)
    paths = []
    for view, camera in zip(views, numbers, strict=True):
        places = feet(camera, view.boxes, height)
        places[np.abs(places) > FARTHEST] = np.nan
        paths.append(places_at(view, places, times))
    alignments = {}
    for i, j in combinations(range(len(views)), 2):
        alignment = align(paths[i], paths[j], lags)
        if alignment is not None:
            alignments[i, j] = alignment
    return placed(numbers, [view.name for view in views], alignments)


def _warn(calibration: PeopleCalibration) -> None:
    """Say which cameras the people contradict, and whose clocks run apart."""
    for k, (view, camera) in enumerate(zip(calibration.views, calibration.numbers, strict=True)):
        if calibration.errors[k] > WRONG:
            message = f"{view.name}: its people are {calibration.errors[k]:.2f} m from where the other cameras see them"
            warnings.warn(f"{message}; is its lens distorted, or its floor another?", InputWarning, stacklevel=3)
        if camera[DRIFT]:
            gone, rate = abs(camera[DRIFT]) * np.ptp(view.times), view.frame_rate / (1 + camera[DRIFT])
            message = f"{view.name}: its clock runs apart from the first one's, by {gone:.2f} s over the video"
            warnings.warn(f"{message}; frame_rate {rate:.4g} is written for it", InputWarning, stacklevel=3)


@dataclass(frozen=True)
class Disagreement:
    """What the people say about a camera.

    Attributes:
        name: of the camera.
        error: median metres between where it puts people and where they are.
        height: metres that people are high by it, in the median.
        offset: seconds by which its clock is wrong.
        wrong: whether it contradicts them.
    """

    name: str
    error: float
    height: float
    offset: float
    wrong: bool

    def __str__(self) -> str:
        text = f"{self.error:.2f} m from the people, {self.height:.2f} m high by it, clock off by {self.offset:.3f} s"
        return f"{self.name}: {'disagrees with the people: ' if self.wrong else 'agrees: '}{text}"


def check_cameras(
    cameras: Sequence[CameraOverFloor] | str | Path, calibration: PeopleCalibration
) -> list[Disagreement]:
    """Compare cameras with those that people give.

    Their floor is laid on the one of the people by the turn and shift that most cameras agree with.

    Args:
        cameras: in the order of the sources, or their file.
        calibration: from the same sources.

    Raises:
        RequestError: there is another number of cameras, or a camera sees none of its people on the floor.
    """
    cameras = cameras if isinstance(cameras, list | tuple) else read_cameras(a_path(cameras, "cameras"))
    if len(cameras) != len(calibration.views):
        raise RequestError(f"`cameras`: expected {len(calibration.views)} cameras, one a source, got {len(cameras)}")
    places = [_by_both(camera, calibration, k) for k, camera in enumerate(cameras)]
    heights = np.array([height for *_, height in places])
    away = []
    for theirs, ours, _ in places:
        middle, centre = theirs.mean(), ours.mean()
        turn = np.exp(1j * np.angle(np.vdot(ours - centre, theirs - middle)))
        away.append([float(np.median(np.abs(turn * (b - centre) + middle - a))) for a, b, _ in places])
    # Of equals, such as each of two cameras, the one by which people are as high as people are.
    unlike = np.abs(np.log(heights / calibration.height))
    best = int(np.argmin(np.minimum(away, 5 * WRONG).sum(axis=1) + 0.01 * unlike))
    late = np.array([camera.offset for camera in cameras]) - calibration.numbers[:, OFFSET]
    late -= late[best]
    frame = np.array([0.5 / view.frame_rate for view in calibration.views])
    limit = HEIGHT_SPREAD / calibration.height
    wrong = (
        (np.array(away[best]) > WRONG)
        | (np.abs(late) > frame + 3 * calibration.deviations[:, OFFSET])
        | (unlike > limit)
    )
    columns = ([camera.name for camera in cameras], away[best], heights.tolist(), late.tolist(), wrong.tolist())
    return [Disagreement(*row) for row in zip(*columns, strict=True)]


def _by_both(entry: CameraOverFloor, calibration: PeopleCalibration, k: int) -> tuple[FloatArray, FloatArray, float]:
    """Places of the same people by a camera and by the people, complex metres; their height by the camera."""
    ours, view, person, camera = calibration.places(k), calibration.views[k], calibration.height, calibration.numbers[k]
    if (entry.camera.width, entry.camera.height) != view.size:
        size = f"{entry.camera.width}x{entry.camera.height}"
        raise RequestError(f"{entry.name}: expected pictures of {size} by `cameras`, got {view.size[0]}x{view.size[1]}")
    theirs = entry.camera.ground(picture(camera, feet(camera, view.boxes, person), 0.0))
    near = np.abs(ours - camera[7] - 1j * camera[8])
    good = np.isfinite(theirs).all(axis=1) & (near <= np.median(near))
    if not good.any():
        raise RequestError(f"{entry.name}: expected people on the floor before the camera, found none; check its pose")
    top = entry.camera.project(theirs + np.array([0, 0, person]))[0][:, 1]
    height = float(person * np.nanmedian(view.heights / (view.boxes[:, 3] - top)))
    return theirs[good, 0] + 1j * theirs[good, 1], ours[good], height
