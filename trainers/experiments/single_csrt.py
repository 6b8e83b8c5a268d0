"""One pass of OpenCV-contrib's CSRT; runs alone, in an environment that need not have this package.

Reads from standard input a line of JSON (``scales``, ``box`` as x, y, width, height, ``shape``, ``count``) and the
images, blue first; writes the boxes from the second image on. With ``--version`` it names OpenCV's version, if that
has the tracker.
"""

import json
import sys

import cv2
import numpy as np


def main() -> None:
    """The pass."""
    cv2.setNumThreads(1)
    head = json.loads(sys.stdin.buffer.readline())
    size = int(np.prod(head["shape"]))

    def read() -> np.ndarray:
        return np.frombuffer(sys.stdin.buffer.read(size), np.uint8).reshape(head["shape"])

    parameters = cv2.TrackerCSRT_Params()  # type: ignore[attr-defined]
    parameters.number_of_scales = head["scales"]
    tracker = cv2.TrackerCSRT_create(parameters)  # type: ignore[attr-defined]
    box = head["box"]
    tracker.init(read(), tuple(round(value) for value in box))
    boxes = []
    for _ in range(head["count"] - 1):
        held, found = tracker.update(read())
        box = list(found) if held else box
        boxes.append(box)
    print(json.dumps(boxes))


if __name__ == "__main__":
    if sys.argv[1:] == ["--version"]:
        assert cv2.TrackerCSRT_create  # type: ignore[attr-defined]
        print(cv2.__version__)
    else:
        main()
