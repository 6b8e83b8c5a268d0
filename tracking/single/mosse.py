"""MOSSE: a linear correlation filter on grey values, in closed form; thesis 2.2.4.

Bolme et al., "Visual object tracking using adaptive correlation filters", CVPR 2010. The filter is a quotient of two
running sums, so an update costs one transform. The first frame is learnt under small random rotations and scalings.
"""

from __future__ import annotations

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from tsuiseki.tracking.filters.correlation_filters import Float32Array, cosine_window, gaussian_labels
from tsuiseki.tracking.single.search_windows import cut, peak
from tsuiseki.tracking.single.tracker import TargetState, box_about, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

# Longer side of the window, template pixels.
LONGEST = 96
# Side of the window over the side of the target.
PADDING = 1.5
# Share of a new frame in the running sums (the paper's eta).
LEARNING_RATE = 0.125
# Standard deviation of the response to learn, template pixels.
LABEL_SIGMA = 2.0
# Random rotations and scalings of the first frame that are learnt.
FIRST_VIEWS = 8
# Added to the denominator, so that frequencies without energy are not divided by zero.
REGULARISATION = 1e-2
# Peak to sidelobe ratio under which the target is lost, section 3.5 of the paper.
LOST_BELOW = 7.0
# Template pixels to each side of the peak that are no sidelobe: 11 x 11 in the paper.
SIDELOBE_EXCLUDED = 5


class Mosse:
    """The score is the peak-to-sidelobe ratio; below 7 the target counts as lost and nothing is learnt."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._size = np.asarray(box[2:] - box[:2], dtype=np.float64)
        self._centre = box_centre(box)
        self._scale = PADDING * float(self._size.max()) / LONGEST
        columns, rows = (max(16, 2 * round(PADDING * side / self._scale / 2)) for side in self._size.tolist())
        self._shape = rows, columns
        self._taper = cosine_window(self._shape)
        self._labels = gaussian_labels(self._shape, LABEL_SIGMA)
        patch = self._patch(image)
        spectra = [self._spectrum(view) for view in (patch, *(self._disturbed(patch) for _ in range(FIRST_VIEWS)))]
        self._numerator = sum(self._labels * s.conj() for s in spectra)
        self._denominator = sum((s * s.conj()).real for s in spectra)

    def follow(self, image: ImageArray) -> TargetState:
        spectrum = self._spectrum(self._patch(image))
        response = scipy.fft.irfft2(spectrum * self._numerator / (self._denominator + REGULARISATION), s=self._shape)
        shift, value = peak(response)
        ratio = peak_to_sidelobe(response, value)
        if ratio >= LOST_BELOW:
            self._centre = self._centre + shift * self._scale
            centred = self._spectrum(self._patch(image))
            self._numerator += LEARNING_RATE * (self._labels * centred.conj() - self._numerator)
            self._denominator += LEARNING_RATE * ((centred * centred.conj()).real - self._denominator)
        return TargetState(box_about(self._centre, self._size), ratio, "tracking" if ratio >= LOST_BELOW else "lost")

    def _patch(self, image: ImageArray) -> Float32Array:
        rows, columns = self._shape
        patch = cut(image, self._centre[None], np.array([self._scale]), columns, rows)[0]
        return np.asarray(cv2.cvtColor(patch, cv2.COLOR_RGB2GRAY), dtype=np.float32)

    def _spectrum(self, patch: Float32Array) -> NDArray[np.complex64]:
        logarithm = np.log1p(patch)
        logarithm -= logarithm.mean()
        return np.asarray(scipy.fft.rfft2(logarithm / (logarithm.std() + np.float32(1e-5)) * self._taper))

    def _disturbed(self, patch: Float32Array) -> Float32Array:
        """The patch a little turned and stretched about its middle."""
        change = np.eye(2) + self._rng.normal(0, 0.05, (2, 2))
        middle = np.array([patch.shape[1], patch.shape[0]]) / 2
        matrix = np.column_stack([change, middle - change @ middle])
        return np.asarray(
            cv2.warpAffine(patch, matrix, (patch.shape[1], patch.shape[0]), borderMode=cv2.BORDER_REPLICATE)
        )


def peak_to_sidelobe(response: Float32Array, value: float) -> float:
    """How many standard deviations the peak stands above the map away from it."""
    rows, columns = response.shape
    row, column = divmod(int(np.argmax(response)), columns)
    far_row = np.abs((np.arange(rows) - row + rows // 2) % rows - rows // 2) > SIDELOBE_EXCLUDED
    far_column = np.abs((np.arange(columns) - column + columns // 2) % columns - columns // 2) > SIDELOBE_EXCLUDED
    side = response[far_row[:, None] | far_column[None, :]]
    return float((value - side.mean()) / (side.std() + 1e-9)) if side.size else 0.0
