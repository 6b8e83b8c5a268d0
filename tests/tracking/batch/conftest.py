"""Five short videos of different rates and codecs, and a small detector whose scores hang on every pixel."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from tsuiseki.tracking.batch import run
from tsuiseki.tracking.batch.tasks import BatchTask, TaskOutcome, do

FRAMES = 60


class Here:
    """Does tasks in this process, one after the other, and keeps what it did."""

    def __init__(self) -> None:
        self.tasks: list[BatchTask] = []
        self.outcomes: list[tuple[BatchTask, TaskOutcome]] = []

    def free(self) -> bool:
        return not self.outcomes

    def submit(self, task: BatchTask) -> None:
        self.tasks.append(task)
        self.outcomes.append((task, do(task)))

    def finished(self, _: float) -> list[tuple[BatchTask, TaskOutcome]]:
        done, self.outcomes = self.outcomes, []
        return done

    def close(self) -> None: ...

    def kinds(self) -> list[str]:
        return [task.kind for task in self.tasks]


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Here:
    """Does the tasks of whatever batch the test runs."""
    executor = Here()
    monkeypatch.setattr(run, "_executor", lambda _: (executor, True))
    return executor


def picture(number: int, rng: np.random.Generator) -> np.ndarray:
    """A textured ground that turns brighter, jumps once, and has something moving on it."""
    ground = np.kron(rng.integers(60, 180, (8, 10, 3)), np.ones((6, 8, 1))).astype(np.uint8)
    ground = np.roll(ground, 5 if number >= 37 else 0, axis=1)
    left = number % 60
    ground[12:36, left : left + 12] = 250 - 2 * number
    return np.clip(ground.astype(int) + number // 2, 0, 255).astype(np.uint8)


@pytest.fixture(scope="session")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    pictures = [picture(number, np.random.default_rng(3)) for number in range(FRAMES)]
    for name, code, rate in (("still.avi", "MJPG", 12.5), ("web.webm", "VP80", 29.97)):
        writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*code), rate, (80, 48))
        for image in pictures:
            writer.write(image)
        writer.release()
    uneven = np.cumsum(np.random.default_rng(0).integers(60, 200, FRAMES)).tolist()
    for name, times in (("coded.mp4", [100 * n for n in range(FRAMES)]), ("uneven.mp4", uneven)):
        write_h264(folder / name, pictures, times)
    (folder / "pictures").mkdir()
    for number, image in enumerate(pictures):
        cv2.imwrite(str(folder / "pictures" / f"{number:03}.png"), image)
    return folder


def write_h264(path: Path, pictures: list[np.ndarray], times: list[int]) -> None:
    """With frames that are coded by those after them, and a key frame in every 20."""
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=30, options={"bf": "2", "g": "20"})
        stream.width, stream.height, stream.pix_fmt = 80, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 3000)
        for image, time in zip(pictures, times, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = time, Fraction(1, 3000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.fixture(scope="session")
def networks(inputs: Any, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Options with a detector whose scores follow the brightness of the picture."""
    model = onnx.load(inputs.detector)
    for constant in model.graph.initializer:
        if constant.name == "nothing":
            constant.CopyFrom(numpy_helper.from_array(np.array([-0.7], np.float32), "nothing"))
    path = tmp_path_factory.mktemp("networks") / "detector.onnx"
    onnx.save(model, path)
    return ["--detector", str(path), "--appearance", str(inputs.appearance), "--affinity", "none"]
