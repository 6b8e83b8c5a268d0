"""What `tsuiseki track drone` costs: milliseconds a stage, and linking with actions against linking without.

    OMP_NUM_THREADS=1 python -m benchmarks.drone.pipeline [--people 10] [--frames 300] [--repeat 5]

Stages are CPU milliseconds of one thread for a 1280x720 frame with so many people, the least of the repeats. Linking,
networks apart, is timed over all frames, the methods taking turns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np

from benchmarks.machine import machine
from benchmarks.walkers import acting_look_alikes, walking_people
from tsuiseki.tracking.drone.drone_models import DroneMethod
from tsuiseki.tracking.drone.run import suited
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker
from tsuiseki.tracking.features.action import STREAMS, ActionRecogniser
from tsuiseki.tracking.features.camera_motion import camera_motion
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.weights import DRONE_DETECTOR, shipped

WEIGHTS = Path(__file__).resolve().parents[2] / "tracking" / "weights"
ACTIONS = 12
# Bounds of people's boxes in the frames that the stages are timed on, pixels.
SMALLEST, LARGEST = 30, 90


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(machine("numpy", "onnxruntime", "opencv-python-headless"))
    for stage, milliseconds in stages(arguments.people, arguments.repeat).items():
        print(f"{stage:34s}{milliseconds:9.2f} ms a frame")
    linking(arguments.people, arguments.frames, arguments.repeat)


def stages(people: int, repeat: int) -> dict[str, float]:
    """CPU milliseconds of everything that looks at a frame."""
    before, image, boxes = frames_with_people(people)
    names = [WEIGHTS / f"action_drone_{name}.onnx" for name in STREAMS]
    recogniser = ActionRecogniser(names, threads=1)
    appearance = Appearance(WEIGHTS / "appearance_people.onnx", threads=1)
    detector = Detector(shipped(DRONE_DETECTOR), threads=1)
    steps: dict[str, Callable[[], Any]] = {
        "detect": lambda: detector.detect([image]),
        "camera motion": lambda: camera_motion(before, image, people=boxes),
        "optical flow": lambda: recogniser.flow([before, image]),
        "actions, four streams, with flow": lambda: recogniser.recognise([before, image], boxes),
        "appearance": lambda: appearance.describe(image, boxes),
    }
    return {name: 1000 * min(cpu_seconds(step) for _ in range(repeat)) for name, step in steps.items()}


def frames_with_people(people: int) -> tuple[ImageArray, ImageArray, FloatArray]:
    """Two noisy 1280x720 frames a few pixels apart, and boxes."""
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.integers(0, 256, (740, 1300, 3)).astype(np.uint8), (0, 0), 3)
    corner = rng.uniform(0, 1, (people, 2)) * [1280 - LARGEST, 720 - LARGEST]
    boxes = np.concatenate([corner, corner + rng.uniform(SMALLEST, LARGEST, (people, 2))], axis=1)
    return np.ascontiguousarray(ground[:720, :1280]), np.ascontiguousarray(ground[5:725, 8:1288]), boxes


def linking(people: int, frames: int, repeat: int) -> None:
    """Print what linking costs, without actions and with them."""
    # People of the walkers are twice as tall as in a drone's 1280x720 pictures.
    easy = walking_people(frames, people, size=(2560, 1440), feature_length=128)
    for kind, (video, every_action) in {
        "walkers": (easy, acting(easy)),
        "jerked look-alikes": acting_look_alikes(frames, people, ACTIONS),
    }.items():
        given = [replace(found, actions=actions) for found, actions in zip(video, every_action, strict=True)]
        best: dict[DroneMethod, float] = dict.fromkeys(get_args(DroneMethod), np.inf)
        for _ in range(repeat):
            for method in best:
                best[method] = min(best[method], cpu_seconds(partial(linked, given, method)))
        for method, seconds in best.items():
            ratio = seconds / best["flow"]
            print(f"linking {frames} frames of {kind}, {method:10s}{1000 * seconds:9.1f} ms, {ratio:.2f} times flow")


def linked(video: Sequence[Detections], method: DroneMethod) -> None:
    """Link a video by a method."""
    tracker = DroneTracker(suited(DroneSettings(), method), 30.0)
    for found in video:
        tracker.update(found if method != "flow" else replace(found, actions=None))
    tracker.people()


def acting(video: Sequence[Detections]) -> list[FloatArray]:
    """Noisy probabilities of actions for every detection."""
    rng = np.random.default_rng(1)
    return [rng.beta(0.5, 2, (len(found), ACTIONS)) for found in video]


def cpu_seconds(step: Callable[[], Any]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    step()
    return time.process_time() - start


if __name__ == "__main__":
    main()
