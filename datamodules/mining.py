"""False boxes of a detector in labelled pictures, about which it is to look again. No torch.

Most of a picture shows nobody, and most of that a detector knows already. Where it still takes something for a person
it has something to learn, so windows about its own false boxes come more often than chance would bring them (Sung and
Poggio, *Example-based Learning for View-based Human Face Detection*, PAMI 1998, section 2.5, call it bootstrapping).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.augmentation import Augmentation, fitted_scale
from tsuiseki.datamodules.footage import Footage
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import SizedDetect, open_detector
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray

# A box that meets a label by as much is a misplaced person, which is another thing to learn.
_MEETS = 0.3
# Most of a box lies on a label to be ignored: nobody says whether it is right.
_INSIDE = 0.5
# A window shows things as large as the detector saw them, give or take as much.
_ABOUT_AS_LARGE = 1.25


@dataclass(frozen=True)
class Mining:
    """A round of mining.

    Attributes:
        detector: whose false boxes are sought in the training pictures before the first step: an exported one (of
            others if it tells its class of people), or the bare name of one that ships; empty for none.
        share: of the examples that are windows about one of them, in [0, 1); nobody is composed into these. 0 for none.
        lowest_score: of those boxes, in (0, 1).
        as_seen: these windows show things about as large as the detector saw them; else at any scale, as others do.
    """

    detector: str = ""
    share: float = 0.3
    lowest_score: float = 0.2
    as_seen: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.share < 1 and 0 < self.lowest_score < 1):
            raise RequestError(
                "mining: expected a share in [0, 1) and a lowest score in (0, 1), "
                f"got {self.share} and {self.lowest_score}"
            )


NO_MINING = Mining()


@dataclass(frozen=True)
class FalseBoxes:
    """What a detector takes for people in some footage and is nobody.

    Attributes:
        images: ``(N,)`` index into the footage.
        sizes: ``(N, 2)`` height and width of the picture, pixels.
        middles: ``(N, 2)`` of the boxes, pixels.
        scales: ``(N,)`` pixels of the detector's input a pixel of the picture.
        scores: ``(N,)`` in (0, 1).
    """

    images: IntArray
    sizes: IntArray
    middles: FloatArray
    scales: FloatArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.images)

    def draw(
        self, rng: np.random.Generator, size: tuple[int, int], augmentation: Augmentation
    ) -> tuple[int, FloatArray, Augmentation]:
        """One of them, the likelier the surer the detector is.

        Args:
            rng: draws it.
            size: height and width of the network's input.
            augmentation: of any example.

        Returns:
            The picture's index, where the box has its middle, and the augmentation that shows things about as large as
            the detector saw them.
        """
        one = int(rng.choice(len(self), p=self.scores / self.scores.sum()))
        as_seen = self.scales[one] / fitted_scale(self.sizes[one].tolist(), size)
        scale = (as_seen / _ABOUT_AS_LARGE, as_seen * _ABOUT_AS_LARGE)
        return int(self.images[one]), self.middles[one], replace(augmentation, scale=scale)


def mine(footage: Sequence[Footage], mining: Mining) -> list[FalseBoxes]:
    """The false boxes of ``mining.detector`` in each of ``footage``; says how many there are.

    Raises:
        RequestError: the file is no detector, or it is wrong about nothing.
    """
    detector = open_detector(mining.detector, mining.lowest_score)
    found = [_false_boxes(detector, each) for each in footage]
    if not any(map(len, found)):
        raise RequestError(
            f"expected false boxes of {mining.detector} with a score of {mining.lowest_score} or more in the training "
            "pictures, got none; lower data.mining.lowest_score, or leave data.mining.detector out"
        )
    pictures, boxes = sum(map(len, footage)), sum(map(len, found))
    print(f"mined {boxes} false boxes of {mining.detector} in {pictures} training pictures", flush=True)
    return found


def _false_boxes(detector: SizedDetect, footage: Footage) -> FalseBoxes:
    images, sizes, middles, scales, scores = [], [], [], [], []
    for index in range(len(footage)):
        example = footage.example(index)
        size = example.image.shape[:2]
        found = detector.detect([example.image])[0]
        wrong = found.select(np.flatnonzero(is_false(found, example.boxes, example.ignored)))
        images.append(np.full(len(wrong), index))
        sizes.append(np.tile(size, (len(wrong), 1)))
        middles.append((wrong.boxes[:, :2] + wrong.boxes[:, 2:]) / 2)
        scales.append(np.full(len(wrong), fitted_scale(size, detector.input_size or size)))
        scores.append(wrong.scores)
    return FalseBoxes(*(np.concatenate(parts) for parts in (images, sizes, middles, scales, scores)))


def is_false(found: Detections, boxes: FloatArray, ignored: BoolArray) -> BoolArray:
    """``(N,)`` which of ``found`` meet none of the labels ``(M, 4)``, and lie in none of those ``ignored``.

    Boxes about somebody's legs alone, or about two people, are false, too.
    """
    away = iou_matrix(found.boxes, boxes).max(axis=1, initial=0) < _MEETS
    inside = intersections(found.boxes[:, None], boxes[ignored][None]) / areas(found.boxes)[:, None]
    return np.asarray(away & (inside.max(axis=1, initial=0) < _INSIDE))
