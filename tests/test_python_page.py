"""The Python lines of the README and of `docs/python.md` run, on short generated clips."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings, write_blobs
from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, write_drone
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishSettings, write_goldfish
from tsuiseki.datamodules.scenes.sphere_clip import ball_cameras
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, write_street
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, write_cameras
from tsuiseki.tracking.types import Frame, Targets
from tsuiseki.tracking.video.source import LiveSource, open_source
from tsuiseki.tracking.video.webm import VideoWriter

REPOSITORY = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)
PAGE = BLOCK.findall((REPOSITORY / "docs" / "python.md").read_text(encoding="utf-8"))
README = BLOCK.findall((REPOSITORY / "README.md").read_text(encoding="utf-8"))


def as_video(images: list[np.ndarray], path: Path) -> None:
    """A video file; what it is called says nothing about how it is coded."""
    with VideoWriter(path.with_suffix(".webm"), 25.0) as writer:
        for image in images:
            writer.write(image)
    path.with_suffix(".webm").rename(path)


def cup() -> list[np.ndarray]:
    """A chequered square that moves over noise, in 10,20,40,60 at first."""
    rng = np.random.default_rng(0)
    square = np.kron(rng.integers(0, 2, (8, 6, 1)) * 255, np.ones((5, 5, 3))).astype(np.uint8)
    images = []
    for t in range(8):
        image = rng.integers(90, 130, (120, 160, 3)).astype(np.uint8)
        image[20:60, 10 + 2 * t : 40 + 2 * t] = square
        images.append(image)
    return images


def film_ball(folder: Path) -> None:
    """A disk where the outline of a ball of 10 cm, that moves past 0, 0, 1.2 m, lies in two cameras."""
    cameras = ball_cameras(2)
    rng = np.random.default_rng(0)
    places = np.array([[0.02 * t, 0.0, 1.2] for t in range(3)])
    for name, camera in zip(("left", "right"), cameras, strict=True):
        rows = [f"{t + 1},{u!r},{v!r}" for t, (u, v) in enumerate(camera.project(places)[0].tolist())]
        (folder / f"{name}.csv").write_text("\n".join(["frame,x,y", *rows]) + "\n")
    for number, camera in enumerate(cameras, start=1):
        (folder / f"camera{number}").mkdir()
        for t in range(3):
            image = rng.integers(90, 110, (camera.height, camera.width, 3)).astype(np.uint8)
            centre = np.array([[0.02 * t, 0.0, 1.2]])
            radius = 0.1 * camera.focal[0] / camera.to_camera(centre)[0, 2]
            place = tuple(np.round(camera.project(centre)[0][0]).astype(int).tolist())
            cv2.circle(image, place, round(radius), (200, 60, 40), -1)
            cv2.imwrite(str(folder / f"camera{number}" / f"{t + 1:06d}.png"), image)
    placed = [PlacedCamera(f"camera{n}", camera, 15.0) for n, camera in enumerate(cameras, start=1)]
    write_cameras(folder / "cameras.yaml", placed)


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the page names: street.mp4, cup.mp4, balls.mp4, fish, flight, camera1, camera2, cameras.yaml."""
    folder = tmp_path_factory.mktemp("clips")
    street = write_street(folder / "labelled", StreetSettings(frames=12), seed=100)
    as_video([frame.image for frame in open_source(street).frames()], folder / "street.mp4")
    as_video(cup(), folder / "cup.mp4")
    balls = write_blobs(folder / "blobs", BlobSceneSettings(frames=8, width=320, height=240, objects=3), seed=1)
    as_video([frame.image for frame in open_source(balls).frames()], folder / "balls.mp4")
    write_goldfish(folder / "fish", GoldfishSettings(frames=4, fish=1), seed=4)
    write_drone(folder / "flight", DroneSceneSettings(frames=6, width=320, height=240, people=3), 3)
    film_ball(folder)
    return folder


@pytest.fixture
def webcam(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A webcam that shows six frames of the street and is unplugged."""
    images = [frame.image for frame in open_source(clips / "labelled").frames()][:6]

    def frames(_: Any) -> Iterator[Frame]:
        yield from (Frame(number, number / 25, image) for number, image in enumerate(images))

    def opened(address: int | str, name: str, wanted: Any) -> LiveSource:
        return LiveSource(address, name, 25.0, wanted)

    monkeypatch.setattr(LiveSource, "open", staticmethod(opened))
    monkeypatch.setattr(LiveSource, "frames", frames)


@pytest.mark.usefixtures("webcam")
@pytest.mark.parametrize("blocks", [README, PAGE], ids=["README", "docs/python.md"])
def test_the_lines_run(
    blocks: list[str], clips: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(clips)
    names: dict[str, Any] = {}
    assert blocks
    for number, block in enumerate(blocks, start=1):
        exec(compile(block, f"block {number}", "exec"), names)
    assert len(names["tracks"]) > 0
    assert isinstance(names["people"], Targets)
    assert "tracking" in capsys.readouterr().out


def test_the_page_shows_every_function() -> None:
    import tsuiseki

    text = (REPOSITORY / "docs" / "python.md").read_text(encoding="utf-8")
    functions = [name for name in tsuiseki.__all__ if name[0].islower() and name not in ("read_tracks",)]
    assert [name for name in functions if f"{name}(" not in text] == []


def test_the_readme_is_short() -> None:
    lines = [line for block in README for line in block.splitlines() if line and "import" not in line]
    assert len(lines) <= 10
