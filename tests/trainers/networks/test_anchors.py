"""Anchors proposed for a configuration: in input pixels, as YAML that the configuration takes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.networks.anchors import anchors_for


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A sequence of 200x100 images with people of 10x30 and 20x60, and a larger one that does not count."""
    (tmp_path / "img1").mkdir()
    (tmp_path / "gt").mkdir()
    rows = []
    for n in range(8):
        cv2.imwrite(str(tmp_path / "img1" / f"{n + 1:06d}.png"), np.zeros((100, 200, 3), dtype=np.uint8))
        rows += [f"{n + 1},1,11,11,{10 + 0.01 * n},30,1,1,1", f"{n + 1},2,81,21,{20 + 0.01 * n},60,1,1,1"]
        rows += [f"{n + 1},3,121,1,90,{90 + n},1,1,1" if n > 5 else f"{n + 1},3,121,1,90,{90 + n},0,8,1"]
    (tmp_path / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return tmp_path


def test_proposals_are_in_input_pixels(folder: Path) -> None:
    text = anchors_for(folder, 64, 100, frames=(1, 6), per_level=(1, 1, 1), scale=(1.0, 1.0))
    sizes = np.array([level[0] for level in yaml.safe_load(text)["anchors"]])
    # 200x100 into 100x64 is a factor of 0.5; three anchors split one of two sizes.
    assert all(np.abs(sizes - size).max(axis=1).min() <= 0.1 for size in ([5, 15], [10, 30]))
    stretched = anchors_for(folder, 200, 100, frames=(1, 6), resize="stretch", per_level=(1, 1, 1), scale=(1.0, 1.0))
    sizes = np.array([level[0] for level in yaml.safe_load(stretched)["anchors"]])
    assert all(np.abs(sizes - size).max(axis=1).min() <= 0.1 for size in ([5, 60], [10, 120]))


def test_too_many_anchors_are_refused_in_one_line(folder: Path) -> None:
    with pytest.raises(RequestError, match="ask for fewer anchors"):
        anchors_for(folder, 64, 100, per_level=(90, 90, 90), scale=(1.0, 1.0))
    with pytest.raises(RequestError, match="3 or 4 numbers"):
        anchors_for(folder, 64, 100, per_level=(3, 2))


def test_the_command_prints_what_the_function_gives(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["train", "detector", "--propose-anchors", str(folder), "--height", "64", "--width", "100"]
    assert main([*words, "--per-level", "1,1,1"]) == 0
    assert capsys.readouterr().out == anchors_for(folder, 64, 100, per_level=(1, 1, 1)) + "\n"
    assert main([*words, "--per-level", "3,2"]) == 2
    assert "3 or 4 numbers" in capsys.readouterr().err
