"""Networks from archives of npm and PyPI: a local index of our own serves them, by which npm and pip fetch.

The real registries are tried where they can be reached, by whatever the machine is set to.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import socket
import struct
import subprocess
import tarfile
import threading
import zipfile
from base64 import b64encode
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.weights import catalogue, registries
from tsuiseki.tracking.weights.catalogue import CATALOGUE, CatalogueModel
from tsuiseki.tracking.weights.download import download
from tsuiseki.tracking.weights.tensorflow_js import frozen_graph

ROOT = Path(__file__).parents[3]
needs_npm = pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed")


def network(folder):
    """An ONNX detector that finds one person."""
    rows = np.zeros((3, 7), np.float32)
    rows[0] = [0, 8, 8, 24, 56, 0, 0.9]
    return save_constant(folder / "made.onnx", {"output": rows}, plain=("output",)).read_bytes()


def npm_archive(files):
    """A package of npm."""
    files = {"package/package.json": b'{"name": "@ours/net", "version": "1.0.0"}', **files}
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for name, content in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
        link = tarfile.TarInfo("package/link.onnx")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    return packed.getvalue()


def wheel(files):
    """A wheel of PyPI."""
    about = "ours_net-1.0.0.dist-info"
    files = {
        **files,
        f"{about}/METADATA": b"Metadata-Version: 2.1\nName: ours-net\nVersion: 1.0.0\n",
        f"{about}/WHEEL": b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/RECORD": b"",
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


class Index:
    """Answers as npm's registry and as PyPI's simple index do; ``asked`` keeps the paths."""

    def __init__(self):
        self.npm, self.wheel, self.asked = b"", b"", []
        index = self

        class Answer(BaseHTTPRequestHandler):
            def do_GET(self):
                index.asked.append(self.path)
                kind, content = index.answer(self.path)
                if content is None:
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *words):
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Answer)
        self.address = f"http://127.0.0.1:{self.http.server_port}"
        threading.Thread(target=self.http.serve_forever, args=(0.02,), daemon=True).start()

    def answer(self, path):
        if path.endswith(".tgz"):
            return "application/octet-stream", self.npm
        if path.endswith(".whl"):
            return "application/octet-stream", self.wheel
        if path.lower().startswith("/@ours"):
            sums = {"integrity": "sha512-" + b64encode(hashlib.sha512(self.npm).digest()).decode()}
            tarball = f"{self.address}/net-1.0.0.tgz"
            version = {"name": "@ours/net", "version": "1.0.0", "dist": {"tarball": tarball, **sums}}
            package = {"name": "@ours/net", "dist-tags": {"latest": "1.0.0"}, "versions": {"1.0.0": version}}
            return "application/json", json.dumps(package).encode()
        if path == "/simple/ours-net/":
            link = '<a href="/ours_net-1.0.0-py3-none-any.whl">ours_net-1.0.0-py3-none-any.whl</a>'
            return "text/html", f"<html><body>{link}</body></html>".encode()
        return "text/plain", None


@pytest.fixture
def index(tmp_path, monkeypatch):
    """The only index that npm and pip know."""
    index = Index()
    for name in [name for name in os.environ if name.upper().startswith(("PIP_", "NPM_CONFIG_"))]:
        monkeypatch.delenv(name)
    settings = {"TSUISEKI_CACHE": tmp_path / "cache", "PIP_CONFIG_FILE": os.devnull}
    settings |= {"PIP_INDEX_URL": f"{index.address}/simple", "npm_config_registry": index.address}
    settings |= {"npm_config_cache": tmp_path / "npm", "npm_config_fetch_retries": 0, "PIP_NO_CACHE_DIR": 1}
    for name, value in settings.items():
        monkeypatch.setenv(name, str(value))
    yield index
    index.http.shutdown()
    index.http.server_close()


def entry(address, archive, member, content):
    """A catalogue entry of such an archive."""
    return CatalogueModel(
        "ours-s",
        "detector",
        "1.0.0",
        address,
        "Apache-2.0",
        "pictures of ours, CC0",
        hashlib.sha256(archive).hexdigest(),
        len(archive),
        {"person": 0},
        member=member,
        file_sha256=hashlib.sha256(content).hexdigest(),
    )


def npm_entry(index, content, name="package/made.onnx", **changes):
    index.npm = npm_archive({name: content})
    return replace(entry("pkg:npm/%40ours/net@1.0.0", index.npm, name, content), **changes)


@needs_npm
@pytest.mark.slow
def test_a_network_comes_from_the_npm_registry_that_the_user_has_set(index, tmp_path, monkeypatch, capsys):
    made = npm_entry(index, network(tmp_path))
    monkeypatch.setattr(catalogue, "CATALOGUE", (made,))
    assert main(["models", "get", "ours-s", "--yes"]) == 0
    assert made.sha256 in capsys.readouterr().out
    assert any(path.endswith(".tgz") for path in index.asked)
    detector = open_detector("ours-s")
    np.testing.assert_allclose(
        detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])[0].boxes, [[8, 8, 24, 56]], atol=1e-3
    )
    assert sorted(path.suffix for path in made.file.parent.iterdir()) == [".json", ".onnx"]


@pytest.mark.slow
def test_a_network_comes_from_the_index_that_the_user_has_set_for_pip(index, tmp_path):
    content = network(tmp_path)
    index.wheel = wheel({"ours_net/made.onnx": content})
    made = entry("pkg:pypi/ours-net@1.0.0", index.wheel, "ours_net/made.onnx", content)
    download(made)
    assert made.checked().read_bytes() == content
    assert index.asked[0] == "/simple/ours-net/"


@pytest.mark.slow
@pytest.mark.usefixtures("index")
def test_what_the_registry_lacks_is_said_in_its_own_words_with_another_way():
    lacking = entry("pkg:pypi/ours-other@1.0.0", b"", "made.onnx", b"")
    with pytest.raises(
        RunError, match=r"ours-other 1.0.0 of PyPI: .*No matching .* or put the archive at .*ours-s.whole"
    ):
        download(lacking)
    assert not lacking.file.exists()


def test_an_archive_that_lies_in_the_cache_is_taken_without_asking_anybody(index, tmp_path):
    content = network(tmp_path)
    made = npm_entry(index, content)
    made.whole.parent.mkdir(parents=True)
    made.whole.write_bytes(index.npm)
    download(made)
    assert made.checked().read_bytes() == content
    assert index.asked == []


def test_a_network_within_a_member_begins_at_its_byte(index, tmp_path, monkeypatch):
    content = network(tmp_path)
    made = npm_entry(index, b"labels" + content, start=6, file_sha256=hashlib.sha256(content).hexdigest())
    monkeypatch.setattr("tsuiseki.tracking.weights.download.fetch_archive", put(index.npm))
    download(made)
    assert made.checked().read_bytes() == content


def put(archive):
    """What `fetch_archive` does, without npm."""
    return lambda _, file: file.write_bytes(archive)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"sha256": "0" * 64}, "expected 0{64} but got"),
        ({"file_sha256": "0" * 64}, "expected a network of sha256 0{64}, got .* it is not kept"),
        ({"member": "package/none.onnx"}, "expected 'package/none.onnx' in the archive, found none"),
        ({"member": "package/link.onnx"}, "expected 'package/link.onnx' in the archive, found none"),
    ],
)
def test_another_archive_or_member_is_refused_and_nothing_is_kept(index, tmp_path, monkeypatch, changes, reason):
    made = npm_entry(index, network(tmp_path), **changes)
    monkeypatch.setattr("tsuiseki.tracking.weights.download.fetch_archive", put(index.npm))
    with pytest.raises(RunError, match=reason):
        download(made)
    assert [path.name for path in made.file.parent.iterdir()] == []


def test_no_path_in_an_archive_leads_outside(index, tmp_path, monkeypatch):
    content = network(tmp_path)
    made = npm_entry(index, content, name="../../../outside.onnx")
    monkeypatch.setattr("tsuiseki.tracking.weights.download.fetch_archive", put(index.npm))
    download(made)
    assert made.checked().read_bytes() == content
    assert not list(tmp_path.rglob("outside*"))


def test_a_registry_that_is_silent_has_a_bound(index, tmp_path, monkeypatch):
    made = npm_entry(index, network(tmp_path))

    def silent(command, **settings):
        raise subprocess.TimeoutExpired(command, settings["timeout"])

    monkeypatch.setattr(registries.subprocess, "run", silent)
    with pytest.raises(RunError, match=r"@ours/net 1.0.0 of npm: not there after 600 s"):
        download(made)


def test_a_missing_npm_is_said_in_one_line(index, tmp_path, monkeypatch):
    made = npm_entry(index, network(tmp_path))
    monkeypatch.setattr(registries.shutil, "which", lambda _: None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RunError, match="npm is not installed; set its registry for npm, or put the archive at"):
        download(made)


def test_no_file_of_the_repository_names_a_registry():
    names = re.compile(r"registry\.npmjs|pypi\.org/simple|files\.pythonhosted|npm_config_registry *=")
    folders = ("tracking", "docs", "configs", "models", "datamodules", "trainers")
    files = [
        path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".md", ".yaml")
    ]
    assert len(files) > 300
    assert [
        path for path in (*files, ROOT / "README.md", ROOT / "pyproject.toml") if names.search(path.read_text())
    ] == []


def graph(value):
    """A graph model of TensorFlow.js that adds a constant to its input."""
    nodes = [
        {
            "name": "x",
            "op": "Placeholder",
            "attr": {"dtype": {"type": "DT_FLOAT"}, "shape": {"shape": {"dim": [{"size": "2"}]}}},
        },
        {"name": "c", "op": "Const", "attr": {"dtype": {"type": "DT_FLOAT"}}},
        {"name": "y", "op": "AddV2", "input": ["x", "c"], "attr": {"T": {"type": "DT_FLOAT"}}},
    ]
    weights = [{"name": "c", "shape": [2], "dtype": "float32", "quantization": {"dtype": "float16"}}]
    model = {"modelTopology": {"node": nodes}, "weightsManifest": [{"paths": ["w.bin"], "weights": weights}]}
    return json.dumps(model).encode(), np.array(value, "<f2").tobytes()


def test_a_model_of_tensorflow_js_is_the_same_graph_frozen(tmp_path):
    openvino = pytest.importorskip("openvino")
    file = tmp_path / "graph.pb"
    file.write_bytes(frozen_graph(*graph([1.5, -300])))
    compiled = openvino.Core().compile_model(openvino.Core().read_model(file), "CPU")
    np.testing.assert_allclose(compiled(np.array([1, 2], np.float32))[0], [2.5, -298])


@pytest.mark.parametrize(
    ("model", "weights", "reason"),
    [
        (b"{}", b"", "weightsManifest"),
        (b"no json", b"", "Expecting value"),
        (graph([1, 2])[0], b"\0", "buffer"),
        (graph([1, 2])[0], b"\0" * 6, "6 bytes of weights for 4"),
        (graph([1, 2])[0].replace(b"DT_FLOAT", b"DT_NONE"), b"\0" * 4, "DT_NONE"),
        (graph([1, 2])[0].replace(b'"float16"', b'"complex64"'), b"\0" * 16, "complex64"),
    ],
)
def test_what_is_no_graph_model_is_refused_in_one_line(model, weights, reason):
    with pytest.raises(RunError, match=f"expected a graph model of TensorFlow.js, got one with .*{reason}"):
        frozen_graph(model, weights)


def test_numbers_are_written_as_protobuf_writes_them():
    nodes = {
        "node": [
            {"name": "n", "op": "o", "attr": {"f": {"f": 0.5}, "i": {"i": "-1"}, "s": {"s": b64encode(b"ab").decode()}}}
        ]
    }
    written = frozen_graph(json.dumps({"modelTopology": nodes, "weightsManifest": []}).encode(), b"")
    assert struct.pack("<f", 0.5) in written
    assert b"\x18" + b"\xff" * 9 + b"\x01" in written
    assert b"\x12\x02ab" in written


def test_entries_of_registries_say_all_that_is_needed():
    packages = [each for each in CATALOGUE if each.address.startswith("pkg:")]
    assert {each.name for each in packages} >= {"nanodet-g", "ssd-openimages", "blazepose", "pedestrian-ssdlite"}
    for each in packages:
        assert re.fullmatch(r"pkg:(npm|pypi)/(%40[\w.-]+/)?[\w.-]+@[\w.]+", each.address)
        assert len(each.sha256) == len(each.file_sha256) == 64
        assert each.member


def reachable(host):
    try:
        socket.create_connection((host, 443), timeout=3).close()
    except OSError:
        return False
    return True


@pytest.mark.slow
@needs_npm
@pytest.mark.integration
def test_a_real_network_comes_from_the_registry_of_this_machine(tmp_path, monkeypatch):
    set_registry = subprocess.run(["npm", "config", "get", "registry"], capture_output=True, text=True, timeout=60)
    host = re.sub(r"^https?://([^/:]+).*", r"\1", set_registry.stdout.strip())
    if not reachable(host):
        pytest.skip(f"the registry of npm, {host}, cannot be reached")
    monkeypatch.setenv("TSUISEKI_CACHE", str(tmp_path))
    assert main(["models", "get", "blazepose", "--yes"]) == 0
    assert open_detector("blazepose").layout == "blazepose"
