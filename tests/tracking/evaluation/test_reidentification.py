"""Appearance networks scored on Market-1501's layout and on labelled video."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.reidentification import read_views, score_views
from tsuiseki.tracking.types import FloatArray, ImageArray

COLOURS = {1: (200, 30, 30), 2: (30, 200, 30), 3: (30, 30, 200)}


class MeanColour:
    """Describes a box by its mean colour."""

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        rows = [image[y1:y2, x1:x2].mean(axis=(0, 1)) - 90.0 for x1, y1, x2, y2 in boxes.astype(int).tolist()]
        return np.array([row / np.linalg.norm(row) for row in rows])


def picture(path: Path, colour: tuple[int, int, int], size: tuple[int, int] = (64, 32)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((*size, 3), colour[::-1], np.uint8))


def market(folder: Path) -> Path:
    """Two people before two cameras; person 2 is another colour before the second; a distractor looks like that."""
    picture(folder / "query" / "0001_c1s1_000001_00.jpg", COLOURS[1])
    picture(folder / "query" / "0002_c1s1_000002_00.jpg", COLOURS[2])
    picture(folder / "bounding_box_test" / "0001_c1s1_000100_01.jpg", COLOURS[3])
    picture(folder / "bounding_box_test" / "0001_c2s1_000001_00.jpg", COLOURS[1])
    picture(folder / "bounding_box_test" / "0002_c2s1_000002_00.jpg", COLOURS[3])
    picture(folder / "bounding_box_test" / "0000_c2s1_000003_00.jpg", COLOURS[2])
    picture(folder / "bounding_box_test" / "-1_c2s1_000004_00.jpg", COLOURS[2])
    return folder


def video(folder: Path) -> Path:
    """Two people for 60 frames of 96 x 96 pixels."""
    rows = []
    for n in range(60):
        image = np.full((96, 96, 3), 128, np.uint8)
        for person, x in ((1, 8), (2, 56)):
            image[16:80, x : x + 32] = COLOURS[person]
            rows.append(f"{n + 1},{person},{x + 1},17,32,64,1,1,1")
        (folder / "img1").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / "img1" / f"{n + 1:06d}.png"), image[..., ::-1])
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text("\n".join(rows) + "\n")
    return folder


def test_views_of_the_own_camera_and_junk_do_not_count_and_distractors_do(tmp_path: Path) -> None:
    scores = score_views(read_views(market(tmp_path)), MeanColour())
    # Person 1 comes first. Person 2's other view comes after the distractor, and after nobody else is nearer.
    assert (scores.rank1, scores.rank5, scores.queries) == (0.5, 1.0, 2)
    assert 0.5 < scores.mean_average_precision < 1


def test_views_of_a_video_are_a_second_apart(tmp_path: Path) -> None:
    views = read_views(video(tmp_path / "v"))
    assert len(views.pictures) == 3
    assert (views.query.sum(), len(views.ids)) == (2, 6)
    assert score_views(views, MeanColour()).mean_average_precision == 1.0


def test_networks_are_compared_on_labelled_video(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scores = tmp_path / "scores.json"
    words = ["evaluate", "appearance", str(video(tmp_path / "v")), "people", "--json", str(scores)]
    assert main(words) == 0
    assert "Rank 10" in capsys.readouterr().out
    assert json.loads(scores.read_text())["people"]["mean_average_precision"] == pytest.approx(1.0)


def test_too_few_people_and_folders_without_pictures_are_refused(tmp_path: Path) -> None:
    (tmp_path / "query").mkdir()
    with pytest.raises(RequestError, match="expected crops of Market-1501"):
        read_views(tmp_path)
    picture(tmp_path / "query" / "0001_c1s1_000001_00.jpg", COLOURS[1])
    picture(tmp_path / "bounding_box_test" / "0001_c2s1_000001_00.jpg", COLOURS[1])
    with pytest.raises(RequestError, match="expected two people or more"):
        read_views(tmp_path)
