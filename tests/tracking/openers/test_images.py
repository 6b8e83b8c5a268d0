"""58.2, 58.8: one opener reads images everywhere, of any name, and says a lack of memory as one."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.figures.assets import read_texture
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import read_silhouettes
from tsuiseki.tracking.openers import images as image_opener
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.adapt.watch import Watched

REPOSITORY = Path(__file__).resolve().parents[3]
# Latin 1, as old disks and archives have it; no UTF-8.
STRANGE = os.fsdecode(b"caf\xe9")
IMAGE = np.random.default_rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
OPAQUE = np.dstack([IMAGE, np.full((12, 16), 255, np.uint8)])


def write(path: Path, image: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder whose name is not UTF-8."""
    try:
        (tmp_path / STRANGE).mkdir()
    except OSError:
        pytest.skip("this file system takes names of UTF-8 only")
    return tmp_path / STRANGE


def test_images_of_names_that_are_not_utf8_are_read(folder: Path) -> None:
    np.testing.assert_array_equal(decoded_image(write(folder / f"{STRANGE}.png", IMAGE)), IMAGE)
    np.testing.assert_array_equal(read_image(folder / f"{STRANGE}.png"), IMAGE[..., ::-1])
    np.testing.assert_array_equal(decoded_image(write(folder / "o.png", OPAQUE), cv2.IMREAD_UNCHANGED), OPAQUE)


def test_photographs_of_names_that_are_not_utf8_are_read(folder: Path) -> None:
    write(folder / "surfaces" / f"{STRANGE}.png", IMAGE)
    write(folder / "things" / f"{STRANGE}.png", OPAQUE)
    photographs, rng = Photographs(folder), np.random.default_rng(0)
    np.testing.assert_array_equal(photographs.surface(rng), IMAGE[..., ::-1])
    np.testing.assert_array_equal(photographs.thing(rng)[..., :3], IMAGE[..., ::-1])


def test_textures_of_names_that_are_not_utf8_are_read(folder: Path) -> None:
    np.testing.assert_array_equal(read_texture(write(folder / "t.png", IMAGE))[..., :3], IMAGE[..., ::-1])
    (folder / "t.png").write_bytes(b"")
    with pytest.raises(RequestError, match="expected a picture at "):
        read_texture(folder / "t.png")


def test_rendered_people_of_names_that_are_not_utf8_are_read(folder: Path) -> None:
    columns = "file,feet_x,feet_y,head_x,head_y,height,tilt,left,right"
    (folder / "sprites.csv").write_text(f"{columns}\n0000-0,8,12,8,0,1.7,0.2,0,16\n")
    write(folder / "0000-0.png", OPAQUE)
    write(folder / "0000-0.normal.png", IMAGE)
    np.testing.assert_array_equal(SpriteLibrary(folder).sprite(0).albedo, IMAGE[..., ::-1])


def test_silhouettes_of_names_that_are_not_utf8_are_read(folder: Path) -> None:
    write(folder / "silhouettes" / f"{STRANGE}.png", IMAGE[..., 0])
    np.testing.assert_array_equal(read_silhouettes(folder), IMAGE[None, ..., 0])


def test_what_adaptation_has_kept_is_read_in_a_folder_whose_name_is_not_utf8(folder: Path) -> None:
    """A kept picture of what differs is taken as it is, instead of being made anew."""
    levels = np.zeros((12, 16), np.uint8)
    levels[2:4], levels[6:8] = 1, 2
    write(folder / "foreground" / "000001.png", levels)
    empty = np.zeros((12, 16, 3), np.uint8)
    watched = Watched("gone", (0, None), str(folder), (0,), 1, 10.0, (16, 12), "still", empty=empty)
    kept = watched.difference(0)
    assert kept is not None
    np.testing.assert_array_equal(kept.different, levels > 0)
    np.testing.assert_array_equal(kept.bright, levels == 2)


@pytest.mark.parametrize("content", [b"", b"no image", None])
def test_what_is_no_image_is_none(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "a.png").write_bytes(content)
    assert decoded_image(tmp_path / "a.png") is None


def test_a_lack_of_memory_is_not_a_broken_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 9 bytes")

    path = write(tmp_path / "surfaces" / "a.png", IMAGE)
    monkeypatch.setattr(image_opener.cv2, "imdecode", fail)
    for read in (decoded_image, read_image, read_texture):
        with pytest.raises(MemoryError, match=r"a\.png needs more"):
            read(path)
    with pytest.raises(MemoryError, match=r"a\.png needs more"):
        Photographs(tmp_path).surface(np.random.default_rng(0))


def test_nothing_reads_or_writes_an_image_by_a_name_that_must_be_utf8() -> None:
    files = [
        str(path.relative_to(REPOSITORY))
        for folder in ("tracking", "models", "datamodules", "trainers")
        for path in (REPOSITORY / folder).rglob("*.py")
        if re.search(r"\.im(read|write)\w*\(", path.read_text(encoding="utf-8"))
    ]
    assert files == []
