"""The server of the page: who may ask, and what it answers."""

from __future__ import annotations

import http.client
import json
import signal
import socket
import time
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from starlette.testclient import TestClient

from tests.tracking.review.conftest import FRAMES, PEOPLE, SIZE
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.review.reviewed import Reviewed
from tsuiseki.tracking.review.server import JpegFrames, application
from tsuiseki.tracking.review.session import Session
from tsuiseki.tracking.review.track_rows import ROW

TOKEN, HOST = "t0ken", "127.0.0.1:8000"
ADDRESS = f"http://{HOST}/{TOKEN}/"


@pytest.fixture
def client(reviewable):
    session = Session(reviewable)
    reviewed = Reviewed(session, "result")
    yield TestClient(application(reviewed, JpegFrames(session.source), TOKEN, 8000), base_url=ADDRESS)
    session.close()


# ---- Who may ask


@pytest.mark.parametrize("path", ["", "data", "picture/3", "boxes/0", "main.js", "change/undo"])
@pytest.mark.parametrize("token", ["", "/t0ke", "/t0ken2", "/T0KEN", "/töken"])
def test_without_the_token_nothing_is_given(client, path, token):
    for ask in (client.get, client.post):
        answer = ask(f"http://{HOST}{token}/{path}")
        assert answer.status_code == 403
        assert "token" in answer.text


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1:8001"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost:8000"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
    ids=str,
)
def test_other_sites_are_refused(client, headers):
    for ask in (client.get, client.post):
        answer = ask("data", headers=headers)
        assert (answer.status_code, len(answer.text.splitlines())) == (403, 1)


def test_a_link_of_a_report_opens_the_page_and_nothing_else(client):
    link = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}
    assert client.get("", headers=link).status_code == 200
    assert client.post("", headers=link).status_code == 405
    for path in ("data", "main.js", "change/undo"):
        assert client.get(path, headers=link).status_code == client.post(path, headers=link).status_code == 403


@pytest.mark.parametrize("path", ["nothing", "..%2f..%2frun.py", "%2e%2e/server.py", "picture/80", "picture/x", "x/y"])
def test_what_is_not_of_the_page_is_not_there(client, path):
    assert client.get(path).status_code == 404


def test_every_answer_is_for_this_page_alone(client):
    for path in ("", "data", "picture/0", "nothing", "../"):
        headers = client.get(path).headers
        assert "script-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert "access-control-allow-origin" not in headers
        assert headers["cache-control"] == "no-store"
    assert "<script>" not in client.get("").text
    assert client.get("main.js").headers["content-type"].startswith("text/javascript")


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (b"{}", "text/plain"),
        (b"{", "application/json"),
        (b"[1]", "application/json"),
        (b"", "application/json"),
        (b"[" * 90_000, "application/json"),
        (b'"' + b"x" * 200_000 + b'"', "application/json"),
    ],
    ids=["text", "half", "list", "empty", "deep", "long"],
)
def test_what_is_no_json_object_is_refused(client, content, kind):
    answer = client.post("change/correct", content=content, headers={"Content-Type": kind})
    assert (answer.status_code, len(answer.text.splitlines())) == (400, 1)


# ---- What it answers


def rows(client, number=0):
    return np.frombuffer(client.get(f"boxes/{number}").content, ROW)


def test_the_state_describes_the_result(client):
    state = client.get("data").json()
    assert (state["size"], state["frames"], state["rate"]) == ([*SIZE], FRAMES, 25.0)
    assert [track["spans"] for track in state["tracks"]] == [[[0, FRAMES - 1]]] * PEOPLE
    found = rows(client)
    assert len(found) == FRAMES * PEOPLE
    assert np.all(np.diff(found["frame"]) >= 0)
    assert client.get("boxes/1").content == b""


def test_pictures_are_those_of_their_frames(client, tracked):
    for frame in (40, 3, 79, 0):
        got = cv2.imdecode(np.frombuffer(client.get(f"picture/{frame}").content, np.uint8), cv2.IMREAD_COLOR)
        want = cv2.imread(str(tracked.parent / "clip" / f"{frame + 1:06d}.jpg"))
        assert np.abs(got.astype(int) - want).mean() < 2


def test_an_exchange_says_what_changed_and_is_undone(client):
    before = rows(client)
    answer = client.post("change/correct", json={"kind": "switch", "ids": [3, 4], "frame": 70}).json()
    assert answer["changed"] == [[3, 70, FRAMES - 1], [4, 70, FRAMES - 1]]
    assert answer["chunks"] == [0]
    assert not np.array_equal(rows(client), before)
    undone = client.post("change/undo", json={}).json()
    assert undone["version"] != answer["version"]
    assert np.array_equal(rows(client), before)


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"kind": "dance"},
        {"kind": "same", "ids": [1], "frame": 3},
        {"kind": "same", "ids": [1, 2], "frame": 3},
        {"kind": "delete", "ids": [99]},
        {"kind": "delete", "ids": []},
        {"kind": "delete", "ids": 3},
        {"kind": "delete", "ids": ["1"]},
        {"kind": "switch", "ids": [1], "frame": 3},
        {"kind": "box", "frame": 3, "box": [1, 2, 0, 5]},
        {"kind": "box", "frame": -1, "box": [1, 2, 3, 5]},
        {"kind": "box", "frame": 900, "box": [1, 2, 3, 5]},
        {"kind": "box", "frame": 3, "box": [1, 2, float("inf"), 5]},
        {"kind": "box", "frame": 3, "box": [1, 2]},
        {"kind": "box", "frame": 3},
        {"kind": "box", "frame": 3, "box": [1, 2, 30, 50], "of": 1},
        {"kind": "target", "frame": 3, "of": 1},
        {"kind": "name", "ids": [1], "frame": "me"},
        {"kind": "name", "ids": [1], "name": [1]},
        {"kind": "several"},
        {"kind": "next", "ids": [1, 1], "frame": 3, "last": 3},
        {"kind": "right", "ids": [1], "frame": 9, "last": 3},
        {"kind": "same", "ids": [1, 2], "dance": 3},
    ],
    ids=str,
)
def test_a_correction_that_says_nothing_is_refused_in_a_line(client, given):
    before = client.get("data").json()
    content = json.dumps(given)
    answer = client.post("change/correct", content=content, headers={"Content-Type": "application/json"})
    assert (answer.status_code, len(answer.text.splitlines())) == (400, 1)
    assert client.get("data").json() == before


def test_answers_are_counted(client):
    question = client.get("data").json()["questions"][0]
    answer = client.post("change/answer", json={"key": question["key"], "yes": True}).json()
    assert answer["answered"] == 1
    assert question["key"] not in [one["key"] for one in answer["questions"]]
    assert client.post("change/answer", json={"key": question["key"], "yes": "no"}).status_code == 400
    assert client.post("change/answer", json={"key": "nothing", "yes": True}).status_code == 400
    assert client.post("change/dance", json={}).status_code == 400


# ---- The command


@pytest.mark.slow
def test_a_reviewer_at_a_time_and_an_end_within_a_second(reviewable, started, capsys):
    process, usual = started(reviewable)
    process.kill()
    process.wait()
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind(("127.0.0.1", urlsplit(usual).port))
        taken.listen()
        process, address = started(reviewable)
    assert urlsplit(address).port != urlsplit(usual).port
    assert urlsplit(address).path == urlsplit(usual).path
    assert main(["review", str(reviewable)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    idle = http.client.HTTPConnection(urlsplit(address).netloc)
    idle.request("GET", urlsplit(address).path)
    assert idle.getresponse().read().startswith(b"<!doctype html>")
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(5) == 0
    assert time.monotonic() - begin < 2  # one on an idle computer
    assert process.stdout.read().count("\n") == 1
    started(reviewable)


@pytest.mark.parametrize("what", ["missing", "small", "short"])
def test_another_video_is_refused(reviewable, tmp_path, capsys, what):
    other = tmp_path / "other"
    if what != "missing":
        other.mkdir()
    for frame in range({"missing": 0, "small": FRAMES, "short": FRAMES - 9}[what]):
        size = SIZE if what == "short" else (32, 24)
        cv2.imwrite(str(other / f"{frame:06d}.png"), np.zeros((*size[::-1], 3), np.uint8))
    assert main(["review", str(reviewable), "--video", str(other)]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert {"missing": "found no", "small": "32x24", "short": "71"}[what] in error


def test_the_extra_is_named_where_it_is_missing(reviewable, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert main(["review", str(reviewable)]) == 2
    assert "reviewing needs starlette and uvicorn; install the extra" in capsys.readouterr().err
