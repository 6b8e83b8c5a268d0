"""Calibrated scores are probabilities, and the order of detections stays."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.exporting.export_detector import RawHeads
from tsuiseki.trainers.networks.calibration import fit_calibration


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
