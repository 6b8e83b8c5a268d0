"""The shipped models are found by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.weights import shipped, shipped_names, shipped_or_file


def test_every_shipped_model_is_found() -> None:
    assert {"detector_street", "appearance_people", "affinity_people", "objectness_scenes"} <= set(shipped_names())
    for name in shipped_names():
        assert shipped(name).stem == name
        assert shipped(name).is_file()


def test_an_unknown_name_says_which_was_meant() -> None:
    with pytest.raises(RequestError, match="did you mean detector_street"):
        shipped("detector_streets")
    with pytest.raises(RequestError, match="expected one of action_drone"):
        shipped("zebra")


def test_a_bare_word_stands_for_a_shipped_model_and_a_path_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert shipped_or_file("detector", "figures") == shipped("detector_figures")
    assert shipped_or_file("detector", "own.onnx") == Path("own.onnx")
    assert shipped_or_file("detector", tmp_path / "own") == tmp_path / "own"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "street").touch()
    assert shipped_or_file("detector", "street") == Path("street")
    with pytest.raises(RequestError, match="one of the shipped ceiling, drone, drone_larger, figures, people, street"):
        shipped_or_file("detector", "figure")
