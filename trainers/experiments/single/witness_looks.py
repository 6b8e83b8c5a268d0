"""What other witnesses than those that ship say of a box, look by look, on the way of ``combined --recognise``.

Each says a number, the lower the likelier the target is lost. `other_witnesses` makes rules of them.
"""

from __future__ import annotations

from collections import deque
from itertools import product
from pathlib import Path
from statistics import median

import numpy as np

from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.matching import colour_bins
from tsuiseki.tracking.single.recognised import Describe, Recognised, RecognitionSettings
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.experiments.single.runs import Clip, generated_clip

WITNESSES = {
    "likeness": "likeness of the first box over its running median (what ships)",
    "gallery": "greatest likeness to the first box and ten early looks",
    "alone": "likeness of the box less that of the likest of eight boxes around",
    "halves": "colours of the first frame's upper and lower half, the less alike one",
    "course": "step of nine frames against the median one",
    "change": "likeness to the box nine frames ago",
}
_SHIPPED = RecognitionSettings()  # the running median is that of `recognition`
_GALLERY = 10


class Looks:
    """What the witnesses say of one clip, look by look.

    Args:
        describe: appearance features of boxes.
        image: the first frame.
        box: ``(4,)`` of the target in it.
    """

    def __init__(self, describe: Describe, image: ImageArray, box: FloatArray) -> None:
        self._describe = describe
        self._first = self._features(image, box[None])[0]
        self._halves = _half_colours(image, box)
        self._usual, self._gallery = [_SHIPPED.expected] * _SHIPPED.trusted, [self._first]
        self._before: deque[FloatArray] = deque([self._first], maxlen=3)
        self._boxes: deque[FloatArray] = deque([box], maxlen=4)
        self._steps: list[FloatArray] = []

    def look(self, image: ImageArray, box: FloatArray) -> list[float]:
        """A number a witness, in the order of `WITNESSES`."""
        sides = box[2:] - box[:2]
        around = [np.tile(sides * step, 2) for step in product((-1, 0, 1), repeat=2) if any(step)]
        found = self._features(image, box + np.array([np.zeros(4), *around]))
        likenesses = found @ self._first
        gallery = float((np.array(self._gallery) @ found[0]).max())
        change = float(self._before[0] @ found[0])
        self._before.append(found[0])
        usual = median(self._usual)
        if likenesses[0] >= 0.8 * usual and len(self._gallery) <= _GALLERY:
            self._gallery.append(found[0])
        if likenesses[0] >= _SHIPPED.share * usual:
            self._usual = [*self._usual, float(likenesses[0])][-_SHIPPED.memory :]
        alone = float(likenesses[0] - likenesses[1:].max())
        halves = float(np.minimum(self._halves, _half_colours(image, box)).sum(axis=1).min())
        return [float(likenesses[0]) / usual, gallery, alone, halves, self._course(box), change]

    def _course(self, box: FloatArray) -> float:
        self._boxes.append(box)
        moved = (self._boxes[-1] - self._boxes[0]).reshape(2, 2).mean(axis=0) * 3 / (len(self._boxes) - 1)
        step = moved / float(np.sqrt((box[2:] - box[:2]).prod()))
        usual = np.median(self._steps, axis=0) if self._steps else step
        self._steps.append(step)
        return -float(np.hypot(*(step - usual)))

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        found = np.asarray(self._describe(image, boxes), dtype=np.float64)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))


def _half_colours(image: ImageArray, box: FloatArray) -> FloatArray:
    """``(2, 64)`` shares of colours in the upper and lower half of a box; all zero where it is outside."""
    high, wide = image.shape[:2]
    x1, y1, x2, y2 = np.clip(np.round(box), 0, [wide, high, wide, high]).astype(int).tolist()
    bins, middle = colour_bins(image[y1:y2, x1:x2]), (y2 - y1) // 2
    return np.array([np.bincount(b.ravel(), minlength=64) / max(b.size, 1) for b in (bins[:middle], bins[middle:])])


def watch_looks(clip: Clip, network: Path, seed: int) -> list[list[float]]:
    """A row a frame: overlap, lost as it ships, lost by the tracker alone, and each witness (NaN between looks)."""
    describe, truth = Appearance(network, threads=1).describe, clip.sequence.boxes
    tracker = Combined(seed=seed)
    recognised = Recognised(tracker, describe)
    recognised.start(clip.images[0], truth[0])
    looks = Looks(describe, clip.images[0], truth[0])
    rows, nothing = [], [float("nan")] * len(WITNESSES)
    for t, image in enumerate(clip.images[1:], start=1):
        found = recognised.follow(image)
        overlap = float(iou_pairs(truth[t][None], found.box[None])[0]) if np.isfinite(truth[t]).all() else float("nan")
        said = looks.look(image, found.box) if t % recognised.settings.every == 0 else nothing
        rows.append([overlap, float(found.status == "lost"), float(tracker.state().status == "lost"), *said])
    return rows


def watch_chase_looks(number: int, network: Path, seed: int) -> list[list[float]]:
    """`watch_looks` on a generated chase."""
    return watch_looks(generated_clip(number), network, seed)
