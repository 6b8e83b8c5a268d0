"""The size of the pictures in the coded frames of a video file.

OpenCV scales every frame of a file to the size of the first one, without a word. A camera that changes its resolution
midway, or a recording pasted together from two, would then be followed with the wrong geometry. The headers of the
coded frames tell: JPEG (ITU T.81, B.2.2), VP8 (RFC 6386, 9.1), VP9 (bitstream specification, 7.2) and H.264 (ITU H.264,
7.3.2.1.1). Of other codecs nothing is known.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import cv2

from tsuiseki.tracking.video.frame_source import Size

_SEQUENCE_PARAMETERS = re.compile(rb"\x00\x00\x01[\x07\x27\x47\x67]")
_HIGH_PROFILES = {100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135}
_HEADER_BYTES = 4096  # headers stand before the picture


class CodedFrames:
    """A file's coded frames, which ``capture`` grabs one by one, beside the capture that decodes them.

    They are ``there`` where the file gives its frames undecoded.
    """

    def __init__(self, path: Path) -> None:
        self.capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
        code = int(self.capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        self._parse = PARSERS.get(code.to_bytes(4, "little").decode("latin-1").upper())
        self.there = self.capture.get(cv2.CAP_PROP_FORMAT) == -1

    def next_size(self) -> Size | None:
        """Width and height that the next coded frame states; None where it states none, as most do, or is unknown."""
        return self.size() if self._parse and self.there and self.capture.grab() else None

    def size(self) -> Size | None:
        """Width and height that the frame that was grabbed states; likewise."""
        packet = self.capture.retrieve()[1] if self._parse else None
        return None if self._parse is None or packet is None else self._parse(packet.tobytes()[:_HEADER_BYTES])


def jpeg_size(packet: bytes) -> Size | None:
    """Of the first frame header among the marker segments."""
    place = 2
    while place + 9 <= len(packet) and packet[place] == 0xFF:
        marker = packet[place + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(packet[place + k : place + k + 2], "big") for k in (5, 7))
            return width, height
        place += 2 + int.from_bytes(packet[place + 2 : place + 4], "big")
    return None


def vp8_size(packet: bytes) -> Size | None:
    """Of a key frame."""
    if len(packet) < 10 or packet[0] & 1 or packet[3:6] != b"\x9d\x01\x2a":
        return None
    width, height = (int.from_bytes(packet[k : k + 2], "little") & 0x3FFF for k in (6, 8))
    return width, height


def vp9_size(packet: bytes) -> Size | None:
    """Of a key frame."""
    bits = _Bits(packet[:32])
    if len(packet) < 16 or bits.read(2) != 2:
        return None
    profile = bits.read(1) + 2 * bits.read(1)
    if profile == 3:
        bits.read(1)
    shown_again, between = bits.read(1), bits.read(1)
    bits.read(2)
    if shown_again or between or bits.read(24) != 0x498342:
        return None
    if profile >= 2:
        bits.read(1)
    if bits.read(3) != 7:  # 7: RGB
        bits.read(1)
        bits.read(3 if profile in (1, 3) else 0)
    elif profile in (1, 3):
        bits.read(1)
    width, height = bits.read(16) + 1, bits.read(16) + 1
    return width, height


def h264_size(packet: bytes) -> Size | None:
    """Of a sequence parameter set, which stands before a key frame, in a byte stream with start codes."""
    found = _SEQUENCE_PARAMETERS.search(packet)
    if found is None:
        return None
    payload = re.split(rb"\x00\x00\x00|\x00\x00\x01", packet[found.end() :], maxsplit=1)[0]
    try:
        return _sequence_size(_Bits(payload.replace(b"\x00\x00\x03", b"\x00\x00")))
    except EOFError:
        return None


def _sequence_size(bits: _Bits) -> Size:
    profile = bits.read(8)
    bits.read(16)
    bits.unsigned()
    chroma = 1
    if profile in _HIGH_PROFILES:
        chroma = bits.unsigned()
        if chroma == 3 and bits.read(1):
            chroma = 0  # planes coded apart count as without colour
        bits.unsigned()
        bits.unsigned()
        bits.read(1)
        if bits.read(1):
            for k in range(8 if chroma in (0, 1, 2) else 12):
                if bits.read(1):
                    _skip_scaling_list(bits, 16 if k < 6 else 64)
    bits.unsigned()
    _skip_order_of_pictures(bits)
    bits.unsigned()
    bits.read(1)
    columns, rows = bits.unsigned() + 1, bits.unsigned() + 1
    fields = 1 if bits.read(1) else 2
    if fields == 2:
        bits.read(1)
    bits.read(1)
    left = right = top = bottom = 0
    if bits.read(1):
        left, right, top, bottom = (bits.unsigned() for _ in range(4))
    across = 2 if chroma in (1, 2) else 1
    down = fields * (2 if chroma == 1 else 1)
    return 16 * columns - across * (left + right), 16 * rows * fields - down * (top + bottom)


def _skip_scaling_list(bits: _Bits, length: int) -> None:
    scale = 8
    for _ in range(length):
        scale = (scale + bits.signed()) % 256
        if scale == 0:
            return


def _skip_order_of_pictures(bits: _Bits) -> None:
    kind = bits.unsigned()
    if kind == 0:
        bits.unsigned()
    elif kind == 1:
        bits.read(1)
        bits.signed()
        bits.signed()
        for _ in range(bits.unsigned()):
            bits.signed()


class _Bits:
    """Bits of a header from the first on; at the end EOFError."""

    def __init__(self, data: bytes) -> None:
        self._text = "".join(f"{byte:08b}" for byte in data)
        self._place = 0

    def read(self, count: int) -> int:
        """The next ``count`` bits as a number."""
        end = self._place + count
        if end > len(self._text):
            raise EOFError("the header ends early")
        value = int(self._text[self._place : end] or "0", 2)
        self._place = end
        return value

    def unsigned(self) -> int:
        """The next number in Exp-Golomb code."""
        zeros = 0
        while self.read(1) == 0:
            zeros += 1
        return (1 << zeros) - 1 + self.read(zeros)

    def signed(self) -> int:
        """The next signed number in Exp-Golomb code."""
        code = self.unsigned()
        return (code + 1) // 2 if code % 2 else -(code // 2)


PARSERS: dict[str, Callable[[bytes], Size | None]] = {
    "MJPG": jpeg_size,
    "VP80": vp8_size,
    "VP90": vp9_size,
    "H264": h264_size,
    "AVC1": h264_size,
}
