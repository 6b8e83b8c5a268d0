"""Labelled pictures: anchors proposed in input pixels, and calibrated scores that are probabilities."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.detector_labels import anchors_for, fit_calibration
from tsuiseki.trainers.exporting.written_networks import RawHeads


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sequence of 200x100 images with people of 10x30 and 20x60, and a larger one that does not count."""
    (tmp_path / "img1").mkdir()
    (tmp_path / "gt").mkdir()
    rows = []
    for n in range(8):
        cv2.imwrite(str(tmp_path / "img1" / f"{n + 1:06d}.png"), np.zeros((100, 200, 3), dtype=np.uint8))
        rows += [f"{n + 1},1,11,11,{10 + 0.01 * n},30,1,1,1", f"{n + 1},2,81,21,{20 + 0.01 * n},60,1,1,1"]
        rows += [f"{n + 1},3,121,1,90,{90 + n},1,1,1" if n > 5 else f"{n + 1},3,121,1,90,{90 + n},0,8,1"]
    (tmp_path / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return tmp_path


def test_proposals_are_in_input_pixels(folder: Path) -> None:
    text = anchors_for(folder, 64, 100, frames=(1, 6), per_level=(1, 1, 1), scale=(1.0, 1.0))
    sizes = np.array([level[0] for level in yaml.safe_load(text)["anchors"]])
    # 200x100 into 100x64 is a factor of 0.5; three anchors split one of two sizes.
    assert all(np.abs(sizes - size).max(axis=1).min() <= 0.1 for size in ([5, 15], [10, 30]))
    stretched = anchors_for(folder, 200, 100, frames=(1, 6), resize="stretch", per_level=(1, 1, 1), scale=(1.0, 1.0))
    sizes = np.array([level[0] for level in yaml.safe_load(stretched)["anchors"]])
    assert all(np.abs(sizes - size).max(axis=1).min() <= 0.1 for size in ([5, 60], [10, 120]))


def test_too_many_anchors_are_refused_in_one_line(folder: Path) -> None:
    with pytest.raises(RequestError, match="ask for fewer anchors"):
        anchors_for(folder, 64, 100, per_level=(90, 90, 90), scale=(1.0, 1.0))
    with pytest.raises(RequestError, match="3 or 4 numbers"):
        anchors_for(folder, 64, 100, per_level=(3, 2))


def test_a_known_calibration_is_found() -> None:
    rng = np.random.default_rng(0)
    logit = rng.normal(-1, 1.5, 40_000)
    right = rng.random(40_000) < 1 / (1 + np.exp(-(2 * logit + 1)))
    scale, shift = fit_calibration(1 / (1 + np.exp(-logit)), right)
    # Standard errors of a logistic regression on this many samples are about 0.03.
    assert scale == pytest.approx(2, abs=0.1)
    assert shift == pytest.approx(1, abs=0.1)


def test_a_fit_that_may_not_be_so_steep_keeps_the_share_that_is_right() -> None:
    rng = np.random.default_rng(0)
    logit = rng.normal(-1, 1.5, 2_000)
    right = rng.random(2_000) < 1 / (1 + np.exp(-(2 * logit + 1)))
    scores = 1 / (1 + np.exp(-logit))
    scale, shift = fit_calibration(scores, right, steepest=1.0)
    assert scale == 1
    assert np.mean(1 / (1 + np.exp(-(logit + shift)))) == pytest.approx(right.mean(), abs=1e-9)
    assert fit_calibration(scores, right, steepest=5.0) == fit_calibration(scores, right)


def test_the_heads_apply_it_to_the_logit_of_the_score() -> None:
    class Fixed(torch.nn.Module):
        anchors = torch.zeros(2, 4)

        def forward(self, _: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            return torch.tensor([[[0.5, 1.5], [2.0, -1.0]]]), torch.zeros(1, 2, 4)

    logits, _, _ = RawHeads(Fixed(), (2.0, 1.0))(torch.zeros(1, 3, 4, 4))  # type: ignore[arg-type]
    np.testing.assert_allclose((logits[..., 1] - logits[..., 0]).numpy(), [[3.0, -5.0]])


@pytest.mark.parametrize("right", [np.ones(4, dtype=bool), np.zeros(4, dtype=bool)])
def test_one_kind_alone_cannot_calibrate(right: np.ndarray) -> None:
    with pytest.raises(RequestError, match="right and wrong"):
        fit_calibration(np.full(4, 0.5), right)


def test_scores_that_say_nothing_are_refused() -> None:
    with pytest.raises(RequestError, match="say nothing"):
        fit_calibration(np.array([0.1, 0.2, 0.8, 0.9]), np.array([True, True, False, False]))
