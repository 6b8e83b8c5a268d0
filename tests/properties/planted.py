"""Planted faults: small changes of the source, and for each the test that must fail with it.

A fault is made in a copy of the package, never in place: a folder of links to all files but the changed one. The test
runs there in a process of its own, forked from one that has the libraries loaded and nothing of ours.

`python -m tests.properties.planted` runs all of them; with words, those whose file or test has one of them.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
# Packages of the wheel.
PACKAGES = ("configs", "datamodules", "models", "tracking", "trainers")
# Libraries that most tests load, and that take longest to.
LIBRARIES = ["cv2", "hypothesis.extra.numpy", "numpy", "pydantic", "pytest", "scipy.optimize", "scipy.stats", "yaml"]
# Seconds that a test may take with a fault in it.
LONGEST = 60.0
# What pytest ends with where a test failed.
FAILED = 1


@dataclass(frozen=True)
class Fault:
    """A change of the source.

    Attributes:
        file: in the repository.
        old: text that stands there once.
        new: what is put in its place.
        test: name of the test that fails then, as pytest has it.
    """

    file: str
    old: str
    new: str
    test: str

    def __str__(self) -> str:
        return f"{self.file}: {self.old!r} -> {self.new!r} ({self.test})"


def plant(fault: Fault, folder: Path) -> None:
    """A package ``tsuiseki`` in ``folder`` that has the fault.

    Raises:
        ValueError: the text to change is not there, or more than once.
    """
    text = (REPOSITORY / fault.file).read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        raise ValueError(f"expected {fault.old!r} once in {fault.file}, found it {text.count(fault.old)} times")
    package = folder / "tsuiseki"
    package.mkdir()
    for source in (*(REPOSITORY / "src/tsuiseki").glob("*.py*"), *(REPOSITORY / name for name in PACKAGES)):
        (package / source.name).symlink_to(source)
    place = package
    for part in Path(fault.file).parts:
        source = (place / part).resolve()
        (place / part).unlink()
        place = place / part
        if source.is_dir():
            place.mkdir()
            for entry in source.iterdir():
                (place / entry.name).symlink_to(entry)
    place.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
    # A time that no compiled file of the unchanged source has.
    os.utime(place, (0, 0))


def run_there(folder: str, test: str) -> None:
    """Run a test by the package in ``folder``; the process ends with what pytest ends with."""
    os.chdir(REPOSITORY)
    sys.path[:0] = [folder, str(REPOSITORY)]
    sys.dont_write_bytecode = True
    with Path(folder, "output.txt").open("w") as output:
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
    import pytest

    profile = ["--hypothesis-profile", "planted"] if test.startswith("tests/properties/") else []
    options = ["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "", *profile]
    os._exit(int(pytest.main([*options, f"--basetemp={folder}/temporary", test])))


def complaint(fault: Fault) -> str:
    """Why the test does not catch the fault; empty where it does."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)
    with tempfile.TemporaryDirectory() as folder:
        plant(fault, Path(folder))
        process = context.Process(target=run_there, args=(folder, fault.test))
        process.start()
        process.join(LONGEST)
        if process.is_alive():
            process.kill()
            process.join()
            return f"ran for {LONGEST:g} seconds"
        if process.exitcode == FAILED:
            return ""
        with contextlib.suppress(OSError):
            return f"ended with {process.exitcode}: " + Path(folder, "output.txt").read_text(encoding="utf-8")[-1000:]
        return f"ended with {process.exitcode}"


def main(words: Sequence[str]) -> int:
    """Run the faults that ``words`` name, all where there are none; 1 where a test does not catch its fault."""
    from tests.properties.faults import BY_FILE, of_file
    from tests.properties.room_faults import ROOMS

    faults = [fault for part in (*map(of_file, BY_FILE), *ROOMS.values()) for fault in part]
    chosen = [f for f in faults if not words or any(word in f.file or word in f.test for word in words)]
    started, missed = time.monotonic(), 0
    for fault in chosen:
        if said := complaint(fault):
            missed += 1
            print(f"not caught: {fault}\n{said}\n", flush=True)
    print(f"{len(chosen) - missed} of {len(chosen)} faults were caught in {time.monotonic() - started:.0f} s")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
