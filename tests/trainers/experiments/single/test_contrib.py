"""OpenCV-contrib's tracker in an environment of its own; a shell script stands for its Python."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.trainers.experiments.single.contrib import Contrib, find_contrib, follow_with_contrib


def test_a_python_without_it_is_refused(tmp_path):
    with pytest.raises(RequestError, match="opencv-contrib-python-headless"):
        find_contrib(Path(sys.executable), 33)
    with pytest.raises(RequestError, match="opencv-contrib-python-headless"):
        find_contrib(tmp_path / "python", 33)


def test_all_images_are_sent_and_the_boxes_come_back(tmp_path):
    script = tmp_path / "python"
    script.write_text(f"#!/bin/sh\ncat > {tmp_path}/sent\necho '[[5, 6, 10, 20], [7, 8, 10, 20]]'\n")
    script.chmod(0o755)
    images = [np.full((4, 6, 3), (1, 2, k), np.uint8) for k in range(3)]
    found = follow_with_contrib(Contrib("5", 33, str(script)), images, np.array([3.0, 4, 13, 24]))
    assert found.tolist() == [[3, 4, 13, 24], [5, 6, 15, 26], [7, 8, 17, 28]]
    head, _, pixels = (tmp_path / "sent").read_bytes().partition(b"\n")
    assert b'"box": [3.0, 4.0, 10.0, 20.0]' in head
    assert pixels == b"".join(bytes([k, 2, 1]) * 24 for k in range(3))  # blue first


def test_where_it_breaks_off_the_user_hears_of_it(tmp_path):
    script = tmp_path / "python"
    script.write_text("#!/bin/sh\nexit 1\n")
    script.chmod(0o755)
    with pytest.raises(RunError, match="CSRT"):
        follow_with_contrib(Contrib("5", 33, str(script)), [np.zeros((400, 600, 3), np.uint8)] * 3, np.arange(4.0))
