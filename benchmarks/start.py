"""CPU seconds of a program's start: until the first frame with its people, and of the page of a result.

    python -m benchmarks.start SOURCE [--view auto] [--frames 1-200] [--repeat 3]

Each turn has a process of its own with one thread, and the quietest counts. The first number holds the imports.
``page`` is what `Result.save` takes for the page, its plots and files, once in a fresh process, which imports
matplotlib, and once more.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TASKS = ("imports", "first frame", "page", "page again")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source")
    parser.add_argument("--view", default="auto")
    parser.add_argument("--frames", default="1-200")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--turn", action="store_true", help="one turn, in this process")
    words = parser.parse_args()
    if words.turn:
        print(*turn(words.source, words.view, words.frames))
        return
    options = ["--turn", f"--view={words.view}", f"--frames={words.frames}"]
    command = [sys.executable, "-m", __spec__.name, words.source, *options]
    turns = [subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True) for _ in range(words.repeat)]
    for task, values in zip(TASKS, zip(*(map(float, run.stdout.split()) for run in turns), strict=True), strict=True):
        print(f"{task:12} {min(values):.2f} s CPU")


def turn(source: str, view: str, frames: str) -> tuple[float, ...]:
    """Seconds of the tasks."""
    from tsuiseki import follow_people, track_people
    from tsuiseki.tracking.counts.page import with_page

    imported = time.process_time()
    next(iter(follow_people(source, view=view, threads=1)))
    first = time.process_time()
    result = with_page(track_people(source, view=view, frames=frames, threads=1))
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        for name in "ab":
            begin = time.process_time()
            result.save(Path(folder) / name)
            spent.append(time.process_time() - begin)
    return imported, first, *spent


if __name__ == "__main__":
    main()
