"""`tsuiseki track people --events`: a recording gives events on its way or at its end, and bad input a line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.tracking.events.test_camera_events import VALID
from tsuiseki.tracking.cli import main

SCENE = "lines: [{name: door, from: [100, 0], to: [100, 200]}]\nevents: {counts: 2}\n"


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence that is text only: somebody walks from the left to the right in 5 s, somebody else stands."""
    folder = tmp_path_factory.mktemp("sequence") / "gate"
    (folder / "det").mkdir(parents=True)
    (folder / "seqinfo.ini").write_text(
        "[Sequence]\nname=gate\nframeRate=10\nseqLength=50\nimWidth=320\nimHeight=240\n"
    )
    rows = [f"{t + 1},-1,{x},60,20,60,0.9" for t in range(50) for x in (10 + 4 * t, 250)]
    (folder / "det/det.txt").write_text("\n".join(rows) + "\n")
    (folder.parent / "scene.yaml").write_text(SCENE)
    return folder


# Methods that answer at once, at the end, and with a delay.
HOWS = [
    pytest.param(("sort",), id="sort"),
    pytest.param(("flow",), id="flow", marks=pytest.mark.slow),
    pytest.param(("flow", "--delay", "1"), id="delay", marks=pytest.mark.slow),
]


def words_of(sequence: Path, out: Path, *more: str) -> list[str]:
    given = ["--detections", str(sequence / "det/det.txt"), "--affinity", "none", "--appearance", "none"]
    given = given if "flow" in more else [*given[:2]]
    return ["track", "people", str(sequence), *given, "--out", str(out), *more]


def events_in(path: Path) -> list[dict[str, Any]]:
    events = [json.loads(line) for line in path.read_text().splitlines()]
    for event in events:
        VALID.validate(event)
    return events


@pytest.mark.slow
@pytest.mark.parametrize("how", HOWS)
def test_a_recording_gives_events(how: tuple[str, ...], sequence: Path, tmp_path: Path) -> None:
    file, scene = tmp_path / "events.jsonl", sequence.parent / "scene.yaml"
    more = ("--method", *how, "--events", str(file), "--scene", str(scene))
    assert main(words_of(sequence, tmp_path / "o", *more)) == 0
    events = events_in(file)
    types = [event["type"].removeprefix("tsuiseki.") for event in events]
    assert [types.count(name) for name in ("appeared", "crossed", "counted", "lost")] == [2, 1, 3, 0]
    (crossed,) = (event["data"] for event in events if event["type"].endswith("crossed"))
    (walker,) = (event["data"]["person"] for event in events if event["type"].endswith("appeared")
                 and event["data"]["box"][0] < 100)  # fmt: skip
    # Feet are at 20 + 4 t; the band is 12 pixels, a fifth of the height.
    assert (crossed["person"], crossed["line"]) == (walker, "door")
    assert crossed["frame"] == pytest.approx(24, abs=1)
    assert {event["source"] for event in events} == {"gate"}
    assert not [event for event in events if "time" in event]
    assert not (tmp_path / "o/.events.sqlite").exists()
    assert json.loads((tmp_path / "o/run.json").read_text())["settings"]["events"] == str(file)


@pytest.mark.slow
def test_a_file_of_events_goes_on(sequence: Path, tmp_path: Path) -> None:
    file = tmp_path / "events.jsonl"
    for name in "ab":
        assert main(words_of(sequence, tmp_path / name, "--method", "sort", "--events", str(file))) == 0
    ids = [event["id"] for event in events_in(file)]
    assert len(set(ids)) == len(ids)
    assert len({name.split("-")[0] for name in ids}) == 2


@pytest.mark.slow
def test_the_program_s_output_has_events_alone(sequence: Path, tmp_path: Path) -> None:
    code = "import sys; from tsuiseki.tracking.cli import main; sys.exit(main(sys.argv[1:]))"
    words = words_of(sequence, tmp_path / "o", "--method", "sort", "--events", "-")
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) > 3
    for line in lines:
        VALID.validate(json.loads(line))
    assert "2 people in 50 frames" in done.stderr


def test_a_receiver_that_is_not_there_lets_the_run_go_on(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.tracking.events import delivery

    monkeypatch.setattr(delivery.Delivery.__init__, "__defaults__", (0.2,))
    address = "http://user:secret@127.0.0.1:9/events"
    assert main(words_of(sequence, tmp_path / "o", "--method", "sort", "--events", address)) == 0
    error = capsys.readouterr().err
    assert "note: http://127.0.0.1:9/events does not take events (Connection refused); they wait" in error
    assert "the same command sends them" in error
    assert "secret" not in error
    assert (tmp_path / "o/tracks.txt").stat().st_size
    assert (tmp_path / "o/.events.sqlite").stat().st_size
    assert json.loads((tmp_path / "o/run.json").read_text())["settings"]["events"] == "http://127.0.0.1:9/events"


def test_a_run_without_end_keeps_no_password(sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tsuiseki.tracking.events import delivery

    monkeypatch.setattr(delivery.Delivery.__init__, "__defaults__", (0.2,))
    filmed = tmp_path / "gate"
    shutil.copytree(sequence, filmed)
    (filmed / "img1").mkdir()
    for frame in range(50):
        cv2.imwrite(str(filmed / f"img1/{frame + 1:06d}.jpg"), np.zeros((240, 320, 3), np.uint8))
    address = "http://user:s@c:ret@127.0.0.1:9/events"
    assert main(words_of(filmed, tmp_path / "o", "--method", "sort", "--events", address, "--roll", "1")) == 0
    for name in ("live.json", "run.json"):
        text = (tmp_path / "o" / name).read_text()
        assert "http://127.0.0.1:9/events" in text
        assert "ret@" not in text


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--events", "ftp://h"], "--events: expected -, a file, or an address"),
        (["--events", "/nowhere/\0"], "--events"),
        (["--scene", "scene.yaml"], "expected --scene with --events, --page or --overlay, got it alone"),
        (["--events", "-", "--scene", "none.yaml"], "expected YAML with lines and zones at none.yaml"),
    ],
)
def test_what_cannot_be_watched_is_refused_in_a_line(
    more: list[str], line: str, sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words_of(sequence, tmp_path / "o", "--method", "sort", *more)) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not (tmp_path / "o").exists()


def test_a_scene_of_another_size_is_refused(sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text("size: [640, 480]\n" + SCENE)
    more = ("--method", "sort", "--events", "-", "--scene", str(scene))
    assert main(words_of(sequence, tmp_path / "o", *more)) == 2
    assert "expected the size of the video, got 640x480" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["events: {moves: 0}", "events: {rate: 1}", "events: 3", "events: {counts: yes}"])
def test_wrong_intervals_are_refused(content: str, sequence: Path, tmp_path: Path, capsys: Any) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.splitlines()[0] + "\n" + content)
    assert main(words_of(sequence, tmp_path / "o", "--method", "sort", "--events", "-", "--scene", str(scene))) == 2
    assert "scene.yaml: events" in capsys.readouterr().err


def test_a_detector_that_sees_nothing_gives_counts_alone(sequence: Path, tmp_path: Path) -> None:
    nothing = tmp_path / "det.txt"
    nothing.write_text("1,-1,0,0,20,60,0.01\n")
    words = ["track", "people", str(sequence), "--detections", str(nothing), "--method", "sort", "--score-threshold"]
    file = tmp_path / "events.jsonl"
    assert main([*words, "0.5", "--out", str(tmp_path / "o"), "--events", str(file)]) == 0
    (counted,) = events_in(file)
    assert counted["data"] | {"end": 0} == {
        "start": 0.0, "end": 0, "frames": 50, "people": 0.0, "most": 0, "lines": {}, "zones": {},
    }  # fmt: skip
    assert np.isclose(counted["data"]["end"], 4.9)
