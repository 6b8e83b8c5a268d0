"""`follow_single`: one target, each frame with its score and status, and what cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_target
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.single.run import follow_single, track_single
from tsuiseki.tracking.single.settings import SingleChoice

BOX = np.array([30, 40, 60, 80.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten images of a chequered square that moves by 2 pixels a frame."""
    rng = np.random.default_rng(0)
    square = np.kron(rng.integers(0, 2, (8, 6, 1)) * 255, np.ones((5, 5, 3))).astype(np.uint8)
    path = tmp_path_factory.mktemp("square")
    for t in range(10):
        image = rng.integers(90, 130, (120, 160, 3)).astype(np.uint8)
        image[40:80, 30 + 2 * t : 60 + 2 * t] = square
        cv2.imwrite(str(path / f"{t:03d}.png"), image)
    return path


def truth(count: int = 10) -> np.ndarray:
    return BOX + np.arange(count)[:, None] * np.array([2, 0, 2, 0])


@pytest.mark.parametrize("method", ["combined", "kcf-particle", "kcf", SingleChoice("csk").tracker()])
def test_every_frame_is_answered(folder: Path, method: Any) -> None:
    seen = list(follow_single(folder, BOX.tolist(), method))
    assert [frame.index for frame, _ in seen] == list(range(10))
    assert all(target.frame == frame.index and target.status == "tracking" for frame, target in seen)
    assert evaluate_target(truth(), [target for _, target in seen]).overlaps.mean() > 0.7


def test_the_command_writes_what_the_function_gives(folder: Path, tmp_path: Path) -> None:
    seen = [target.box for _, target in follow_single(folder, BOX, "kcf", frames="1-6")]
    words = ["track", "single", str(folder), "--box", "30,40,30,40", "--method", "kcf", "--frames", "1-6"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    np.testing.assert_allclose(seen, read_boxes(tmp_path / "out" / "boxes.txt"), atol=0.01)
    (whole,) = found = track_single(folder, BOX, "kcf", frames="1-6")
    np.testing.assert_array_equal(whole.boxes, seen)
    assert found.frames["status"] == ["tracking"] * 6
    written, saved = (tmp_path / "out" / "boxes.txt").read_text(), found.save(tmp_path / "saved")
    assert (saved / "boxes.txt").read_text() == written


def test_frames_come_as_they_are_asked_for(folder: Path) -> None:
    target = follow_single(folder, BOX)
    assert next(target)[0].index == 0
    assert next(target)[1].frame == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"box": None}, "expected the `box` of the target"),
        ({"box": (1, 2, 3)}, "four numbers x1, y1, x2, y2, got shape"),
        ({"method": "magic"}, "`method`: expected 'combined', "),
        ({"preset": "paper"}, "paper: expected with the method kcf, got combined"),
        ({"frames": "90-99"}, "expected frames within 1-10"),
        ({"box": (10, 10, 5, 5)}, "positive width and height"),
        ({"box": (900, 10, 950, 50)}, "inside the 160x120 image"),
    ],
)
def test_what_cannot_be_says_so_in_a_line(folder: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RequestError, match=message) as raised:
        next(follow_single(folder, **({"box": BOX} | options)))
    assert "\n" not in str(raised.value)
