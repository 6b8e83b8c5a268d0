"""Correlation filters against brute force over cyclic shifts and against a plain ridge regression."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.correlation_filters import (
    FilterBank,
    GaussianKernel,
    blend,
    gaussian_labels,
    join,
    respond,
    train,
    transform,
)
from tsuiseki.tracking.single.search_windows import maxima_of_each, peak, signed_shift

SHAPE = (6, 8)


class LinearKernel:
    """The scalar product over the number of features, KCF equation 31: the filter is a ridge regression."""

    def __call__(self, windows, templates):
        return (windows.spectra * templates.spectra.conj()).sum(axis=1) / np.float32(windows.size)


def windows(seed, count=1, channels=3):
    return np.random.default_rng(seed).normal(size=(count, channels, *SHAPE)).astype(np.float32)


def shifts():
    return [(dy, dx) for dy in range(SHAPE[0]) for dx in range(SHAPE[1])]


@pytest.mark.parametrize(
    ("kernel", "plain"),
    [
        (LinearKernel(), lambda a, b: (a * b).sum() / a.size),
        (GaussianKernel(0.5), lambda a, b: np.exp(-((a - b) ** 2).sum() / (0.25 * a.size))),
    ],
)
def test_kernel_equals_brute_force_over_all_shifts(kernel, plain):
    a, b = windows(0), windows(1)
    found = np.fft.irfft2(kernel(transform(a), transform(b)), s=SHAPE)[0]
    expected = [plain(a[0], np.roll(b[0], shift, axis=(1, 2))) for shift in shifts()]
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)


def test_training_solves_the_ridge_regression_over_all_shifts():
    x = windows(2)
    labels, regularisation = gaussian_labels(SHAPE, 1.0), 0.1
    bank = train(transform(x), labels, LinearKernel(), regularisation)
    rolled = np.array([np.roll(x[0], shift, axis=(1, 2)).ravel() for shift in shifts()]).astype(float)
    gram = rolled @ rolled.T / x[0].size
    wanted = np.fft.irfft2(labels, s=SHAPE).ravel()
    dual = np.linalg.solve(gram + regularisation * np.eye(len(gram)), wanted)
    # Tested on other windows: the response to z at a shift is the regression's value for z rolled back.
    z = windows(3)
    found = respond(bank, transform(z), LinearKernel())[0]
    back = np.array([np.roll(z[0], (-dy, -dx), axis=(1, 2)).ravel() for dy, dx in shifts()]).astype(float)
    # The labels are symmetric, so the order of shifts of the dual is that of the labels.
    np.testing.assert_allclose(found.ravel(), back @ rolled.T / x[0].size @ dual, atol=1e-4)


@pytest.mark.parametrize("shift", [(0, 0), (1, -2), (-2, 3)])
@pytest.mark.parametrize("kernel", [GaussianKernel(0.5), LinearKernel()])
def test_a_shifted_window_is_found(kernel, shift):
    x = windows(4)
    bank = train(transform(x), gaussian_labels(SHAPE, 0.7), kernel, 1e-4)
    response = respond(bank, transform(np.roll(x, shift, axis=(2, 3))), kernel)[0]
    found, value = peak(response)
    assert np.round(found).tolist() == [shift[1], shift[0]]
    assert value == pytest.approx(1.0, abs=0.02)


def test_filters_respond_together_as_they_do_alone():
    kernel = GaussianKernel(0.6)
    banks = [train(transform(windows(k)), gaussian_labels(SHAPE, 1.0), kernel, 1e-4) for k in range(3)]
    z = transform(windows(9))
    together = respond(join(banks), z, kernel)
    np.testing.assert_allclose(together, np.concatenate([respond(b, z, kernel) for b in banks]), atol=1e-5)


@pytest.mark.parametrize("columns", [7, 8])
def test_blending_keeps_the_energy_of_the_template(columns):
    a, b = (np.random.default_rng(k).normal(size=(1, 2, 6, columns)).astype(np.float32) for k in (0, 1))
    labels = gaussian_labels((6, columns), 1.0)
    mixed = blend(*(train(transform(x), labels, LinearKernel(), 1.0) for x in (a, b)), 0.25)
    assert mixed.templates.energies[0] == pytest.approx(((0.75 * a + 0.25 * b) ** 2).sum(), rel=1e-4)
    assert isinstance(mixed, FilterBank)


def test_peak_lies_between_cells():
    x = np.arange(16)
    response = np.exp(-((signed_shift(x - 2.3, 16)[None] ** 2) + signed_shift(x + 1.4, 16)[:, None] ** 2) / 8)
    found, _ = peak(response.astype(np.float32))
    np.testing.assert_allclose(found, [2.3, -1.4], atol=0.05)  # a Gaussian is no parabola


def test_local_maxima_are_ordered_and_cyclic():
    response = np.zeros((10, 12), dtype=np.float32)
    response[0, 0], response[4, 5], response[9, 11] = 3, 2, 1  # the last is a neighbour of the first
    _, places, values = maxima_of_each(response[None], 5)
    assert places.tolist() == [[0, 0], [5, 4]]
    assert values.tolist() == [3, 2]


def test_a_flat_map_has_no_maximum():
    assert len(maxima_of_each(np.ones((1, 5, 5), dtype=np.float32), 3)[0]) == 0


def test_maxima_of_several_maps_are_those_of_each():
    responses = np.random.default_rng(3).integers(0, 9, (4, 6, 8)).astype(np.float32)  # many are equal
    responses[2] = 1  # a flat map has none
    which, shifts, values = maxima_of_each(responses, 3)
    assert np.unique(which).tolist() == [0, 1, 3]
    for k, response in enumerate(responses):
        around = [np.roll(response, (i, j), (0, 1)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        plain = (response >= np.max(around, axis=0)) & (response > np.min(around, axis=0))
        found = sorted(response[plain].tolist(), reverse=True)[:3]
        assert values[which == k].tolist() == found
        for (x, y), value in zip(shifts[which == k].astype(int), values[which == k], strict=True):
            assert plain[y, x]
            assert response[y, x] == value
