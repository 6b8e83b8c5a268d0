"""The learning rate over a training: its shape, and that going on with other lengths makes no jump."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.optim import SGD

from tsuiseki.trainers.network_module import WarmupCosine

WARMUP, FINAL = 10, 0.01


def begun(total: int) -> WarmupCosine:
    weight = torch.nn.Parameter(torch.zeros(1))
    return WarmupCosine(SGD([weight], lr=1.0), WARMUP, total, FINAL)


def rates(schedule: WarmupCosine, steps: int) -> list[float]:
    """After each of so many steps."""
    found = []
    for _ in range(steps):
        schedule.optimizer.step()
        schedule.step()
        found.append(float(schedule.optimizer.param_groups[0]["lr"]))
    return found


def gone_on_with(before: WarmupCosine, total: int) -> WarmupCosine:
    """As a trainer does: the optimiser's state, then the schedule's."""
    after = begun(total)
    after.optimizer.load_state_dict(before.optimizer.state_dict())
    after.load_state_dict(before.state_dict())
    return after


def test_without_a_stop_it_is_the_closed_form() -> None:
    steps = np.arange(1, 131)
    fall = FINAL + (1 - FINAL) * (1 + np.cos(np.pi * np.clip((steps - WARMUP) / (110 - WARMUP), 0, 1))) / 2
    np.testing.assert_allclose(rates(begun(110), 130), np.where(steps < WARMUP, (steps + 1) / WARMUP, fall))


def test_the_same_length_goes_on_as_if_never_stopped() -> None:
    stopped = begun(110)
    first = rates(stopped, 47)
    np.testing.assert_allclose(first + rates(gone_on_with(stopped, 110), 63), rates(begun(110), 110))


@pytest.mark.parametrize("total", [60, 80, 200, 1000])
@pytest.mark.parametrize("done", [4, 10, 47])
def test_another_length_falls_without_a_jump_to_the_final_share(done: int, total: int) -> None:
    stopped = begun(110)
    first = rates(stopped, done)
    every = np.array(first + rates(gone_on_with(stopped, total), total - done))
    left = total - max(done, WARMUP)
    # The rise has steps of 1 / 10; the steepest fall of half a cosine is π / 2 times the mean.
    assert np.diff(every).max() <= 1 / WARMUP + 1e-9
    assert -np.diff(every).min() <= 1.6 * max(1 / left, 1 / 100)
    assert every[WARMUP - 1 :].argmax() == 0
    np.testing.assert_allclose(every[-1], FINAL)


def test_an_ended_training_goes_on_at_the_final_share() -> None:
    stopped = begun(50)
    rates(stopped, 50)
    np.testing.assert_allclose(rates(gone_on_with(stopped, 90), 40), FINAL)


def test_several_stops() -> None:
    one = begun(40)
    first = rates(one, 20)
    two = gone_on_with(one, 80)
    second = rates(two, 30)
    third = rates(gone_on_with(two, 60), 10)
    every = first + second + third
    assert abs(np.diff(every)[WARMUP:]).max() < 0.1
    assert all(np.diff(every)[WARMUP:] <= 1e-9)
    np.testing.assert_allclose(every[-1], FINAL)
