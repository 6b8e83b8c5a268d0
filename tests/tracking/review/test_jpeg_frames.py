"""Pictures in any order are those that playing gives."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.review.server import JpegFrames

av = pytest.importorskip("av")
SIZE, FRAMES, STRIPE = (64, 48), 50, 4


def film(path, codec, options, rate=25, variable=False):
    """A video whose frames show their numbers as stripes, light for 1."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate)
        stream.width, stream.height, stream.pix_fmt, stream.options = *SIZE, "yuv420p", options
        for number in range(FRAMES):
            image = np.full((SIZE[1], SIZE[0], 3), 40, np.uint8)
            for bit in range(8):
                image[:, bit * 8 : bit * 8 + 8] = 220 if number >> bit & 1 else 40
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = number + (number // 3 if variable else 0)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def number_in(jpeg):
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return sum(int(image[20, bit * 8 + 4] > 128) << bit for bit in range(8))


def size_of(pictures):
    return cv2.imdecode(np.frombuffer(pictures.jpeg(0), np.uint8), cv2.IMREAD_GRAYSCALE).shape[::-1]


ORDER = [30, 31, 32, 5, 49, 0, 48, 17, 16, 15, 40, 13, 26, 25, 24, 1, *range(FRAMES)]


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"g": "12", "bf": "3"}),
        ("open.mp4", "libx264", {"x264-params": "keyint=12:bframes=3:open-gop=1"}),
        ("a.webm", "libvpx", {"g": "10", "deadline": "realtime"}),
        ("a.mkv", "libx264", {"g": "400"}),
        ("raw.h264", "libx264", {"g": "12", "bf": "2"}),
        ("a.avi", "mpeg4", {"g": "12", "bf": "2"}),
    ],
    ids=lambda value: value if isinstance(value, str) and "." in value else "",
)
@pytest.mark.parametrize("variable", [False, True], ids=["even", "uneven"])
def test_any_order_gives_the_frames_of_playing(tmp_path, name, codec, options, variable):
    path = film(tmp_path / name, codec, options, variable=variable)
    played, capture = [], cv2.VideoCapture(str(path))
    while (found := capture.read())[0]:
        played.append(number_in(cv2.imencode(".png", found[1])[1].tobytes()))
    pictures = JpegFrames(path)
    assert size_of(pictures) == SIZE
    assert pictures.length == len(played)
    got = [number_in(pictures.jpeg(frame)) for frame in ORDER if frame < len(played)]
    assert got == [played[frame] for frame in ORDER if frame < len(played)]


@pytest.mark.parametrize("matrix", [(0, 1, -1, 0), (0, -1, 1, 0), (-1, 0, 0, -1)], ids=["right", "left", "over"])
def test_a_telephone_that_was_turned_is_turned_back(tmp_path, matrix):
    path = film(tmp_path / "a.mp4", "libx264", {})
    content = bytearray(path.read_bytes())
    # Of the track's header, the matrix that the picture is shown by.
    place = content.index(b"tkhd") + 44
    for number, value in zip((0, 1, 3, 4), matrix, strict=True):
        content[place + 4 * number : place + 4 * number + 4] = (value << 16).to_bytes(4, "big", signed=True)
    path.write_bytes(content)
    pictures, capture = JpegFrames(path), cv2.VideoCapture(str(path))
    played = [capture.read()[1] for _ in range(6)][5]
    assert size_of(pictures) == played.shape[1::-1]
    got = cv2.imdecode(np.frombuffer(pictures.jpeg(5), np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(got.astype(int) - played).mean() < 6


def test_a_source_without_pictures_is_refused(tmp_path):
    (tmp_path / "a.txt").write_text("nothing")
    for name in ("a.txt", "b.mp4", "."):
        with pytest.raises(RequestError):
            JpegFrames(tmp_path / name)


def test_one_broken_picture_leaves_the_others(tmp_path):
    for number in range(6):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((24, 32, 3), 40 * number, np.uint8))
    pictures = JpegFrames(tmp_path)
    (tmp_path / "2.png").write_bytes(b"broken")
    assert pictures.jpeg(1)
    with pytest.raises(RunError):
        pictures.jpeg(2)
    assert cv2.imdecode(np.frombuffer(pictures.jpeg(3), np.uint8), cv2.IMREAD_GRAYSCALE).mean() == pytest.approx(
        120, abs=2
    )
