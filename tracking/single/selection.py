"""A box that the user draws with the mouse, on a page in the browser."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.drawing import drawn_on
from tsuiseki.tracking.types import FloatArray, ImageArray

# Of a drawn box, at least, pixels.
LEAST_SIDE = 2.0


def select_box(image: ImageArray) -> FloatArray:
    """``(4,)`` corners of a box that the user draws on an image with the mouse; see `drawn_on`.

    Raises:
        RequestError: the page cannot be served.
    """

    def box_of(answer: Any) -> FloatArray:
        try:
            x, y, width, height = map(float, answer)
        except (TypeError, ValueError):
            x = y = width = height = np.nan
        corners: FloatArray = np.array([x, y, x + width, y + height])
        if not np.isfinite(corners).all():
            raise RequestError("expected four numbers x, y, width, height")
        corners = np.clip(corners, 0, np.tile(image.shape[1::-1], 2))
        if (corners[2:] - corners[:2]).min() < LEAST_SIDE:
            raise RequestError(f"expected a box of at least {LEAST_SIDE:g} x {LEAST_SIDE:g} pixels inside the image")
        return np.asarray(corners)

    return drawn_on(image, "target.html", box_of, "draw the box of the target", "give `box` instead")
