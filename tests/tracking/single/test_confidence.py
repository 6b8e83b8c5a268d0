"""When the combined tracker doubts its filter."""

import numpy as np
import pytest

from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST
from tsuiseki.tracking.single.particles import Confidence, RunningMean

BOX = np.array([30, 20, 50, 40.0])


def picture(colour):
    image = np.full((60, 80, 3), (30, 200, 30), dtype=np.uint8)
    image[20:40, 30:50] = colour
    return image


def test_a_running_mean_is_plain_at_first():
    running = RunningMean(rate=0.25)
    for value in (4.0, 2.0, 3.0):
        running = running.add(value)
    assert running.mean == pytest.approx(3.0)
    for _ in range(10):
        running = running.add(7.0)
    # the fourth value still has a plain quarter, the nine others a quarter each
    assert running.mean == pytest.approx(7 - 4 * 0.75**10)


def test_the_thesis_s_switch_is_a_threshold():
    confidence = Confidence.start(PRINTED, picture((200, 20, 20)), BOX)
    assert confidence.colour is None
    colour = confidence.colour_score(picture((30, 200, 30)), BOX)
    assert confidence.doubts(0.2, colour)
    assert not confidence.doubts(0.21, colour)


def test_a_response_below_the_usual_is_doubted():
    confidence = Confidence(ROBUST)
    for _ in range(5):
        confidence = confidence.learn(picture(0), BOX, 0.8, None)
    assert confidence.doubts(0.51, None)
    assert not confidence.doubts(0.53, None)


def test_lost_colours_are_doubted_in_frames_of_a_look():
    red, gone = picture((200, 20, 20)), picture((30, 200, 30))
    confidence = Confidence.start(ROBUST, red, BOX)
    confidence = confidence.learn(red, BOX, 0.5, confidence.colour_score(red, BOX))
    assert not confidence.doubts(0.5, confidence.colour_score(red, BOX))
    assert confidence.doubts(0.5, confidence.colour_score(gone, BOX))
    assert not confidence.doubts(0.5, None)
