"""What was computed is taken again for the same arguments and code, and for nothing else."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers import store as store_module
from benchmarks.papers.store import Store
from tsuiseki.tracking.types import FloatArray

CALLS: list[object] = []


@dataclass(frozen=True)
class Settings:
    size: int = 1
    share: float | None = None

    @cached_property
    def double(self) -> int:
        return 2 * self.size


@dataclass(frozen=True)
class Scaled:
    settings: Settings
    points: FloatArray
    names: tuple[str, ...]
    by_name: dict[str, list[float]]
    pairs: dict[int, tuple[int, float]]


def scale(settings: Settings, points: FloatArray) -> Scaled:
    CALLS.append(settings)
    return Scaled(settings, points * settings.size, ("a", "b"), {"x": [0.1, float("inf")]}, {3: (1, 0.5)})


def write(folder: Path, text: str) -> None:
    CALLS.append(text)
    folder.mkdir(parents=True)
    (folder / "text.txt").write_text(text)


@pytest.fixture(autouse=True)
def no_calls() -> None:
    CALLS.clear()


def test_a_value_comes_back_as_it_was(tmp_path: Path) -> None:
    points = np.array([[0.1, np.nan], [1e-300, -0.0]])
    first = Store(tmp_path).recall(scale, Settings(2), points)
    again = Store(tmp_path).recall(scale, Settings(2), points)
    assert len(CALLS) == 1
    for scaled in (first, again):
        assert scaled.points.tobytes() == (2 * points).tobytes()
        assert (scaled.settings, scaled.names, scaled.by_name, scaled.pairs) == (
            Settings(2), ("a", "b"), {"x": [0.1, float("inf")]}, {3: (1, 0.5)},
        )  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "points"),
    [(Settings(2), [0.0]), (Settings(1, 0.0), [0.0]), (Settings(1), [1.0]), (Settings(1), [0.0, 0.0])],
)
def test_other_arguments_are_computed_anew(tmp_path: Path, settings: Settings, points: Sequence[float]) -> None:
    store = Store(tmp_path)
    for _ in range(2):
        store.recall(scale, Settings(1), np.array([0.0]))
        store.recall(scale, settings, np.array(points))
    assert len(CALLS) == 2


def test_what_was_computed_on_an_argument_makes_no_difference(tmp_path: Path) -> None:
    store, settings = Store(tmp_path), Settings()
    store.recall(scale, settings, np.zeros(1))
    assert settings.double == 2
    store.recall(scale, settings, np.zeros(1))
    assert len(CALLS) == 1


def test_nothing_that_other_code_made_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Store(tmp_path).recall(scale, Settings(), np.zeros(1))
    monkeypatch.setattr(store_module, "code_version", lambda: "another")
    Store(tmp_path).recall(scale, Settings(), np.zeros(1))
    assert len(CALLS) == 2


def test_the_version_of_the_code_is_that_of_all_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resources, "files", lambda _: tmp_path)
    versions = set()
    for name, text in (("a.py", "1"), ("deep/b.py", "1"), ("a.py", "2"), ("weights/c.json", "{}"), ("d.txt", "1")):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        versions.add(store_module.code_version.__wrapped__())
    assert len(versions) == 4


def test_a_folder_is_made_once_and_whole(tmp_path: Path) -> None:
    store = Store(tmp_path)
    first = store.made("clip", write, "text")
    assert (first / "text.txt").read_text() == "text"
    assert first == store.made("clip", write, "text")
    assert first != store.made("clip", write, "other")
    assert CALLS == ["text", "other"]

    with pytest.raises(FileExistsError):
        store.made("clip", breaks_off, "text")

    # A run that is killed cannot tidy up: its folder stays, empty.
    shutil.rmtree(first)
    assert (store.made("clip", write, "text") / "text.txt").read_text() == "text"


def breaks_off(folder: Path, text: str) -> None:
    write(folder, text)
    write(folder, text)


def test_what_has_no_lasting_name_is_refused(tmp_path: Path) -> None:
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        Store(tmp_path).recall(lambda: 1)


STOP = {"after": 1000}
"""Runs after which somebody interrupts."""


def measure(slope: float, unit: int) -> dict[str, float]:
    if len(CALLS) == STOP["after"]:
        raise KeyboardInterrupt
    CALLS.append((slope, unit))
    return {"error": slope * unit, "missed": 1.0}


MEASURED = {"plain": partial(measure, 1.0), "steep": partial(measure, 3.0)}
UNITS = (1, 2, 4)


def test_an_interrupted_study_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STOP, "after", 4)
    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path).study(MEASURED, UNITS)
    assert len(CALLS) == 4
    monkeypatch.undo()
    measured = Store(tmp_path).study(MEASURED, UNITS)
    assert len(CALLS) == len(set(CALLS)) == 6
    assert [one["error"] for one in measured["steep"]] == [3.0, 6.0, 12.0]
    # One more row or unit costs its own runs alone.
    Store(tmp_path).study({**MEASURED, "flat": partial(measure, 0.0)}, (*UNITS, 8))
    assert len(CALLS) == 6 + 2 + 4
