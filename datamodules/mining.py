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
from tsuiseki.tracking.features.networks.exported import SizedDetect, open_detector
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray

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
        detector: whose false boxes are sought in the training pictures before the first step: an exported one, or the
            bare name of one that ships; empty for none.
        share: of the examples that are windows about one of them, in [0, 1).
        lowest_score: of those boxes, in (0, 1).
    """

    detector: str = ""
    share: float = 0.3
    lowest_score: float = 0.2

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
        middles: ``(N, 2)`` of the boxes, pixels.
        scales: ``(N,)`` pixels of the detector's input a pixel of the picture.
        scores: ``(N,)`` in (0, 1).
    """

    images: np.ndarray[tuple[int], np.dtype[np.int64]]
    middles: FloatArray
    scales: FloatArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.images)

    def draw(
        self, rng: np.random.Generator, footage: Footage, size: tuple[int, int], augmentation: Augmentation
    ) -> tuple[int, FloatArray, Augmentation]:
        """One of them, the likelier the surer the detector is.

        Args:
            rng: draws it.
            footage: the one these boxes are of.
            size: height and width of the network's input.
            augmentation: of any example.

        Returns:
            The picture's index, where the box has its middle, and the augmentation that shows things about as large as
            the detector saw them.
        """
        one = int(rng.choice(len(self), p=self.scores / self.scores.sum()))
        index = int(self.images[one])
        as_seen = self.scales[one] / fitted_scale(footage.example(index).image.shape[:2], size)
        scale = (as_seen / _ABOUT_AS_LARGE, as_seen * _ABOUT_AS_LARGE)
        return index, self.middles[one], replace(augmentation, scale=scale)


def mine(footage: Sequence[Footage], mining: Mining) -> list[FalseBoxes]:
    """The false boxes of ``mining.detector`` in each of ``footage``.

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
    return found


def _false_boxes(detector: SizedDetect, footage: Footage) -> FalseBoxes:
    images, middles, scales, scores = [], [], [], []
    for index in range(len(footage)):
        example = footage.example(index)
        size = example.image.shape[:2]
        found = detector.detect([example.image])[0]
        wrong = found.select(np.flatnonzero(is_nobody(found, example.boxes, example.ignored)))
        images.append(np.full(len(wrong), index))
        middles.append((wrong.boxes[:, :2] + wrong.boxes[:, 2:]) / 2)
        scales.append(np.full(len(wrong), fitted_scale(size, detector.input_size or size)))
        scores.append(wrong.scores)
    return FalseBoxes(
        np.concatenate(images).astype(np.int64), np.concatenate(middles), np.concatenate(scales), np.concatenate(scores)
    )


def is_nobody(
    found: Detections, boxes: FloatArray, ignored: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """``(N,)`` which of ``found`` are away from all labels ``(M, 4)``, and not within one of those ``ignored``."""
    away = iou_matrix(found.boxes, boxes).max(axis=1, initial=0) < _MEETS
    inside = intersections(found.boxes[:, None], boxes[ignored][None]) / areas(found.boxes)[:, None]
    return np.asarray(away & (inside.max(axis=1, initial=0) < _INSIDE))
