"""The second witness: it says lost after enough unlike looks, comes back, and is silent about what it does not know."""

import numpy as np
import pytest

from tsuiseki.tracking.single import witness
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.response_particles import ResponseParticles
from tsuiseki.tracking.single.settings import NONE, SingleChoice
from tsuiseki.tracking.single.tracker import TargetState
from tsuiseki.tracking.single.witness import Recognised

BOX = np.array([10.0, 10.0, 30.0, 50.0])


class StandingStill:
    """Says that it tracks, always at the same place."""

    def start(self, _, box):
        self.box = box

    def follow(self, _):
        return TargetState(self.box, 0.9, "tracking")


@pytest.fixture(autouse=True)
def in_every_frame(monkeypatch):
    monkeypatch.setattr(witness, "LOOK_INTERVAL", 1)
    monkeypatch.setattr(witness, "TRUSTED", 2)


def statuses(likenesses):
    """Of a tracker whose box looks like the first one by each of ``likenesses``."""
    told = iter([1.0, *likenesses])

    def describe(*_):
        likeness = next(told)
        return np.array([[likeness, np.sqrt(1 - likeness**2)]]) * 7  # any length

    tracker = Recognised(StandingStill(), describe)
    image = np.zeros((60, 60, 3), dtype=np.uint8)
    tracker.start(image, BOX)
    return [tracker.follow(image).status for _ in range(len(likenesses) * witness.LOOK_INTERVAL)]


def test_two_unlike_looks_in_a_row_say_lost_and_a_like_one_takes_it_back():
    assert statuses([0.9, 0.9, 0.2, 0.2, 0.2, 0.8]) == ["tracking"] * 3 + ["lost"] * 2 + ["tracking"]
    assert "lost" not in statuses([0.9, 0.9, 0.2, 0.9, 0.2, 0.9])


@pytest.mark.parametrize("usual", [0.58, 0.55])
def test_a_network_that_hardly_knows_the_target_is_not_heard(usual):
    assert "lost" not in statuses([usual] * 4 + [0.0] * 4)


def test_a_box_that_is_lost_at_once_is_not_taken_for_the_target():
    assert statuses([0.1] * 4) == ["tracking"] + ["lost"] * 3


def test_it_looks_every_few_frames(monkeypatch):
    for name, value in (("LOOK_INTERVAL", 3), ("TRUSTED", 1), ("LOST_INFERENCES", 1)):
        monkeypatch.setattr(witness, name, value)
    assert statuses([0.9, 0.1]) == ["tracking"] * 5 + ["lost"]


def test_of_what_is_not_upright_the_network_is_not_asked():
    def never(*_):
        raise AssertionError("asked")

    tracker = Recognised(StandingStill(), never)
    tracker.start(np.zeros((60, 60, 3), dtype=np.uint8), np.array([10.0, 10.0, 50.0, 50.0]))
    assert not tracker.asked
    assert tracker.follow(np.zeros((60, 60, 3), dtype=np.uint8)).status == "tracking"


def test_combined_has_a_witness_of_its_own():
    assert isinstance(SingleChoice(network=NONE, recognise=True).tracker(), Combined)
    assert isinstance(SingleChoice(recognise=True).tracker(), ResponseParticles)
    assert isinstance(SingleChoice(method="kcf", recognise=True).tracker(), Recognised)
