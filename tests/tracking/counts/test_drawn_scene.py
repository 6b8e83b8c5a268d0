"""`tsuiseki scene`: the page on which the user draws, asked as a browser asks."""

import http.client
import json
import queue
import socket
import threading
import urllib.error
import urllib.request

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.scene import read_scene
from tsuiseki.tracking.report import drawing

DRAWN = {
    "size": [64, 48],
    "lines": [{"name": "door", "from": [1, 2], "to": [30, 2.5]}],
    "zones": [{"name": "shop", "corners": [[0, 10], [20, 10], [20, 40]]}],
    "ignored": [],
}


def post(address, content):
    request = urllib.request.Request(f"{address}answer", json.dumps(content).encode(), method="POST")
    return urllib.request.urlopen(request, timeout=5).read().decode()


def test_the_command_writes_what_is_drawn(tmp_path, inputs, monkeypatch):
    addresses, refused = queue.Queue(), []
    monkeypatch.setattr(drawing, "_has_display", lambda: True)
    monkeypatch.setattr(drawing.webbrowser, "open", addresses.put)

    def browse():
        address = addresses.get(timeout=20)
        assert "image.png" in urllib.request.urlopen(address, timeout=5).read().decode()
        for wrong in ({**DRAWN, "size": [9, 9]}, [], {**DRAWN, "lines": DRAWN["lines"] * 2}, {**DRAWN, "camera": "a"}):
            try:
                post(address, wrong)
            except urllib.error.HTTPError as error:
                refused.append(error.read().decode())
        post(address, DRAWN)

    thread = threading.Thread(target=browse, daemon=True)
    thread.start()
    out = tmp_path / "scene.yaml"
    assert main(["scene", str(inputs.video), "--out", str(out)]) == 0
    thread.join(5)
    assert len(refused) == 4
    assert "door twice" in refused[2]
    scene = read_scene(out)
    assert scene.size == (64, 48)
    assert scene.lines[0].ends.tolist() == [[1, 2], [30, 2.5]]
    assert scene.zones[0].name == "shop"


@pytest.mark.parametrize("there", [True, False])
def test_what_cannot_be_written_or_read_is_refused_at_once(tmp_path, inputs, capsys, there):
    out = tmp_path / "scene.yaml"
    out.write_text("kept") if there else None
    assert main(["scene", str(inputs.video if there else tmp_path / "none.mp4"), "--out", str(out)]) == 2
    assert ("already exists" if there else "none.mp4") in capsys.readouterr().err


@pytest.fixture
def page():
    server = drawing._Server(np.zeros((48, 64, 3), np.uint8), "scene.html", lambda answer: answer)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()


def asked(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection(f"127.0.0.1:{server.server_address[1]}", timeout=5)
    body = b"[1]" if method == "POST" else None
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    return connection.getresponse()


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1:1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
    ],
    ids=str,
)
def test_other_sites_and_hosts_are_refused(page, headers):
    for path, method in ((page.path, "GET"), (f"{page.path}image.png", "GET"), (f"{page.path}answer", "POST")):
        answer = asked(page, path, method, **headers)
        assert (answer.status, len(answer.read().splitlines())) == (403, 1)
    assert not page.answered.is_set()


def test_every_answer_of_the_page_forbids_what_it_does_not_need(page):
    for path, status in ((page.path, 200), (f"{page.path}scene.js", 200), (f"{page.path}no", 404), ("/", 403)):
        answer = asked(page, path)
        content, headers = answer.read(), answer.headers
        assert answer.status == status
        assert "script-src 'self'" in headers["Content-Security-Policy"]
        assert "unsafe" not in headers["Content-Security-Policy"]
        assert headers["Cache-Control"] == "no-store"
        assert b"<script>" not in content
        assert b"<style>" not in content


@pytest.mark.parametrize("length", ["", "-1", "x", "99999999", "9" * 400])
def test_an_answer_of_no_length_or_too_long_is_refused(page, length):
    answer = asked(page, f"{page.path}answer", "POST", Content_Length=length)
    assert answer.status == 400


def test_who_connects_and_says_nothing_is_let_go(page, monkeypatch):
    monkeypatch.setattr(drawing._Handler, "timeout", 0.2)
    with socket.create_connection(("127.0.0.1", page.server_address[1]), 5) as silent:
        silent.sendall(b"POST /")
        assert silent.recv(100) == b""
