"""Reading and writing video: what goes in comes out, and what is broken is refused."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.video.webm import VideoWriter

FRAMES = 20


def picture(number: int, width: int = 64, height: int = 48) -> ImageArray:
    """Red on the left, blue on the right, brighter with every frame."""
    image = np.zeros((height, width, 3), dtype=np.uint8)
    image[:, : width // 2, 0] = 100 + 7 * number
    image[:, width // 2 :, 2] = 100 + 7 * number
    return image


def number_of(image: ImageArray) -> float:
    """Which `picture` this is, as far as compression left it."""
    return (float(image[:, :16, 0].mean()) - 100) / 7


@pytest.fixture(scope="module")
def webm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "clip.webm"
    with VideoWriter(path, frame_rate=10) as writer:
        for number in range(FRAMES):
            writer.write(picture(number))
    return path


@pytest.fixture
def images(tmp_path: Path) -> Path:
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(5):
        cv2.imwrite(str(folder / f"{number:03d}.png"), picture(number)[:, :, ::-1])
    return folder


def test_frames_of_a_video_come_in_order_in_rgb(webm: Path) -> None:
    source = open_source(webm)
    frames = list(source.frames())
    assert [f.index for f in frames] == list(range(FRAMES))
    assert [f.time for f in frames] == pytest.approx([n / 10 for n in range(FRAMES)])
    # VP8 keeps a flat picture to within a few grey levels; red and blue would differ by 100 and more.
    assert [number_of(f.image) for f in frames] == pytest.approx(range(FRAMES), abs=0.7)
    assert frames[0].image[:, -16:, 2].mean() > 90


def test_frames_of_a_folder_come_by_name(images: Path) -> None:
    source = open_source(images)
    assert source.length == 5
    for number, frame in enumerate(source.frames()):
        np.testing.assert_array_equal(frame.image, picture(number))


def test_frames_whose_numbers_have_no_leading_zeros_come_in_their_order(tmp_path: Path) -> None:
    for number in (0, 1, 2, 9, 10, 11, 100):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture(number % 10)[:, :, ::-1])
    names = [path.name for path in list_images(tmp_path)]
    assert names == ["0.png", "1.png", "2.png", "9.png", "10.png", "11.png", "100.png"]
    for frame, number in zip(open_source(tmp_path).frames(), (0, 1, 2, 9, 0, 1, 0), strict=True):
        np.testing.assert_array_equal(frame.image, picture(number))


@pytest.mark.parametrize("wanted", [FrameRange(2, 3), FrameRange(3), FrameRange(0, 0)])
def test_a_stretch_keeps_its_numbers(webm: Path, images: Path, wanted: FrameRange) -> None:
    for source, length in ((open_source(images, wanted), 5), (open_source(webm, wanted), FRAMES)):
        expected = [n for n in range(length) if n in wanted]
        frames = list(source.frames())
        assert [f.index for f in frames] == expected
        assert [number_of(f.image) for f in frames] == pytest.approx(expected, abs=0.7)


def test_a_video_is_streamed(tmp_path: Path) -> None:
    path = tmp_path / "long.webm"
    size = (320, 240)
    with VideoWriter(path, 25) as writer:
        for number in range(60):
            writer.write(np.full((*size[::-1], 3), number, dtype=np.uint8))
    source = open_source(path)
    tracemalloc.start()
    for _ in source.frames():
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6 * 3 * size[0] * size[1]


def test_an_odd_size_loses_its_last_row_and_column(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "odd.webm", 10) as writer:
        for number in range(3):
            writer.write(picture(number, 65, 49))
    assert next(open_source(tmp_path / "odd.webm").frames()).image.shape == (48, 64, 3)


def test_a_turned_photograph_is_turned_upright(tmp_path: Path) -> None:
    for name, orientation in (("a.jpg", 6), ("b.jpg", 6)):
        exif = Image.Exif()
        exif[0x0112] = orientation
        Image.fromarray(picture(3)).save(tmp_path / name, exif=exif)
    first, *_ = open_source(tmp_path).frames()
    assert first.image.shape == (64, 48, 3)


def test_a_truncated_video_breaks_off_with_one_line(webm: Path, tmp_path: Path) -> None:
    path = tmp_path / "truncated.webm"
    path.write_bytes(webm.read_bytes()[: webm.stat().st_size // 2])
    with pytest.raises(RunError, match=r"expected 20 frames, but the video breaks off after frame \d+"):
        list(open_source(path).frames())
    assert len(list(open_source(path, parse_frames("1-3")).frames())) == 3


def test_what_is_no_video_is_refused(tmp_path: Path, webm: Path, images: Path) -> None:
    def refused(source: Path | str, because: str, frames: str | None = None) -> None:
        with pytest.raises(RequestError, match=because) as caught:
            list(open_source(source, parse_frames(frames)).frames())
        assert "\n" not in str(caught.value)

    (tmp_path / "text.mp4").write_text("this is no video")
    (tmp_path / "empty.webm").write_bytes(b"")
    (tmp_path / "list.m3u8").write_text("#EXTM3U\n#EXTINF:1,\n/etc/passwd\n")
    (tmp_path / "nothing").mkdir()
    with VideoWriter(tmp_path / "zero.webm", 10):
        pass
    (tmp_path / "header.webm").write_bytes(webm.read_bytes()[:300])
    refused(tmp_path / "missing.mp4", "found no")
    refused(tmp_path / "text.mp4", "FFmpeg can decode")
    (tmp_path / "gt.txt").write_text("1,1,10,10,20,40,1,1,1\n" * 200)
    refused(tmp_path / "gt.txt", "FFmpeg can decode")
    refused(tmp_path / "empty.webm", "FFmpeg can decode")
    refused(tmp_path / "header.webm", "FFmpeg can decode")
    refused(tmp_path / "list.m3u8", "playlist")
    refused(tmp_path / "nothing", "found neither")
    (tmp_path / "nothing" / "monday.mp4").touch()
    refused(tmp_path / "nothing", "found neither, but monday.mp4; give a video by its own path")
    refused("97", "pictures from webcam 97")
    refused("99999999999999999999", "a webcam number or an address, found no 9999")
    refused(webm, "within 1-20", "400-500")
    refused(images, "within 1-5", "4-9")
    (images / "notes.txt").write_text("hello")
    refused(images, "only images, found notes.txt")


@pytest.mark.parametrize("broken", ["other size", "no image", "cut off"])
def test_a_folder_with_a_strange_image_is_refused(images: Path, broken: str) -> None:
    data = {
        "other size": cv2.imencode(".png", picture(0, 32, 32))[1].tobytes(),
        "no image": b"hello",
        "cut off": (images / "003.png").read_bytes()[:20],
    }[broken]
    (images / "003.png").write_bytes(data)
    with pytest.raises(RequestError, match=r"003.png: expected (64x48 pixels as in 000.png, got 32x32|an image)"):
        open_source(images)


def test_an_image_that_breaks_off_later_fails_the_run(images: Path) -> None:
    (images / "003.png").write_bytes((images / "003.png").read_bytes()[:60])
    source = open_source(images)
    with pytest.raises(RunError, match=r"003.png: expected an image"):
        list(source.frames())


@pytest.mark.parametrize("text", ["", "a-b", "5", "0-4", "9-2", "1-2-3", "-"])
def test_a_wrong_stretch_is_refused(text: str) -> None:
    with pytest.raises(RequestError, match="expected `frames` FIRST-LAST"):
        parse_frames(text)


@pytest.mark.parametrize("name", ["stack.tif", "moving.webp", "moving.png"])
@pytest.mark.parametrize("alone", [True, False])
def test_several_images_in_one_file_are_refused_with_their_number(name: str, alone: bool, tmp_path: Path) -> None:
    pages = [Image.new("RGB", (16, 16), (40 * n, 0, 0)) for n in range(3)]
    pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:])
    with pytest.raises(RequestError, match="expected one image in a file, got 3"):
        open_source(tmp_path / name if alone else tmp_path)
    pages[0].save(tmp_path / name)
    assert len(list(open_source(tmp_path / name if alone else tmp_path).frames())) == 1


@pytest.mark.parametrize(
    ("head", "kind"),
    [(b"\0\0\0\x18ftypheic", "HEIC"), (b"\0\0\0\x1cftypmif1", "HEIC"), (b"\0\0\0\x18ftypisom", "a video"),
     (b"8BPS\0\1", "a picture of Photoshop"), (b"text", "something that cannot be decoded")],
)  # fmt: skip
def test_what_a_file_is_that_is_no_image_is_told_whatever_its_name(head: bytes, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "1.jpg"
    path.write_bytes(head + bytes(200))
    for source in (path, tmp_path):
        with pytest.raises(RequestError, match=f"1.jpg: expected an image, got {kind}"):
            open_source(source)
