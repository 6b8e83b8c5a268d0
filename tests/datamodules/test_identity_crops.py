"""Crops of people from layouts of still pictures."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.identity_crops import crops_from_folder


def test_crops_of_market_are_people_without_distractors(tmp_path: Path) -> None:
    folder = tmp_path / "bounding_box_train"
    folder.mkdir()
    for name in ("0002_c1s1_000451_03", "0002_c2s1_000007_01", "0007_c1s1_000451_01", "0000_c1s1_000451_01"):
        cv2.imwrite(str(folder / f"{name}.jpg"), np.zeros((128, 64, 3), np.uint8))
    (tmp_path / "query").mkdir()
    shutil.copytree(folder, tmp_path / "bounding_box_test")
    for place in (tmp_path, folder, tmp_path / "bounding_box_test"):
        crops = crops_from_folder(place, None)
        assert crops.ids.tolist() == [2, 2, 7]
        assert crops.boxes.tolist() == [[0, 0, 64, 128]] * 3
