"""What a teacher's lessons gain by the mean over the mirror image: its average precision with and without it.

    python -m benchmarks.detectors.flipped_teacher --data ../shared/data [--teacher FILE]
        [--pictures FOLDER] [--only NAME ...]

On the sequences of `accuracy.py` and on labelled pictures in `--pictures`; whole frames fitted into 640x480.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import torch

from benchmarks.detectors.accuracy import sequences
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.models.distillation import SoftTargets
from tsuiseki.tracking.evaluation.detection import LabelledBoxes, evaluate_detections
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped
from tsuiseki.trainers.exporting.exported_weights import layout_of
from tsuiseki.trainers.networks.detector import DetectorTraining, detections

SIZE = (480, 640)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--teacher", type=Path, default=shipped(PEOPLE_DETECTOR))
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--streets", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    measured = [(s.name, s.pictures) for s in sequences(arguments.data, arguments.streets, arguments.every)]
    if arguments.pictures is not None:
        measured.append((str(arguments.pictures), lambda: pictures_in(arguments.pictures)))
    print(f"{'sequence':22} flips    AP.3   AP.5  AP.75")
    for name, labelled in measured:
        if arguments.only and not any(word in name for word in arguments.only):
            continue
        pictures = list(labelled())
        for flips in (False, True):
            found = taught(arguments.teacher, flips)
            boxes = [found(image) for image, _ in pictures]
            truth = [labels for _, labels in pictures]
            scores = [evaluate_detections(truth, boxes, iou).average_precision for iou in (0.3, 0.5, 0.75)]
            print(f"{name:22} {flips!s:5}  " + " ".join(f"{x:6.3f}" for x in scores), flush=True)


def pictures_in(folder: Path) -> Iterator[tuple[ImageArray, LabelledBoxes]]:
    """The labelled pictures of a folder."""
    for sample in labelled_images(folder, None):
        image = cv2.imread(str(sample.path))
        assert image is not None
        yield image[..., ::-1].astype(np.uint8), LabelledBoxes(sample.boxes, sample.ignored)


def taught(teacher: Path, flips: bool) -> Callable[[ImageArray], Detections]:
    """What a student is taught about an image, as detections."""
    layout = layout_of(teacher)
    student = DetectorTraining(
        trunk=layout.trunk,  # type: ignore[arg-type]
        height=SIZE[0],
        width=SIZE[1],
        anchors=layout.anchors,
        teacher=str(teacher),
        teacher_flips=flips,
    )

    def found(image: ImageArray) -> Detections:
        assert student.teacher is not None
        fitted, scale = fit_image(image, student.card)
        targets: SoftTargets = student.teacher.targets(student.normalised(torch.from_numpy(fitted)[None]))
        margin = targets.scores.logit(eps=1e-6)
        logits = torch.stack((torch.zeros_like(margin), margin), dim=-1)
        every = detections(logits, targets.offsets, student.network.anchors, student.card)[0]
        return Detections(every.boxes / np.tile(scale, 2), every.scores)

    return found


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
