"""Two readings of chapter 3: a window about each particle in (3.5), and P_J by the heights of the maxima in (3.1)."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.kcf_particle_settings import THESIS
from tsuiseki.tracking.single.particles import from_before, random_walk

SETTINGS = replace(THESIS, response_share=1.0, response_scale="printed", windows_of="particles")
BOX = np.array([60.0, 60, 84, 96])


def textured(seed, high, wide):
    noise = np.random.default_rng(seed).normal(size=(high, wide, 3)).astype(np.float32)
    return np.clip(60 * cv2.GaussianBlur(noise, (0, 0), 1.5) / 0.19 + 128, 0, 255).astype(np.uint8)


def frame(left):
    image = textured(0, 160, 300)
    image[60:96, left : left + 24] = textured(1, 36, 24)
    return image


@pytest.fixture
def tracker():
    tracker = KcfParticle(SETTINGS)
    tracker.start(frame(60), BOX)
    return tracker


def likelihoods(tracker, image, particles):
    windows = tracker._observation.windows(image, tracker.target, 0)
    view = tracker._observation.view(image, windows, tracker.target.bank, 1.0)
    return np.exp(tracker._log_likelihood(particles, view))


def test_particles_that_were_at_the_target_read_the_same_in_their_own_window(tracker):
    rng, centre = np.random.default_rng(0), tracker.target.centre
    particles = np.column_stack([rng.normal(centre, 4, (6, 2)), np.zeros(6)])
    own = np.column_stack([particles, np.tile(centre, (6, 1))])
    image = frame(63)
    np.testing.assert_allclose(
        likelihoods(tracker, image, own), likelihoods(tracker, image, particles), rtol=1e-3, atol=1e-5
    )


def test_a_particle_beyond_the_targets_window_sees_in_its_own(tracker):
    there = np.array([[212.0, 78.0, 0]])  # the middle of the target, which has jumped by 140 pixels
    near = np.array([[206.0, 76.0]])
    image = frame(200)
    assert likelihoods(tracker, image, there)[0] < 1e-5
    assert likelihoods(tracker, image, np.column_stack([there, near]))[0] > 0.3


def test_where_particles_were_is_kept_beside_them():
    particles = np.array([[10.0, 20, 1], [30, 40, 2]])
    moved = from_before(random_walk(np.array([2.0, 2.0])))(particles, 1.0, np.random.default_rng(0))
    np.testing.assert_array_equal(moved[:, 3:], particles[:, :2])
    np.testing.assert_array_equal(moved[:, 2], particles[:, 2])
    assert (moved[:, :2] != particles[:, :2]).all()


def test_the_mixture_weighs_maxima_by_their_heights(tracker):
    peaks, heights = np.zeros((3, 2)), np.array([0.3, 0.1, -0.2])
    assert tracker._mixture_weights(peaks, heights) is None
    tracker.settings = replace(SETTINGS, mixture="heights")
    np.testing.assert_allclose(tracker._mixture_weights(peaks, heights), [0.75, 0.25, 0], atol=1e-6)
