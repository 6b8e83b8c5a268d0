"""Models of the catalogue from a server of our own: fetched whole, in parts, wrongly, slowly or not at all."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import threading
import time
import zipfile
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.exported import as_describer, open_detector
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.openvino_session import FORMATS
from tsuiseki.tracking.weights import catalogue, download
from tsuiseki.tracking.weights.catalogue import CATALOGUE, OPTIONS, CatalogueModel, file_sum

BLANK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


class Server:
    """Answers with ``content``; ``asked`` keeps the first byte of each request, ``cut`` the bytes after which it ends.

    ``pause`` seconds go by before each of its pieces, ``status`` is what it answers, and ``ranges`` whether it goes on
    where it is asked to.
    """

    def __init__(self):
        self.content, self.asked, self.cut, self.pause, self.status, self.ranges = b"", [], [], 0.0, 200, True
        server = self

        class Answer(BaseHTTPRequestHandler):
            def do_GET(self):
                server.answer(self)

            def log_message(self, *words):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
        self.address = f"http://127.0.0.1:{self.http.server_port}/model.onnx"
        threading.Thread(target=self.http.serve_forever, daemon=True).start()

    def answer(self, request):
        start = int(request.headers.get("Range", "bytes=0-")[6:-1])
        self.asked.append(start)
        if self.status != 200 or start >= len(self.content) > 0:
            request.send_error(self.status if self.status != 200 else 416)
            return
        start = start if self.ranges else 0
        rest = self.content[start:]
        request.send_response(206 if start else 200)
        request.send_header("Content-Length", str(len(rest)))
        request.end_headers()
        rest = rest[: self.cut.pop(0)] if self.cut else rest
        try:
            for piece in range(0, len(rest), 1000) if self.pause else [0]:
                time.sleep(self.pause)
                request.wfile.write(rest[piece : piece + 1000] if self.pause else rest)
                request.wfile.flush()
        except OSError:  # nobody listens any more
            pass


@pytest.fixture
def server():
    server = Server()
    yield server
    server.http.shutdown()
    server.http.server_close()


@pytest.fixture
def entry(server, tmp_path, monkeypatch):
    """A detector of two classes, of which the file does not tell which one is people."""
    monkeypatch.setenv("TSUISEKI_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(download, "MEGABYTE", 100)
    rows = np.zeros((3, 7), np.float32)
    rows[0] = [0, 8, 8, 24, 56, 1, 0.9]
    server.content = save_constant(tmp_path / "made.onnx", {"output": rows}, plain=("output",)).read_bytes()
    made = CatalogueModel(
        "ours-s",
        "detector",
        "1.0",
        server.address,
        "Apache-2.0",
        "pictures of ours, CC0",
        hashlib.sha256(server.content).hexdigest(),
        len(server.content),
        {"person": 1},
    )
    monkeypatch.setattr(catalogue, "CATALOGUE", (made,))
    return made


def fetched(entry):
    """Fetch it; the number of pieces, of 100 bytes here, that its progress counted."""
    pieces = []

    def watch(items, *_):
        for item in items:
            pieces.append(item)
            yield item

    download.download(entry, watch)
    return len(pieces)


def test_the_command_shows_the_terms_fetches_and_the_name_is_a_detector_then(entry, server, tmp_path, capsys):
    with pytest.raises(RequestError, match="not yet downloaded; give `tsuiseki models get ours-s`"):
        open_detector("ours-s")
    assert main(["models", "get", "ours-s"]) == 2
    shown = capsys.readouterr().out
    for told in (entry.address, entry.sha256, "Apache-2.0", "CC0", "1.0"):
        assert told in shown
    assert server.asked == []
    assert main(["models", "get", "ours-s", "--yes"]) == 0
    assert entry.sha256 in capsys.readouterr().out
    assert entry.file.read_bytes() == server.content
    assert entry.file.is_relative_to(tmp_path / "cache")
    assert main(["models", "get", "ours-s"]) == 0
    assert "it is there already" in capsys.readouterr().out
    assert server.asked == [0]
    detector = open_detector("ours-s", options=DetectorOptions(colour="BGR"))
    assert (detector.layout, detector.person, detector.input.colour) == ("yolov7", 1, "BGR")
    np.testing.assert_allclose(detector.detect([BLANK])[0].boxes, [[8, 8, 24, 56]], atol=1e-3)


@pytest.mark.usefixtures("entry")
def test_the_user_is_asked_where_there_is_a_terminal(server, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    for said, count in (("n", 0), ("", 0), ("y", 1)):
        monkeypatch.setattr("builtins.input", lambda _, said=said: said)
        assert main(["models", "get", "ours-s"]) == 0
        assert len(server.asked) == count
    assert "nothing was downloaded" in capsys.readouterr().out


def test_a_run_records_what_was_downloaded(entry, tmp_path):
    fetched(entry)
    clip = tmp_path / "clip" / "img1"
    clip.mkdir(parents=True)
    import cv2

    for n in range(3):
        cv2.imwrite(str(clip / f"{n + 1:06d}.png"), BLANK)
    out = tmp_path / "out"
    words = ["track", "people", str(clip.parent), "--detector", "ours-s", "--appearance", "none", "--out", str(out)]
    assert main([*words, "--view", "1"]) == 0
    record = json.loads((out / "run.json").read_text())
    kept = record["facts"]["models"]
    assert (kept["ours-s"]["sha256"], kept["ours-s"]["version"]) == (entry.sha256, "1.0")
    assert (out / "tracks.txt").read_text().startswith("1,1,9")


def test_a_download_that_was_cut_goes_on_where_it_ended(entry, server):
    server.cut = [300, 200]
    fetched(entry)
    assert server.asked == [0, 300, 500]
    assert entry.file.read_bytes() == server.content


def test_the_progress_counts_each_megabyte_once_however_often_it_is_cut(entry, server):
    server.cut = [300, 200]
    assert fetched(entry) == math.ceil(len(server.content) / 100)


def test_one_that_keeps_breaking_off_is_kept_for_the_next_command(entry, server):
    server.cut = [100] * download.TRIES
    with pytest.raises(RunError, match=rf"broke off {download.TRIES} times, .* 500 bytes are kept: give the command"):
        fetched(entry)
    assert not entry.file.exists()
    fetched(entry)
    assert server.asked[-1] == 500
    assert entry.file.read_bytes() == server.content


def test_a_server_that_does_not_go_on_begins_anew(entry, server):
    server.cut, server.ranges = [300], False
    fetched(entry)
    assert entry.file.read_bytes() == server.content


def test_leftovers_that_are_longer_than_the_file_are_thrown_away(entry, server):
    entry.file.parent.mkdir(parents=True)
    entry.file.with_suffix(".part").write_bytes(b"x" * (len(server.content) + 1))
    fetched(entry)
    assert entry.file.read_bytes() == server.content


def test_another_sum_is_refused_and_nothing_is_kept(entry, server):
    server.content = server.content[:-1] + b"!"
    with pytest.raises(RunError, match=rf"expected {entry.sha256} but got [0-9a-f]{{64}}"):
        fetched(entry)
    assert [path.name for path in entry.file.parent.iterdir()] == []
    assert main(["models", "get", "ours-s", "--yes"]) == 1


def test_a_file_that_changed_in_the_cache_is_not_used(entry):
    fetched(entry)
    entry.file.write_bytes(b"another")
    with pytest.raises(RequestError, match=rf"expected sha256 {entry.sha256}, got .* to fetch it anew"):
        open_detector("ours-s")
    assert main(["models", "get", "ours-s", "--yes"]) == 0
    assert open_detector("ours-s").layout == "yolov7"


def test_a_sum_that_nobody_published_is_kept_shown_and_held_to(entry, server, monkeypatch, capsys):
    unknown = replace(entry, sha256="", size=0)
    monkeypatch.setattr(catalogue, "CATALOGUE", (unknown,))
    assert main(["models", "get", "ours-s", "--yes"]) == 0
    printed = capsys.readouterr().out
    assert "sha256       not known; that of the first download is kept" in printed
    assert f"sha256 {entry.sha256}; this sum is not verified" in printed
    assert unknown.record()["sha256"] == entry.sha256
    unknown.file.unlink()
    server.content += b"more"
    with pytest.raises(RunError, match=f"expected {entry.sha256} but got"):
        fetched(unknown)


def test_the_network_in_an_archive_is_taken_out(entry, server):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("../2024/end2end.onnx", server.content)
        archive.writestr("detail.json", "{}")
    onnx, server.content = server.content, packed.getvalue()
    zipped = replace(entry, address=server.address[: -len("onnx")] + "zip", sha256="", size=0)
    fetched(zipped)
    assert zipped.checked().read_bytes() == onnx
    assert zipped.record()["sha256"] == hashlib.sha256(server.content).hexdigest()
    assert sorted(path.suffix for path in zipped.file.parent.iterdir()) == [".json", ".onnx"]
    zipped.file.with_suffix(".json").unlink()
    server.content = b"no archive"
    with pytest.raises(RunError, match="expected an archive, got something else; it is not kept"):
        fetched(zipped)


def test_a_full_disk_is_said_in_one_line(entry, monkeypatch):
    monkeypatch.setattr(download, "_append", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "no space")))
    with pytest.raises(RunError, match="no space left; make room, or name another cache by TSUISEKI_CACHE"):
        fetched(entry)


def test_a_cache_that_cannot_be_written_is_said_in_one_line(entry, tmp_path):
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(RunError, match="make it writable, or name another cache"):
        fetched(entry)


def test_what_the_server_refuses_is_not_asked_again(entry, server):
    server.status = 404
    with pytest.raises(RunError, match="the server answers 404 Not Found"):
        fetched(entry)
    assert len(server.asked) == 1


def test_silence_has_a_bound(entry, server, monkeypatch):
    server.pause = 0.6
    for name, value in (("PATIENCE", 0.3), ("TRIES", 2)):
        monkeypatch.setattr(download, name, value)
    begun = time.monotonic()
    with pytest.raises(RunError, match=r"broke off 2 times, the last time with .*timed out"):
        fetched(entry)
    assert time.monotonic() - begun < 5


def test_a_server_that_is_not_there_is_said_in_one_line(entry, server):
    server.http.shutdown()
    server.http.server_close()
    with pytest.raises(RunError, match="Connection refused"):
        fetched(entry)


def test_two_downloads_of_one_model_do_not_mix(entry, server):
    def second_comes(pieces, *_):
        with pytest.raises(RequestError, match="another run is downloading ours-s"):
            fetched(entry)
        yield from pieces

    download.download(entry, second_comes)
    assert entry.checked().read_bytes() == server.content


def test_the_cache_is_where_the_system_has_it(monkeypatch, tmp_path):
    monkeypatch.delenv("TSUISEKI_CACHE", raising=False)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name, **_: tmp_path / name)
    assert catalogue.cache_folder() == tmp_path / "tsuiseki" / "models"


def test_an_appearance_network_goes_by_its_name_too(entry, server, tmp_path, monkeypatch):
    from tests.tracking.features.test_foreign_appearance import mean_colour

    server.content = mean_colour(tmp_path / "a.onnx", ("n", 3, 24, 12)).read_bytes()
    made = replace(entry, name="ours-reid", kind="appearance", sha256="", size=0)
    made = replace(made, options={"mean": (0, 0, 0), "std": (1, 1, 1)})
    monkeypatch.setattr(catalogue, "CATALOGUE", (made,))
    fetched(made)
    assert as_describer("ours-reid").feature_length == 3
    image, boxes = np.full((40, 40, 3), (0, 150, 200), np.uint8), np.array([[0, 0, 20, 40.0]])
    # The command line gives the default options where a user gives none.
    for options in (None, AppearanceOptions()):
        described = as_describer("ours-reid", options=options).describe(image, boxes)
        np.testing.assert_allclose(described, [[0, 0.6, 0.8]], atol=1e-6)
    with pytest.raises(RequestError, match="detector: expected an ONNX file or one of the shipped"):
        open_detector("ours-reid")


def test_the_catalogue_says_all_of_every_model():
    assert len({each.name for each in CATALOGUE}) == len(CATALOGUE)
    for each in CATALOGUE:
        assert each.address.startswith(("https://", "pkg:npm/", "pkg:pypi/"))
        assert each.kind in OPTIONS
        assert each.version
        assert each.licence
        assert each.data
        for kept in (each.sha256, each.file_sha256, each.weights_sha256):
            algorithm, _, digits = kept.rpartition(":")
            assert not kept or (len(digits) == (96 if algorithm == "sha384" else 64) and int(digits, 16))
        assert each.size or not each.sha256
        assert each.ending in (".onnx", *FORMATS)
        (DetectorOptions if each.kind == "detector" else AppearanceOptions)(**each.options)


def test_of_the_catalogue_one_lacks_a_sum():
    without = [each.name for each in CATALOGUE if not (each.sha256 or each.file_sha256)]
    assert without == ["osnet-x1-0"]


def test_the_weights_beside_a_graph_of_openvino_are_fetched_and_held_to_their_sum(entry, server):
    sums = {"sha256": "", "weights_sha256": "sha384:" + hashlib.sha384(server.content).hexdigest()}
    pair = replace(entry, address=server.address[: -len("onnx")] + "xml", ending=".xml", size=0, **sums)
    fetched(pair)
    assert [path.read_bytes() for path in pair.files] == [server.content] * 2
    assert pair.checked().suffix == ".xml"
    assert sorted(path.suffix for path in pair.file.parent.iterdir()) == [".bin", ".json", ".xml"]
    pair.files[1].write_bytes(b"another")
    with pytest.raises(RequestError, match=r"ours-s.bin: expected sha256 sha384:.* to fetch it anew"):
        pair.checked()


def test_sums_are_those_of_the_files(tmp_path):
    (tmp_path / "f").write_bytes(b"abc")
    assert file_sum(tmp_path / "f").startswith("ba7816bf8f01cfea")
