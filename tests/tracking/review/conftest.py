"""A clip of people who pass each other, its result, and the command that reviews it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.types import Track

SIZE, FRAMES, PEOPLE = (640, 360), 80, 8


def walkers(people: int, frames: int, size: tuple[int, int]) -> list[Track]:
    """People who walk to and fro, every second one against the others."""
    t = np.arange(frames)
    tracks = []
    for k in range(people):
        share = 0.5 + 0.45 * np.sin(2 * np.pi * t / 80 * 0.5 + np.pi * (k % 2) + 0.3 * (k // 2))
        x, y = share * (size[0] - 30), 20 + (size[1] - 120) * (k // 2) / max(people // 2 - 1, 1) + 3 * (k % 2)
        boxes = np.column_stack([x, np.full(frames, y), x + 30, np.full(frames, y + 80)])
        tracks.append(Track(k + 1, t, boxes, np.full(frames, 0.9)))
    return tracks


@pytest.fixture(scope="session")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a result."""
    folder, tracks = tmp_path_factory.mktemp("tracked"), walkers(PEOPLE, FRAMES, SIZE)
    (folder / "clip").mkdir()
    for frame in range(FRAMES):
        image = np.full((SIZE[1], SIZE[0], 3), 150, np.uint8)
        for track in tracks:
            x1, y1, x2, y2 = track.boxes[frame].astype(int)
            image[y1:y2, x1:x2] = (40 * track.id % 256, 90 * track.id % 256, 200)
        cv2.imwrite(str(folder / "clip" / f"{frame + 1:06d}.jpg"), image)
    noise = np.random.default_rng(0).normal(0, 1, (FRAMES, PEOPLE, 4))
    found = [np.column_stack([[t.boxes[f] for t in tracks] + noise[f], np.full(PEOPLE, 0.9)]) for f in range(FRAMES)]
    result = track_people(str(folder / "clip"), detections=found, appearance="none", frame_rate=25.0)
    return result.save(folder / "result")


@pytest.fixture
def reviewable(tracked: Path, tmp_path: Path) -> Path:
    """The folder of a result that nobody has reviewed."""
    return Path(shutil.copytree(tracked, tmp_path / "result"))


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """Starts ``tsuiseki review`` with given words; returns the process and the address of the page."""
    running = []

    def start(*words: object) -> tuple[subprocess.Popen[str], str]:
        call = "import sys; from tsuiseki.tracking.cli import main; sys.exit(main())"
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "DISPLAY": "", "WAYLAND_DISPLAY": ""}
        process = subprocess.Popen(
            [sys.executable, "-c", call, "review", *map(str, words)],
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        running.append(process)
        line = process.stderr.readline() if process.stderr else ""
        found = re.search(r"http://\S+", line)
        assert found, line
        return process, found[0]

    yield start
    for process in running:
        process.kill()
        process.communicate()
