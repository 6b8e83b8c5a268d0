"""The four speeds that people under a fisheye camera ask for, by the processor's clock on one thread.

Run `OMP_NUM_THREADS=1 python -m benchmarks.fisheye.speed`.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import cv2
import numpy as np

from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import build_table
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, UnrolledDetector
from tsuiseki.tracking.fisheye.view import upright_crops
from tsuiseki.tracking.weights import shipped

WIDTH, HEIGHT, PEOPLE = 1280, 960, 10


def milliseconds(work: Callable[[], object], rounds: int) -> float:
    """Median over ``rounds`` of what ``work`` takes."""
    taken = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return 1000 * float(np.median(taken))


def main() -> None:
    """Print what each takes, and what it may take."""
    cv2.setNumThreads(1)
    focal = np.full(2, 0.475 * HEIGHT / (np.pi / 2))
    flat = EquidistantLens(WIDTH, HEIGHT, focal, np.array([640.0, 480.0]), np.zeros(4))
    lens = fit_omnidirectional(flat, degree=4)
    camera = OmnidirectionalCamera(lens, np.diag([1.0, -1.0, -1.0]), np.array([4.0, 8.0, 3.0]))
    rng = np.random.default_rng(0)
    points = rng.normal(size=(100_000, 3))
    points[:, 2] = np.abs(points[:, 2])
    table = build_table(camera, np.array([0.0, 0.0, 8.0, 16.0]))
    boxes = table.upright[rng.integers(0, len(table), PEOPLE)] + rng.normal(0, 3, (PEOPLE, 4)).cumsum(axis=1) * 0.1
    image = rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    rotated = table.look_up(boxes)[0]
    detector = Detector(shipped(DETECTORS["unrolled"]), threads=1)
    unrolled = UnrolledDetector(detector, camera, detector.input_size)
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}, OpenCV {cv2.__version__}")
    rows = (
        (f"rotated boxes and places of {PEOPLE} people, of {len(table)}", lambda: table.look_up(boxes), 200, 0.3),
        (f"{PEOPLE} crops turned upright, 128x64", lambda: upright_crops(image, rotated, 128, 64), 100, 2.0),
        ("table of a 1280x960 camera", lambda: build_table(camera, np.array([0.0, 0.0, 8.0, 16.0])), 3, 5000.0),
        ("100,000 points to pixels", lambda: lens.project(points), 30, 6.0),
        (f"the image unrolled into {len(unrolled.tiles)} views", lambda: unrolled.unroll(image), 30, None),
        ("people found in them", lambda: unrolled.detect([image]), 10, None),
    )
    for name, work, rounds, most in rows:
        asked = "" if most is None else f"   at most {most:g}"
        print(f"{name:50} {milliseconds(work, rounds):9.3f} ms{asked}")


if __name__ == "__main__":
    main()
