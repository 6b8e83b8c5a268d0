"""Dataclasses in a file: they come back as they were, and nothing in a file runs."""

from __future__ import annotations

import ast
import io
import json
import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.values import read_values, write_values
from tsuiseki.tracking.types import Detections, FloatArray, Track

REPOSITORY = Path(__file__).resolve().parents[3]


class Pair(NamedTuple):
    left: Any
    right: Any


@dataclass(frozen=True)
class Parts:
    points: FloatArray
    inner: tuple[Parts, ...] = ()
    by_name: dict[Any, Any] = field(default_factory=dict)


RUNS: list[str] = []


@dataclass
class Runs:
    value: int

    def __post_init__(self) -> None:
        RUNS.append("ran")


def again(folder: Path, value: Any) -> Any:
    with (folder / "a.npz").open("wb") as file:
        write_values(file, value)
    return read_values(folder / "a.npz", "values")


def test_values_come_back_as_they_were(tmp_path: Path):
    points = np.array([[0.1, np.nan], [1e-300, -0.0]])
    value = Parts(points, (Parts(np.arange(3)), Parts(np.empty((0, 4)))), {3: [1, None, "x"], "y": {True}, (1, 2): 0.5})
    result = again(tmp_path, Pair(value, {"path": Path("a/b"), "score": np.float32(0.1), "far": float("inf")}))
    assert type(result) is Pair
    assert result.left.points.tobytes() == points.tobytes()
    assert [part.points.shape for part in result.left.inner] == [(3,), (0, 4)]
    assert result.left.inner[0].points.dtype == np.int64
    assert result.left.by_name == value.by_name
    assert result.right == {"path": Path("a/b"), "score": np.float32(0.1), "far": float("inf")}
    assert type(result.right["score"]) is np.float32


def test_tracks_and_detections_come_back(tmp_path: Path):
    boxes = np.array([[1.0, 2, 3, 4], [2, 3, 4, 5]])
    track = Track(7, np.array([3, 5]), boxes, np.array([0.5, 0.25]), names={2: "person"})
    detections = [Detections(boxes, np.array([0.1, 0.2]), features=np.eye(2)), Detections.empty()]
    result = again(tmp_path, (track, detections))
    assert result == (track, detections)


def test_what_is_no_plain_value_is_refused_when_it_is_written():
    for value in (object(), lambda: 1, np.array([object()]), 2**70):
        with pytest.raises(TypeError, match="expected plain values"):
            write_values(io.BytesIO(), value)


def crafted(folder: Path, structure: Any) -> Path:
    np.savez(folder / "a.npz", structure=np.frombuffer(json.dumps(structure).encode(), np.uint8))
    return folder / "a.npz"


@pytest.mark.parametrize(
    "structure",
    [
        {"module": "os", "class": "system", "fields": {}},
        {"module": "subprocess", "class": "Popen", "fields": {"args": "ls"}},
        {"module": "not.loaded", "class": "Class", "fields": {}},
        {"module": __name__, "class": "Parts", "fields": {"points": 1}},
        {"module": __name__, "class": "Parts.__init__", "fields": {}},
        {"array": ["<f8", 1000], "alone": False},
        {"array": ["<f8", -1], "alone": False},
        {"eval": "1"},
        {"dict": [[[], 1]]},
        {},
        [{"set": [{"list": []}]}],
    ],
)
def test_a_crafted_file_is_refused_in_a_line(structure: Any, tmp_path: Path):
    with pytest.raises(RequestError, match=r"a\.npz: expected values, got"):
        read_values(crafted(tmp_path, structure), "values")


def test_no_constructor_runs(tmp_path: Path):
    RUNS.clear()
    value = read_values(crafted(tmp_path, {"module": __name__, "class": "Runs", "fields": {"value": 3}}), "values")
    assert (type(value), value.value, RUNS) == (Runs, 3, [])


@pytest.mark.slow
def test_nothing_in_the_package_or_the_papers_unpickles():
    """Checkpoints are read with ``weights_only=True``, arrays without objects, the rest is JSON or arrays."""
    words = (
        r"pickle\.loads?\(|Unpickler|allow_pickle=True|weights_only=False|import (joblib|shelve|dill)|marshal\.loads?"
    )
    folders = ["tracking", "trainers", "datamodules", "models", "benchmarks"]
    found = subprocess.run(
        ["grep", "-rnE", words, *folders, "--include=*.py"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    # Lightning's word for a checkpoint with the optimiser's state; it is written, not read.
    lines = [line for line in found.stdout.splitlines() if "save_checkpoint(" not in line]
    assert lines == []
    calls = (
        ast.unparse(node)
        for folder in folders
        for path in (REPOSITORY / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    )
    loads = [call for call in calls if re.match(r"(torch|np)\.load\(|[\w.()]+\.load_from_checkpoint\(", call)]
    assert len(loads) > 5
    bounded = ("weights_only=True", "'weights_only': True", "allow_pickle=False", "mmap_mode")
    assert [call for call in loads if not any(word in call for word in bounded)] == []
