"""Networks are refused where they were trained."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.affinity import check_trained_elsewhere, trained_frames

PETS = "PETS09-S2L1-first"
ALL = [(0.0, float("inf"))]


@pytest.mark.parametrize(
    ("said", "frames"),
    [
        ("", []),
        ("generated pictures only (configs/detector_scenes.yaml)", []),
        ("PETS09-S2L1-first, frames 1-300", [(1, 300)]),
        ("pets frames 1–300, 350-400", [(1, 300), (350, 400)]),
        ("PETS09-S2L1-first", ALL),
        ("MOT17-02 frames 1-300; MOT17-05", []),  # the number in a name is no stretch, and the name another's
    ],
)
def test_what_a_card_says(said: str, frames: list[tuple[float, float]]) -> None:
    assert trained_frames(said, PETS) == frames


def network(said: str) -> Any:
    """A network that says this of its training."""
    card = ModelCard(kind="detector", name="ssd", class_names=("person",), training_data=said)
    return SimpleNamespace(path=Path("d.onnx"), card=card)


@pytest.mark.parametrize(("first", "last"), [(1, 400), (300, 301), (250, 260)])
def test_seen_frames_are_refused(first: int, last: int) -> None:
    with pytest.raises(
        RequestError, match=rf"d.onnx: expected a detector that was not trained on frames {first}-{last} of"
    ):
        check_trained_elsewhere([network("PETS frames 1-300")], [(PETS, first, last)])


def test_other_frames_are_taken(recwarn: pytest.WarningsRecorder) -> None:
    check_trained_elsewhere([network("PETS frames 1-300")], [(PETS, 301, 400)])
    check_trained_elsewhere([network("generated people")], [(PETS, 1, 400)])
    assert not recwarn.list


def test_silence_is_told_once() -> None:
    with pytest.warns(UserWarning, match=r"d.onnx does not say what it was trained on") as told:
        check_trained_elsewhere([network("")], [(PETS, 1, 100), (PETS, 101, 200)])
    assert len(told) == 1
