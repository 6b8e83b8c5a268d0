"""Commands that no other test runs with good input; `tests/conftest.py` checks that a whole session leaves none out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cameras.lens_files import write_intrinsics
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cli import main


def street(folder: Path) -> tuple[list[str], str]:
    size = ["--frames", "2", "--people", "2", "--width", "160", "--height", "96"]
    return [*size, "--out", str(folder / "clip")], "clip/gt/gt.txt"


def points(folder: Path) -> tuple[list[str], str]:
    """Points that a camera of known lens sees."""
    lens = PinholeCamera(
        640, 480, np.array([210.0, 212]), np.array([320.5, 240.5]), distortion=np.array([0.1, 0, 0, 0, 0])
    )
    write_intrinsics(folder / "lens.yaml", lens, 0.0)
    places = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 4], (8, 3))
    rows = np.column_stack([places, lens.project(places)[0]])
    np.savetxt(folder / "points.csv", rows, delimiter=",", header="x,y,z,u,v")
    given = [str(folder / "points.csv"), "--intrinsics", str(folder / "lens.yaml")]
    return [*given, "--out", str(folder / "cameras.yaml")], "cameras.yaml"


# The words after the command, and a file that it writes.
HERE: dict[str, Callable[[Path], tuple[list[str], str]]] = {"simulate street": street, "calibrate points": points}


@pytest.mark.parametrize("command", HERE)
def test_a_good_request_ends_well(command: str, tmp_path: Path) -> None:
    words, written = HERE[command](tmp_path)
    assert main([*command.split(), *words]) == 0
    assert (tmp_path / written).is_file()
