"""The plain loop about a Siamese network, as OpenCV's `cv2.TrackerNano` has it, its rounding included.

Each frame has one response, about where the target was. Scores are multiplied by a penalty for a change of size and
shape, and mixed with a window that is highest in the middle (Li et al., "High performance visual tracking with Siamese
region proposal network", CVPR 2018, eq. 14). The best cell's box is the place; the size goes towards its size. The loop
is for comparison: with NanoTrack's files its boxes are OpenCV's. So it also does what OpenCV does by mistake: the size
in the penalty is compared with the target's place.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.single.siamese import SiameseNetwork, Square, size_change, square_side
from tsuiseki.tracking.single.tracker import TargetState
from tsuiseki.tracking.types import FloatArray, ImageArray, Status

# Factor on the change of size and shape in the penalty's exponent.
PENALTY = 0.055
# Share of the window in what decides.
WINDOW = 0.455
# Share of a new size, times penalty and score.
RATE = 0.37
# Smallest side of a box, pixels.
LEAST_SIDE = 10.0
# Score from which the target counts as tracked; OpenCV leaves that to its user.
TRACKED = 0.5


class SiameseLoop:
    """A network that follows the best cell; the score is the network's own there, in [0, 1].

    Args:
        network: that responds.
    """

    def __init__(self, network: SiameseNetwork) -> None:
        self._network = network

    def start(self, image: ImageArray, box: FloatArray) -> None:
        corner, self._size = np.trunc(box[:2]), np.trunc(box[2:] - box[:2])
        self._centre = corner + self._size / 2
        square = _square(self._centre, self._network.template_side(self._size))
        self._templates = [self._network.template(image, square)]

    def follow(self, image: ImageArray) -> TargetState:
        pixels = self._network.template_pixels
        rounded = float(np.sqrt(np.prod(self._size + int(self._size.sum()) / 2)))
        side = rounded * self._network.template_side(self._size) / square_side(self._size)
        square = _square(self._centre, side * (self._network.search_pixels // pixels))
        (response,) = self._network.respond(image, square, self._templates)
        sizes = response.boxes[..., 2:] - response.boxes[..., :2]
        # OpenCV compares with the target's place, see the module.
        change = size_change(sizes, square_side(self._centre), self._size[0] / self._size[1])
        penalty = np.exp(-PENALTY * (change - 1))
        window = cv2.createHanningWindow(response.scores.shape[::-1], cv2.CV_64F)
        decisive = penalty * response.scores * (1 - WINDOW) + window * WINDOW
        cell = np.unravel_index(int(np.argmax(decisive)), decisive.shape)
        rate = RATE * float(penalty[cell] * response.scores[cell])
        shift = (response.boxes[cell][:2] + response.boxes[cell][2:]) / 2
        extent = np.array(image.shape[1::-1], dtype=np.float64)
        self._centre = np.clip(self._centre + shift * side / pixels, 0, extent)
        self._size = np.clip(self._size + rate * (sizes[cell] * side / pixels - self._size), LEAST_SIDE, extent)
        corner = np.trunc(self._centre - self._size / 2)
        score = float(response.scores[cell])
        status: Status = "tracking" if score >= TRACKED else "searching"
        return TargetState(np.concatenate([corner, corner + np.trunc(self._size)]), score, status)


def _square(centre: FloatArray, side: float) -> Square:
    """OpenCV's whole square about a place."""
    whole = int(side)
    left, top = (int(value) - (whole + 1) // 2 for value in centre)
    return Square(left, top, whole)
