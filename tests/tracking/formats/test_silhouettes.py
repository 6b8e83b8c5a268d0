"""Silhouettes on disk, and whether a centre lies inside one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import FOLDER, centre_inside, read_silhouettes


@pytest.fixture
def pictures():
    pictures = np.zeros((3, 6, 8), dtype=np.uint8)
    pictures[:, 1:3, 2:5] |= 1
    pictures[:, 2:4, 4:7] |= 2
    return pictures


def test_silhouettes_survive_the_file(tmp_path, pictures):
    (tmp_path / FOLDER).mkdir()
    for frame, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / FOLDER / f"{frame + 1:06d}.png"), picture)
    assert np.array_equal(read_silhouettes(tmp_path), pictures)


@pytest.mark.parametrize(
    ("identity", "centre", "inside"),
    [(1, (2.0, 1.0), True), (1, (4.99, 2.99), True), (1, (5.0, 2.0), False), (2, (4.5, 2.5), True),
     (1, (1.99, 1.5), False), (3, (4.5, 2.5), False), (1, (-1.0, 1.0), False), (1, (8.0, 2.0), False),
     (1, (3.0, np.nan), False), (1, (np.inf, 2.0), False)],
)  # fmt: skip
def test_centres_inside_and_outside(pictures, identity, centre, inside):
    assert centre_inside(pictures, identity, np.tile(centre, (3, 1))).tolist() == [inside] * 3


def test_what_is_not_there_or_broken_is_refused(tmp_path):
    with pytest.raises(RequestError, match="found none"):
        read_silhouettes(tmp_path)
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "000001.png").write_bytes(b"no picture")
    with pytest.raises(RequestError, match="something else"):
        read_silhouettes(tmp_path)
