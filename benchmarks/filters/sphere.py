"""What a frame of the sphere tracker costs, beside the bare `cv2.remap` that fetches its polar samples.

Both run in turn on one thread and are timed by the processor's clock, so that what else the machine does touches both
alike; the figure to look at is the ratio. A frame weighs all particles twice, and the bare fetch
is that of both times. Run
`OMP_NUM_THREADS=1 python -m benchmarks.filters.sphere`.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable

import cv2
import numpy as np

from tsuiseki.tracking.cameras.outline import sphere_outlines
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.sphere.tracker import SphereTracker, TimedViews
from tsuiseki.tracking.sphere.views import ContourSettings, SphereContourLikelihood, fetch, polar_maps
from tsuiseki.tracking.types import ImageArray

SIZES = ((250, 2), (500, 2), (1000, 2), (2000, 2), (4000, 2), (500, 4), (1000, 6))
ROUNDS = 60


def cameras(count: int) -> list[PinholeCamera]:
    """Cameras around a ball at the origin, four metres away, 800x600."""
    turn = 2 * np.pi * np.arange(count) / count
    return [
        PinholeCamera.look_at(np.array([4 * np.cos(a), 4 * np.sin(a), 1.5]), np.array([0, 0, 1.0]), 693.0, 800, 600)
        for a in turn
    ]


def picture(camera: PinholeCamera, rng: np.random.Generator) -> ImageArray:
    """A ball at (0, 0, 1) before soft clutter: what makes a step weigh twice."""
    soft = cv2.GaussianBlur(rng.uniform(0, 255, (600, 800, 3)).astype(np.float32), (0, 0), 6.0)
    clutter = np.clip(128 + 8 * (soft - 128), 0, 255).astype(np.uint8)
    outline = sphere_outlines(camera, np.array([[0.0, 0.0, 1.0]]), 0.1).points(48)[0]
    cv2.fillPoly(clutter, [np.round(outline).astype(np.int32)], (220, 60, 40))
    return clutter


def interleaved(first: Callable[[], object], second: Callable[[], object]) -> tuple[float, float, float]:
    """Least and median ratio second / first over rounds in turn, and the median seconds of the second."""
    pairs = []
    for _ in range(ROUNDS):
        start = time.process_time()
        first()
        middle = time.process_time()
        second()
        pairs.append((middle - start, time.process_time() - middle))
    a, b = np.array(pairs).T
    return float(b.min() / a.min()), float(np.median(b / a)), float(np.median(b))


def measure(particles: int, count: int) -> tuple[float, float, float]:
    """Ratios of a whole frame to the bare fetch of its samples, and seconds a frame."""
    views = cameras(count)
    rng = np.random.default_rng(0)
    images = [picture(view, rng) for view in views]
    tracker = SphereTracker(SphereContourLikelihood(views, 0.1))
    state = tracker.start_at(np.array([0.0, 0.0, 1.0]), 0.03, particles, count, rng)
    maps = [polar_maps(c, state.particles.particles[:, :3], 0.1, ContourSettings()) for c in views]

    def bare() -> None:
        for image, polar in zip(images, maps, strict=True):
            for _ in range(tracker.stages):
                fetch(image, polar)

    def frame() -> None:
        tracker.step(state, TimedViews(state.time + 1 / 15, images), rng)

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
