"""What a second core brings `tsuiseki track people`: whole commands, start and report included, on one core and on all.

    python -m benchmarks.detectors.cores SOURCE [--frames 1-300] [--repeat 3] [--threads 1 0] [--pin]

The commands take turns, so that a slower machine slows all of them. Reported are the wall-clock and CPU seconds of
the fastest turn, the ratio of the wall-clock times in each turn, how many processes wanted a core, the seconds of each
stage, and whether the tracks are the same, byte for byte. Decoders of video files take all cores by themselves, also
with `--threads 1`; with `--pin` each command has as many cores as threads.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.machine import machine


@dataclass(frozen=True)
class Turn:
    """A finished command.

    Attributes:
        wall: seconds.
        cpu: seconds, of all its threads.
        load: processes that wanted a core while it ran, the mean, its own included.
        tracks: what it wrote.
        stages: seconds of each, summed over threads.
    """

    wall: float
    cpu: float
    load: float
    tracks: bytes
    stages: dict[str, float]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source")
    parser.add_argument("--frames")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 0])
    parser.add_argument("--pin", action="store_true")
    parser.add_argument("--more", nargs=argparse.REMAINDER, default=[], help="options of the command")
    arguments = parser.parse_args()
    given = ["--frames", arguments.frames] if arguments.frames else []
    turns: dict[int, list[Turn]] = {threads: [] for threads in arguments.threads}
    for _ in range(arguments.repeat):
        for threads in arguments.threads:
            options = [arguments.source, *given, "--threads", str(threads), *arguments.more]
            turns[threads].append(turn(options, threads if arguments.pin else 0))
    print(machine("numpy", "onnxruntime", "opencv-python-headless"))
    first = turns[arguments.threads[0]]
    for threads, here in turns.items():
        best = min(here, key=lambda each: each.wall)
        ratios = " ".join(f"{a.wall / b.wall:.2f}" for a, b in zip(first, here, strict=True))
        same = "the same tracks" if {t.tracks for t in here} == {first[0].tracks} else "OTHER TRACKS"
        loads = " ".join(f"{each.load:.1f}" for each in here)
        print(f"--threads {threads}: {best.wall:.2f} s, CPU {best.cpu:.2f} s; {ratios} times as fast; {same}")
        print(f"    processes that wanted a core: {loads}")
        print("    seconds: " + ", ".join(f"{name} {seconds:.2f}" for name, seconds in best.stages.items()))


def turn(options: Sequence[str], cores: int) -> Turn:
    """Run the command once, on so many ``cores``; 0 for all."""
    there = sorted(os.sched_getaffinity(0))
    given = set(there[: cores or None])
    program = "from tsuiseki.tracking.cli import main; raise SystemExit(main())"
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-c", program, "track", "people", *options, "--out", str(out)]
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.sched_setaffinity(process.pid, given)
        wanting: list[int] = []
        while not (ended := os.wait4(process.pid, os.WNOHANG))[0]:
            wanting.append(running())
            time.sleep(0.1)
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(ended[1])
        if process.returncode:
            raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
        stages = json.loads((out / "run.json").read_text(encoding="utf-8"))["seconds"]
        tracks = (out / "tracks.txt").read_bytes()
    load = sum(wanting) / max(len(wanting), 1)
    return Turn(wall, ended[2].ru_utime + ended[2].ru_stime, load, tracks, stages)


def running() -> int:
    """Threads that run or wait for a core now."""
    return int(Path("/proc/loadavg").read_text(encoding="utf-8").split()[3].split("/")[0]) - 1


if __name__ == "__main__":
    main()
