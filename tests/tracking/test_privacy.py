"""A record of privacy goes with a result into its run.json, its page and its hidden video, and deletes it in time."""

from __future__ import annotations

import json
import shutil
from datetime import date, timedelta
from pathlib import Path

import pytest

from tests.tracking.runs.test_run import square_on_noise
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.scene import read_scene, scene_text
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.privacy import Privacy, read_privacy, today

RECORD = "privacy: {purpose: count, area: door <east>, retention: 30, access: manager}\n"
LINES = "lines: [{name: door, from: [0, 40], to: [100, 40]}]\n"


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a clip, a scene, and in ``results/kept`` the result of a run with a record of privacy."""
    tmp_path = tmp_path_factory.mktemp("privacy")
    clip, record, out = square_on_noise(tmp_path / "clip"), tmp_path / "scene.yaml", tmp_path / "results" / "kept"
    record.write_text(LINES + RECORD)
    (tmp_path / "det.txt").write_text("".join(f"{n},-1,{18 + 3 * n},31,20,20,0.9\n" for n in range(1, 11)))
    words = ["--detections", str(tmp_path / "det.txt"), "--method", "sort"]
    assert main(["track", "people", str(clip), *words, "--privacy", str(record), "--out", str(out)]) == 0
    return tmp_path


@pytest.fixture
def kept(tracked: Path, tmp_path: Path) -> Path:
    """The result in a copy of the folder."""
    shutil.copytree(tracked, tmp_path, dirs_exist_ok=True)
    return tmp_path / "results" / "kept"


def set_made(folder: Path, days_ago: int) -> None:
    path = folder / "run.json"
    values = json.loads(path.read_text())
    values["facts"]["privacy"]["made"] = (today() - timedelta(days=days_ago)).isoformat()
    path.write_text(json.dumps(values))


def test_the_record_is_read_from_a_file_of_its_own_and_from_a_scene(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(RECORD)
    (tmp_path / "scene.yaml").write_text(LINES + RECORD)
    record = read_privacy(tmp_path / "own.yaml")
    assert record == Privacy(purpose="count", area="door <east>", retention=30, access="manager")
    scene = read_scene(tmp_path / "scene.yaml")
    assert record == read_privacy(tmp_path / "scene.yaml") == scene.privacy
    (tmp_path / "again.yaml").write_text(scene_text(scene))
    assert read_scene(tmp_path / "again.yaml").privacy == record
    assert record.facts(date(2026, 1, 31)).items() >= {"made": "2026-01-31", "until": "2026-03-02"}.items()


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lines: []\n", "expected privacy with purpose, area, retention, access, found none"),
        ("privacy: {purpose: count}\n", "privacy: expected purpose, area, retention, access, got"),
        (RECORD.replace("30", "-1"), "privacy: `retention`"),
        (RECORD.replace("30", "soon"), "privacy: `retention`"),
        (RECORD.replace("count", "' '"), "privacy: `purpose`"),
        ("- privacy\n", "expected privacy with"),
    ],
)
def test_a_record_that_is_not_whole_is_refused_in_a_line(text: str, line: str, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(RequestError, match=line) as refused:
        read_privacy(tmp_path / "bad.yaml")
    assert "\n" not in str(refused.value)


def test_the_run_and_its_page_have_the_record(kept: Path) -> None:
    record = json.loads((kept / "run.json").read_text())["facts"]["privacy"]
    assert record["purpose"] == "count"
    assert record["until"] == (today() + timedelta(days=30)).isoformat()
    page = (kept / "report.html").read_text()
    assert "door &lt;east&gt;" in page
    assert "manager" in page


@pytest.mark.slow
@pytest.mark.parametrize("asked", [LINES + RECORD, LINES], ids=["of the scene", "of the result"])
def test_counts_have_the_record(asked: str, kept: Path, tmp_path: Path) -> None:
    out = tmp_path / "answers"
    (tmp_path / "scene.yaml").write_text(asked)
    assert main(["count", str(kept), "--scene", str(tmp_path / "scene.yaml"), "--out", str(out)]) == 0
    assert json.loads((out / "run.json").read_text())["facts"]["privacy"]["access"] == "manager"
    assert "door &lt;east&gt;" in (out / "report.html").read_text()


def test_linked_results_have_the_record_whose_days_end_first(kept: Path, tmp_path: Path) -> None:
    shorter, bare = tmp_path / "results" / "shorter", tmp_path / "results" / "bare"
    for number, folder in enumerate((shorter, bare), 1):
        shutil.copytree(kept, folder)
        tracks = (folder / "tracks.txt").read_text().splitlines()
        (folder / "tracks.txt").write_text("\n".join(tracks[: -3 * number]) + "\n")
        values = json.loads((folder / "run.json").read_text())
        values["facts"]["privacy"] |= {"retention": 7, "until": (today() + timedelta(days=7)).isoformat()}
        if folder == bare:
            del values["facts"]["privacy"]
        (folder / "run.json").write_text(json.dumps(values))
    words = ["link", str(kept), str(shorter), str(bare), "--appearance", "none", "--out", str(tmp_path / "linked")]
    assert main(words) == 0
    assert json.loads((tmp_path / "linked/run.json").read_text())["facts"]["privacy"]["retention"] == 7
    set_made(tmp_path / "linked", 8)
    assert main(["forget", str(tmp_path)]) == 0
    assert not list(tmp_path.glob("linked/*/tracks.txt"))
    assert list(kept.glob("tracks.txt"))


@pytest.mark.parametrize("name", ["hidden.webm", "hidden.mp4"])
def test_the_hidden_video_has_the_record(name: str, kept: Path, tmp_path: Path) -> None:
    import av

    assert main(["hide", str(kept), str(tmp_path / "clip"), "--out", str(tmp_path / name)]) == 0
    with av.open(str(tmp_path / name)) as video:
        metadata = {key.lower(): value for key, value in video.metadata.items()}
    assert "purpose: count; area: door <east>; retention: 30; access: manager" in metadata["comment"]


def test_results_are_deleted_by_their_record(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (kept / "notes.txt").write_text("of the user")
    set_made(kept, 30)
    assert main(["forget", str(kept.parent)]) == 0
    assert (kept / "tracks.txt").exists()
    set_made(kept, 31)
    assert main(["forget", str(kept.parent)]) == 0
    assert [path.name for path in kept.iterdir()] == ["notes.txt"]
    assert "1 of 1 results deleted" in capsys.readouterr().out


def test_results_older_than_so_many_days_are_deleted(kept: Path) -> None:
    set_made(kept, 8)
    assert main(["forget", str(kept), "--older-than", "8"]) == 0
    assert kept.exists()
    assert main(["forget", str(kept), "--older-than", "7"]) == 0
    assert not kept.exists()


def test_what_cannot_be_deleted_is_said(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["forget", str(kept.parent.parent / "clip")]) == 2
    assert "found no run.json" in capsys.readouterr().err
    values = json.loads((kept / "run.json").read_text())
    values["facts"]["privacy"]["made"] = "soon"
    (kept / "run.json").write_text(json.dumps(values))
    assert main(["forget", str(kept)]) == 2
    assert "privacy: expected made and retention" in capsys.readouterr().err
    del values["facts"]["privacy"]
    (kept / "run.json").write_text(json.dumps(values))
    assert main(["forget", str(kept)]) == 0
    assert kept.exists()
