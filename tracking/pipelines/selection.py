"""A box that the user draws with the mouse."""

from __future__ import annotations

import os
import sys

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray


def select_box(image: ImageArray) -> FloatArray:
    """``(4,)`` corners of a box that the user draws on an image with the mouse.

    Raises:
        RequestError: there is no display or no window, or nothing was drawn.
    """
    needed = "a display and an OpenCV with windows (pip install opencv-python)"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        # Without this OpenCV's window library ends the process.
        raise RequestError(f"`select`: expected {needed}, found no display; give `box` X,Y,W,H instead")
    try:
        x, y, w, h = cv2.selectROI("target", np.ascontiguousarray(image[..., ::-1]))
        cv2.destroyWindow("target")
    except (cv2.error, AttributeError) as error:
        raise RequestError(f"`select`: expected {needed}; give `box` X,Y,W,H instead") from error
    if w <= 0 or h <= 0:
        raise RequestError("`select`: expected a box, got none")
    return np.array([x, y, x + w, y + h], dtype=np.float64)
