"""A correlation filter over sizes: which of several sizes of the target fits the present frame.

Danelljan et al., "Accurate scale estimation for robust visual tracking", BMVC 2014 (DSST), section 3.2. A sample is a
row of features for each of S sizes of the target's box, cut at one size; the filter is a ridge regression over cyclic
shifts in size, as numerator and denominator that are running means.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray

Complex2D = NDArray[np.complex64]
# Lambda of the ridge regression, a feature.
_REGULARISATION = 0.01
# Deviation of the response to learn, times the square root of the number of sizes, steps of size.
_LABEL_WIDTH = 0.25


@dataclass(frozen=True)
class ScaleSample:
    """Features of a target's box at S sizes; they are used twice, to measure the size and to learn it.

    Attributes:
        rows: ``(S, D)`` of neighbouring sizes.
    """

    rows: FloatArray | NDArray[np.float32]

    @cached_property
    def spectrum(self) -> Complex2D:
        """``(S // 2 + 1, D)`` of the tapered rows."""
        return np.asarray(scipy.fft.rfft(self.rows * _taper(len(self.rows)), axis=0), dtype=np.complex64)


@dataclass(frozen=True)
class ScaleFilter:
    """Numerator and denominator, eq. (3) and (4), of the H = S // 2 + 1 frequencies of real rows.

    Attributes:
        numerator: ``(H, D)``.
        denominator: ``(H,)``, not negative.
    """

    numerator: Complex2D
    denominator: NDArray[np.float32]

    @classmethod
    def learn(cls, sample: ScaleSample, offset: float = 0.0) -> ScaleFilter:
        """From a sample, the right size ``offset`` rows after the middle one."""
        spectrum = sample.spectrum
        numerator = spectrum.conj() * _label(len(sample.rows), offset)[:, None]
        return cls(numerator, (spectrum.real**2 + spectrum.imag**2).sum(axis=1))

    def blend(self, new: ScaleFilter, rate: float) -> ScaleFilter:
        """Moved towards ``new`` by ``rate`` in [0, 1]."""
        share = np.float32(rate)
        return ScaleFilter(
            self.numerator + share * (new.numerator - self.numerator),
            self.denominator + share * (new.denominator - self.denominator),
        )

    def respond(self, sample: ScaleSample) -> FloatArray:
        """``(S,)`` response to a sample, in the order of the sizes; eq. (6)."""
        spectrum = (self.numerator * sample.spectrum).sum(axis=1)
        least = _REGULARISATION * self.numerator.shape[1]
        response = np.fft.irfft(spectrum / (self.denominator + least), n=len(sample.rows))
        return np.asarray(response[_cyclic_steps(len(response))])


def best_offset(response: FloatArray) -> float:
    """Steps from the middle size to where the response over sizes is greatest, between sizes by a parabola."""
    k = int(np.argmax(response))
    offset = float(k - len(response) // 2)
    if 0 < k < len(response) - 1:
        curvature = 2 * response[k] - response[k - 1] - response[k + 1]
        offset += float(0.5 * (response[k + 1] - response[k - 1]) / curvature) if curvature > 1e-9 else 0.0
    return offset


def far_peak(response: FloatArray, least: int, margin: float) -> float:
    """`best_offset` where that is a peak far from the middle size, 0 else.

    Args:
        response: ``(S,)``, S odd.
        least: steps from which on it is far.
        margin: how much greater than at the middle it must be. One that is greatest at either end has no peak.
    """
    middle, top = len(response) // 2, int(np.argmax(response))
    if abs(top - middle) < least or top in (0, len(response) - 1) or response[top] - response[middle] <= margin:
        return 0.0
    return best_offset(response)


def far_area(ratio: float, step: float, least: int) -> float:
    """Steps of size by which an area has grown, where they are at least ``least``, 0 else.

    Args:
        ratio: of the area now to what it was at the present size, > 0.
        step: ratio of neighbouring sizes, > 1.
        least: steps from which on it is far.
    """
    steps = 0.5 * float(np.log(max(ratio, 1e-6)) / np.log(step))
    return steps if abs(steps) >= least else 0.0


@lru_cache(maxsize=8)
def _taper(count: int) -> NDArray[np.float32]:
    return np.hanning(count + 2)[1:-1, None].astype(np.float32)


@lru_cache(maxsize=8)
def _cyclic_steps(count: int) -> NDArray[np.int64]:
    """``(count,)`` cyclic positions of the steps from the middle size, the smallest size first."""
    return (np.arange(count) - count // 2) % count


def _label(count: int, offset: float) -> Complex2D:
    steps = (np.arange(count) + count // 2) % count - count // 2  # in cyclic order, no step first
    label = np.exp(-0.5 * ((steps - offset) / (_LABEL_WIDTH * np.sqrt(count))) ** 2)
    return np.asarray(np.fft.rfft(label), dtype=np.complex64)
