"""Where the time of `track_people` goes: the networks' own CPU time, and all the rest of the program beside it.

    python -m benchmarks.detectors.time_in_network SOURCE [--detector FILE ...] [--frames 1-300] [--view 1] [--repeat 3]

Each detector has a process of its own; they take turns, so that a slower machine slows all of them. Reported are
CPU milliseconds a frame, the start and the imports of the program included, of the quietest turn: in onnxruntime, and
in all else, also as a share of the former; then the frames in a second of the wall clock.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from threading import Lock

from benchmarks.machine import machine


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source")
    parser.add_argument("--detector", nargs="+", default=["people"])
    parser.add_argument("--frames")
    parser.add_argument("--view", default="auto")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--turn", action="store_true", help="one run, in this process")
    arguments = parser.parse_args()
    if arguments.turn:
        print(*turn(arguments.source, arguments.detector[0], arguments.frames, arguments.view, arguments.threads))
        return
    found: dict[str, list[list[float]]] = {detector: [] for detector in arguments.detector}
    given = {name: getattr(arguments, name) for name in ("frames", "view", "threads")}
    options = ["--turn", *(f"--{name}={value}" for name, value in given.items() if value)]
    for _ in range(arguments.repeat):
        for detector, turns in found.items():
            command = [sys.executable, "-m", __spec__.name, arguments.source, *options, "--detector", detector]
            start = time.perf_counter()
            line = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1]
            frames, network, cpu = map(float, line.split())
            turns.append([network / frames, (cpu - network) / frames, frames / (time.perf_counter() - start)])
    print(machine("numpy", "onnxruntime", "opencv-python-headless"))
    for detector, turns in found.items():
        network, rest, _ = min(turns, key=lambda each: each[0] + each[1])
        fastest = max(each[2] for each in turns)
        print(
            f"{Path(detector).name:24} networks {1000 * network:5.1f} ms CPU a frame, all else "
            f"{1000 * rest:5.1f}, {100 * rest / network:.0f} % of it; {fastest:.1f} frames a second"
        )


def turn(source: str, detector: str, frames: str | None, view: str, threads: int) -> tuple[int, float, float]:
    """Frames, the CPU seconds of the networks, and those of this process since it began."""
    import tsuiseki  # turns telemetry off before onnxruntime is loaded

    # isort: split
    import onnxruntime

    run, lock, inside = onnxruntime.InferenceSession.run, Lock(), [0.0]

    def timed(*given: object) -> object:
        start = time.thread_time()
        outputs = run(*given)
        with lock:
            inside[0] += time.thread_time() - start
        return outputs

    onnxruntime.InferenceSession.run = timed
    result = tsuiseki.track_people(source, detector=detector, frames=frames, view=view, threads=threads)
    return len(result.frames["frame"]), inside[0], time.process_time()


if __name__ == "__main__":
    main()
