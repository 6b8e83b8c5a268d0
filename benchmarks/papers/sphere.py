"""Section 3 of the sphere paper (`stereo-sphere`): a ball in space from two cameras, paper beside here.

A ball is moved by hand before several cameras and followed in several ways against the exact truth. All rows of one
kind of film see the same images, one film a seed; the filter's parameters are the same for all seeds.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.plots import Curve, curves
from benchmarks.papers.store import Cached
from benchmarks.papers.tables import Column, Name, at_quantile, tabulated, values_of, with_interval
from tsuiseki.datamodules.scenes.sphere_clip import CarriedBallSettings, SphereClip, ball_cameras
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.space import distance_to_path
from tsuiseki.tracking.filters.base import Motion
from tsuiseki.tracking.filters.resampling import Covering
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.sphere import views
from tsuiseki.tracking.sphere.points import track_sphere_points, triangulate
from tsuiseki.tracking.sphere.settings import SphereSettings, chosen_motion
from tsuiseki.tracking.sphere.tracker import SphereTracker, TimedViews
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class DistanceScores:
    """Summary of distances, metres; their deviation is the standard deviation."""

    mean: float
    maximum: float
    deviation: float
    median: float
    count: int


def distance_scores(distances: FloatArray) -> DistanceScores:
    """The summary of distances ``(T,)``.

    Raises:
        ValueError: there is none.
    """
    if len(distances) == 0:
        raise ValueError("expected at least one distance, got none")
    return DistanceScores(
        float(distances.mean()),
        float(distances.max()),
        float(distances.std()),
        float(np.median(distances)),
        len(distances),
    )


RADIUS = 0.10
"""Of the ball, metres; seen from 4 m it is 35 pixels across."""
PAPER, OURS = SphereSettings(preset="paper"), SphereSettings()
WALK, FLIGHT = chosen_motion(PAPER, RADIUS), chosen_motion(OURS, RADIUS)
"""Of `track sphere --preset paper` and of `track sphere`; with them the rows are what the command runs."""
FIRST_COVERED = 30
"""The first frame in which a board covers the first camera."""
PAPER_FRAME = 20
"""The frame of figures 2 and 5, counted from 1."""
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20)

LIKELIHOODS: Mapping[str, Callable[[Sequence[PinholeCamera], float, Sequence[ImageArray]], views.ViewLikelihood]] = {
    "background": lambda cameras, _, empty: views.BackgroundLikelihood(cameras, empty),
    "printed": lambda cameras, radius, _: views.PrintedContourLikelihood(cameras, radius),
    "printed, fourth power": lambda cameras, radius, _: views.PrintedContourLikelihood(cameras, radius, power=4.0),
    "contour": lambda cameras, radius, _: views.SphereContourLikelihood(cameras, radius),
    "faint": lambda cameras, radius, _: views.SphereContourLikelihood(cameras, radius, faint=True),
}
"""From C cameras, the radius in metres and C pictures of the empty scene."""


@dataclass(frozen=True)
class FilmRow:
    """One way to track a film.

    Attributes:
        likelihood: one of `LIKELIHOODS`.
        motion: as section 2.1, or with velocity.
        particles: how many.
        cameras: the first so many.
        covered: frames from `FIRST_COVERED` on in which a board covers the first camera.
        notices: whether covered cameras are recognised.
        stages: of weighing in a step.
        camera_error: turns each camera so far that the middle of its image moves by so many pixels.
        radius_error: of the radius that the tracker gets, over the true one.
        film: fields of `CarriedBallSettings` that differ from its defaults.
    """

    likelihood: str = "contour"
    motion: Motion = WALK
    particles: int = OURS.particles
    cameras: int = 2
    covered: int = 0
    notices: bool = True
    stages: int = 2
    camera_error: float = 0.0
    radius_error: float = 0.0
    film: Mapping[str, Any] = field(default_factory=dict)


Group = Literal["section 3", "disturbed", "particles", "cameras", "covered"]
VARIED = ("particles", "cameras", "covered")
at_once = partial(FilmRow, notices=False, stages=1)
"""As the paper does it."""
DISTURBANCES: Mapping[str, Mapping[str, Any]] = {
    "exact cameras and radius, no blur, one clock": {},
    **{f"cameras turned by {p:g} px": {"camera_error": p} for p in (1.0, 2.0, 5.0)},
    **{f"radius {100 * r:+.0f} %": {"radius_error": r} for r in (0.05, 0.1)},
    **{f"out of focus, {s:g} px": {"film": {"defocus": s}} for s in (2.0, 4.0)},
    "smeared, exposure 1/15 s": {"film": {"exposure": 1 / 15}},
    "camera 2 late by 1/30 s": {"film": {"lateness": (0.0, 1 / 30)}},
}
"""What films of real cameras have and the others have not."""
WAYS: Mapping[tuple[Group, str], FilmRow] = {
    ("section 3", "background, as printed (2.2.1): `--preset paper --likelihood background`"): at_once("background"),
    ("section 3", "contour, as printed (2.2.2): `--preset paper`"): at_once("printed"),
    ("section 3", "contour, to the fourth power"): at_once("printed, fourth power"),
    ("section 3", "contour, an exponential over normalised rays"): at_once("contour"),
    ("section 3", "+ two stages of weighing"): FilmRow(notices=False),
    ("section 3", "+ covered cameras noticed"): FilmRow(),
    ("section 3", "+ a velocity: `track sphere`"): FilmRow(motion=FLIGHT),
    **{
        ("disturbed", f"{name}{suffix}"): make(**change)
        for name, change in DISTURBANCES.items()
        for suffix, make in (("", partial(FilmRow, motion=FLIGHT)), (", as printed", partial(at_once, "printed")))
    },
    **{
        ("disturbed", f"out of focus, {blur:g} px, `--faint true`"): FilmRow("faint", FLIGHT, film={"defocus": blur})
        for blur in (2.0, 4.0)
    },
    **{("particles", f"{n}"): FilmRow(particles=n) for n in (50, 100, 200, 500, 1000, 2000)},
    **{("cameras", f"{n}"): FilmRow(cameras=n) for n in (2, 3, 4, 6)},
    **{
        ("covered", f"{n} frames, {name}"): FilmRow("contour", FLIGHT, 500, cameras, n, notices)
        for name, cameras, notices in (
            ("2 cameras", 2, True),
            ("3 cameras", 3, True),
            ("3 cameras, every view trusted", 3, False),
        )
        for n in (0, 5, 10, 20, 40)
    },
}
"""Everything that is compared, by table and row."""
BACKGROUND, PRINTED = list(WAYS)[:2]
PAPER_ERRORS: Mapping[str, Mapping[Name, float]] = {
    "mean": {BACKGROUND[1]: 20.0, PRINTED[1]: 3.20},
    "maximum": {BACKGROUND[1]: 29.5, PRINTED[1]: 4.88},
    "deviation": {BACKGROUND[1]: 9.90, PRINTED[1]: 1.03},
}
"""Distance to the path in the paper's film, cm (section 3)."""
FilmErrors: TypeAlias = Mapping[str, DistanceScores]
"""Of one way on one film: ``to_position`` at the same time, and ``to_path``, the paper's error."""


def reproduce(
    *,
    store: Cached,
    seeds: PositiveInt = 3,
    frames: PositiveInt = 100,
    only: Group | Literal["varied"] | None = None,
    seed: NonNegativeInt = 0,
) -> Outcome:
    """Section 3 of the sphere paper: a ball moved by hand, by background difference and by outline, paper beside here.

    The contour likelihood is there as printed, and with what is added. DIR gets results.json, tables.md, figures 2 and
    5 as pictures.png, and errors.png.

    Args:
        store: of what was computed.
        seeds: number of films, each with its own room, person, ball and noise.
        frames: of each film.
        only: one table alone: section 3; or disturbed, the error with inexact cameras and radius, blur and clocks that
            differ; or the error against particles, cameras or covered frames, or varied: these three and their figure.
        seed: of the first film; the others follow.

    Raises:
        RequestError: films of a single frame.
    """
    if frames < 2:
        raise RequestError(f"`frames`: expected at least 2, got {frames}")
    groups = {None: get_args(Group), "varied": VARIED}.get(only, (only,))
    ways = {name: way for name, way in WAYS.items() if name[0] in groups}
    measured: dict[tuple[str, str], list[FilmErrors]] = {name: [] for name in ways}
    # A film has two cameras for those that are disturbed, else as many as any of the ways on it needs.
    films: dict[str, dict[tuple[Group, str], FilmRow]] = {}
    for name, way in ways.items():
        films.setdefault(repr((name[0] == "disturbed", way.film)), {})[name] = way
    for number in range(seed, seed + seeds):
        for ways_of in films.values():
            rows = list(ways_of.values())
            film = CarriedBallSettings(cameras=max(way.cameras for way in rows), frames=frames, **rows[0].film)
            errors = store.recall(run_film, number, film, rows)
            for name, film_errors in zip(ways_of, errors, strict=True):
                measured[name].append(film_errors)
    tables = [
        tabulated(
            {label: errors for (of, label), errors in measured.items() if of == group},
            _columns(group),
            (group,),
            group.capitalize(),
        )
        for group in groups
    ]
    plots = {"errors": errors_figure(measured)} if set(groups) >= set(VARIED) else {}
    if "section 3" in groups:
        plots["pictures"] = pictures_figure(SphereClip(CarriedBallSettings(frames=frames), seed))
    note = f"Errors in cm over {seeds} films: mean over films of mean and sd, greatest max; 95 % by Student's t."
    return Outcome(values_of(measured, ("group", "name")), tables, plots, notes=[note])


def _columns(group: str) -> list[Column]:
    columns = []
    for kind, label in (("to_position", "to position: "), ("to_path", "to path: ")):
        paper = PAPER_ERRORS if (group, kind) == ("section 3", "to_path") else {}
        columns += [
            Column(f"{label}mean, 95 % over films", f"{kind}.mean", ".2f", 100, with_interval, paper.get("mean", {})),
            Column("max", f"{kind}.maximum", ".2f", 100, partial(at_quantile, share=1.0), paper.get("maximum", {})),
            Column("sd", f"{kind}.deviation", ".2f", 100, paper=paper.get("deviation", {})),
        ]
    return columns


def run_film(seed: int, settings: CarriedBallSettings, ways: Sequence[FilmRow]) -> list[FilmErrors]:
    """The errors of every way on the film of ``seed``.

    Args:
        seed: of room, person, noise and particles.
        settings: of the film.
        ways: all of one kind of film.
    """
    scene = SphereClip(settings, seed)
    empty = scene.backgrounds()
    runs, points = [], [list[FloatArray]() for _ in ways]
    for way in ways:
        wrong, particles_rng = np.random.default_rng((seed, 5)), np.random.default_rng((seed, 4))
        cameras = [turned(camera, way.camera_error, wrong) for camera in scene.cameras[: way.cameras]]
        radius = scene.settings.radius * (1 + way.radius_error)
        likelihood = LIKELIHOODS[way.likelihood](cameras, radius, empty[: way.cameras])
        tracker = SphereTracker(likelihood, way.motion, Covering() if way.notices else None, stages=way.stages)
        # The paper measures where the ball is at the start.
        begin = scene.truth[0], OURS.spread, way.particles, way.cameras, particles_rng, float(scene.times[0])
        runs.append((tracker, tracker.start_at(*begin), particles_rng))
    hidden = [range(FIRST_COVERED, FIRST_COVERED + way.covered) for way in ways]
    rng = np.random.default_rng((seed, 3))
    for index, (images, _) in enumerate(progress(scene.frames(), f"film {seed}", settings.frames)):
        board = scene.covered_image(0, rng) if any(index in frames for frames in hidden) else None
        for n, (tracker, state, particles_rng) in enumerate(runs):
            views_shown = list(images[: ways[n].cameras])
            if board is not None and index in hidden[n]:
                views_shown[0] = board
            state, info = tracker.step(state, TimedViews(float(scene.times[index]), views_shown), particles_rng)
            runs[n] = tracker, state, particles_rng
            points[n].append(info.point)
    paths = [np.array(particles_rng) for particles_rng in points]
    off = [np.sqrt(np.square(path - scene.truth).sum(axis=1)) for path in paths]
    along = [distance_to_path(path, scene.truth) for path in paths]
    return [{"to_position": distance_scores(a), "to_path": distance_scores(b)} for a, b in zip(off, along, strict=True)]


def turned(camera: PinholeCamera, pixels: float, rng: np.random.Generator) -> PinholeCamera:
    """The camera turned in a random direction so far that the middle of its image moves by ``pixels``."""
    direction = rng.uniform(0, 2 * np.pi)
    angle = float(np.arctan(pixels / camera.focal.mean()))
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    return replace(camera, rotation=Rotation.from_rotvec(angle * axis).as_matrix() @ camera.rotation)


def pictures_figure(scene: SphereClip) -> Figure:
    """Figures 2 and 5: what two cameras show at one moment, and its difference from the empty scene."""
    number = min(PAPER_FRAME, scene.settings.frames)
    images, _ = next(islice(scene.frames(), number - 1, None))
    figure = Figure(figsize=(9, 7), dpi=80, layout="constrained")
    panels = figure.subplots(2, 2)
    for place, (image, background) in enumerate(zip(images[:2], scene.backgrounds(), strict=False)):
        difference = np.sqrt(np.square(image.astype(np.float64) - background).sum(axis=2))
        panels[0, place].imshow(image)
        panels[0, place].set_title(f"Figure 2 ({'ab'[place]}): camera {place + 1}, frame {number}", fontsize=9)
        panels[1, place].imshow(difference, cmap="gray", vmin=0, vmax=200)
        panels[1, place].set_title(f"Figure 5 ({'ab'[place]}): difference from the background", fontsize=9)
    for axes in panels.ravel():
        axes.set_axis_off()
    return figure


def errors_figure(measured: Mapping[tuple[str, str], Sequence[FilmErrors]]) -> Figure:
    """The mean error against particles, cameras and covered frames."""
    panels: dict[str, list[Curve]] = {}
    for group in VARIED:
        lines: dict[str, list[tuple[float, float]]] = {}
        for (of, label), films in measured.items():
            if of == group:
                number, _, line = label.partition(" frames, ")
                mean = 100 * float(np.mean([film["to_position"].mean for film in films]))
                lines.setdefault(line or "`track sphere`", []).append((float(number), mean))
        panels[group] = [Curve(name, [x for x, _ in line], [y for _, y in line]) for name, line in lines.items()]
    across = ("particles", "cameras", "covered frames of camera 1")
    figure = curves(panels, across, "mean distance to the true position, cm", (3.7, 3.4))
    for axes in figure.axes:
        axes.set_yscale("log")
        axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
        axes.minorticks_off()
    numbers = panels["particles"][0].x
    figure.axes[0].set_xscale("log")
    figure.axes[0].set_xticks(numbers, [f"{number:g}" for number in numbers])
    return figure


RATE, FRAMES = 60.0, 45
GRAVITY, BALL, BOUNCE = 9.81, 0.02, 0.75
DRAG, SPIN = 0.1, (-2.0, 0.0, 0.0)
"""Of a table tennis ball with top spin: 1/m, 1/s."""
PIXEL, MISSED, FALSE = 1.0, 0.05, 0.02
"""Standard deviation of a measured pixel, and shares of frames without one and with one anywhere in the image."""
POINT_STEP = 1e-4
BALLISTIC = SphereSettings(motion="ballistic", bounce=BOUNCE)
ROWS: Mapping[Name, SphereSettings | None] = {
    "triangulated, where both cameras measured": None,
    "`--points`": SphereSettings(),
    "`--motion ballistic`": BALLISTIC,
    "`--motion ballistic --drag`": SphereSettings(motion="ballistic", bounce=BOUNCE, drag=DRAG),
    "`--motion ballistic --drag --spin`": SphereSettings(motion="ballistic", bounce=BOUNCE, drag=DRAG, spin=SPIN),
}
COLUMNS = (
    Column("error, cm: mean of the throws, 95 %", np.mean, factor=100, show=with_interval),
    *(
        Column(heading, np.asarray, factor=100, show=partial(at_quantile, share=share))
        for heading, share in (("median", 0.5), ("95 % of the moments", 0.95), ("largest", 1.0))
    ),
)


def points(*, store: Cached, seeds: PositiveInt = 20, seed: NonNegativeInt = 0) -> Outcome:
    """A thrown ball by its pixels in two cameras: what knowing gravity, drag and spin is worth.

    DIR gets results.json and tables.md.

    Args:
        store: of what was computed.
        seeds: throws.
        seed: of the first.
    """
    rows = {name: partial(run_throw, row) for name, row in ROWS.items()}
    measured = store.study(rows, range(seed, seed + seeds), "throws")
    note = (
        f"{seeds} throws of {FRAMES} frames at {RATE:g} frames/s, two cameras; pixels {PIXEL:g} px off, "
        f"{100 * MISSED:.0f} % missed, {100 * FALSE:.0f} % false; drag {DRAG:g} 1/m, top spin {-SPIN[0]:g} 1/s."
    )
    return Outcome(measured, [tabulated(measured, COLUMNS, ("filter",), "Thrown balls")], notes=[note])


def thrown(seed: int) -> tuple[FloatArray, FloatArray]:
    """A throw across the room that bounces once, and what two cameras measured of it.

    Returns:
        ``(T, 3)`` metres, by small steps of its own; ``(2, T, 2)`` pixels, NaN where nothing was measured.
    """
    rng = np.random.default_rng(seed)
    place = np.array([0.0, -1.3, 1.0]) + rng.uniform(-0.15, 0.15, 3)
    speed = np.array([rng.uniform(-0.5, 0.5), rng.uniform(3.5, 5.0), rng.uniform(0.5, 2.0)])
    truth = np.empty((FRAMES, 3))
    steps = round(1 / (RATE * POINT_STEP))
    for frame in range(FRAMES):
        truth[frame] = place
        for _ in range(steps):
            gained = np.cross(SPIN, speed) - DRAG * np.linalg.norm(speed) * speed - [0.0, 0.0, GRAVITY]
            place = place + speed / (RATE * steps)
            speed = speed + gained / (RATE * steps)
            if place[2] < BALL and speed[2] < 0:
                speed[2] *= -BOUNCE
    pixels = np.stack([camera.project(truth)[0] for camera in ball_cameras(2)])
    size = [ball_cameras(1)[0].width, ball_cameras(1)[0].height]
    pixels += PIXEL * rng.standard_normal(pixels.shape)
    wild = rng.random(pixels.shape[:2]) < FALSE
    pixels[wild] = rng.uniform(0, size, (int(wild.sum()), 2))
    outside = ((pixels < 0) | (pixels > size)).any(axis=2)
    pixels[outside | (rng.random(pixels.shape[:2]) < MISSED)] = np.nan
    return truth, pixels


def run_throw(settings: SphereSettings | None, seed: int) -> FloatArray:
    """``(T,)`` distances to the truth, metres, as `track sphere --points` finds them.

    Args:
        settings: one of `ROWS`.
        seed: of the throw and of the particles.
    """
    (truth, measured), cameras = thrown(seed), ball_cameras(2)
    if settings is None:
        points, _ = triangulate(cameras, measured.transpose(1, 0, 2))
        away = np.linalg.norm(points - truth, axis=1)
        return np.asarray(away[np.isfinite(away)])
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"camera{number}.csv" for number in (1, 2)]
        for path, pixels in zip(files, measured, strict=True):
            rows = [f"{k + 1},{x},{y}" for k, (x, y) in enumerate(pixels.tolist()) if np.isfinite(x)]
            path.write_text("\n".join(["frame,x,y", *rows]) + "\n", encoding="utf-8")
        placed = [PlacedCamera(f"camera{number}", camera, RATE) for number, camera in enumerate(cameras, start=1)]
        write_cameras(Path(folder) / "cameras.yaml", placed)
        positions = track_sphere_points(
            files, Path(folder) / "cameras.yaml", settings=settings, deviation=PIXEL, radius=BALL, seed=seed
        )
    frames = np.array([round(position.time * RATE) for position in positions])
    located = np.array([position.point for position in positions])
    inside = frames < FRAMES
    return np.asarray(np.linalg.norm(located[inside] - truth[frames[inside]], axis=1))
