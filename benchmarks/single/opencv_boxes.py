"""One pass of an OpenCV-contrib tracker, for `benchmarks/single/networks.py`; runs in an environment of its own.

    python opencv_boxes.py CSRT images.npy x1,y1,x2,y2

Prints boxes x1, y1, x2, y2 without the first frame, and milliseconds of CPU a frame, as JSON.
"""

import json
import sys
import time

import cv2
import numpy as np

cv2.setNumThreads(1)
name, path, corners = sys.argv[1:]
images = np.load(path, mmap_mode="r")
x1, y1, x2, y2 = (float(value) for value in corners.split(","))
tracker = getattr(cv2, f"Tracker{name}_create")()
tracker.init(np.ascontiguousarray(images[0][..., ::-1]), (int(x1), int(y1), int(x2 - x1), int(y2 - y1)))
boxes, spent, last = [], 0.0, [x1, y1, x2, y2]
for image in images[1:]:
    picture = np.ascontiguousarray(image[..., ::-1])
    begin = time.process_time()
    found, (x, y, w, h) = tracker.update(picture)
    spent += time.process_time() - begin
    last = [x, y, x + w, y + h] if found else last
    boxes.append(last)
print(json.dumps([boxes, 1000 * spent / len(boxes)]))
