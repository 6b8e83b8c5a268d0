"""Sizes in the headers of coded frames, against files that OpenCV writes and headers written bit by bit."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.video.coded_size import CodedFrames, h264_size, jpeg_size, vp8_size, vp9_size
from tsuiseki.tracking.video.source import open_source


def picture(width: int, height: int, level: int = 90) -> np.ndarray:
    return cv2.circle(np.full((height, width, 3), level, np.uint8), (width // 2, height // 2), 9, (0, 255, 0), -1)


def motion_jpeg(path: Path, sizes: list[tuple[int, int]]) -> Path:
    """One JPEG file after another, which is a video."""
    coded = [cv2.imencode(".jpg", picture(*size, level=40 + 5 * k))[1] for k, size in enumerate(sizes)]
    path.write_bytes(b"".join(one.tobytes() for one in coded))
    return path


@pytest.mark.parametrize("code", ["VP80", "VP90", "MJPG"])
@pytest.mark.parametrize("size", [(64, 48), (130, 98)])
def test_the_sizes_of_written_files(tmp_path: Path, code: str, size: tuple[int, int]) -> None:
    path = tmp_path / ("clip.avi" if code == "MJPG" else "clip.webm")
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 10, size)
    assert writer.isOpened()
    for k in range(5):
        writer.write(picture(*size, level=40 + 20 * k))
    writer.release()
    coded = CodedFrames(path)
    stated = [coded.next_size() for _ in range(6)]
    assert stated[0] == size
    assert set(stated) <= {size, None}


def test_a_video_that_changes_its_size_is_noticed_where_it_does(tmp_path: Path) -> None:
    path = motion_jpeg(tmp_path / "cut.mjpeg", [(64, 48)] * 6 + [(128, 96)] * 6)
    frames = open_source(path).frames()
    assert [next(frames).index for _ in range(6)] == list(range(6))
    with pytest.raises(RunError, match="expected 64x48 pixels throughout, got 128x96 from about frame 7 on"):
        next(frames)


def test_a_video_of_one_size_is_read_to_its_end(tmp_path: Path) -> None:
    path = motion_jpeg(tmp_path / "whole.mjpeg", [(64, 48)] * 6)
    assert len(list(open_source(path).frames())) == 6


class Writer:
    """Bits of an H.264 header."""

    def __init__(self) -> None:
        self.text = ""

    def bits(self, value: int, count: int) -> None:
        self.text += f"{value:0{count}b}"

    def golomb(self, *values: int) -> None:
        for value in values:
            code = f"{value + 1:b}"
            self.text += "0" * (len(code) - 1) + code

    def payload(self) -> bytes:
        text = self.text + "1"
        text += "0" * (-len(text) % 8)
        raw = bytes(int(text[k : k + 8], 2) for k in range(0, len(text), 8))
        escaped = bytearray()
        for byte in raw:  # a third byte below 4 after two zeros is escaped
            if len(escaped) >= 2 and not any(escaped[-2:]) and byte < 4:
                escaped.append(3)
            escaped.append(byte)
        return bytes(escaped)


def sequence(
    profile: int, columns: int, rows: int, crop: tuple[int, int, int, int] | None, frames_only: int = 1, order: int = 0
) -> bytes:
    writer = Writer()
    writer.bits(profile, 8)
    writer.bits(0, 8)
    writer.bits(40, 8)
    writer.golomb(0)
    if profile == 100:
        writer.golomb(1, 0, 0)
        writer.bits(0, 1)
        writer.bits(1, 1)  # scaling lists: the first is there, and ends at its first step
        writer.bits(1, 1)
        writer.golomb(16)  # the code of -8: 8 - 8 ends it
        writer.bits(0, 7)
    writer.golomb(4, order)
    if order == 0:
        writer.golomb(2)
    elif order == 1:
        writer.bits(0, 1)
        writer.golomb(0, 0, 2, 1, 2)
    writer.golomb(3)
    writer.bits(0, 1)
    writer.golomb(columns - 1, rows - 1)
    writer.bits(frames_only, 1)
    if not frames_only:
        writer.bits(0, 1)
    writer.bits(1, 1)
    writer.bits(int(crop is not None), 1)
    if crop is not None:
        writer.golomb(*crop)
    writer.bits(0, 1)
    return b"\x00\x00\x00\x01\x09\x10\x00\x00\x00\x01\x67" + writer.payload() + b"\x00\x00\x01\x68\xce"


@pytest.mark.parametrize(
    ("header", "size"),
    [
        (sequence(66, 20, 15, None), (320, 240)),
        (sequence(66, 20, 15, None, order=1), (320, 240)),
        (sequence(77, 20, 15, None, order=2), (320, 240)),
        (sequence(100, 120, 68, (0, 0, 0, 4)), (1920, 1080)),
        (sequence(77, 45, 18, (0, 0, 0, 0), frames_only=0), (720, 576)),
        (sequence(100, 104, 68, (0, 5, 0, 4)), (1654, 1080)),
    ],
)
def test_h264_sizes(header: bytes, size: tuple[int, int]) -> None:
    assert h264_size(header) == size


@pytest.mark.parametrize("parse", [jpeg_size, vp8_size, vp9_size, h264_size])
@pytest.mark.parametrize("packet", [b"", b"\x00", b"\xff\xd8", bytes(40), b"\x00\x00\x01\x67", b"\xff\xd8\xff\xc0\x00"])
def test_a_packet_without_a_header_states_nothing(parse, packet: bytes) -> None:
    assert parse(packet) is None
