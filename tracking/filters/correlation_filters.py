"""Kernelised correlation filters as banks that share one search window, and one filter that changes slowly.

Henriques et al., "High-speed tracking with kernelized correlation filters", PAMI 2015 (KCF); thesis section 2.2.4.
A sample is a window of features, already multiplied by a cosine window, kept as its spectrum. A filter holds a template
(a running mean of samples) and the dual coefficients of a ridge regression from every cyclic shift of the template
to a Gaussian label centred at shift zero. Maps are ``(rows, columns)`` over cyclic shifts: ``map[0, 0]`` is no shift.
Arrays have a leading filter or sample axis, so that all filters respond in one batched transform.

The linear filter lives on the target alone (`learn`). Li et al., "Learning spatial-temporal regularized correlation
filters for visual tracking", CVPR 2018, with the support of Galoogahi et al., "Learning background-aware correlation
filters for visual tracking", ICCV 2017. A window of D channels with spectrum ``x`` and the filter ``f`` (spectrum
``c``, conjugated) answer ``r = sum_d x_d c_d``. Learning from one window minimises

    1/2 |sum_d x_d * f_d - y|^2  +  mu/2 |f - f_before|^2      with f = 0 outside the target,

``y`` being a Gaussian at shift zero. Shifted windows show true background and not the target wrapped around, so the
window may be much larger than the target; the second term is the memory, instead of a running mean.

The constraint is split off, ``f = g`` with ``g`` on the support (ADMM): per frequency the first step is the solution
of a D x D system of rank one plus identity, closed by Sherman and Morrison; the second is a mask in the image plane.
The mask is a small rectangle, so its rows and columns are transformed alone, as products of matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from pydantic import PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.types import Columns

Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex64]


@dataclass(frozen=True)
class Samples(Columns):
    """Windows of features in the frequency domain.

    Attributes:
        spectra: ``(B, C, rows, columns // 2 + 1)`` complex64.
        energies: ``(B,)`` float32, sum of squares of each window.
        shape: rows and columns.
    """

    spectra: ComplexArray
    energies: Float32Array
    shape: tuple[int, int]

    @property
    def size(self) -> int:
        """Number of features of a window."""
        return int(self.spectra.shape[1]) * self.shape[0] * self.shape[1]


def transform(features: Float32Array) -> Samples:
    """Samples of windows ``(B, C, rows, columns)`` float32."""
    energies = np.einsum("bcij,bcij->b", features, features)
    return Samples(scipy.fft.rfft2(features), energies, (features.shape[2], features.shape[3]))


@pydantic_dataclass(frozen=True, config=SETTINGS)
class GaussianKernel:
    """``exp(-|a - b|^2 / (sigma^2 n))`` with ``n`` features in a window, KCF equation 30.

    A call gives its spectrum ``(K, rows, columns // 2 + 1)`` between windows and all cyclic shifts of templates.

    Attributes:
        sigma: bandwidth, > 0.
    """

    sigma: PositiveFloat = 0.5

    def __call__(self, windows: Samples, templates: Samples) -> ComplexArray:
        rows, columns = windows.shape
        cross = scipy.fft.irfft2((windows.spectra * templates.spectra.conj()).sum(axis=1), s=(rows, columns))
        distance = (windows.energies + templates.energies)[:, None, None] - 2 * cross
        scale = np.float32(-1 / (self.sigma**2 * windows.size))
        return np.asarray(scipy.fft.rfft2(np.exp(np.maximum(distance, 0) * scale)))


@dataclass(frozen=True)
class FilterBank(Columns):
    """K filters.

    Attributes:
        templates: the running means of the training samples, one a filter.
        coefficients: ``(K, rows, columns // 2 + 1)`` complex64, the dual coefficients.
    """

    templates: Samples
    coefficients: ComplexArray


def join(banks: list[FilterBank]) -> FilterBank:
    """All filters of several banks in one, in their order."""
    spectra = np.concatenate([bank.templates.spectra for bank in banks])
    energies = np.concatenate([bank.templates.energies for bank in banks])
    coefficients = np.concatenate([bank.coefficients for bank in banks])
    return FilterBank(Samples(spectra, energies, banks[0].templates.shape), coefficients)


def train(samples: Samples, labels: ComplexArray, kernel: GaussianKernel, regularisation: float) -> FilterBank:
    """One filter a sample, KCF equation 17, of B windows centred on the target.

    ``labels`` is the spectrum of `gaussian_labels`, and ``regularisation`` lambda of the ridge regression, > 0.
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


# mu over the number of cells: how strongly the filter keeps to that of the frame before; windows have a mean square of
# one.
MEMORY = 300.0
# Penalties of ``f = g`` over the number of cells, one a round of ADMM.
PENALTIES = (1.0, 10.0)


@dataclass(frozen=True)
class Support:
    """A rectangle of cells about shift zero, outside of which a filter is zero.

    Attributes:
        mask: ``(rows, columns)`` one inside, zero elsewhere.
        inwards: ``(H, rows)`` the inverse transform of the H rows inside.
        across: ``(2 * half, 2 * half)`` along the columns, with ``half = columns // 2 + 1``: half a spectrum, real and
            imaginary parts in turn, to that of what lies inside.
        outwards: ``(rows, H)`` the transform of the H rows.
    """

    mask: Float32Array
    inwards: ComplexArray
    across: Float32Array
    outwards: ComplexArray

    @classmethod
    def of(cls, shape: tuple[int, int], height: float, width: float) -> Support:
        """Cells at most half of ``height`` x ``width`` cells from shift zero, cyclic."""
        rows, columns = shape
        row, column = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
        inside, across = row <= height / 2, column <= width / 2
        transform = np.fft.fft(np.eye(rows))
        parts = np.eye(2 * (columns // 2 + 1)).view(np.complex128)
        inner = np.fft.rfft(np.fft.irfft(parts, n=columns) * across)
        return cls(
            (inside[:, None] & across).astype(np.float32),
            np.ascontiguousarray(transform.conj()[inside] / rows, dtype=np.complex64),
            np.ascontiguousarray(inner.view(np.float64), dtype=np.float32),
            np.ascontiguousarray(transform[:, inside], dtype=np.complex64),
        )

    def restrict(self, spectra: ComplexArray) -> ComplexArray:
        """``(D, rows, columns // 2 + 1)`` spectra of the same windows with zeros outside the rectangle."""
        inside = self.inwards @ spectra
        inner = inside.view(np.float32).reshape(-1, len(self.across)) @ self.across
        return np.asarray(self.outwards @ inner.view(np.complex64).reshape(inside.shape))


def learn(
    window: ComplexArray,
    label: ComplexArray,
    support: Support,
    previous: ComplexArray | None,
) -> ComplexArray:
    """The filter after one more window.

    Args:
        window: ``(D, rows, columns // 2 + 1)`` spectrum of a window with the target at shift zero.
        label: ``(rows, columns // 2 + 1)`` spectrum of the response to learn, see `gaussian_labels`.
        support: where the filter may be other than zero.
        previous: the filter so far, shaped like ``window``; None for the first window.
    """
    cells = np.float32(support.mask.size)
    memory = np.float32(MEMORY) * cells if previous is not None else np.float32(0)
    squares = np.square(window.view(np.float32))
    energy = (squares[..., ::2] + squares[..., 1::2]).sum(axis=0)
    conjugate = window.conj()
    target = conjugate * label
    if previous is not None:
        target += _times(previous, memory)
    masked, dual = target, None  # the first round knows of no rectangle
    for penalty in PENALTIES:
        weight = np.float32(penalty) * cells
        right = target if dual is None else target + _times(masked - dual, weight)
        filters = conjugate * (np.einsum("dij,dij->ij", window, right) / (weight + memory + energy))
        filters = _times(np.subtract(right, filters, out=filters), 1 / (weight + memory))
        if dual is not None:
            filters += dual
        masked = support.restrict(filters)
        dual = np.subtract(filters, masked, out=filters)
    return masked


def _times(spectra: ComplexArray, factor: np.float32) -> ComplexArray:
    """``spectra`` times a real ``factor``; numpy would make a complex number of it and take twice as long."""
    return np.asarray((spectra.view(np.float32) * factor).view(np.complex64))


def regularised_response(filters: ComplexArray, windows: ComplexArray, shape: tuple[int, int]) -> Float32Array:
    """``(..., rows, columns)`` responses over cyclic shifts; ``[..., 0, 0]`` is no shift.

    Args:
        filters: ``(..., D, rows, columns // 2 + 1)`` from `learn`.
        windows: likewise, to broadcast against ``filters``.
        shape: rows and columns.
    """
    return np.asarray(scipy.fft.irfft2((filters * windows).sum(axis=-3), s=shape))
