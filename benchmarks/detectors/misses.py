"""Detectors side by side on the generated pictures that the first of them does worst on.

    python -m benchmarks.detectors.misses FILE [FILE ...] --out misses.jpg

A row is a pose, or places without people: of its pictures the one with most people missed and false boxes of the first
detector. Green is a box on a person (IoU 0.5), red a false box, and yellow a person who is missed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from benchmarks.detectors.fixed_sets import SCORE, drawn
from tsuiseki.datamodules.scenes.clip import write_image
from tsuiseki.datamodules.training_images import LEAST_VISIBLE
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

SETS = ("sitting", "falling", "lying", "lifeless")
GREEN, RED, YELLOW = (0, 170, 0), (220, 0, 0), (255, 220, 0)
# Of what is saved: a page is about 900 pixels wide, and the picture one of many.
QUALITY = 75
SCALE = 0.7
# Overlap with a person that finds them.
OVERLAP = 0.5


def main() -> None:
    """Draw and save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--sprites", type=Path, default=Path("out/cache/sprites-val"))
    parser.add_argument("--out", type=Path, default=Path("out/misses.jpg"))
    words = parser.parse_args()
    picture = side_by_side(words.files, words.sprites)
    write_image(
        words.out,
        np.asarray(cv2.resize(picture, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)),
        quality=QUALITY,
    )


def side_by_side(files: list[Path], sprites: Path) -> ImageArray:
    """A row each of `SETS`, a column each of the detectors."""
    detectors = [open_detector(file, SCORE, threads=1) for file in files]
    rows = list[ImageArray]()
    for name in SETS:
        pictures = drawn(sprites, name)
        errors = [
            sum(map(np.sum, wrong(people, visible, detectors[0].detect([image])[0].boxes)))
            for image, people, visible in pictures
        ]
        worst = pictures[int(np.argmax(errors))]
        rows.append(np.hstack([marked(*worst, each.detect([worst[0]])[0].boxes) for each in detectors]))
    return np.vstack(rows)


def wrong(people: FloatArray, visible: FloatArray, boxes: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Who of the people is missed though ``visible`` enough, and which of the boxes are on none of them."""
    overlap = iou_matrix(people, boxes)
    missed = (overlap.max(axis=1, initial=0) < OVERLAP) & (visible >= LEAST_VISIBLE)
    return missed, overlap.max(axis=0, initial=0) < OVERLAP


def marked(image: ImageArray, people: FloatArray, visible: FloatArray, boxes: FloatArray) -> ImageArray:
    """A copy with the boxes, and the people who are missed."""
    canvas = image.copy()
    missed, false = wrong(people, visible, boxes)
    colours = [RED if each else GREEN for each in false] + [YELLOW] * int(missed.sum())
    for box, colour in zip(np.concatenate([boxes, people[missed]]).round().astype(int), colours, strict=True):
        cv2.rectangle(canvas, box[:2].tolist(), box[2:].tolist(), colour, 2)
    return canvas


if __name__ == "__main__":
    main()
