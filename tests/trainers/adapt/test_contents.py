"""A run is told from another by what its files hold, not by what they are called."""

from __future__ import annotations

import os
from pathlib import Path

from tsuiseki.trainers.adapt.contents import digest_of, state_of


def test_a_model_that_was_written_anew(tmp_path: Path) -> None:
    model = tmp_path / "model.onnx"
    model.write_bytes(b"one")
    first = digest_of(model)
    os.utime(model, (0, 0))
    assert digest_of(model) == first
    model.write_bytes(b"two")
    assert digest_of(model) != first
    assert digest_of(tmp_path / "gone.onnx") == ""


def test_a_video_that_was_written_anew(tmp_path: Path) -> None:
    folder = tmp_path / "sequence"
    (folder / "img1").mkdir(parents=True)
    picture = folder / "img1" / "1.jpg"
    picture.write_bytes(b"one")
    os.utime(picture, (100, 100))
    first = state_of(str(folder))
    assert first == state_of(str(folder)) == state_of(str(picture))
    os.utime(picture, (200, 200))
    assert state_of(str(folder)) != first
    (folder / "img1" / "2.jpg").write_bytes(b"two")
    assert state_of(str(folder))[:2] == [2, 6]
    assert state_of("rtsp://camera") == [0, 0, 0]
