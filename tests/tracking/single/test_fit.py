"""The noise of the Kalman filter of one target by maximum likelihood, from films that are drawn by its model."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracking.points.test_fit import at_the_start
from tests.tracking.single.moving_texture import clip
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import Gaussians, log_likelihood
from tsuiseki.tracking.single import run
from tsuiseki.tracking.single.matching import PlaceNoise
from tsuiseki.tracking.single.run import fit_noise, follow_single
from tsuiseki.tracking.single.settings import SingleChoice
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

SIDE = 16
TRUE = PlaceNoise(velocity=0.02, measurement=0.15)


def film(seed: int, frames: int = 60) -> tuple[list[ImageArray], FloatArray, FloatArray]:
    """Images, boxes as drawn, and true centres of a target that moves and is measured with the noise of `TRUE`."""
    rng = np.random.default_rng(seed)
    while True:
        turns, shifts = SIDE * TRUE.velocity * rng.standard_normal((2, frames, 2)) * [[[1.0]], [[0.5]]]
        centres = 160.0 + np.cumsum(np.cumsum(turns, axis=0) - turns + shifts, axis=0)
        # It stays in the picture.
        if np.abs(centres - 160.0).max() < 130:
            break
    drawn = centres + SIDE * TRUE.measurement * rng.standard_normal(centres.shape)
    return *clip(drawn, SIDE, SIDE, shape=(320, 320)), centres


def error(noise: PlaceNoise, seeds: range) -> float:
    """Mean distance of the boxes from the true centres, pixels."""
    away = []
    for seed in seeds:
        images, boxes, centres = film(seed)
        choice = SingleChoice(method="kalman", noise=(noise.velocity, noise.measurement))
        estimates = [estimate.box for _, estimate in follow_single(images, boxes[0], choice.tracker())]
        away.append(np.linalg.norm(np.array(estimates).reshape(-1, 2, 2).mean(axis=1) - centres, axis=1).mean())
    return float(np.mean(away))


def test_the_density_of_a_measurement_is_that_of_its_innovation() -> None:
    state = Gaussians(np.array([[1.0, 2.0]]), np.diag([4.0, 9.0])[None])
    density = log_likelihood(state, np.array([[3.0]]), np.array([[1.0, 1.0]]), np.array([[3.0]]))
    # The innovation is 3 - 1 - 2 = 0, its variance 4 + 9 + 3.
    assert density.tolist() == pytest.approx([-0.5 * np.log(2 * np.pi * 16)])


@pytest.mark.slow
def test_the_noise_of_a_drawn_film_lies_in_its_intervals_and_follows_unseen_ones_better() -> None:
    images, boxes, _ = film(2)
    hand_set = PlaceNoise()
    choice, fitted = fit_noise(SingleChoice(method="kalman"), open_source(images), boxes[0])
    assert fitted["velocity"].low < TRUE.velocity < fitted["velocity"].high < 4 * fitted["velocity"].low
    assert fitted["measurement"].low < TRUE.measurement < fitted["measurement"].high < 3 * fitted["measurement"].low
    assert choice.noise is not None
    assert error(PlaceNoise(*choice.noise), range(50, 53)) < error(hand_set, range(50, 53))


def test_the_command_writes_options_that_it_reads_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "fit_settings", at_the_start)
    images, boxes, _ = film(2, frames=12)
    (tmp_path / "film").mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"film/{number:03d}.png"), image[..., ::-1])
    x, y = boxes[0, :2]
    words = ["track", "single", str(tmp_path / "film"), "--box", f"{x},{y},{SIDE},{SIDE}", "--out"]
    assert main([*words, str(tmp_path / "fitted"), "--method", "kalman", "--fit"]) == 0
    options = tmp_path / "fitted/fitted.yaml"
    assert options.read_text().startswith("# velocity: ")
    facts = json.loads((tmp_path / "fitted/run.json").read_text())["facts"]
    assert facts["fitted"].keys() == {"velocity", "measurement"}
    assert main([*words, str(tmp_path / "again"), "--config", str(options)]) == 0
    assert (tmp_path / "again/boxes.txt").read_text() == (tmp_path / "fitted/boxes.txt").read_text()


def test_other_methods_have_no_such_noise() -> None:
    images, boxes, _ = film(3, frames=2)
    with pytest.raises(RequestError, match="`fit`: expected `method` kalman"):
        fit_noise(SingleChoice(), open_source(images), boxes[0])
    with pytest.raises(ValueError, match="`noise`: expected with `method` kalman"):
        SingleChoice(noise=(0.1, 0.1))
