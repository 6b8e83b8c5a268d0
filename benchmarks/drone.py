"""What `tsuiseki track drone` costs: milliseconds a stage, the alternation against one flow, memory over long videos.

    OMP_NUM_THREADS=1 python benchmarks/drone.py [--people 10] [--frames 300] [--long 3000] [--repeat 5]

Stages are CPU milliseconds of one thread for a 1280x720 frame with so many people, the least of the repeats. Linking,
networks apart, is timed over all frames: ``graph`` are the gated pairs, their features and prices and the network,
``solve`` the first flow, ``iterate`` each one that follows, repricing included. Then up to 6 iterations against 1,
taking turns; walkers need two flows, look-alikes under a jerking camera more. Memory is what the sliding-window mode
holds after a video and after a longer one; the rows of the result grow with it.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from walkers import acting_look_alikes, machine, walking_people

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.association.costs import HandSetCost
from tsuiseki.tracking.association.flow.network_flow import solve
from tsuiseki.tracking.association.flow.repricing import network, price_pairs
from tsuiseki.tracking.association.rows import DetectionRows, rows_of
from tsuiseki.tracking.association.tracklets.action_refinement import Prices, refine
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.action_inputs import STREAMS
from tsuiseki.tracking.features.motion.camera_motion import camera_motion
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.trackers.drone import HAND_SET_OBSERVATION, DroneSettings, DroneTracker
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray

WEIGHTS = Path(__file__).resolve().parent.parent / "tracking" / "weights"
ACTIONS = 12
# Bounds of people's boxes in the frames that the stages are timed on, pixels.
SMALLEST, LARGEST = 30, 90


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--long", type=int, default=3000)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(machine("numpy", "onnxruntime", "opencv-python-headless"))
    for stage, milliseconds in stages(arguments.people, arguments.repeat).items():
        print(f"{stage:34s}{milliseconds:9.2f} ms a frame")
    linking(arguments.people, arguments.frames, arguments.repeat)
    memory(arguments.people, arguments.frames, arguments.long)


def stages(people: int, repeat: int) -> dict[str, float]:
    """CPU milliseconds of everything that looks at a frame."""
    before, image, boxes = frames_with_people(people)
    names = [WEIGHTS / f"action_drone_{name}.onnx" for name in STREAMS]
    recogniser = ActionRecogniser(names, threads=1)
    appearance = Appearance(WEIGHTS / "appearance_people.onnx", threads=1)
    steps: dict[str, Callable[[], Any]] = {}
    if (WEIGHTS / "detector_drone.onnx").is_file():
        detector = Detector(WEIGHTS / "detector_drone.onnx", threads=1)
        steps["detect"] = lambda: detector.detect([image])
    steps |= {
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
    """Print what linking costs: stage by stage, and with 6 iterations against 1."""
    # People of the walkers are twice as tall as in a drone's 1280x720 pictures.
    easy = walking_people(frames, people, size=(2560, 1440), feature_length=128)
    for kind, (video, said) in {
        "walkers": (easy, acting(easy)),
        "jerked look-alikes": acting_look_alikes(frames, people, ACTIONS),
    }.items():
        rows, actions = rows_of(video, 0, 0), np.concatenate(said)
        for label, prices in costs().items():
            print(f"linking {frames} frames of {kind}, {len(rows)} detections, {label} costs:")
            linking_stages(rows, actions, prices, frames, repeat)
            alternation(rows, actions, prices, repeat)


def linking_stages(rows: DetectionRows, actions: FloatArray, prices: Prices, frames: int, repeat: int) -> None:
    """Print the stages of the first flow, and of each that follows."""
    settings = DroneSettings().refinement
    least: dict[str, float] = {}
    for _ in range(repeat):
        start = time.process_time()
        priced = price_pairs(rows, actions, prices.single, settings.gate, settings.miss)
        graph = network(prices.observation(rows.scores), priced, settings.entry, settings.exit)
        built = time.process_time()
        solve(graph)
        spent = {"graph": built - start, "solve": time.process_time() - built}
        flows = refine(rows, actions, prices, settings)
        next(flows)
        for number in range(2, settings.iterations + 1):
            start = time.process_time()
            if next(flows, None) is None:
                break
            spent[f"iterate, flow {number}"] = time.process_time() - start
        least = {name: min(seconds, least.get(name, np.inf)) for name, seconds in spent.items()}
    for name, seconds in least.items():
        print(f"  {name:32s}{1000 * seconds:9.1f} ms, {1000 * seconds / frames:.3f} ms a frame")


def alternation(rows: DetectionRows, actions: FloatArray, prices: Prices, repeat: int) -> None:
    """Print what 6 iterations cost against 1."""
    once = replace(DroneSettings().refinement, iterations=1)
    settings = {
        "1 iteration": once,
        "up to 6, centred windows": replace(once, iterations=6, windows="centred"),
        "up to 6, one-sided windows": replace(once, iterations=6, windows="one-sided"),
    }
    best, flows = dict.fromkeys(settings, np.inf), dict.fromkeys(settings, 0)
    for _ in range(repeat):
        for name, chosen in settings.items():
            start = time.process_time()
            flows[name] = len(list(refine(rows, actions, prices, chosen)))
            best[name] = min(best[name], time.process_time() - start)
    for name, seconds in best.items():
        ratio = seconds / best["1 iteration"]
        print(f"  {name:32s}{1000 * seconds:9.1f} ms, {flows[name]} flows, {ratio:.2f} times 1 iteration")


def costs() -> dict[str, Prices]:
    """Hand-set costs, and learnt ones where they ship."""
    found = {"hand-set": Prices(HAND_SET_OBSERVATION, HandSetCost())}
    path = WEIGHTS / "affinity_drone_saf.onnx"
    if path.is_file():
        single = Affinity(path, threads=1)
        found["learnt"] = Prices(single.observation, single, Affinity(WEIGHTS / "affinity_drone_maf.onnx", threads=1))
    return found


def acting(video: Sequence[Detections]) -> list[FloatArray]:
    """Noisy probabilities of actions for every detection."""
    rng = np.random.default_rng(1)
    return [rng.beta(0.5, 2, (len(found), ACTIONS)) for found in video]


def memory(people: int, frames: int, longer: int) -> None:
    """Print what the sliding-window mode holds."""
    video = walking_people(longer, people, size=(2560, 1440), feature_length=128)
    actions = acting(video)
    tracker = DroneTracker(DroneSettings(chunk=60))
    tracemalloc.start()
    for number, (found, said) in enumerate(zip(video, actions, strict=True), start=1):
        tracker.update(replace(found, actions=said))
        if number in (frames, longer):
            held, peak = (value / 1e6 for value in tracemalloc.get_traced_memory())
            row = tracker.held_rows
            print(
                f"after {number} frames {held:.1f} MB are held, {peak:.1f} MB at the most; {row} undecided detections"
            )
    tracemalloc.stop()


def cpu_seconds(step: Callable[[], Any]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    step()
    return time.process_time() - start


if __name__ == "__main__":
    main()
