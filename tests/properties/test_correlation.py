"""Correlation filters: what is shifted answers shifted, and spectra say what the pictures say."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.properties.drawn import seeds
from tsuiseki.tracking.filters.correlation_filters import (
    GaussianKernel,
    Support,
    blend,
    gaussian_labels,
    join,
    learn,
    regularised_response,
    respond,
    train,
    transform,
)
from tsuiseki.tracking.filters.scale_filter import ScaleFilter, ScaleSample, best_offset

KERNEL = GaussianKernel(0.5)
shapes = st.tuples(st.integers(6, 11), st.integers(6, 11))
# Windows are kept in single precision.
SINGLE = 2e-4


def windows(seed: int, shape: tuple[int, int], count: int = 1) -> NDArray[np.float32]:
    return np.random.default_rng(seed).normal(0, 1, (count, 2, *shape)).astype(np.float32)


@given(seed=seeds, shape=shapes, shift=st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_a_shifted_window_answers_shifted(seed: int, shape: tuple[int, int], shift: tuple[int, int]) -> None:
    """What moved by some cells has its response there, the greatest where the target went."""
    window = windows(seed, shape)
    bank = train(transform(window), gaussian_labels(shape, 1.0), KERNEL, 1e-3)
    response = respond(bank, transform(window), KERNEL)[0]
    moved = respond(bank, transform(np.roll(window, shift, axis=(2, 3))), KERNEL)[0]
    np.testing.assert_allclose(moved, np.roll(response, shift, axis=(0, 1)), atol=SINGLE)
    assert np.unravel_index(moved.argmax(), shape) == (shift[0] % shape[0], shift[1] % shape[1])


@given(seed=seeds, shape=st.tuples(st.integers(3, 5), st.integers(3, 6)))
def test_the_kernel_is_that_of_all_shifts(seed: int, shape: tuple[int, int]) -> None:
    """In the frequency domain it is the Gaussian kernel between the window and each cyclic shift of the template."""
    window, template = windows(seed, shape, 2)[:, None]
    spectrum = KERNEL(transform(window), transform(template))
    values = scipy.fft.irfft2(spectrum, s=shape)[0]
    for row in range(shape[0]):
        for column in range(shape[1]):
            away = window - np.roll(template, (row, column), axis=(2, 3))
            expected = np.exp(-np.square(away).sum() / (KERNEL.sigma**2 * away.size))
            assert values[row, column] == pytest.approx(expected, abs=SINGLE)


@given(seed=seeds, shape=shapes, rate=st.floats(0, 1))
def test_a_blended_template_is_that_of_the_blended_windows(seed: int, shape: tuple[int, int], rate: float) -> None:
    """The running mean of spectra and its energy are those of the mean of the windows; at 0 and 1 nothing is mixed."""
    old, new = windows(seed, shape, 2)[:, None]
    labels = gaussian_labels(shape, 1.0)
    banks = [train(transform(window), labels, KERNEL, 1e-3) for window in (old, new)]
    mixed, mean = blend(*banks, rate), transform(((1 - rate) * old + rate * new).astype(np.float32))
    np.testing.assert_allclose(mixed.templates.spectra, mean.spectra, atol=1e-3)
    np.testing.assert_allclose(mixed.templates.energies, mean.energies, rtol=1e-3)
    for end, bank in zip((0.0, 1.0), banks, strict=True):
        np.testing.assert_allclose(blend(*banks, end).coefficients, bank.coefficients, atol=1e-2)


@given(seed=seeds, shape=shapes)
def test_filters_of_a_bank_answer_as_each_alone(seed: int, shape: tuple[int, int]) -> None:
    """Filters joined in a bank respond to a window as they do one by one."""
    both, window = windows(seed, shape, 2), windows(seed + 1, shape)
    labels = gaussian_labels(shape, 1.5)
    banks = [train(transform(part[None]), labels, KERNEL, 1e-2) for part in both]
    alone = [respond(bank, transform(window), KERNEL)[0] for bank in banks]
    np.testing.assert_allclose(respond(join(banks), transform(window), KERNEL), alone, atol=SINGLE)


@given(seed=seeds, shape=shapes, sides=st.tuples(st.floats(1, 6), st.floats(1, 6)))
def test_a_support_cuts_what_its_mask_cuts(seed: int, shape: tuple[int, int], sides: tuple[float, float]) -> None:
    """Restricted spectra are those of the windows times the mask, and to restrict them again changes nothing."""
    support, window = Support.of(shape, *sides), windows(seed, shape)[0]
    restricted = support.restrict(scipy.fft.rfft2(window))
    np.testing.assert_allclose(restricted, scipy.fft.rfft2(window * support.mask), atol=1e-3)
    np.testing.assert_allclose(support.restrict(restricted), restricted, atol=1e-3)
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
    inside = (2 * rows[:, None] <= sides[0]) & (2 * columns <= sides[1])
    np.testing.assert_array_equal(support.mask > 0, inside)


@given(seed=seeds, shape=shapes, shift=st.tuples(st.integers(-3, 3), st.integers(-3, 3)))
def test_a_learnt_filter_lives_on_its_target_and_follows_it(
    seed: int, shape: tuple[int, int], shift: tuple[int, int]
) -> None:
    """The regularised filter is zero off its support, and its response shifts with the window."""
    support, window = Support.of(shape, 3.0, 3.0), windows(seed, shape)[0]
    spectrum, label = scipy.fft.rfft2(window), gaussian_labels(shape, 1.0)
    filters = learn(spectrum, label, support, learn(spectrum, label, support, None))
    weights = scipy.fft.irfft2(filters, s=shape)
    np.testing.assert_allclose(weights * (1 - support.mask), 0, atol=1e-4)
    response = regularised_response(filters, spectrum, shape)
    moved = regularised_response(filters, scipy.fft.rfft2(np.roll(window, shift, axis=(1, 2))), shape)
    np.testing.assert_allclose(moved, np.roll(response, shift, axis=(0, 1)), atol=1e-3)


@given(seed=seeds, steps=st.integers(5, 16).map(lambda half: 2 * half + 1), offset=st.integers(-3, 3))
def test_a_scale_filter_finds_the_size_that_it_learnt(seed: int, steps: int, offset: int) -> None:
    """To its own sample it answers greatest at the size that was right, and blended with itself it stays."""
    sample = ScaleSample(np.random.default_rng(seed).normal(0, 1, (steps, 40)).astype(np.float32))
    filters = ScaleFilter.learn(sample, float(offset))
    assert best_offset(filters.respond(sample)) == pytest.approx(offset, abs=0.3)
    np.testing.assert_allclose(filters.blend(filters, 0.3).respond(sample), filters.respond(sample), atol=1e-4)
