"""How many streams two cores can follow: CPU time a frame, by part, with the shipped networks.

    python -m benchmarks.live.streams [--frames 80] [--people 6] [--streams 4] [--rate 10] [--delay 3]

A generated street of 640x480 pixels is followed as live streams are: frames of all streams go through the detector
together. Each part is timed by the CPU time of this process, which other work on the machine does not change. The limit
is what the cores would give if nothing else ran: the sum of the parts over the cores.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2

from benchmarks.machine import machine
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.people.following import Following
from tsuiseki.tracking.people.opening import open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.video.source import open_source

CORES, SEED = 2, 5


@contextmanager
def timed(spent: dict[str, float], part: str) -> Iterator[None]:
    """Add the CPU seconds of the block to a part."""
    begin = time.process_time()
    yield
    spent[part] += time.process_time() - begin


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=80)
    parser.add_argument("--people", type=int, default=6)
    parser.add_argument("--streams", type=int, default=4)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--delay", type=float, default=3.0)
    arguments = parser.parse_args()
    settings = StreetSettings(frames=arguments.frames, people=arguments.people, frame_rate=arguments.rate, samples=1)
    clip = StreetClip(settings, SEED)
    spent, boxes = defaultdict[str, float](float), 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "street.mjpeg"
        with path.open("wb") as file:
            for (image,), _ in clip.frames():
                file.write(cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes())
        source = open_source(path, frame_rate=arguments.rate)
        opened = open_people(source, PeopleFinding(threads=1), Linking(method="flow", delay=arguments.delay), 0)
        with timed(spent, "decode"):
            frames: list[Frame] = list(source.frames())
        following, inputs = Following(opened.tracker), opened.inputs
        # The first call of a network is not like the others.
        inputs.detect.detect([frames[0].image] * arguments.streams)  # type: ignore[union-attr]
        for first in range(0, len(frames), arguments.streams):
            batch = frames[first : first + arguments.streams]
            with timed(spent, "detect"):
                detections = inputs.detect.detect([frame.image for frame in batch])  # type: ignore[union-attr]
            for frame, people in zip(batch, detections, strict=True):
                boxes += len(people)
                if inputs.describe is not None:
                    with timed(spent, "describe"):
                        people = people.with_features(inputs.describe.describe(frame.image, people.boxes))
                with timed(spent, "follow"):
                    for _ in following.push(frame, people):
                        pass
    print(machine("numpy", "onnxruntime", "av"))
    milliseconds = {part: 1000 * seconds / len(frames) for part, seconds in spent.items()}
    total = sum(milliseconds.values())
    print(f"{len(frames)} frames of 640x480, {boxes / len(frames):.1f} boxes each, delay {arguments.delay:g} s")
    parts = ", ".join(f"{part} {value:.1f}" for part, value in milliseconds.items())
    print(f"CPU ms a frame: {parts}; all {total:.1f}")
    rate = 1000 * CORES / (total * arguments.streams)
    needed = arguments.rate * arguments.streams * total / 1000
    print(f"{arguments.streams} streams on {CORES} cores: at most {rate:.1f} frames a second each")
    print(f"{arguments.rate:g} a second of each need {needed:.2f} cores")


if __name__ == "__main__":
    main()
