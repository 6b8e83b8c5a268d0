"""Where OpenCV cannot load: what needs none works, and what needs it says in one line what to do."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tsuiseki.tracking.errors import lacks_memory

PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"
MISSING = "raise ImportError('libGL.so.1: cannot open shared object file: No such file or directory')"


@pytest.fixture
def hidden(tmp_path: Path) -> dict[str, str]:
    """An environment in which OpenCV is the build with windows, on a machine without libGL."""
    (tmp_path / "cv2").mkdir()
    (tmp_path / "cv2" / "__init__.py").write_text(MISSING)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"PYTHONPATH": path}


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_command_says_in_a_line_what_to_do(hidden: dict[str, str], tmp_path: Path) -> None:
    code = "import sys; from tsuiseki.tracking.cli import main; sys.exit(main(sys.argv[1:]))"
    (tmp_path / "video").mkdir()
    done = run(hidden, "-c", code, "track", "people", str(tmp_path / "video"), "--out", str(tmp_path / "out"))
    assert done.returncode == 1
    assert done.stderr.startswith("tsuiseki: OpenCV does not load, for libGL.so.1 is not there;")
    assert "pip install --force-reinstall --no-deps opencv-python-headless" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_trackers_of_given_boxes_need_no_opencv(hidden: dict[str, str]) -> None:
    code = (
        "import tsuiseki as t\nfor s in (t.Sort(), t.DeepSort(), t.ByteTrack(), t.OcSort()): s.update([[0, 0, 9, 9]])"
    )
    done = run(hidden, "-c", code)
    assert done.returncode == 0, done.stderr


def test_the_base_installation_brings_one_opencv_only() -> None:
    """What a package requires is in its metadata; nothing of the base may want another build."""
    seen: set[str] = set()
    waiting = list(tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["dependencies"])
    while waiting:
        wanted = Requirement(waiting.pop())
        needed = wanted.marker is None or any(wanted.marker.evaluate({"extra": e}) for e in ("", *wanted.extras))
        if needed and wanted.name.lower() not in seen:
            seen.add(wanted.name.lower())
            waiting += metadata.requires(wanted.name) or []
    assert "opencv-python-headless" in seen
    assert not {"opencv-python", "opencv-contrib-python"} & seen


def test_errors_that_come_from_each_other_in_a_circle_end() -> None:
    first, second = ValueError("first"), KeyError("second")
    first.__context__, second.__context__ = second, first
    assert not lacks_memory(first)
