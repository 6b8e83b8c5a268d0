"""One pass of OpenCV-contrib's CSRT; a program of `Peer`."""

from typing import Any

import cv2
import numpy as np


def version() -> str:
    """Of OpenCV, if it has CSRT."""
    assert cv2.TrackerCSRT_create  # type: ignore[attr-defined]
    return cv2.__version__


def answer(job: dict[str, Any]) -> list[list[float]]:
    """Boxes x, y, width, height from the second image on.

    Args:
        job: ``images``, a file of ``(T, H, W, 3)`` uint8 BGR; ``box`` in the first; ``scales``, the sizes it tries.
    """
    cv2.setNumThreads(1)
    images, box = np.load(job["images"], mmap_mode="r"), job["box"]
    parameters = cv2.TrackerCSRT_Params()  # type: ignore[attr-defined]
    parameters.number_of_scales = job["scales"]
    tracker = cv2.TrackerCSRT_create(parameters)  # type: ignore[attr-defined]
    tracker.init(np.array(images[0]), tuple(round(value) for value in box))
    boxes = []
    for image in images[1:]:
        held, found = tracker.update(np.array(image))
        box = list(found) if held else box
        boxes.append(box)
    return boxes
