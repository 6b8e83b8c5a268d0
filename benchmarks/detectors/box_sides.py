"""Where boxes lie beside the labels, and what average precision would be if some sides were the labels'.

    python -m benchmarks.detectors.box_sides --data ../shared/data [--detector FILE] [--every N] [--only NAME ...]

The sequences are those of `accuracy.py`. Offsets are detections minus labels, in heights of
the person: the median and half of the middle half's width, over detections that score 0.3 or more and overlap a label
by 0.4 or more. In the second line each detection near a label takes the sides named from it; scores stay.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.detectors.accuracy import LOWEST_SCORE, sequences
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.features.views import parse_view
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped

SURE, NEAR, FIT = 0.3, 0.4, 0.75
SIDES = ("left", "top", "right", "bottom")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--detector", default=str(shipped(PEOPLE_DETECTOR)))
    parser.add_argument("--view", default="auto")
    parser.add_argument("--streets", type=int, default=3)
    parser.add_argument("--every", type=int, default=1, help="look at every n-th frame only")
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    for sequence in sequences(arguments.data, arguments.streets, arguments.every):
        if arguments.only and not any(word in sequence.name for word in arguments.only):
            continue
        pictures = list(sequence.pictures())
        tiled = ViewedDetector(open_detector(arguments.detector, LOWEST_SCORE, threads=1), parse_view(arguments.view))
        tiled.prepare([image for image, _ in pictures[:3]])
        found = [tiled.detect([image])[0] for image, _ in pictures]
        report(sequence.name, [labels for _, labels in pictures], found)


def report(name: str, truth: list[LabelledBoxes], found: list[Detections]) -> None:
    """Print both lines of one sequence."""
    pairs = [paired(labels, detections) for labels, detections in zip(truth, found, strict=True)]
    boxes, wanted = (
        np.concatenate([p[k][d.scores[p[2]] >= SURE] for p, d in zip(pairs, found, strict=True)]) for k in (0, 1)
    )
    if not len(boxes):
        print(f"{name}: no box near a label")
        return
    heights = wanted[:, 3] - wanted[:, 1]
    offsets = (boxes - wanted) / heights[:, None]
    low, middle, high = np.percentile(offsets, (25, 50, 75), axis=0)
    shown = ", ".join(f"{s} {m:+.3f} ±{h:.3f}" for s, m, h in zip(SIDES, middle, (high - low) / 2, strict=True))
    print(f"{name}: {len(boxes)} boxes; {shown}; width by height {np.median(widths(boxes)):.2f}, "
          f"labelled {np.median(widths(wanted)):.2f}")  # fmt: skip
    changed: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
        "as found": lambda b, _: b,
        "labelled top and bottom": lambda b, w: np.stack([b[:, 0], w[:, 1], b[:, 2], w[:, 3]], axis=1),
        "left and right": lambda b, w: np.stack([w[:, 0], b[:, 1], w[:, 2], b[:, 3]], axis=1),
        "middle across": lambda b, w: b + np.outer(w[:, ::2].mean(axis=1) - b[:, ::2].mean(axis=1), [1, 0, 1, 0]),
        "width": lambda b, w: np.stack([_about(b, w, -1), b[:, 1], _about(b, w, 1), b[:, 3]], axis=1),
    }
    values = []
    for what, change in changed.items():
        moved = []
        for detections, (near, labelled, which) in zip(found, pairs, strict=True):
            new = detections.boxes.copy()
            new[which] = change(near, labelled)
            moved.append(Detections(new, detections.scores))
        values.append(f"{what} {evaluate_detections(truth, moved, FIT).average_precision:.3f}")
    print("    AP at 0.75: " + ", ".join(values), flush=True)


def paired(labels: LabelledBoxes, found: Detections) -> tuple[FloatArray, FloatArray, IntArray]:
    """Detections near a label ``(K, 4)``, those labels ``(K, 4)``, and which detections they are ``(K,)``."""
    boxes = labels.boxes[~labels.ignored]
    if not len(boxes) or not len(found):
        return np.empty((0, 4)), np.empty((0, 4)), np.empty(0, dtype=np.int64)
    overlap = iou_matrix(found.boxes, boxes)
    which = np.flatnonzero(overlap.max(axis=1) >= NEAR)
    return found.boxes[which], boxes[overlap[which].argmax(axis=1)], which


def widths(boxes: FloatArray) -> FloatArray:
    """``(N,)`` width by height."""
    return np.asarray((boxes[:, 2] - boxes[:, 0]) / (boxes[:, 3] - boxes[:, 1]))


def _about(boxes: FloatArray, wanted: FloatArray, side: int) -> FloatArray:
    return np.asarray(boxes[:, ::2].mean(axis=1) + side * (wanted[:, 2] - wanted[:, 0]) / 2)


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
