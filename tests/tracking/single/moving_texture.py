"""A clip of a reddish texture that moves over a bluish one, and what a tracker of it is asked."""

import cv2
import numpy as np

from tsuiseki.tracking.geometry import iou_pairs

SIZE = (160, 200)


def texture(seed, height, width, tint):
    noise = np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(70 * smooth / smooth.std() + tint, 0, 255).astype(np.uint8)


def clip(path, height=36, width=24, sizes=None, hidden=(), shape=SIZE):
    """Images and boxes of a reddish texture that moves over a bluish one; in ``hidden`` frames it is not drawn."""
    background = texture(0, *shape, (60, 90, 150))
    sprite = texture(1, 72, 48, (170, 80, 50))
    images, boxes = [], []
    for t, (x, y) in enumerate(path):
        size = 1.0 if sizes is None else sizes[t]
        w, h = round(width * size), round(height * size)
        left, top = round(x - w / 2), round(y - h / 2)
        image = background.copy()
        if t not in hidden:
            drawn = cv2.resize(sprite, (w, h), interpolation=cv2.INTER_AREA)
            x1, y1, x2, y2 = max(left, 0), max(top, 0), min(left + w, shape[1]), min(top + h, shape[0])
            if x1 < x2 and y1 < y2:
                image[y1:y2, x1:x2] = drawn[y1 - top : y2 - top, x1 - left : x2 - left]
        images.append(image)
        boxes.append([left, top, left + w, top + h])
    return images, np.array(boxes, dtype=float)


def walk(frames, speed=2.0):
    t = np.arange(frames)
    return np.column_stack([60 + speed * t, 70 + 6 * np.sin(t / 4)])


def run(tracker, images, box):
    tracker.start(images[0], box)
    return [tracker.follow(image) for image in images[1:]]


def overlaps(seen, boxes):
    return iou_pairs(np.array([s.box for s in seen]), boxes[1:])


def mean_colours(image, boxes):
    """Features ``(N, 3)`` of boxes: their mean colours, around the middle of the range."""
    found = []
    for x1, y1, x2, y2 in np.clip(boxes.astype(int), 0, np.tile(image.shape[1::-1], 2) - 1):
        found.append(image[y1 : max(y2, y1 + 1), x1 : max(x2, x1 + 1)].mean(axis=(0, 1)) - 127)
    return np.array(found)
