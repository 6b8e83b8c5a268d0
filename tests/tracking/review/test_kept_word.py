"""What the review says it saved is saved: on a full disk, after a kill, with names of any kind."""

import errno
import json

import pytest
from starlette.testclient import TestClient

from tests.tracking.review.test_server import ADDRESS, TOKEN
from tsuiseki.tracking import output
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.formats import correction_log
from tsuiseki.tracking.formats.correction_log import read_corrections
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.review import session as session_module
from tsuiseki.tracking.review.reviewed import Reviewed
from tsuiseki.tracking.review.server import application
from tsuiseki.tracking.review.session import Session


def full(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def everything(folder):
    """Content of all files but the log of corrections."""
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file() and p.name != "corrections.jsonl"}


@pytest.mark.parametrize("writer", ["write_tracks", "record_text"])
def test_on_a_full_disk_nothing_is_replaced_and_closing_tries_again(reviewable, monkeypatch, writer):
    session, before = Session(reviewable), everything(reviewable)
    session.correct(session.made("delete", [1]))
    with monkeypatch.context() as disk:
        disk.setattr(session_module, writer, full)
        with pytest.raises(RequestError, match="No space left"):
            session.save()
        assert not session.saved
        assert everything(reviewable) == before
    session.close()
    assert 1 not in {track.id for track in read_tracks(reviewable / "tracks.txt")}
    assert json.loads((reviewable / "run.json").read_text())["facts"]["corrections"] == 1


def test_a_review_whose_tracks_are_not_written_ends_in_an_error(reviewable, monkeypatch):
    session = Session(reviewable)
    session.correct(session.made("delete", [1]))
    monkeypatch.setattr(session_module, "write_tracks", full)
    with pytest.raises(RunError, match="has all corrections"):
        session.close()
    monkeypatch.undo()
    # The lock is gone, and the next review writes what is missing.
    again = Session(reviewable)
    assert not again.saved
    again.close()
    assert len(read_tracks(reviewable / "tracks.txt")) == 7


def test_the_record_comes_last(reviewable, monkeypatch):
    """Killed before run.json takes its place, the next review knows that tracks and record may not agree."""
    session = Session(reviewable)
    session.correct(session.made("delete", [1]))
    session.save()
    session.undo()
    session.correct(session.made("delete", [2]))  # as many corrections as before

    class Killed(BaseException):
        pass

    replace, order = output.Path.replace, []

    def killed(path, target):
        order.append(target.name)
        if target.name == "run.json":
            raise Killed
        return replace(path, target)

    with monkeypatch.context() as kill:
        kill.setattr(output.Path, "replace", killed)
        with pytest.raises(Killed):
            session.save()
    assert order[-1] == "run.json"
    session._open.close()
    again = Session(reviewable)
    assert not again.saved
    again.close()
    assert [t.id for t in read_tracks(reviewable / "tracks.txt")] == [1, 3, 4, 5, 6, 7, 8]
    assert json.loads((reviewable / "run.json").read_text())["results"]["."]["corrections"]


def test_what_comes_while_files_are_written_is_not_saved_yet(reviewable, monkeypatch):
    session = Session(reviewable)
    session.correct(session.made("delete", [1]))
    written = session_module.write_tracks

    def meanwhile(path, tracks):
        if path.name == "tracks.txt" and session.answered == 1:
            session.correct(session.made("delete", [2]))
        written(path, tracks)

    monkeypatch.setattr(session_module, "write_tracks", meanwhile)
    session.save()
    assert not session.saved
    session.close()
    assert len(read_tracks(reviewable / "tracks.txt")) == 6


def test_a_line_that_a_full_disk_refuses_leaves_the_log_and_the_tracks(reviewable, monkeypatch):
    session = Session(reviewable)
    session.correct(session.made("name", [1], name="Ann"))
    log, tracks = session.corrections_file.read_bytes(), session.tracks()
    monkeypatch.setattr(correction_log.os, "fsync", full)
    with pytest.raises(RequestError, match="No space left"):
        session.correct(session.made("delete", [2]))
    monkeypatch.undo()
    assert session.corrections_file.read_bytes() == log
    assert [t.id for t in session.tracks()] == [t.id for t in tracks]
    session.correct(session.made("delete", [3]))
    assert [t.id for t in session.tracks()] == [1, 2, 4, 5, 6, 7, 8]
    session.close()
    assert len(read_corrections(session.corrections_file).corrections) == 2


@pytest.fixture
def client(reviewable):
    session = Session(reviewable)
    yield TestClient(application(Reviewed(session, "result"), None, TOKEN, 8000), base_url=ADDRESS)
    session.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    "request_text",
    [
        '{"kind": "name", "ids": [1], "name": "\\ud800"}',
        '{"kind": "name", "ids": [1], "name": "a\\udfffb"}',
        '{"kind": "name", "ids": [1], "name": "a\\u0000b"}',
        json.dumps({"kind": "name", "ids": [1], "name": "x" * 101}),
        json.dumps({"kind": "name", "ids": [1] * 3000}),
        '{"kind": "\\ud800"}',
        json.dumps({"kind": "x" * 5000}),
        '{"kind": "name", "ids": [1], "\\ud800": 1}',
        '{"kind": "box", "frame": 3, "box": [1, 2, NaN, 5]}',
        '{"kind": "box", "frame": 3, "box": [1e300, 2, 3, 5]}',
        json.dumps({"kind": "box", "frame": 3, "box": [1] * 3000}),
        json.dumps({"kind": "real", "ids": [1], "frame": 10**30}),
        '{"kind": "real", "ids": [1], "frame": true}',
        '{"kind": "same", "ids": [1, 2], "frame": 3, "last": 99999999}',
        '{"kind": "target", "frame": 3, "of": 1, "point": [1]}',
        '{"kind": "target", "frame": 3, "of": 1, "point": [1e9, 1e9]}',
    ],
)
def test_nothing_is_appended_before_it_was_checked(client, reviewable, request_text):
    before = client.get("data").json()
    json_type = {"Content-Type": "application/json"}
    answer = client.post("change/correct", content=request_text, headers=json_type)
    assert (answer.status_code, len(answer.text.splitlines())) == (400, 1)
    assert len(answer.text) < 400
    assert not (reviewable / "corrections.jsonl").exists()
    assert client.get("data").json() == before


@pytest.mark.parametrize("what", ["answer", "undo", "redo"])
@pytest.mark.parametrize("content", [{"key": "\ud800", "yes": True}, {"key": "x" * 9000, "yes": True}, {"more": 1}])
def test_every_field_of_every_request_is_bounded(client, what, content):
    answer = client.post(f"change/{what}", content=json.dumps(content), headers={"Content-Type": "application/json"})
    assert (answer.status_code, len(answer.text.splitlines())) == (400, 1)
    assert len(answer.text) < 400


@pytest.mark.parametrize("path", ["boxes/", "picture/"])
@pytest.mark.parametrize("number", ["9" * 30, "9" * 5000, "-1", "²", "1.5"])
def test_numbers_in_addresses_are_bounded(client, path, number):
    assert client.get(f"{path}{number}").status_code == 404


def test_questions_of_much_come_later(reviewable, monkeypatch):
    monkeypatch.setattr("tsuiseki.tracking.review.reviewed.AT_ONCE", 0)
    session = Session(reviewable)
    reviewed = Reviewed(session, "result")
    for _ in range(200):
        if not reviewed.state["ranking"]:
            break
        reviewed._unranked.wait(0.05)
    assert len(reviewed.state["questions"]) > 0
    boxes = reviewed.state["boxes"]
    state = reviewed.change("correct", {"kind": "name", "ids": [1], "name": "Ann"})
    assert state["ranking"]
    assert state["boxes"] != boxes
    session.close()


def test_a_folder_that_cannot_be_written_to_is_refused_at_the_start(reviewable, monkeypatch, capsys):
    monkeypatch.setattr(output.tempfile, "TemporaryFile", full)
    assert main(["review", str(reviewable)]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "cannot write to" in error


@pytest.mark.parametrize("place", ["/proc/none", "/proc"])
def test_outputs_are_refused_before_anything_is_computed(inputs, monkeypatch, capsys, place):
    """Rights bind no superuser, but nobody can make a file in /proc."""
    if not output.Path("/proc/self").exists():
        pytest.skip("there is no /proc here")
    monkeypatch.setattr("tsuiseki.tracking.video.source.open_source", lambda *_, **__: pytest.fail("opened"))
    assert main(["scene", str(inputs.video), "--out", f"{place}/scene.yaml"]) == 2
    assert "cannot write to" in capsys.readouterr().err
    assert main(["track", "people", str(inputs.video), "--out", f"{place}/out"]) == 2
    assert "cannot write to" in capsys.readouterr().err
