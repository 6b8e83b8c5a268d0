"""A thrown ball from its measured pixels, with drag and spin known or not (`reproduce sphere-points`)."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.sphere_clip import ball_cameras
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.sphere.run import track_sphere_points
from tsuiseki.tracking.sphere.settings import SphereSettings
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.study import (
    Bench,
    Column,
    Name,
    Outcome,
    Study,
    at_least_one,
    at_quantile,
    tabulated,
    with_interval,
)

RATE, FRAMES = 60.0, 45
GRAVITY, RADIUS, BOUNCE = 9.81, 0.02, 0.75
DRAG, SPIN = 0.1, (-2.0, 0.0, 0.0)
"""Of a table tennis ball with top spin: 1/m, 1/s."""
PIXEL, MISSED, FALSE = 1.0, 0.05, 0.02
"""Standard deviation of a measured pixel, and shares of frames without one and with one anywhere in the image."""
STEP = 1e-4
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


def reproduce(bench: Bench, seeds: int = 20, seed: int = 0) -> Outcome:
    """A thrown ball by its pixels in two cameras: what knowing gravity, drag and spin is worth.

    DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        seeds: throws.
        seed: of the first.

    Raises:
        RequestError: no throw.
    """
    at_least_one(seeds=seeds)
    found = Study(ROWS, range(seed, seed + seeds), run_throw, "throws").run(bench)
    note = (
        f"{seeds} throws of {FRAMES} frames at {RATE:g} frames/s, two cameras; pixels {PIXEL:g} px off, "
        f"{100 * MISSED:.0f} % missed, {100 * FALSE:.0f} % false; drag {DRAG:g} 1/m, top spin {-SPIN[0]:g} 1/s."
    )
    values = {name: [one.tolist() for one in throws] for name, throws in found.items()}
    return Outcome(values, [tabulated(found, COLUMNS)], notes=[note])


def thrown(seed: int) -> tuple[FloatArray, FloatArray]:
    """A throw across the room that bounces once, and what two cameras measured of it.

    Returns:
        ``(T, 3)`` metres, by small steps of its own; ``(2, T, 2)`` pixels, NaN where nothing was measured.
    """
    rng = np.random.default_rng(seed)
    place = np.array([0.0, -1.3, 1.0]) + rng.uniform(-0.15, 0.15, 3)
    speed = np.array([rng.uniform(-0.5, 0.5), rng.uniform(3.5, 5.0), rng.uniform(0.5, 2.0)])
    truth = np.empty((FRAMES, 3))
    steps = round(1 / (RATE * STEP))
    for frame in range(FRAMES):
        truth[frame] = place
        for _ in range(steps):
            gained = np.cross(SPIN, speed) - DRAG * np.linalg.norm(speed) * speed - [0.0, 0.0, GRAVITY]
            place = place + speed / (RATE * steps)
            speed = speed + gained / (RATE * steps)
            if place[2] < RADIUS and speed[2] < 0:
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
        found = track_sphere_points(
            files, Path(folder) / "cameras.yaml", settings=settings, deviation=PIXEL, radius=RADIUS, seed=seed
        )
    frames = np.array([round(position.time * RATE) for position in found])
    known = np.array([position.point for position in found])
    inside = frames < FRAMES
    return np.asarray(np.linalg.norm(known[inside] - truth[frames[inside]], axis=1))
