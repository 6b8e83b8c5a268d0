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
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tsuiseki.tracking.filters.correlation.kernelised_correlation import ComplexArray

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


def learn(
    window: ComplexArray,
    wanted: ComplexArray,
    support: Float32Array,
    before: ComplexArray | None,
    settings: RegularisedLearning,
) -> ComplexArray:
    """The filter after one more window.

    Args:
        window: ``(D, rows, columns // 2 + 1)`` spectrum of a window with the target at shift zero.
        wanted: ``(rows, columns // 2 + 1)`` spectrum of the wanted response.
        support: ``(rows, columns)`` one on the target, about shift zero, zero elsewhere.
        before: the filter so far, shaped like ``window``; None for the first window.
        settings: see there.
    """
    cells = np.float32(support.size)
    memory = np.float32(settings.memory) * cells if before is not None else np.float32(0)
    energy = (window.real**2 + window.imag**2).sum(axis=0)
    conjugate = window.conj()
    target = conjugate * wanted
    if before is not None:
        target = target + memory * before
    masked = np.zeros_like(window)
    dual = np.zeros_like(window)
    for penalty in settings.penalties:
        weight = np.float32(penalty) * cells
        right = target + weight * (masked - dual)
        filters = (right - conjugate * ((window * right).sum(axis=0) / (weight + memory + energy))) / (weight + memory)
        image_plane = scipy.fft.irfft2(filters + dual, s=support.shape) * support
        masked = scipy.fft.rfft2(image_plane)
        dual = dual + filters - masked
    return np.asarray(masked, dtype=np.complex64)


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


def support_mask(shape: tuple[int, int], height: float, width: float) -> Float32Array:
    """``(rows, columns)`` one where a cell is at most half of ``height`` x ``width`` cells from shift zero, cyclic."""
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in shape)
    return ((rows[:, None] <= height / 2) & (columns[None, :] <= width / 2)).astype(np.float32)
