"""A linear correlation filter that lives on the target alone and changes slowly.

Li et al., "Learning spatial-temporal regularized correlation filters for visual tracking", CVPR 2018, with the support
of Galoogahi et al., "Learning background-aware correlation filters for visual tracking", ICCV 2017. A window of D
channels with spectrum ``x`` and the filter ``f`` (spectrum ``c``, conjugated) answer ``r = sum_d x_d c_d``. Learning
from one window minimises

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

from tsuiseki.tracking.filters.kernelised_correlation import ComplexArray

Float32Array = NDArray[np.float32]


@dataclass(frozen=True)
class RegularisedLearning:
    """Constants of learning; windows have a mean square of one.

    Attributes:
        memory: mu over the number of cells, >= 0: how strongly the filter keeps to that of the frame before.
        penalties: of ``f = g`` over the number of cells, one a round of ADMM, > 0.
    """

    memory: float = 300.0
    penalties: tuple[float, ...] = (1.0, 10.0)


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
        kept = np.fft.rfft(np.fft.irfft(parts, n=columns) * across)
        return cls(
            (inside[:, None] & across).astype(np.float32),
            np.ascontiguousarray(transform.conj()[inside] / rows, dtype=np.complex64),
            np.ascontiguousarray(kept.view(np.float64), dtype=np.float32),
            np.ascontiguousarray(transform[:, inside], dtype=np.complex64),
        )

    def restrict(self, spectra: ComplexArray) -> ComplexArray:
        """``(D, rows, columns // 2 + 1)`` spectra of the same windows with zeros outside the rectangle."""
        inside = self.inwards @ spectra
        kept = inside.view(np.float32).reshape(-1, len(self.across)) @ self.across
        return np.asarray(self.outwards @ kept.view(np.complex64).reshape(inside.shape))


def learn(
    window: ComplexArray,
    wanted: ComplexArray,
    support: Support,
    before: ComplexArray | None,
    settings: RegularisedLearning,
) -> ComplexArray:
    """The filter after one more window.

    Args:
        window: ``(D, rows, columns // 2 + 1)`` spectrum of a window with the target at shift zero.
        wanted: ``(rows, columns // 2 + 1)`` spectrum of the wanted response.
        support: where the filter may be other than zero.
        before: the filter so far, shaped like ``window``; None for the first window.
        settings: see there.
    """
    cells = np.float32(support.mask.size)
    memory = np.float32(settings.memory) * cells if before is not None else np.float32(0)
    squares = np.square(window.view(np.float32))
    energy = (squares[..., ::2] + squares[..., 1::2]).sum(axis=0)
    conjugate = window.conj()
    target = conjugate * wanted
    if before is not None:
        target += _times(before, memory)
    masked, dual = target, None  # the first round knows of no rectangle
    for penalty in settings.penalties:
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


def respond(filters: ComplexArray, windows: ComplexArray, shape: tuple[int, int]) -> Float32Array:
    """Responses over cyclic shifts.

    Args:
        filters: ``(..., D, rows, columns // 2 + 1)`` from `learn`.
        windows: likewise, to broadcast against ``filters``.
        shape: rows and columns.

    Returns:
        ``(..., rows, columns)``; ``[..., 0, 0]`` is no shift.
    """
    return np.asarray(scipy.fft.irfft2((filters * windows).sum(axis=-3), s=shape))
