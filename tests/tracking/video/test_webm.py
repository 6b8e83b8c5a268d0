"""Videos that are written are whole, the same every time, and small pictures are taken."""

from __future__ import annotations

import resource
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.video.webm import VideoWriter


def write(path: Path, height: int, width: int, frames: int = 12) -> bytes:
    rng = np.random.default_rng(0)
    with VideoWriter(path, 10) as writer:
        for _ in range(frames):
            writer.write(rng.integers(0, 256, (height, width, 3)).astype(np.uint8))
    return path.read_bytes()


@pytest.mark.parametrize("kind", ["webm", "mp4"])
@pytest.mark.parametrize("size", [(1, 1), (3, 40), (47, 65)])
def test_the_same_pictures_give_the_same_bytes(kind: str, size: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / f"a.{kind}"
    assert write(path, *size) == write(tmp_path / f"b.{kind}", *size)
    shapes = {frame.image.shape[:2] for frame in open_source(path).frames()}
    assert shapes == {tuple(max(16, side - side % 2) for side in size)}
    assert len(list(open_source(path).frames())) == 12


@pytest.mark.parametrize("kind", ["webm", "mp4"])
def test_a_full_disk_is_noticed(kind: str, tmp_path: Path) -> None:
    # Python ignores the signal of this limit, so that writing fails as on a full disk.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8_000, before[1]))
    try:
        with pytest.raises(RunError, match=r"not written to its end; is the disk full\?"):
            write(tmp_path / f"a.{kind}", 96, 128, 60)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("kind", ["webm", "mp4"])
def test_the_bit_rate_of_noise_is_bounded(kind: str, tmp_path: Path) -> None:
    pixels, frames = 640 * 480, 12
    size = len(write(tmp_path / f"a.{kind}", 480, 640, frames))
    # The codecs by themselves spend 2 bits a pixel on it; the first frame is the dearest.
    assert 8 * size < 0.75 * pixels * frames
    assert [frame.time for frame in open_source(tmp_path / f"a.{kind}").frames()] == [n / 10 for n in range(frames)]
    assert [path.name for path in tmp_path.iterdir()] == [f"a.{kind}"]
