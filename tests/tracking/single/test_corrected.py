"""A target that was lost is followed on, and back, from where a person says that it is."""

import cv2
import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, walk
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.correction_log import Box, CorrectedVideo, Correction, append
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.geometry import iou_pairs

SHAPE, GONE, FOUND = (160, 320), range(15, 20), 35


@pytest.fixture
def jumping(tmp_path):
    """A target that is hidden for a while, and comes out far away."""
    path = walk(50)
    path[GONE.start :, 0] += 120
    images, boxes = clip(path, hidden=GONE, shape=SHAPE)
    (tmp_path / "clip").mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "clip" / f"{number:03}.png"), image)
    return tmp_path, boxes


def said(folder, *corrections, size=SHAPE[::-1]):
    append(folder / "corrections.jsonl", corrections, CorrectedVideo("clip", size, 50))
    return ["--corrections", str(folder / "corrections.jsonl")]


@pytest.mark.slow
def test_a_box_is_followed_on_and_back(jumping):
    folder, boxes = jumping
    x1, y1, x2, y2 = boxes[0].tolist()
    words = ["track", "single", str(folder / "clip"), "--method", "kcf", "--box", f"{x1},{y1},{x2 - x1},{y2 - y1}"]
    assert main([*words, "--out", str(folder / "before")]) == 0
    there = np.r_[GONE.stop : len(boxes)]
    assert np.median(iou_pairs(read_boxes(folder / "before/boxes.txt"), boxes)[there]) < 0.1
    x1, y1, x2, y2 = boxes[FOUND].tolist()
    more = said(folder, Correction("box", (Box(FOUND, x1, y1, x2 - x1, y2 - y1),)))
    assert main([*words, "--out", str(folder / "after"), *more]) == 0
    overlap = iou_pairs(read_boxes(folder / "after/boxes.txt"), boxes)
    assert overlap[there].min() > 0.6
    assert overlap[: GONE.start].min() > 0.6


@pytest.mark.parametrize(
    ("correction", "size", "line"),
    [
        (Correction("real", (Box(3, 1, 2, 30, 40),)), SHAPE[::-1], "expected boxes that show where the target is"),
        (Correction("box", (Box(3, 1, 2, 30, 40),)), (64, 48), "expected corrections of clip of 320x160 pixels"),
    ],
)
def test_corrections_without_a_box_and_of_another_video_are_refused(jumping, capsys, correction, size, line):
    folder, _ = jumping
    words = ["track", "single", str(folder / "clip"), "--box", "20,30,30,35", "--out", str(folder / "o")]
    assert main([*words, *said(folder, correction, size=size)]) == 2
    assert line in capsys.readouterr().err
