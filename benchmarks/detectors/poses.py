"""Recall of a detector by pose, on generated pictures of people in one pose each.

    tsuiseki simulate sprites --assets FOLDER --out SPRITES --poses 0.93 --tilts -0.08,1.5 --seed 78
    python -m benchmarks.detectors.poses SPRITES [--detector FILE] [--pictures N] [--score S]

A pose takes N pictures of streets, close views and views from above. Counted are people of whom a quarter is visible;
*half hidden* are those of whom a quarter to three quarters are. A detection counts from score S on.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.figures.rendering import Sprite
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import settings_of_scene
from tsuiseki.tracking.features.exported import SizedDetect, open_detector
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped

SCENES, SIZE, SEED, STANDING = ("street", "near", "aerial"), (640, 480), 78, "standing or walking"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sprites", type=Path)
    parser.add_argument("--detector", default=str(shipped(PEOPLE_DETECTOR)))
    parser.add_argument("--pictures", type=int, default=24)
    parser.add_argument("--score", type=float, default=0.3)
    arguments = parser.parse_args()
    detector = open_detector(arguments.detector, arguments.score)
    print(f"{'pose':20}{'people':>8}{'IoU .3':>8}{'IoU .5':>8}{'half hidden':>13}{'IoU .3':>8}")
    library = OnePose(arguments.sprites)
    for pose in np.unique(library.poses).tolist():
        library.shown = pose
        overlap, visible = np.concatenate([found(detector, library, n) for n in range(arguments.pictures)], axis=1)
        hidden = overlap[visible < 0.75]
        print(
            f"{pose or STANDING:20}{len(overlap):8}{np.mean(overlap >= 0.3):8.2f}{np.mean(overlap >= 0.5):8.2f}"
            f"{len(hidden):13}{np.mean(hidden >= 0.3) if len(hidden) else np.nan:8.2f}"
        )


class OnePose(SpriteLibrary):
    """Rendered people, of whom only those in one pose are shown."""

    shown = ""

    def near(self, rng: np.random.Generator, tilt: float, pose: str | None = None) -> Sprite:
        """See `SpriteLibrary.near`."""
        return super().near(rng, tilt, self.shown if pose is None else pose)


def found(detector: SizedDetect, library: OnePose, number: int) -> FloatArray:
    """``(2, N)`` greatest IoU of a detection with each person of a picture, and how much of each is visible."""
    rng = np.random.default_rng([SEED, *(library.shown or STANDING).encode(), number])
    settings = settings_of_scene(SCENES[number % len(SCENES)], rng, SIZE)
    settings = replace(settings, people=(2, 12), rendered=1.0)
    image, boxes, visible = random_training_scene(rng, settings, library)
    counted = visible >= 0.25
    (detections,) = detector.detect([image])
    overlap = iou_matrix(boxes[counted], detections.boxes).max(axis=1, initial=0)
    return np.stack([overlap, visible[counted]])


if __name__ == "__main__":
    main()
