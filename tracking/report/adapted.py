"""`report.html` of models that learnt a camera: what changed from round to round, and what they learnt from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.geometry import clip_boxes, grown, iou_matrix
from tsuiseki.tracking.report.rendering import render
from tsuiseki.tracking.types import Detections, ImageArray, IntArray

HEADINGS = {
    "agreement": "Agreement",
    "people": "People",
    "boxes": "Boxes a frame",
    "detections": "Detections a frame",
    "rejected": "Rejected a frame",
}
# RGB of boxes that both pictures have, and of those that the other one lacks.
_COLOUR = (255, 196, 0)
_ONLY_HERE = (40, 110, 255)  # told apart from the other by the colour-blind, too
# Overlap from which two boxes are the same.
_SAME = 0.5
# Longest side of a picture on the page, pixels; it is stored twice as large for dense screens.
_LONGEST = 480
# Height of a crop, pixels.
_CROP = 96


@dataclass(frozen=True)
class BeforeAndAfter:
    """One picture ``(H, W, 3)`` uint8 RGB, and the detections in it of the start and of the round that is shown."""

    caption: str
    image: ImageArray
    start: Detections
    later: Detections

    def pictures(self, name: str) -> list[tuple[str, int, ImageArray]]:
        """Name, number of detections and picture of the start and of the round of that name."""
        in_both = assign_overlaps(iou_matrix(self.start.boxes, self.later.boxes), _SAME)
        return [
            (caption, len(detections), _drawn(self.image, detections, shared))
            for caption, detections, shared in zip(("start", name), (self.start, self.later), in_both, strict=True)
        ]


@dataclass(frozen=True)
class AdaptedReport:
    """What the page shows.

    Attributes:
        sources: the videos.
        rounds: the numbers of each, by the names in `HEADINGS`.
        best: the round that is kept; 0 where none is.
        compared: pictures before and after.
        examples: crops by what they are examples of.
        compared_round: whose detections are compared with those of the start.
        notes: lines about the camera and the end of the rounds.
        unlearnt: name of the detector that is left where no round is kept.
    """

    sources: Sequence[str]
    rounds: Sequence[Mapping[str, float]]
    best: int
    compared: Sequence[BeforeAndAfter]
    examples: Mapping[str, Sequence[ImageArray]]
    compared_round: int
    notes: Sequence[str] = ()
    unlearnt: str = "the start"


def adapted_page(report: AdaptedReport) -> str:
    """The page as HTML, self-contained; the round that is kept is marked."""
    learnt = len(report.rounds) - 1
    outcome = f"round {report.best} is kept" if report.best else f"no round is kept: what is left is {report.unlearnt}"
    return render(
        "adapted.html.j2",
        title=f"A camera learnt from {', '.join(report.sources)}",
        introduction=f"{learnt} round{'' if learnt == 1 else 's'}; {outcome}.",
        report=report,
        head=["", *HEADINGS.values()],
        rows=[
            [f"round {number}" if number else "start", *(_number(values[key]) for key in HEADINGS)]
            for number, values in enumerate(report.rounds)
        ],
        is_best=lambda row, _: 0 < row == report.best,
        later=f"round {report.compared_round}" + ("" if report.compared_round == report.best else ", not kept"),
    )


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.3f}" if value <= 1 else f"{value:.1f}"


def _drawn(image: ImageArray, detections: Detections, in_both: IntArray) -> ImageArray:
    scale = min(1.0, 2 * _LONGEST / max(image.shape[:2]))
    drawn = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    for row, (x1, y1, x2, y2) in enumerate((detections.boxes * scale).round().astype(int).tolist()):
        cv2.rectangle(drawn, (x1, y1), (x2, y2), _COLOUR if row in in_both else _ONLY_HERE, 2)
    return np.asarray(drawn, dtype=np.uint8)


def example_crop(image: ImageArray, box: np.ndarray) -> ImageArray:
    """The part of ``image`` around ``box`` ``(4,)`` with the box drawn in, `_CROP` pixels high."""
    region = clip_boxes(grown(box[None], 0.6), image.shape[1], image.shape[0])[0].round().astype(int)
    x1, y1, x2, y2 = region.tolist()
    part = image[y1 : max(y2, y1 + 2), x1 : max(x2, x1 + 2)].copy()
    scale = _CROP / part.shape[0]
    drawn = cv2.resize(part, None, fx=scale, fy=scale)
    inner = ((box - np.tile(region[:2], 2)) * scale).round().astype(int).tolist()
    cv2.rectangle(drawn, (inner[0], inner[1]), (inner[2], inner[3]), _COLOUR, 1)
    return np.asarray(drawn, dtype=np.uint8)
