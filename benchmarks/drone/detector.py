"""Recall of exported drone detectors: on labelled clips, and of the one labelled person of a UAV123 sequence.

    python -m benchmarks.drone.detector --detector tracking/weights/detector_drone.onnx [--clips DIR …]
        [--uav ../shared/data/sot/uav/person12] [--frames 102-201] [--every 1] [--write-mot DIR]
        [--precision 0.75]

Clips are MOTChallenge sequences; people of whom less than 40 % shows are left out. In a sequence of UAV123 everybody
but the labelled person is unknown, so detections beside it need not be wrong. A person is found where a detection has
an IoU of 0.5 or more with the label. ``--write-mot`` makes a MOTChallenge sequence of those frames, with links to the
images, to fine-tune on. ``--precision`` looks for the least score, by hundredths, at which the mean precision on the
clips is so high, and prints the mean recall there.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.labelled_images import LabelledFrame, labelled_images
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.drone.observations import Observers, observe
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import list_images, write_sequence_info
from tsuiseki.tracking.geometry import corners_from_xywh, iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Frame
from tsuiseki.tracking.types.labels import GroundTruth

VISIBLE, OVERLAP = 0.4, 0.5
THRESHOLDS = (0.1, 0.3, 0.5)
SCORES = np.arange(10, 100) / 100


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--detector", type=Path)
    parser.add_argument("--clips", type=Path, nargs="*", default=[])
    parser.add_argument("--uav", type=Path)
    parser.add_argument("--frames", default="1-100000")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--write-mot", type=Path)
    parser.add_argument("--precision", type=float)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    first, last = map(int, arguments.frames.split("-"))
    if arguments.write_mot is not None:
        write_mot(uav_images(arguments.uav)[first - 1 : last], arguments.write_mot)
    if arguments.detector is None:
        return
    samples = {clip.name: labelled_images(clip, (first, last)) for clip in arguments.clips}
    if arguments.uav is not None:
        samples[arguments.uav.name] = uav_images(arguments.uav)[first - 1 : last]
    for name, images in samples.items():
        report(name, arguments.detector, images[:: arguments.every])
    if arguments.precision is not None:
        at_precision(arguments.detector, [i[:: arguments.every] for i in samples.values()], arguments.precision)


def uav_images(folder: Path) -> list[LabelledFrame]:
    """The frames of a UAV123 sequence with their one box, which is 1-based; frames without are left out."""
    rows = np.genfromtxt(folder / "groundtruth_rect.txt", delimiter=",")
    found = []
    for frame, (path, row) in enumerate(zip(list_images(folder / "img"), rows, strict=True)):
        if np.isfinite(row).all():
            box = corners_from_xywh(row[None] - np.array([1, 1, 0, 0]))
            one = np.ones(1, dtype=np.int64)
            found.append(
                LabelledFrame(path, folder.name, frame, box, one, np.zeros(1, dtype=np.bool_), np.ones(1), one)
            )
    return found


def write_mot(images: list[LabelledFrame], folder: Path) -> None:
    """A MOTChallenge sequence of ``images``, the first of which is its first frame."""
    (folder / "img1").mkdir(parents=True, exist_ok=True)
    start = images[0].frame
    for sample in images:
        link = folder / "img1" / f"{sample.frame - start + 1:06d}.jpg"
        if not link.exists():
            link.symlink_to(Path(str(sample.picture)).resolve())
    count = len(images)
    frames, everyone = np.array([s.frame - start for s in images]), np.ones(count, dtype=np.bool_)
    boxes = np.concatenate([s.boxes for s in images])
    truth = GroundTruth(frames, np.ones(count, dtype=np.int64), boxes, everyone, ~everyone, np.ones(count))
    write_ground_truth(folder / "gt" / "gt.txt", truth)
    height, width = read_image(images[0].picture).shape[:2]
    write_sequence_info(folder, images[0].sequence, 30.0, count, width, height)


def report(name: str, detector: Path, images: list[LabelledFrame]) -> None:
    """Print a line for each threshold of the score."""
    for threshold in THRESHOLDS:
        observers = Observers(Detector(detector, threshold, threads=1), camera=True)
        frames = (Frame(sample.frame, float(sample.frame), read_image(sample.picture)) for sample in images)
        people = hits = total = right = 0
        for sample, seen in zip(images, observe(frames, observers), strict=True):
            kept = seen.detections
            counted, overlapping = compare(kept, sample)
            people += int(counted.sum())
            hits += int(overlapping[:, counted].any(axis=0).sum())
            total += len(kept)
            right += int(overlapping.any(axis=1).sum())
        print(
            f"{name:20s} score >= {threshold:.1f}: recall {hits / max(people, 1):.3f} of {people} people in "
            f"{len(images)} frames, {total / max(len(images), 1):.1f} detections a frame, "
            f"{right / max(total, 1):.3f} of them on somebody labelled"
        )


def compare(found: Detections, sample: LabelledFrame) -> tuple[BoolArray, BoolArray]:
    """Which labels count ``(M,)``, and which detections lie on which labels ``(N, M)``."""
    overlapping: BoolArray = iou_matrix(found.boxes, sample.boxes) >= OVERLAP
    return ~sample.ignored & (sample.visibility >= VISIBLE), overlapping


def at_precision(detector: Path, clips: list[list[LabelledFrame]], wanted: float) -> None:
    """Print the mean recall where the mean precision is ``wanted``."""
    network = Detector(detector, float(SCORES[0]), threads=1)
    found = [scored(network, images) for images in clips]
    for score in SCORES:
        recalls = [(hit_by >= score).mean() for _, _, hit_by in found]
        precisions = [right[scores >= score].mean() for scores, right, _ in found]
        if np.mean(precisions) >= wanted:
            recall, precision = np.mean(recalls), np.mean(precisions)
            print(f"{len(clips)} clips, score >= {score:.2f}: mean recall {recall:.3f}, mean precision {precision:.3f}")
            return
    print(f"{len(clips)} clips: a mean precision of {wanted} is not reached at any score")


def scored(detector: Detector, images: list[LabelledFrame]) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Scores ``(N,)`` of detections, whether each is on somebody, and of each person the best score on him or 0."""
    scores, right, hit_by = [], [], []
    for sample in images:
        (kept,) = detector.detect([read_image(sample.picture)])
        counted, overlapping = compare(kept, sample)
        scores.append(kept.scores)
        right.append(overlapping.any(axis=1))
        hit_by.append((overlapping * kept.scores[:, None]).max(axis=0, initial=0.0)[counted])
    return np.concatenate(scores), np.concatenate(right), np.concatenate(hit_by)


if __name__ == "__main__":
    main()
