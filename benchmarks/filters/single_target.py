"""Milliseconds of CPU a frame of the trackers of one target, one thread, as ratios to OpenCV-contrib in one run.

    python -m benchmarks.filters.single_target --data ../shared/data --peer /path/to/venv/bin/python

The peer's environment holds `opencv-contrib-python-headless`; without `--peer` only ratios to KCF are printed. Rounds
are interleaved (ours, peer, ours, peer, ...) and the median of each is taken; the image is decoded before the clock
starts. `plain / KCF` is over the frames without search, against a step of KCF from the same place, size and filter;
`/ KCF` is against KCF on its own way.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.formats.single import SingleSequence, find_single_sequences
from tsuiseki.tracking.geometry import xywh_from_corners
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.kcf import KcfTracker
from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST, KcfParticle
from tsuiseki.tracking.single.settings import NONE, SingleChoice
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video.image_folder import read_image

SEQUENCES = ("otb/Crossing", "otb/DragonBaby", "vot/bag", "uav/person12", "uav-more/group2")
PEER_SCRIPT = Path(__file__).with_name("opencv_peer.py")
OURS: dict[str, Callable[[], SingleTracker]] = {
    "KCF fixed": lambda: KcfTracker(kcf.THESIS),
    "KCF scale search": lambda: KcfTracker(kcf.KcfSettings()),
    "kcf-particle printed": lambda: KcfParticle(PRINTED),
    "kcf-particle robust fixed": lambda: KcfParticle(replace(ROBUST, kcf=kcf.THESIS)),
    "kcf-particle robust": lambda: KcfParticle(ROBUST),
    "combined fixed": lambda: SingleChoice("combined", NONE, scale=False).tracker(),
    "combined": lambda: SingleChoice("combined", NONE).tracker(),
}
BASES = {
    "kcf-particle thesis": "KCF fixed",
    "kcf-particle robust fixed": "KCF fixed",
    "kcf-particle robust": "KCF scale search",
    "combined fixed": "KCF fixed",
    "combined": "KCF scale search",
}


def frame_times(
    tracker: SingleTracker, images: list[ImageArray], sequence: SingleSequence
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Milliseconds of each frame, in which the particle filter ran, and milliseconds of KCF from the same state."""
    tracker.start(images[0], sequence.boxes[0])
    times, searched, alone = [], [], []
    for count, image in enumerate(images[1:]):
        before = getattr(tracker, "searched_frames", 0)
        follow: Callable[[], object] = partial(tracker.follow, image)
        if isinstance(tracker, KcfParticle):
            step = partial(kcf.step, tracker.model, tracker.target, image)
            first, second = (step, follow) if count % 2 else (follow, step)  # the first one finds the image cold
            spent = (milliseconds(first), milliseconds(second))
            alone.append(spent[1 - count % 2])
            times.append(spent[count % 2])
        else:
            times.append(milliseconds(follow))
        searched.append(getattr(tracker, "searched_frames", 0) > before)
    return np.array(times), np.array(searched), np.array(alone)


def milliseconds(work: Callable[[], object]) -> float:
    """CPU time of one call."""
    start = time.process_time()
    work()
    return 1000 * (time.process_time() - start)


def peer_time(python: str, name: str, sequence: SingleSequence, folder: Path) -> float:
    """Milliseconds a frame of an OpenCV-contrib tracker."""
    listing = folder / "images.txt"
    listing.write_text("\n".join(str(path.resolve()) for path in sequence.images), encoding="utf-8")
    box = ",".join(f"{v:g}" for v in xywh_from_corners(sequence.boxes[0]))
    command = [python, str(PEER_SCRIPT), name, str(listing), box]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def measure(sequence: SingleSequence, python: str | None, rounds: int, folder: Path) -> None:
    images = [read_image(path) for path in sequence.images]
    means: dict[str, list[float]] = {name: [] for name in (*OURS, "CSRT")}
    plain: dict[str, list[float]] = {name: [] for name in OURS}
    search: dict[str, list[float]] = {name: [] for name in OURS}
    share: dict[str, float] = {}
    for _ in range(rounds):
        for name, make in OURS.items():
            times, searched, alone = frame_times(make(), images, sequence)
            means[name].append(float(times.mean()))
            if len(alone):
                plain[name].append(float(times[~searched].mean() / alone[~searched].mean()))
            search[name].append(float(times[searched].mean()) if searched.any() else np.nan)
            share[name] = float(searched.mean())
        means["CSRT"].append(peer_time(python, "CSRT", sequence, folder) if python else np.nan)
    peer = float(np.median(means["CSRT"]))
    print(f"\n{sequence.name}: {len(images)} frames, CSRT {peer:.2f} ms")
    print(f"{'':26}{'ms':>7}{'/ CSRT':>8}{'/ KCF':>7}{'plain / KCF':>13}{'search ms':>11}{'searched':>10}")
    for name in OURS:
        mean = float(np.median(means[name]))
        base = float(np.median(means[BASES[name]])) if name in BASES else np.nan
        over_base = f"{mean / base:7.2f}" if name in BASES else f"{'-':>7}"
        alone_too = f"{np.median(plain[name]):13.2f}" if plain[name] else f"{'-':>13}"
        print(
            f"{name:26}{mean:7.2f}{mean / peer:8.3f}{over_base}{alone_too}"
            f"{np.median(search[name]):11.2f}{100 * share[name]:9.0f}%"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--peer", help="python of an environment with opencv-contrib-python-headless")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    machine = platform.processor() or platform.machine()
    versions = f"Python {platform.python_version()}, OpenCV {cv2.__version__}, numpy {np.__version__}"
    print(f"{machine}, {versions}; one thread, CPU time, median of {arguments.rounds} interleaved rounds")
    with tempfile.TemporaryDirectory() as folder:
        for name in SEQUENCES:
            found = find_single_sequences(arguments.data / "sot" / name)[0]
            measure(found, arguments.peer, arguments.rounds, Path(folder))


if __name__ == "__main__":
    main()
