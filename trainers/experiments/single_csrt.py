"""One pass of OpenCV-contrib's CSRT: `python single_csrt.py < job.json > boxes.json`, in an environment of its own.

A job is ``{"images": file, "box": [x, y, width, height], "scales": number}``; the file has ``(T, H, W, 3)`` uint8 BGR.
The answer has the boxes from the second image on. With ``--version`` it names OpenCV's version, if that has CSRT.
"""

import json
import sys

import cv2
import numpy as np


def main() -> None:
    """The pass."""
    cv2.setNumThreads(1)
    job = json.load(sys.stdin)
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
    print(json.dumps(boxes))


if __name__ == "__main__":
    if sys.argv[1:] == ["--version"]:
        assert cv2.TrackerCSRT_create  # type: ignore[attr-defined]
        print(cv2.__version__)
    else:
        main()
