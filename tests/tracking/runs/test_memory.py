"""58.8: a lack of memory is said to be one, whoever words it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking import onnx
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features import camera_motion
from tsuiseki.tracking.runs.ending import ended
from tsuiseki.tracking.video import image_folder


def fail(error: Exception) -> Callable[..., Any]:
    def failing(*_: Any, **__: Any) -> None:
        raise error

    return failing


@pytest.mark.parametrize(
    "error",
    [
        cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 307200 bytes"),
        ImportError("/x/_traversal.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
        RuntimeError("[ONNXRuntimeError] : 6 : RUNTIME_EXCEPTION : std::bad_alloc"),
        RuntimeError("BFCArena: Available memory of 0 is smaller than requested bytes of 1048576"),
        RuntimeError("CUDA failure 2: out of memory ; GPU=0"),
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
        MemoryError(),
    ],
)
def test_a_lack_of_memory_is_said(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(fail(error)) == 1
    assert capsys.readouterr().err == "tsuiseki: not enough memory\n"


def test_a_lack_of_memory_is_said_by_whatever_name_it_comes(capsys: pytest.CaptureFixture[str]) -> None:
    """A reader that takes any failure of OpenCV for a broken file has it as the cause."""
    for error in (RequestError("a.xml: expected an OpenCV file"), RunError("a.png: expected an image")):
        error.__cause__ = cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) 9 bytes")
        assert ended(fail(error)) == 1
        assert capsys.readouterr().err == "tsuiseki: not enough memory\n"
    broken = RequestError("a.xml: expected an OpenCV file")
    broken.__cause__ = cv2.error("(-49:Unknown error code -49) Input file is invalid")
    assert ended(fail(broken)) == 2
    assert "expected an OpenCV file" in capsys.readouterr().err


def test_a_target_is_not_lost_and_a_camera_not_unknown_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    lacking = cv2.error("(-4:Insufficient memory) Failed to allocate 9 bytes")
    monkeypatch.setattr(camera_motion.cv2, "findTransformECC", fail(lacking))
    picture = np.zeros((8, 8, 3), np.float32)
    with pytest.raises(cv2.error, match="Insufficient memory"):
        camera_motion.refine(picture, picture, np.eye(2, 3))


def test_other_failures_are_not_taken_for_it() -> None:
    with pytest.raises(RuntimeError, match="something else"):
        ended(fail(RuntimeError("something else")))


def test_no_file_is_blamed_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lacking = RuntimeError("std::bad_alloc")
    monkeypatch.setattr(onnx, "opened_on", fail(lacking))
    (tmp_path / "a.onnx").write_bytes(b"any")
    with pytest.raises(MemoryError, match=r"a\.onnx needs more"):
        onnx.open_session(tmp_path / "a.onnx")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((8, 8, 3), np.uint8))
    monkeypatch.setattr(image_folder.cv2, "imdecode", fail(cv2.error("(-4:Insufficient memory)")))
    with pytest.raises(MemoryError, match=r"a\.png needs more"):
        image_folder.read_image(tmp_path / "a.png")
