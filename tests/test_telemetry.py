"""58.22: onnxruntime and OpenVINO write nothing about this machine anywhere, unless the user asks for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
VARIABLE = "ORT_DISABLE_TELEMETRY"
# What opens a network, runs one, and exports one.
PROGRAMS = {
    "python": "import tsuiseki; from tsuiseki.tracking.onnx import kind_of; "
    "from tsuiseki.tracking.weights import shipped; kind_of(shipped('detector_street'))",
    "network": "import numpy as np; from tsuiseki.tracking.features.exported import Appearance; "
    "from tsuiseki.tracking.weights import shipped; Appearance(shipped('appearance_people'), 1)",
    "openvino": "from tsuiseki.tracking.openvino_session import _core; _core()",
    "export": "import tsuiseki.trainers.exporting.export as e; from tsuiseki.tracking.weights import shipped; "
    "e.onnxruntime.InferenceSession(str(shipped('appearance_people')))",
}


def files_after(program: str, home: Path, **variables: str) -> list[str]:
    """What a program has left in a fresh home, where it also finds its caches."""
    left_out = (VARIABLE, "CI")  # OpenVINO is silent in a CI
    plain = {name: value for name, value in os.environ.items() if name not in left_out and not name.startswith("XDG_")}
    environment = {**plain, "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), **variables}
    subprocess.run([sys.executable, "-c", program], env=environment, check=False, capture_output=True, timeout=120)
    return sorted(str(path.relative_to(home)) for path in home.rglob("*") if path.is_file())


@pytest.mark.parametrize("name", ["python", "network", "openvino", pytest.param("export", marks=pytest.mark.slow)])
def test_no_file_appears_in_a_fresh_home(tmp_path: Path, name: str) -> None:
    written = files_after(PROGRAMS[name], tmp_path)
    assert [path for path in written if "onnxruntime" in path or "Microsoft" in path or "intel" in path] == []


def test_importing_turns_it_off_before_onnxruntime_is_loaded() -> None:
    program = f"import os, sys, tsuiseki; print(os.environ['{VARIABLE}'], 'onnxruntime' in sys.modules)"
    plain = {name: value for name, value in os.environ.items() if name != VARIABLE}
    for variables, expected in (({}, "1 False"), ({VARIABLE: "0"}, "0 False")):
        environment = {**plain, **variables}
        printed = subprocess.check_output([sys.executable, "-c", program], env=environment, text=True)
        assert printed.strip() == expected


def test_the_page_on_privacy_says_it() -> None:
    assert VARIABLE in (REPOSITORY / "docs" / "how-to" / "hide-people.md").read_text(encoding="utf-8")
