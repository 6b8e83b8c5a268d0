"""The noise of a body's motion and of its edges by maximum likelihood, from films that are drawn by the model."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.tracking.points.test_fit import at_the_start
from tsuiseki.tracking.bodies import run
from tsuiseki.tracking.bodies.body import Goldfish
from tsuiseki.tracking.bodies.contour import wide_noise
from tsuiseki.tracking.bodies.run import fit_noise
from tsuiseki.tracking.bodies.settings import BodyChoice, DeformableSettings
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

FISH = Goldfish()
FINE = replace(FISH, ellipse_points=200, tail_points=60)
TRUE = {"widen": 0.1, "deformable.spread": 30.0}
SIZE = (240, 320)


def drawn(state: FloatArray) -> ImageArray:
    """A body in orange over grey-green, its tail as thin as a line."""
    image: NDArray[np.uint8] = np.full((*SIZE, 3), (40, 90, 90), np.uint8)
    points = np.round(FINE.contour(state[None])[0] * 16).astype(np.int32)
    cv2.fillPoly(image, [points[:200]], (255, 140, 20), cv2.LINE_8, 4)
    cv2.polylines(image, [points[200:]], False, (255, 140, 20), 2, cv2.LINE_8, 4)
    return image


def film(seed: int, frames: int = 25) -> tuple[list[ImageArray], FloatArray]:
    """Images and true states: a wide random walk of `TRUE`, and images of poses that are as likely as (7) says."""
    rng, noise = np.random.default_rng(seed), wide_noise(FISH).widened(TRUE["widen"])
    states = np.array([160.0, 120.0, rng.uniform(-3, 3), 0.0]) + np.cumsum(noise.draw(frames, rng), axis=0)
    states[:, 3] = np.clip(states[:, 3], -1.2, 1.2)
    images, scale = [], np.array([5.0, 5.0, 0.2, 0.4])
    for state in states:
        shifts = rng.standard_normal((200, 4))
        poses = state + 1.5 * scale * shifts
        away = [largest_distance(FISH.contour(state[None])[0], contour) for contour in FINE.contour(poses)]
        logs = -(np.array(away) ** 2) / TRUE["deformable.spread"] + 0.5 * (shifts**2).sum(axis=1)
        weights = np.exp(logs - logs.max())
        images.append(drawn(poses[rng.choice(len(poses), p=weights / weights.sum())]))
    return images, states


def largest_distance(points: NDArray[np.float32], edges: NDArray[np.float32]) -> float:
    """The largest distance of a point to the nearest edge, pixels."""
    return float(np.sqrt(((points[:, None] - edges[None]) ** 2).sum(axis=2).min(axis=1).max()))


def choice(widen: float = 1.0, spread: float = 40.0) -> BodyChoice:
    """By default the wide walk as it stands."""
    return BodyChoice(colour="orange", widen=widen, deformable=DeformableSettings(300, spread, smooth=1))


def error(chosen: BodyChoice, seed: int) -> float:
    """Mean distance of a followed body from its true places, pixels."""
    images, states = film(seed)
    source = open_source(images)
    tracker = run.body_tracker(replace(chosen, init=[states[0].tolist()]), source)
    for frame in source.frames():
        tracker.update(frame)
    return float(np.linalg.norm(tracker.tracks()[0].states[:, :2] - states[:, :2], axis=1).mean())


@pytest.mark.slow
def test_the_noise_of_a_drawn_film_lies_in_its_intervals_and_follows_an_unseen_one_better() -> None:
    images, states = film(2)
    start = replace(choice(widen=0.3, spread=100.0), init=[states[0].tolist()])
    best, fitted = fit_noise(start, open_source(images))
    # In films of seeds 11 to 18 the widening was within its interval in eight, the spread in four.
    for name, value in TRUE.items():
        assert fitted[name].low < value < fitted[name].high < 3 * fitted[name].low
    assert error(best, 50) < error(choice(), 50)


def test_the_command_writes_options_that_it_reads_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "fit_settings", at_the_start)
    (tmp_path / "film").mkdir()
    for number in range(3):
        image = drawn(np.array([150.0 + 4 * number, 120.0, 0.2, 0.1]))
        cv2.imwrite(str(tmp_path / f"film/{number}.png"), image[..., ::-1])
    words = ["track", "deformable", str(tmp_path / "film"), "--colour", "orange", "--init", "150,120,0.2,0.1", "--out"]
    assert main([*words, str(tmp_path / "fitted"), "--fit", "--widen", "0.2"]) == 0
    options = tmp_path / "fitted/fitted.yaml"
    assert options.read_text().startswith("# widen: 0.2, 95 % from ")
    assert json.loads((tmp_path / "fitted/run.json").read_text())["facts"]["fitted"].keys() == TRUE.keys()
    assert main([*words, str(tmp_path / "again"), "--config", str(options)]) == 0
    assert (tmp_path / "again/states.csv").read_text() == (tmp_path / "fitted/states.csv").read_text()
