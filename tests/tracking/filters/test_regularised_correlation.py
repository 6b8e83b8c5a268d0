"""The regularised filter against a direct solution of its system, and what its support and memory promise."""

import numpy as np
import pytest
import scipy.fft

from tsuiseki.tracking.filters import correlation_filters
from tsuiseki.tracking.filters.correlation_filters import (
    Support,
    gaussian_labels,
    learn,
    regularised_response,
)
from tsuiseki.tracking.single.search_windows import peak

SHAPE = (10, 12)
WANTED = gaussian_labels(SHAPE, 1.0)
EVERYWHERE = Support.of(SHAPE, *SHAPE)
CELLS = SHAPE[0] * SHAPE[1]


def window(seed, channels=3):
    features = np.random.default_rng(seed).normal(size=(channels, *SHAPE)).astype(np.float32)
    return scipy.fft.rfft2(features)


def test_without_a_support_the_filter_is_the_ridge_regression_of_each_frequency(monkeypatch):
    x, before = window(0), window(1) * np.float32(0.01)
    memory = 2.0
    monkeypatch.setattr(correlation_filters, "MEMORY", memory)
    monkeypatch.setattr(correlation_filters, "PENALTIES", (1e-7,))
    found = learn(x, WANTED, EVERYWHERE, before)
    weight = memory * CELLS
    for row, column in [(0, 0), (3, 2), (9, 6)]:
        xs, y = x[:, row, column].astype(complex), complex(WANTED[row, column])
        system = np.outer(xs.conj(), xs) + weight * np.eye(len(xs))
        expected = np.linalg.solve(system, xs.conj() * y + weight * before[:, row, column])
        # single precision: the real and imaginary parts of unpaired frequencies carry rounding of about 1e-4
        np.testing.assert_allclose(found[:, row, column], expected, rtol=2e-3, atol=1e-5)


def test_the_filter_is_zero_outside_the_target():
    support = Support.of(SHAPE, 4, 6)
    assert support.mask.sum() == 5 * 7
    filters = learn(window(0), WANTED, support, None)
    image_plane = scipy.fft.irfft2(filters, s=SHAPE)
    assert np.abs(image_plane[:, support.mask == 0]).max() < 1e-6 * np.abs(image_plane).max()
    assert np.abs(image_plane[:, support.mask == 1]).max() > 0


def test_restricting_is_a_mask_in_the_image_plane():
    support = Support.of(SHAPE, 4, 6)
    masked = scipy.fft.rfft2(scipy.fft.irfft2(window(0), s=SHAPE) * support.mask)
    np.testing.assert_allclose(support.restrict(window(0)), masked, atol=2e-5)  # values up to 35 in single precision


@pytest.mark.parametrize("shift", [(0, 0), (2, -3), (-4, 1)])
def test_the_response_follows_the_target(shift):
    features = np.random.default_rng(0).normal(size=(3, *SHAPE)).astype(np.float32)
    support = Support.of(SHAPE, 6, 6)
    filters = learn(scipy.fft.rfft2(features), WANTED, support, None)
    moved = scipy.fft.rfft2(np.roll(features, shift, axis=(1, 2)))
    found, value = peak(regularised_response(filters, moved, SHAPE))
    np.testing.assert_allclose(found, shift[::-1], atol=0.5)
    # noise gives the filter's 49 cells little to hold the whole window by; elsewhere the response is a fraction of it
    response = regularised_response(filters, moved, SHAPE)
    assert value > 2 * np.sort(response.ravel())[-6]


def test_more_memory_keeps_the_filter_closer_to_the_one_before(monkeypatch):
    before = learn(window(0), WANTED, EVERYWHERE, None)
    distances = []
    for memory in (1.0, 10.0, 100.0, 1e4):
        monkeypatch.setattr(correlation_filters, "MEMORY", memory)
        distances.append(float(np.abs(learn(window(1), WANTED, EVERYWHERE, before) - before).sum()))
    assert distances == sorted(distances, reverse=True)
    assert distances[-1] < 0.01 * distances[0]


def test_a_bank_of_filters_answers_like_each_of_them():
    bank = np.stack([learn(window(k), WANTED, EVERYWHERE, None) for k in range(3)])
    together = regularised_response(bank, window(5), SHAPE)
    for one, alone in zip(bank, together, strict=True):
        np.testing.assert_allclose(regularised_response(one, window(5), SHAPE), alone, atol=1e-6)
