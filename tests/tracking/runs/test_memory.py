"""58.8: a lack of memory is said to be one, whoever words it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking import onnx
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
        MemoryError(),
    ],
)
def test_a_lack_of_memory_is_said(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(fail(error)) == 1
    assert capsys.readouterr().err == "tsuiseki: not enough memory\n"


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
