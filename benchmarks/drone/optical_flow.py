"""End-point error and CPU time of the optical flows on generated pairs whose flow is known.

    python -m benchmarks.drone.optical_flow [--peer PYTHON] [--sizes 320x240,640x480,224x224] [--pairs 3] [--repeat 1]

``--peer`` is the Python of an environment with OpenCV contrib, whose DualTVL1 then takes turns with ours, on the same
pairs with one thread. ``pairs`` are drawn for each size and each of three strengths of motion; seeds are from 1000 on,
others than those the settings were chosen on. ``ratio`` is DualTVL1's CPU time over that of the method,
``worst`` the largest ratio of its error to DualTVL1's on one pair.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.drone.flow_pairs import FlowPair, end_point_error
from benchmarks.machine import machine
from tsuiseki.tracking.features.optical_flow import FLOW_METHODS, dis_flow, optical_flow, tv_l1
from tsuiseki.tracking.types import ImageArray

PEER = "DualTVL1"
MOTIONS = (3.0, 8.0, 16.0)
METHODS = {
    **{f"{name} (ours)" if name == "tv-l1" else name: method for name, method in FLOW_METHODS.items()},
    "dis, then 2 warps of tv-l1": lambda a, b: tv_l1(a, b, start=dis_flow(a, b), warps=2),
}
# Runs in the other environment: a line with a file of two grey images in, a line with the CPU seconds out.
WORKER = """
import sys, time, json, cv2, numpy as np
cv2.setNumThreads(1)
print(json.dumps({"version": cv2.__version__}), flush=True)
for line in sys.stdin:
    with np.load(line.strip(), allow_pickle=False) as pair:
        first, second = pair["first"], pair["second"]
    start = time.process_time()
    flow = cv2.optflow.createOptFlow_DualTVL1().calc(first, second, None)
    seconds = time.process_time() - start
    np.save(line.strip() + ".npy", flow)
    print(json.dumps({"seconds": seconds}), flush=True)
"""


class Peer:
    """DualTVL1 at its defaults in another process."""

    def __init__(self, python: str) -> None:
        self.process = subprocess.Popen(
            [python, "-c", WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.version = self._answer()["version"]

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        answer: dict[str, Any] = json.loads(self.process.stdout.readline())
        return answer

    def __call__(self, pair: FlowPair, folder: Path) -> tuple[float, float]:
        """End-point error and CPU seconds."""
        path = folder / "pair.npz"
        np.savez(path, first=_grey(pair.first), second=_grey(pair.second))
        assert self.process.stdin is not None
        self.process.stdin.write(f"{path}\n")
        self.process.stdin.flush()
        seconds = self._answer()["seconds"]
        return end_point_error(np.load(f"{path}.npy", allow_pickle=False), pair), seconds


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer", default="")
    parser.add_argument("--sizes", default="320x240,640x480,224x224")
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--repeat", type=int, default=1)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    peer = Peer(arguments.peer) if arguments.peer else None
    print(machine("numpy", "opencv-python-headless") + (f", peer OpenCV contrib {peer.version}" if peer else ""))
    with tempfile.TemporaryDirectory() as folder:
        for text in arguments.sizes.split(","):
            width, height = map(int, text.split("x"))
            _measure_size((width, height), arguments.pairs, arguments.repeat, peer, Path(folder))


def _measure_size(size: tuple[int, int], pairs: int, repeat: int, peer: Peer | None, folder: Path) -> None:
    rows: dict[str, list[tuple[float, float]]] = {}
    moved = []
    for number, motion in enumerate(MOTIONS):
        for k in range(pairs):
            pair = FlowPair(np.random.default_rng([1000, size[0], number, k]), size, motion)
            moved.append(float(np.linalg.norm(pair.flow, axis=2).mean()))
            if peer is not None:
                rows.setdefault(PEER, []).append(peer(pair, folder))
            for name, method in METHODS.items():
                rows.setdefault(name, []).append(_measure(pair, method, repeat))
    print(f"\n{size[0]}x{size[1]}, {len(moved)} pairs, mean motion {np.mean(moved):.1f} pixels")
    columns = (
        ("mean error", 11),
        ("median", 8),
        ("largest", 9),
        ("ms", 8),
        ("ratio", 7),
        ("no worse on", 13),
        ("worst", 7),
    )
    print(" " * 28 + "".join(f"{title:>{width}s}" for title, width in columns))
    peers = np.array(rows.get(PEER, []))
    for name, values in rows.items():
        errors, seconds = np.array(values).T
        ratio = f"{peers[:, 1].sum() / seconds.sum():7.1f}" if len(peers) else ""
        wins = f"{(errors <= peers[:, 0]).sum():7d} of {len(errors):2d}" if len(peers) else ""
        worst = f"{(errors / peers[:, 0]).max():7.2f}" if len(peers) else ""
        milliseconds = 1000 * seconds.mean()
        print(
            f"{name:28s}{errors.mean():11.3f}{np.median(errors):8.3f}{errors.max():9.3f}{milliseconds:8.0f}"
            f"{ratio}{wins}{worst}"
        )


def _measure(pair: FlowPair, method: Callable[..., np.ndarray], repeat: int) -> tuple[float, float]:
    best = float("inf")
    for _ in range(repeat):
        start = time.process_time()
        flow = optical_flow(pair.first, pair.second, method)
        best = min(best, time.process_time() - start)
    return end_point_error(flow, pair), best


def _grey(image: ImageArray) -> ImageArray:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


if __name__ == "__main__":
    main()
