"""AP50 and time of the detector in the rooms on which the settings of `benchmarks.papers omnidirectional` were chosen.

Upright boxes of the people of whom three tenths or more are visible, in every fifth second of both cameras:

    OMP_NUM_THREADS=1 python -m benchmarks.fisheye.rooms --calibration calib_results.txt
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from benchmarks.papers.fisheye import ROOMS, VALIDATION_SEEDS, CeilingClip
from tsuiseki.datamodules.scenes.room_clip import Room
from tsuiseki.tracking.evaluation.detection import evaluate_rotated
from tsuiseki.tracking.features.exported import Detect, Detector
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, ceiling_detector
from tsuiseki.tracking.formats.rotated import RotatedBoxes, about_bodies
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.weights import shipped

VISIBLE, EVERY, LEAST_SCORE = 0.3, 5, 0.05


def main() -> None:
    """Print a line for each room and choice of rings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calibration", type=Path, default=None)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--detector", type=Path, default=None)
    parser.add_argument("--view", choices=("unrolled", "image"), default="unrolled")
    parser.add_argument("--rings", nargs="+", default=["1,4", "1,2,4", "1,2,4,8"])
    options = parser.parse_args()
    cv2.setNumThreads(1)
    network = Detector(options.detector or shipped(DETECTORS[options.view]), LEAST_SCORE, threads=1)
    for room in ROOMS:
        pictures = _pictures(room, options.seconds, options.calibration)
        for rings in options.rings:
            counts = [int(n) for n in rings.split(",")]
            truth, found, taken = {}, {}, 0.0
            for sequence, shown in pictures:
                detect = ceiling_detector(network, sequence.plan().cameras[sequence.camera], options.view, counts)
                for name, image, boxes in shown:
                    start = time.process_time()
                    truth[name], found[name] = _unturned(boxes), _found(detect, image)
                    taken += time.process_time() - start
            scores = evaluate_rotated(truth, found)
            spent = 1000 * taken / len(truth)
            print(f"{room}, rings {rings}: AP50 {scores.average_precision:.3f}, {spent:.0f} ms a frame", flush=True)


def _pictures(
    room: Room, seconds: int, calibration: Path | None
) -> list[tuple[CeilingClip, list[tuple[str, ImageArray, FloatArray]]]]:
    """The pictures of both cameras with the boxes of those who are visible."""
    result = []
    for camera in range(2):
        sequence = CeilingClip(room, VALIDATION_SEEDS[0], seconds, 1, camera, calibration)
        frames = enumerate(sequence.pictures())
        result.append(
            (
                sequence,
                [(f"{camera} {k}", i, t.boxes[t.visibility >= VISIBLE]) for k, (_, i, t) in frames if k % EVERY == 0],
            )
        )
    return result


def _found(detect: Detect, image: ImageArray) -> RotatedBoxes:
    found = detect.detect([image])[0]
    boxes = found.boxes
    if found.angles is not None:
        boxes = about_bodies(np.column_stack([_unturned(boxes).boxes[:, :4], found.angles]))
    return _unturned(boxes, found.scores)


def _unturned(boxes: FloatArray, scores: FloatArray | None = None) -> RotatedBoxes:
    rows = np.column_stack([xywh_from_corners(boxes), np.zeros(len(boxes))])
    rows[:, :2] += rows[:, 2:4] / 2
    return RotatedBoxes(rows, np.full(len(boxes), -1), np.ones(len(boxes)) if scores is None else scores)


if __name__ == "__main__":
    main()
