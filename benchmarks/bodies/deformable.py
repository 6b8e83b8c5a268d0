"""A whole frame of the tracker of bodies against the bare OpenCV calls that it cannot do without, on one thread.

    OMP_NUM_THREADS=1 python -m benchmarks.bodies.deformable

The peer is what any reader of section 3.1 would call on a 640x480 image: conversion to HSV, colour range, Canny,
distance transform; it smooths nothing and tracks nothing. Frames of the two are interleaved in one run; times are CPU
time, the minimum over repeats of the median over frames. One fish. The slope is that of the particles' cost alone.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings, goldfish_states
from tsuiseki.tracking.bodies.body import Goldfish
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.trainers.learn_motion import learn_motion

WHOLE_FRAMES = (500, 3000)
SCALING = (500, 2000, 10_000, 30_000, 100_000)


@dataclass(frozen=True)
class Clip:
    """A generated clip: images and the exact states ``(T, 4)`` of its fish."""

    images: Sequence[ImageArray]
    states: FloatArray


def bare_calls(image: ImageArray) -> None:
    """Extraction, edges and distances, and nothing else."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    mask = cv2.inRange(hsv, np.array([7, 115, 51]), np.array([21, 255, 255]))
    cv2.distanceTransform(255 - cv2.Canny(mask, 100, 200), cv2.DIST_L2, 5)


def new_tracker(clip: Clip, particles: int) -> DeformableTracker:
    """With the learnt proposal, as in the experiment."""
    body = Goldfish()
    ways = [goldfish_states(GoldfishSettings(fish=1), np.random.default_rng(seed))[:, 0] for seed in range(5)]
    motion = learn_motion(ways, body.name, body.fields, body.angles, 15.0).proposal()
    extraction = Extraction(parse_colour("orange"))
    return DeformableTracker(body, motion, extraction, DeformableSettings(particles), clip.states[:1])


def frame_times(clip: Clip, particles: int, repeats: int) -> tuple[float, float, float]:
    """Milliseconds of the bare calls, of the image's preparation and of the particles, interleaved."""
    rounds = []
    for _ in range(repeats):
        tracker = new_tracker(clip, particles)
        assert tracker.extraction is not None
        marks = []
        for index, image in enumerate(clip.images):
            start = time.process_time()
            bare_calls(image)
            after_bare = time.process_time()
            edges = EdgeImage.of(image, tracker.extraction)
            after_image = time.process_time()
            tracker.update_edges(index, edges)
            marks.append([start, after_bare, after_image, time.process_time()])
        # The first frame only places the particles.
        rounds.append(np.median(np.diff(marks[1:], axis=1), axis=0))
    bare, image_part, particle_part = (1000 * np.min(rounds, axis=0)).tolist()
    return bare, image_part, particle_part


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    planned = GoldfishClip(GoldfishSettings(frames=options.frames, fish=1), seed=3)
    images, states = zip(*planned.frames(), strict=True)
    clip = Clip([image for image, _ in images], np.stack(states)[:, 0])
    print(f"{platform.processor() or platform.machine()}, OpenCV {cv2.__version__}, numpy {np.__version__}; 640x480")
    print(f"{'particles':>9} {'bare':>7} {'image':>7} {'particles':>9} {'frame':>7} {'ratio':>6} {'frames/s':>8}")
    for particles in WHOLE_FRAMES:
        bare, image_part, particle_part = frame_times(clip, particles, options.repeats)
        frame = image_part + particle_part
        print(
            f"{particles:>9} {bare:7.2f} {image_part:7.2f} {particle_part:9.2f} {frame:7.2f} {frame / bare:6.2f} "
            f"{1000 / frame:8.0f}"
        )
    short = Clip(clip.images[:8], clip.states[:8])
    costs = [frame_times(short, particles, options.repeats)[2] for particles in SCALING]
    slope = float(np.polyfit(np.log(SCALING), np.log(costs), 1)[0])
    shown = ", ".join(f"{n:,}: {cost:.2f}" for n, cost in zip(SCALING, costs, strict=True))
    print(f"particles alone, ms a frame: {shown}; log-log slope {slope:.2f}")


if __name__ == "__main__":
    main()
