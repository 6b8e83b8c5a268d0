"""What was computed is taken again for the same arguments, data and code, and for nothing else."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments import study as store_module
from tsuiseki.trainers.experiments.peers import Peer
from tsuiseki.trainers.experiments.study import Store

CALLS: list[object] = []


@dataclass(frozen=True)
class Settings:
    size: int = 1
    share: float | None = None

    @cached_property
    def double(self) -> int:
        return 2 * self.size


@dataclass(frozen=True)
class Found:
    settings: Settings
    points: FloatArray
    names: tuple[str, ...]
    by_name: dict[str, list[float]]
    pairs: dict[int, tuple[int, float]]


def find(settings: Settings, points: FloatArray, path: Path | None = None, peer: Peer | None = None) -> Found:
    del path, peer
    CALLS.append(settings)
    return Found(settings, points * settings.size, ("a", "b"), {"x": [0.1, float("inf")]}, {3: (1, 0.5)})


def write(folder: Path, text: str) -> None:
    CALLS.append(text)
    folder.mkdir(parents=True)
    (folder / "text.txt").write_text(text)


@pytest.fixture(autouse=True)
def no_calls() -> None:
    CALLS.clear()


def test_a_value_comes_back_as_it_was(tmp_path: Path) -> None:
    points = np.array([[0.1, np.nan], [1e-300, -0.0]])
    first = Store(tmp_path).recall(find, Settings(2), points)
    again = Store(tmp_path).recall(find, Settings(2), points)
    assert len(CALLS) == 1
    for found in (first, again):
        assert found.points.tobytes() == (2 * points).tobytes()
        assert (found.settings, found.names, found.by_name, found.pairs) == (
            Settings(2), ("a", "b"), {"x": [0.1, float("inf")]}, {3: (1, 0.5)},
        )  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "points"),
    [(Settings(2), [0.0]), (Settings(1, 0.0), [0.0]), (Settings(1), [1.0]), (Settings(1), [0.0, 0.0])],
)
def test_other_arguments_are_computed_anew(tmp_path: Path, settings: Settings, points: Sequence[float]) -> None:
    store = Store(tmp_path)
    for _ in range(2):
        store.recall(find, Settings(1), np.array([0.0]))
        store.recall(find, settings, np.array(points))
    assert len(CALLS) == 2


def test_a_path_stands_for_what_is_in_it(tmp_path: Path) -> None:
    data, store = tmp_path / "data", Store(tmp_path / "store")
    data.mkdir()

    def asked(text: str) -> int:
        (data / "one.txt").write_text(text)
        store.recall(find, Settings(), np.zeros(1), data)
        return len(CALLS)

    assert [asked(text) for text in ("1", "1", "2", "1")] == [1, 1, 2, 2]
    (data / "one.txt").rename(data / "two.txt")
    store.recall(find, Settings(), np.zeros(1), data)
    assert len(CALLS) == 3


def test_where_a_peer_lies_and_what_was_computed_on_an_argument_make_no_difference(tmp_path: Path) -> None:
    store, settings = Store(tmp_path), Settings()
    store.recall(find, settings, np.zeros(1), peer=Peer("csrt", "here", "1.0"))
    assert settings.double == 2
    store.recall(find, settings, np.zeros(1), peer=Peer("csrt", "there", "1.0"))
    assert len(CALLS) == 1


def test_nothing_that_other_code_made_is_taken_or_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path)
    for points in (np.zeros(1), np.ones(1)):
        store.recall(find, Settings(), points)
    monkeypatch.setattr(store_module, "code_version", lambda: "another")
    store.recall(find, Settings(), np.zeros(1))
    assert len(CALLS) == 3
    # What the older code made of the same arguments is gone; nothing else is.
    assert len(list((tmp_path / "find").iterdir())) == 2


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
