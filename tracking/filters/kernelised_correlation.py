"""Kernelised correlation filters, as banks of filters that share one search window.

Henriques et al., "High-speed tracking with kernelized correlation filters", PAMI 2015 (KCF); thesis section 2.2.4.
A sample is a window of features, already multiplied by a cosine window, kept as its spectrum. A filter holds a template
(a running mean of samples) and the dual coefficients of a ridge regression from every cyclic shift of the template
to a Gaussian label centred at shift zero. Maps are ``(rows, columns)`` over cyclic shifts: ``map[0, 0]`` is no shift.

Arrays have a leading filter or sample axis, so that all filters respond in one batched transform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tsuiseki.tracking.types import IntArray

Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex64]


@dataclass(frozen=True)
class Samples:
    """Windows of features in the frequency domain.

    Attributes:
        spectra: ``(B, C, rows, columns // 2 + 1)`` complex64.
        energies: ``(B,)`` float32, sum of squares of each window.
        shape: rows and columns.
    """

    spectra: ComplexArray
    energies: Float32Array
    shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.spectra)

    def select(self, which: IntArray | slice) -> Samples:
        """The windows at indices."""
        return Samples(self.spectra[which], self.energies[which], self.shape)

    @property
    def size(self) -> int:
        """Number of features of a window."""
        return int(self.spectra.shape[1]) * self.shape[0] * self.shape[1]


def transform(features: Float32Array) -> Samples:
    """Samples of windows ``(B, C, rows, columns)`` float32."""
    energies = np.einsum("bcij,bcij->b", features, features)
    return Samples(scipy.fft.rfft2(features), energies, (features.shape[2], features.shape[3]))


def _cross_spectrum(windows: Samples, templates: Samples) -> ComplexArray:
    products = windows.spectra * templates.spectra.conj()
    return np.asarray(products.sum(axis=1))


@dataclass(frozen=True)
class GaussianKernel:
    """``exp(-|a - b|^2 / (sigma^2 n))`` with ``n`` features in a window, KCF equation 30.

    A call gives its spectrum ``(K, rows, columns // 2 + 1)`` between windows and all cyclic shifts of templates.

    Attributes:
        sigma: bandwidth, > 0.
    """

    sigma: float = 0.5

    def __call__(self, windows: Samples, templates: Samples) -> ComplexArray:
        rows, columns = windows.shape
        cross = scipy.fft.irfft2(_cross_spectrum(windows, templates), s=(rows, columns))
        distance = (windows.energies + templates.energies)[:, None, None] - 2 * cross
        scale = np.float32(-1 / (self.sigma**2 * windows.size))
        return np.asarray(scipy.fft.rfft2(np.exp(np.maximum(distance, 0) * scale)))


@dataclass(frozen=True)
class FilterBank:
    """K filters.

    Attributes:
        templates: the running means of the training samples, one a filter.
        coefficients: ``(K, rows, columns // 2 + 1)`` complex64, the dual coefficients.
    """

    templates: Samples
    coefficients: ComplexArray

    def __len__(self) -> int:
        return len(self.coefficients)

    def select(self, which: IntArray | slice) -> FilterBank:
        """The filters at indices."""
        return FilterBank(self.templates.select(which), self.coefficients[which])


def join(banks: list[FilterBank]) -> FilterBank:
    """All filters of several banks in one, in their order."""
    spectra = np.concatenate([bank.templates.spectra for bank in banks])
    energies = np.concatenate([bank.templates.energies for bank in banks])
    coefficients = np.concatenate([bank.coefficients for bank in banks])
    return FilterBank(Samples(spectra, energies, banks[0].templates.shape), coefficients)


def train(samples: Samples, labels: ComplexArray, kernel: GaussianKernel, regularisation: float) -> FilterBank:
    """One filter a sample, KCF equation 17.

    Args:
        samples: B windows centred on the target.
        labels: spectrum of the wanted response, from :func:`gaussian_labels`.
        kernel: see :class:`GaussianKernel`.
        regularisation: lambda of the ridge regression, > 0.
    """
    return FilterBank(samples, labels / (kernel(samples, samples) + np.float32(regularisation)))


def respond(bank: FilterBank, windows: Samples, kernel: GaussianKernel) -> Float32Array:
    """``(K, rows, columns)`` responses of K filters to one window, or of one filter to K windows, eq. (2.10)."""
    spectrum = kernel(windows, bank.templates) * bank.coefficients
    return np.asarray(scipy.fft.irfft2(spectrum, s=windows.shape))


def blend(old: FilterBank, new: FilterBank, rate: float | Float32Array) -> FilterBank:
    """``(1 - rate) old + rate new`` filter by filter; ``rate`` is one number or ``(K,)``, in [0, 1]."""
    share = np.broadcast_to(np.asarray(rate, dtype=np.float32), (len(old),))[:, None, None]
    spectra = old.templates.spectra + share[:, None] * (new.templates.spectra - old.templates.spectra)
    coefficients = old.coefficients + share * (new.coefficients - old.coefficients)
    shape = old.templates.shape
    return FilterBank(Samples(spectra, _energies(spectra, shape), shape), coefficients)


def _energies(spectra: ComplexArray, shape: tuple[int, int]) -> Float32Array:
    """Sums of squares from half spectra, by Parseval: every column but the unpaired ones counts twice."""
    flat = spectra.reshape(len(spectra), -1, spectra.shape[-1])
    columns = np.einsum("bij,bij->bj", flat.real, flat.real) + np.einsum("bij,bij->bj", flat.imag, flat.imag)
    total = 2 * columns.sum(axis=1) - columns[:, 0]
    if shape[1] % 2 == 0:
        total -= columns[:, -1]
    return np.asarray(total / (shape[0] * shape[1]), dtype=np.float32)


def gaussian_labels(shape: tuple[int, int], sigma: float) -> ComplexArray:
    """Spectrum of the wanted response: a Gaussian of ``sigma`` cells that is one at shift zero, cyclic."""
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
    labels = np.exp(-(rows[:, None] ** 2 + columns[None, :] ** 2) / (2 * sigma**2))
    return np.asarray(scipy.fft.rfft2(labels.astype(np.float32)))


def cosine_window(shape: tuple[int, int]) -> Float32Array:
    """``(rows, columns)`` product of two Hann windows, zero on the border."""
    return np.outer(np.hanning(shape[0]), np.hanning(shape[1])).astype(np.float32)
