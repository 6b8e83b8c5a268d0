"""Where the time of the detection stage goes: the share spent inside onnxruntime.

    python -m benchmarks.detectors.time_in_network [--detector FILE] [--frames 60] [--size 640 480]

Generated frames of a street go through `Detector.detect`; the session's own time is taken around its call.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from benchmarks.machine import machine
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--detector", default=str(shipped(PEOPLE_DETECTOR)))
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 480))
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    settings = StreetSettings(frames=arguments.frames, width=arguments.size[0], height=arguments.size[1])
    images = [image for (image,), _ in plan_street(settings, 100).frames()]
    detector = Detector(arguments.detector, threads=arguments.threads)
    inside = 0.0
    run = detector.model.run

    def timed(*inputs: Any) -> list[Any]:
        nonlocal inside
        start = time.perf_counter()
        outputs = run(*inputs)
        inside += time.perf_counter() - start
        return outputs

    detector.model.run = timed  # type: ignore[method-assign]
    detector.detect(images[:1])
    inside, start = 0.0, time.perf_counter()
    for image in images:
        detector.detect([image])
    total = time.perf_counter() - start
    print(machine("numpy", "onnxruntime", "opencv-python-headless"))
    print(f"{len(images)} frames of {arguments.size[0]}x{arguments.size[1]}, {arguments.threads} thread(s)")
    print(f"{1000 * total / len(images):.1f} ms a frame, {100 * inside / total:.1f} % of it inside onnxruntime")


if __name__ == "__main__":
    main()
