"""Video files of kinds that went wrong, each made here by PyAV. Numbers such as 58.1 are those of the report."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from fractions import Fraction
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError, RunError
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video import live
from tsuiseki.tracking.video.source import SeekableVideo, open_source

FRAMES, RATE, WIDTH, HEIGHT = 20, 25, 64, 48


def picture(number: int, width: int = WIDTH, height: int = HEIGHT) -> ImageArray:
    """A white square that goes to the right over grey."""
    image = np.full((height, width, 3), 90, np.uint8)
    image[16:32, 2 * number : 2 * number + 12] = 250
    return image


def place_of(image: ImageArray) -> float:
    """Column of the square's left edge, as far as compression left it."""
    return float(np.flatnonzero(image[24, :, 1] > 170)[0])


def write(
    path: Path,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    late: float = 0.0,
    options: dict[str, str] | None = None,
    turned: int = 0,
    pictures: list[np.ndarray[Any, Any]] | None = None,
    source: str = "rgb24",
    sizes: tuple[tuple[int, int], ...] = ((WIDTH, HEIGHT),),
    format: str | None = None,
) -> Path:
    """A video with one stream for each of the ``sizes``, whose first frame comes after ``late`` seconds."""
    with path.open("wb") as file, av.open(file, "w", format or path.suffix[1:].replace("mkv", "matroska")) as container:
        streams: list[Any] = []
        for width, height in sizes:
            stream: Any = container.add_stream(codec, RATE)
            stream.width, stream.height, stream.pix_fmt, stream.options = width, height, pixels, options or {}
            if turned:
                stream.set_display_rotation(turned)
            streams.append(stream)
        for number in range(FRAMES):
            for stream, (width, height) in zip(streams, sizes, strict=True):
                image = picture(number, width, height) if pictures is None else pictures[number]
                frame = av.VideoFrame.from_ndarray(image, format=source)
                frame.pts, frame.time_base = number + round(late * RATE), Fraction(1, RATE)
                container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode(None))
    return path


def check_whole(path: Path | str) -> None:
    """All frames come, each with its picture at its time."""
    source = open_source(path)
    frames = list(source.frames())
    assert [frame.index for frame in frames] == list(range(FRAMES))
    assert [place_of(frame.image) for frame in frames] == pytest.approx([2 * n for n in range(FRAMES)], abs=1)
    assert [frame.time for frame in frames] == pytest.approx([n / RATE for n in range(FRAMES)])
    assert {frame.image.shape[1::-1] for frame in frames} == {source.size}


def test_58_1_interlaced_pictures_are_read(tmp_path: Path) -> None:
    check_whole(write(tmp_path / "a.mpg", "mpeg2video", options={"flags": "+ildct+ilme", "qscale": "2"}, format="mpeg"))


@pytest.mark.slow
def test_58_2_names_that_are_no_text_in_and_out(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    video = write(folder / os.fsdecode(b"caf\xe9.mp4"))
    check_whole(video)
    words = ["track", "single", str(video), "--box", "0,16,12,16", "--overlay", "--out", str(folder / "o")]
    assert main(words) == 0
    assert len(list(open_source(folder / "o" / "overlay.webm").frames())) == FRAMES
    assert "caf" in (folder / "o" / "report.html").read_text(encoding="utf-8")


def test_58_3_relative_names_with_a_colon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("file:a.mp4"))
    check_whole("file:a.mp4")


@pytest.mark.parametrize("kind", ["mkv", "webm", "mp4", "mpegts"])
@pytest.mark.parametrize("late", [0.4, 10.0])
def test_58_4_a_first_frame_that_comes_late(kind: str, late: float, tmp_path: Path) -> None:
    codec = "libvpx" if kind == "webm" else "libx264"
    path = write(tmp_path / f"a.{kind}", codec, late=late)
    check_whole(path)
    source = open_source(path)
    if kind in ("mkv", "webm"):
        assert source.first_time == pytest.approx(late)
        assert source.likely_length == FRAMES
    assert len(list(open_source(path, FrameRange(FRAMES - 2, FRAMES - 1)).frames())) == 2
    if kind != "mpegts":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises((RunError, RequestError), match=r"breaks off|can decode"):
            list(open_source(path).frames())


class Unmeasured(BaseHTTPRequestHandler):
    """Sends a file without saying how long it is."""

    content = b""
    states_length = False
    asked = 0

    def do_GET(self) -> None:
        type(self).asked += 1
        self.send_response(200)
        if self.states_length:
            self.send_header("Content-Length", str(len(self.content)))
        self.end_headers()
        self.wfile.write(self.content)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(Unmeasured, "content", write(tmp_path / "a.mpegts").read_bytes())
    monkeypatch.setattr(Unmeasured, "asked", 0)
    monkeypatch.setattr(live, "PAUSE", 0.1)
    serving = ThreadingHTTPServer(("127.0.0.1", 0), Unmeasured)
    threading.Thread(target=serving.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{serving.server_port}/a.ts"
    serving.shutdown()
    serving.server_close()


@pytest.mark.parametrize("states_length", [True, False])
@pytest.mark.filterwarnings("ignore::tsuiseki.tracking.errors.InputWarning")
def test_58_5_a_file_over_http_is_read_once(states_length: bool, server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Unmeasured, "states_length", states_length)
    source = open_source(server)
    assert source.live
    assert source.endless != states_length
    assert source.size == (WIDTH, HEIGHT)
    assert [place_of(frame.image) for frame in source.frames()] == pytest.approx([2 * n for n in range(FRAMES)], abs=1)


def test_58_6_of_two_video_streams_the_one_that_is_read_is_said_and_chosen(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", sizes=((WIDTH, HEIGHT), (96, 80)))
    with pytest.warns(InputWarning, match="2 video streams, 1 of 64x48, 2 of 96x80 pixels: 1 is read; a.mkv#stream=2"):
        first = open_source(path)
    assert first.size == (WIDTH, HEIGHT)
    second = open_source(path, stream=2)
    assert {frame.image.shape for frame in second.frames()} == {(80, 96, 3)}
    assert open_source(second.address).size == second.size == (96, 80)
    with pytest.raises(RequestError, match="expected a stream within 1-2, got 3"):
        open_source(path, stream=3)
    words = ["track", "single", f"{path}#stream=2", "--box", "0,16,12,16"]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    assert '"size": [\n        96,\n        80' in (tmp_path / "o" / "run.json").read_text()


@pytest.mark.parametrize("depth", [8, 10, 12, 16])
@pytest.mark.filterwarnings("ignore::tsuiseki.tracking.errors.InputWarning")
def test_58_7_levels_of_16_bits_are_scaled_by_those_in_use(depth: int, tmp_path: Path) -> None:
    pictures = [picture(n).astype(np.uint16)[:, :, 0] << (depth - 8) for n in range(FRAMES)]
    pictures[0][:] >>= 3  # dark to begin with
    path = write(tmp_path / "a.mkv", "ffv1", "gray16le", pictures=pictures, source="gray16le")
    for number, frame in enumerate(open_source(path).frames()):
        np.testing.assert_array_equal(frame.image[..., 1], picture(number)[..., 1] >> (3 if number == 0 else 0))


@pytest.mark.parametrize("pixels", ["yuv420p10le", "yuv422p10le", "gray10le", "gray12le"])
def test_58_7_formats_of_10_bits_are_read_at_their_levels(pixels: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mkv", "ffv1", pixels)
    for number, frame in enumerate(open_source(path).frames()):
        assert np.abs(frame.image.astype(int) - picture(number)).mean() < 3


def test_58_17_a_file_tells_size_rate_first_time_length_and_what_it_is(tmp_path: Path) -> None:
    path, other = write(tmp_path / "a.mp4"), write(tmp_path / "b.mp4", pixels="yuv444p")
    source = open_source(path)
    assert (source.size, source.frame_rate, source.first_time) == ((WIDTH, HEIGHT), RATE, 0)
    assert source.likely_length == FRAMES
    copy = tmp_path / "copy.mp4"
    copy.write_bytes(path.read_bytes())
    assert open_source(copy).fingerprint == source.fingerprint != open_source(other).fingerprint
    assert len(source.fingerprint) == 32
    copy.write_bytes(path.read_bytes()[:-1] + b"?")
    assert open_source(copy).fingerprint != source.fingerprint


@pytest.mark.skipif(int(av.__version__.split(".")[0]) < 18, reason="PyAV 17 cannot write it")
@pytest.mark.parametrize("turned", [0, 90, 180, 270])
def test_a_turned_video_is_turned_upright(turned: int, tmp_path: Path) -> None:
    source = open_source(write(tmp_path / "a.mp4", turned=turned))
    assert source.size == ((HEIGHT, WIDTH) if turned % 180 else (WIDTH, HEIGHT))
    frame = next(source.frames())
    assert np.abs(frame.image.astype(int) - np.rot90(picture(0), turned // 90)).mean() < 3


@pytest.mark.parametrize(("matrix", "name"), [(1, "ITU709"), (6, "ITU601")])
@pytest.mark.parametrize("levels", [1, 2])
def test_colours_follow_the_matrix_and_the_range_that_the_stream_states(
    matrix: int, name: str, levels: int, tmp_path: Path
) -> None:
    colour = np.full((HEIGHT, WIDTH, 3), (200, 50, 30), np.uint8)
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream: Any = container.add_stream("ffv1", RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv444p"
        stream.codec_context.colorspace, stream.codec_context.color_range = matrix, levels
        frame = av.VideoFrame.from_ndarray(colour, format="rgb24").reformat(
            format="yuv444p", dst_colorspace=name, dst_color_range=levels
        )
        frame.colorspace, frame.color_range = matrix, levels
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    (frame_read,) = open_source(tmp_path / "a.mkv").frames()
    assert np.abs(frame_read.image.astype(int) - colour).max() <= 3


def test_a_video_that_changes_its_size_is_noticed_where_it_does(tmp_path: Path) -> None:
    """One JPEG file after another is a video."""
    path, coded = tmp_path / "cut.mjpeg", []
    for width, height in [(64, 48)] * 6 + [(128, 96)] * 6:
        context: Any = av.CodecContext.create("mjpeg", "w")
        context.width, context.height, context.pix_fmt, context.time_base = width, height, "yuvj420p", Fraction(1, 25)
        frame = av.VideoFrame.from_ndarray(picture(0, width, height), format="rgb24").reformat(format="yuvj420p")
        coded += [bytes(packet) for packet in [*context.encode(frame), *context.encode(None)]]
    path.write_bytes(b"".join(coded))
    frames = open_source(path).frames()
    assert [next(frames).index for _ in range(6)] == list(range(6))
    with pytest.raises(RunError, match="expected 64x48 pixels throughout, got 128x96 from frame 7 on"):
        next(frames)


@pytest.mark.parametrize("kind", ["mp4", "mkv", "mpegts", "webm"])
def test_frames_from_any_number_on_are_those_of_the_whole(kind: str, tmp_path: Path) -> None:
    codec = "libvpx" if kind == "webm" else "libx264"
    source = open_source(write(tmp_path / f"a.{kind}", codec, late=0.4, options={"g": "5"}))
    whole = [frame.image for frame in source.frames()]
    seekable = SeekableVideo.of(source)
    assert seekable is not None
    assert len(seekable.times) == FRAMES
    for first in (0, 3, 17):
        for frame in seekable.frames(first, FRAMES - 1):
            np.testing.assert_array_equal(frame.image, whole[frame.index])
            assert frame.time == pytest.approx(frame.index / RATE)


@pytest.mark.integration
def test_the_files_that_went_wrong(data_folder: Path) -> None:
    """58.1, 58.4 and 58.6 as they were reported."""
    for name in ("interlaced.mpg", "offset10.mkv", "base.mp4", "base.ts"):
        frames = list(open_source(data_folder / "cases" / "round2" / "01-video" / name).frames())
        assert len(frames) == 40
        assert all(frame.image.mean() == pytest.approx(129, abs=1) for frame in frames)
        assert len({frame.image.tobytes() for frame in frames}) == 40
