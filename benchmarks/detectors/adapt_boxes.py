"""Boxes of `tsuiseki adapt` against labels: as detected, and moved onto silhouettes by some share of the way.

All are moved alike, as silhouettes usually lie; in the last column each goes half of the way to its own, where that is
told.

    python -m benchmarks.detectors.adapt_boxes SEQUENCE [SEQUENCE ...] [--frames FIRST-LAST] [--pictures 60]
        [--detector FILE]

A fixed camera's sequence folders with img1/ and gt/gt.txt. Detections from a score of 0.5 on are matched to labels from
an IoU of 0.3 on; printed are their mean IoU and the share from an IoU of 0.75 on.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.weights import LEARNING_DETECTOR, shipped
from tsuiseki.trainers.adapt.foreground import FARTHEST, usual_offset
from tsuiseki.trainers.adapt.watch import watch, with_empty_view

SHARES, OWN = (0.0, 0.25, 0.5, 1.0), 0.5
SURE, MATCHED, TIGHT = 0.5, 0.3, 0.75


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequences", nargs="+", type=Path)
    parser.add_argument("--frames")
    parser.add_argument("--pictures", type=int, default=60)
    parser.add_argument("--detector", type=Path, default=shipped(LEARNING_DETECTOR))
    arguments = parser.parse_args()
    print(
        "sequence, boxes, offset; mean IoU and share from 0.75 on, moved by " + " · ".join(map(str, SHARES)) + ", own"
    )
    for sequence in arguments.sequences:
        boxes, labels, own, offset = matched(sequence, arguments.frames, arguments.pictures, arguments.detector)
        moves = [share * np.tile(offset, (len(boxes), 1)) for share in SHARES]
        known = ~np.isnan(own)
        moves.append(OWN * np.where(known, np.clip(own, -FARTHEST, FARTHEST), offset))
        scores = [overlaps(boxes + move * np.tile(sides(boxes), 2), labels) for move in moves]
        means = " · ".join(f"{each.mean():.3f}" for each in scores)
        tight = " · ".join(f"{np.mean(each >= TIGHT):.3f}" for each in scores)
        print(f"{sequence.name}, {len(boxes)}, {offset.round(3).tolist()}; {means}; {tight}", flush=True)
        rows = known.all(axis=1)
        likewise = [f"{each[rows].mean():.3f}, {np.mean(each[rows] >= TIGHT):.3f}" for each in (scores[0], scores[-1])]
        print(f"  whose own is known, {rows.mean():.0%}: {' -> '.join(likewise)}", flush=True)


def matched(
    sequence: Path, frames: str | None, pictures: int, detector: Path
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """``(N, 4)`` detected boxes, labels, by how much each lies off its silhouette, and ``(4,)`` what is usual."""
    detect = open_detector(detector, SURE, threads=1)
    truth = read_ground_truth(sequence / "gt" / "gt.txt")
    truth = truth.select(truth.evaluated)
    found, labels, own, offsets = [], [], [], []
    with tempfile.TemporaryDirectory() as folder:
        watched = with_empty_view(watch(str(sequence), parse_frames(frames), Path(folder), pictures))
        for number, frame in enumerate(watched.frames):
            boxes = detect.detect([watched.picture(number)])[0].boxes
            there = truth.boxes[truth.frames == frame]
            rows, columns = assign_overlaps(iou_matrix(boxes, there), MATCHED)
            found.append(boxes[rows])
            labels.append(there[columns])
            picture = watched.difference(number)
            assert picture is not None
            offsets.append(picture.offsets(boxes))
            own.append(offsets[-1][rows])
    return np.concatenate(found), np.concatenate(labels), np.concatenate(own), usual_offset(np.concatenate(offsets))


def sides(boxes: FloatArray) -> FloatArray:
    """``(N, 2)`` widths and heights."""
    return boxes[:, 2:] - boxes[:, :2]


def overlaps(boxes: FloatArray, labels: FloatArray) -> FloatArray:
    """``(N,)`` IoU of each box with its label."""
    shared = intersections(boxes, labels)
    return np.asarray(shared / (areas(boxes) + areas(labels) - shared))


if __name__ == "__main__":
    main()
