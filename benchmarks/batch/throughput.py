"""Many videos by `tsuiseki batch`, against a shell loop and one process, and what a cluster would take.

    python -m benchmarks.batch.throughput [--videos 8] [--frames 100] [--ray] [--out DIR]

Rows track the same generated clips; ratios are to one process of one thread. The schedule of 1,000 videos of an hour is
played through with the measured seconds of each kind of task.
"""

from __future__ import annotations

import argparse
import heapq
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from functools import partial
from pathlib import Path

from tsuiseki.tracking.cli import main

HOURS, RATE, SEGMENT = 1000, 25.0, 60.0


def clips(folder: Path, videos: int, frames: int) -> list[str]:
    """Streets of so many frames, made where they are not there."""
    found = [folder / f"street-{seed}" for seed in range(videos)]
    for seed, path in enumerate(found):
        size = ["--frames", str(frames), "--width", "640", "--height", "360", "--people", "8", "--seed", str(seed)]
        assert path.exists() or main(["simulate", "street", *size, "--out", str(path)]) == 0
    return [str(path) for path in found]


def tsuiseki(*calls: list[str]) -> None:
    """Commands in a process of their own."""
    program = f"from tsuiseki.tracking.cli import main\nfor words in {calls!r}: assert main(words) == 0"
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)


def one_process(videos: list[str], out: Path) -> None:
    """All videos by one thread."""
    tsuiseki(*(["track", "people", video, "--threads", "1", "--out", str(out / Path(video).stem)] for video in videos))


def shell_loop(videos: list[str], out: Path) -> None:
    """A process a video, which takes all cores."""
    for video in videos:
        tsuiseki(["track", "people", video, "--out", str(out / Path(video).stem)])


def batch(videos: list[str], out: Path, workers: int, ray: bool = False) -> None:
    """`tsuiseki batch`."""
    tsuiseki(["batch", "track", "people", *videos, "--out", str(out), "--workers", str(workers), *["--ray"] * ray])


def seconds_of_tasks(out: Path) -> dict[str, tuple[float, float]]:
    """By the kind of task: seconds of each, and seconds a frame that it has."""
    took, frames = defaultdict(list), defaultdict(list)
    for line in (out / ".batch/journal.jsonl").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        if event["event"] == "done":
            took[event["kind"]].append(event["seconds"])
            frames[event["kind"]].append(sum(event["frames"]) if isinstance(event["frames"], list) else event["frames"])
    return {kind: (sum(took[kind]) / len(took[kind]), sum(took[kind]) / max(sum(frames[kind]), 1)) for kind in took}


def played(tasks: dict[str, tuple[float, float]], workers: int) -> tuple[float, float, float]:
    """Hours until all is done, hours of work in it, and of the longest task, where whoever is free takes the next."""
    detect, finish = tasks["detect"][1] * SEGMENT * RATE, tasks["finish"][1] * 3600 * RATE
    free, work = [0.0] * workers, 0.0
    for _ in range(HOURS):
        begun = heapq.heappop(free) + tasks["begin"][0]
        heapq.heappush(free, begun)
        last = begun
        for _ in range(round(3600 / SEGMENT)):
            end = max(heapq.heappop(free), begun) + detect
            heapq.heappush(free, end)
            last = max(last, end)
        free.remove(last)
        free.append(last + finish)
        heapq.heapify(free)
        work += tasks["begin"][0] + round(3600 / SEGMENT) * detect + finish
    return max(free) / 3600, work / 3600, max(detect, finish, tasks["begin"][0]) / 3600


def measure() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--videos", type=int, default=8)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--ray", action="store_true", help="also on Ray")
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "tsuiseki-batch")
    given = parser.parse_args()
    videos, out = clips(given.out, given.videos, given.frames), given.out / "results"
    rows = {"one process": partial(one_process), "shell loop": partial(shell_loop)}
    rows |= {f"batch, {n} workers": partial(batch, workers=n) for n in (1, 2)}
    if given.ray:
        rows |= {f"Ray, {n} workers": partial(batch, workers=n, ray=True) for n in (1, 2)}
    first = None
    for name, run in rows.items():
        shutil.rmtree(out, ignore_errors=True)
        start = time.perf_counter()
        run(videos, out)
        rate = given.videos * given.frames / (time.perf_counter() - start)
        first = first or rate
        print(f"{name:18} {rate:7.1f} frames/s {rate / first:5.2f}", flush=True)
        if name == "batch, 2 workers":
            tasks = seconds_of_tasks(out)
    for workers in (1, 2, 4, 8, 16, 32, 64):
        hours, work, longest = played(tasks, workers)
        busy = f"{work:.0f} machine-hours, {work / hours / workers:.0%} busy, longest task {60 * longest:.1f} min"
        print(f"{workers:3} workers: {hours:8.1f} h, {busy}")


if __name__ == "__main__":
    measure()
