"""One pass of an OpenCV-contrib tracker, for `benchmarks/filters/single_target.py`; runs in an environment of its own.

    python -m benchmarks.filters.opencv_peer CSRT images.txt x,y,w,h

Prints the milliseconds of CPU a frame, one thread.
"""

import sys
import time

import cv2

cv2.setNumThreads(1)
name, listing, box = sys.argv[1:]
with open(listing, encoding="utf-8") as file:  # noqa: PTH123, this runs alone in the peer's environment
    images = [cv2.imread(line.strip()) for line in file if line.strip()]
tracker = getattr(cv2, f"Tracker{name}_create")()
tracker.init(images[0], tuple(int(float(value)) for value in box.split(",")))
start = time.process_time()
for image in images[1:]:
    tracker.update(image)
print(1000 * (time.process_time() - start) / (len(images) - 1))
