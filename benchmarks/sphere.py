"""What a frame of the sphere tracker costs, beside the bare `cv2.remap` that fetches its polar samples.

Both run in turn on one thread, so that what else the machine does touches both alike; the figure to look at is the
ratio. Run `python benchmarks/sphere.py`.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import cv2
import numpy as np

from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.likelihoods.sphere import ContourSettings, fetch, polar_maps
from tsuiseki.tracking.likelihoods.views import ContourLikelihood
from tsuiseki.tracking.trackers.sphere import Glance, SphereTracker

SIZES = ((250, 2), (500, 2), (1000, 2), (2000, 2), (4000, 2), (500, 4), (1000, 6))
ROUNDS = 60


def cameras(count: int) -> list[PinholeCamera]:
    """Cameras around a ball at the origin, four metres away, 800x600."""
    turn = 2 * np.pi * np.arange(count) / count
    return [
        PinholeCamera.look_at(np.array([4 * np.cos(a), 4 * np.sin(a), 1.5]), np.array([0, 0, 1.0]), 693.0, 800, 600)
        for a in turn
    ]


def interleaved(first: Callable[[], object], second: Callable[[], object]) -> tuple[float, float, float]:
    """Least and median ratio second / first over rounds in turn, and the median seconds of the second."""
    pairs = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        first()
        middle = time.perf_counter()
        second()
        pairs.append((middle - start, time.perf_counter() - middle))
    a, b = np.array(pairs).T
    return float(b.min() / a.min()), float(np.median(b / a)), float(np.median(b))


def measure(particles: int, count: int) -> tuple[float, float, float]:
    """Ratios of a whole frame to the bare fetch of its samples, and seconds a frame."""
    views = cameras(count)
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 256, (600, 800, 3), dtype=np.uint8) for _ in views]
    tracker = SphereTracker(ContourLikelihood(views, 0.1))
    state = tracker.start_at(np.array([0.0, 0.0, 1.0]), 0.03, particles, count, rng)
    maps = [polar_maps(c, state.particles.particles[:, :3], 0.1, ContourSettings()) for c in views]

    def bare() -> None:
        for image, polar in zip(images, maps, strict=True):
            fetch(image, polar)

    def frame() -> None:
        tracker.step(state, Glance(state.time + 1 / 15, images), rng)

    for _ in range(3):
        bare()
        frame()
    return interleaved(bare, frame)


def main() -> None:
    """Print the table and the slope."""
    cv2.setNumThreads(1)
    print(f"{platform.processor() or platform.machine()}, OpenCV {cv2.__version__}, numpy {np.__version__}, one thread")
    print("| particles | cameras | frame / bare remap: least times | median | ms a frame |\n|---|---|---|---|---|")
    work, cost = [], []
    for particles, count in SIZES:
        least, median, seconds = measure(particles, count)
        work.append(particles * count)
        cost.append(seconds)
        print(f"| {particles} | {count} | {least:.2f} | {median:.2f} | {1000 * seconds:.2f} |")
    slope = np.polyfit(np.log(work), np.log(cost), 1)[0]
    print(f"log-log slope of the time over particles x cameras: {slope:.2f}")


if __name__ == "__main__":
    main()
