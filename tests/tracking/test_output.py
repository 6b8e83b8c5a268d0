"""Results are whole or not there, and never replace others unasked."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.output import RunRecord, is_partial, landing, output_file, output_folder, whole_file
from tsuiseki.tracking.runs.messages import message_of


def names(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}


def write_result(folder: Path, files: dict[str, str], overwrite: bool = False) -> None:
    with output_folder(folder, overwrite) as work:
        for name, text in files.items():
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            (work / name).write_text(text)
        RunRecord(["test"], {}).write(work)


@pytest.mark.parametrize("existed", [False, True])
def test_nothing_is_there_until_all_is(tmp_path: Path, existed: bool) -> None:
    folder = tmp_path / "out" / "result"
    if existed:
        folder.mkdir(parents=True)
    with output_folder(folder, overwrite=False) as work:
        (work / "tracks.txt").write_text("done")
        assert not (folder / "tracks.txt").exists()
    assert names(folder) == {"tracks.txt"}
    assert [p.name for p in folder.parent.iterdir()] == ["result"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
@pytest.mark.parametrize("existed", [False, True])
def test_a_failure_leaves_what_was_there(tmp_path: Path, error: type[BaseException], existed: bool) -> None:
    folder = tmp_path / "result"
    if existed:
        write_result(folder, {"tracks.txt": "old"})
    before = names(tmp_path)
    with pytest.raises(error), output_folder(folder, overwrite=True) as work:  # noqa: PT012
        (work / "tracks.txt").write_text("half")
        raise error
    assert names(tmp_path) == before
    assert folder.exists() == existed


def test_a_result_is_not_replaced_unasked(tmp_path: Path) -> None:
    write_result(tmp_path / "r", {"tracks.txt": "old"})
    with pytest.raises(RequestError, match=r"already holds run.json, tracks.txt; .* `overwrite`"):
        write_result(tmp_path / "r", {"tracks.txt": "new"})
    assert (tmp_path / "r" / "tracks.txt").read_text() == "old"


def test_overwriting_removes_the_old_result_and_nothing_else(tmp_path: Path) -> None:
    folder = tmp_path / "r"
    write_result(folder, {"tracks.txt": "old", "report/a.csv": "old", "img1/1.jpg": "old", "img1/2.jpg": "old"})
    (folder / "my notes.txt").write_text("keep me")
    write_result(folder, {"tracks.txt": "new", "img1/1.jpg": "new"}, overwrite=True)
    assert not (folder / "report").exists()
    assert names(folder) == {"tracks.txt", "img1/1.jpg", "run.json", "my notes.txt"}
    assert (folder / "tracks.txt").read_text() == "new"
    assert json.loads((folder / "run.json").read_text())["files"] == ["img1/1.jpg", "tracks.txt"]


@pytest.mark.parametrize("name", ["../victim.txt", "/victim.txt", "link/victim.txt"])
def test_a_list_of_files_leads_nowhere_else(tmp_path: Path, name: str) -> None:
    folder, victim = tmp_path / "r", tmp_path / "victim.txt"
    folder.mkdir()
    victim.write_text("keep me")
    (folder / "link").symlink_to(tmp_path)
    (folder / "run.json").write_text(
        json.dumps({"files": [name.replace("/victim", str(victim)[:-4]) if name[0] == "/" else name]})
    )
    write_result(folder, {"tracks.txt": "new"}, overwrite=True)
    assert victim.read_text() == "keep me"


def test_places_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("keep me")
    with pytest.raises(RequestError, match="is a file"):
        write_result(file, {}, overwrite=True)
    with pytest.raises(RequestError, match="cannot write"):
        write_result(file / "below", {})
    with pytest.raises(RequestError, match="already exists"), output_file(file, overwrite=False):
        pass
    with pytest.raises(RequestError, match="is a folder"), output_file(tmp_path, overwrite=True):
        pass
    assert file.read_text() == "keep me"


def test_a_file_is_replaced_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "scores.json"
    file.write_text("old")
    with pytest.raises(ValueError, match="broken"), output_file(file, overwrite=True) as work:  # noqa: PT012
        work.write_text("half")
        raise ValueError("broken")
    assert file.read_text() == "old"
    with output_file(file, overwrite=True) as work:
        work.write_text("new")
    assert file.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["scores.json"]


def test_a_kept_file_is_whole_or_as_before(tmp_path: Path) -> None:
    file = tmp_path / "deeper" / "entry.npz"
    with whole_file(file) as work:
        work.write(b"old")
        assert not file.exists()
    with pytest.raises(ValueError, match="broken"), whole_file(file) as work:  # noqa: PT012
        work.write(b"half")
        raise ValueError("broken")
    assert file.read_bytes() == b"old"
    with whole_file(file) as work:
        work.write(b"new")
    assert file.read_bytes() == b"new"
    assert [path.name for path in file.parent.iterdir()] == ["entry.npz"]
    with pytest.raises(RequestError, match="cannot write to"), whole_file(file / "below.npz"):
        pass


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# The record, a stale file, a file and a folder go; a file, a folder and the record come.
@pytest.mark.parametrize("number", range(1, 8))
def test_a_failure_while_files_take_their_names_brings_the_old_result_back(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, calls, rename = tmp_path / "r", [], Path.rename
    write_result(folder, {"tracks.txt": "old", "report/a.csv": "old", "img1/1.jpg": "old"})
    (folder / "mine.txt").write_text("mine")
    before = contents(folder)

    def failing(self: Path, target: Path) -> Path:
        calls.append(target)
        if len(calls) == number:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OSError, match="No space left on device") as error:
        write_result(folder, {"tracks.txt": "new", "img1/1.jpg": "new"}, overwrite=True)
    monkeypatch.undo()
    assert error.value.filename == str(folder)
    assert contents(folder) == before
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


def test_a_partial_result_lies_beside_a_whole_one_and_in_place_of_a_partial_one(tmp_path: Path) -> None:
    folder, beside = tmp_path / "r", tmp_path / "r.partial"
    write_result(folder, {"tracks.txt": "old"})
    before = contents(folder)
    for text in ("first", "second"):
        with output_folder(folder, overwrite=True) as work:
            (work / "tracks.txt").write_text(text)
            RunRecord(["test"], {}, partial=True, reason="disk full").write(work)
            assert landing(work, folder) == beside
        assert contents(folder) == before
        assert (beside / "tracks.txt").read_text() == text
    assert is_partial(beside)
    with output_folder(beside, overwrite=True) as work:
        (work / "tracks.txt").write_text("third")
        RunRecord(["test"], {}, partial=True).write(work)
    assert (beside / "tracks.txt").read_text() == "third"
    assert names(tmp_path) == {"r/run.json", "r/tracks.txt", "r.partial/run.json", "r.partial/tracks.txt"}


def test_a_folder_that_is_removed_meanwhile_is_said(tmp_path: Path) -> None:
    with (
        pytest.raises(RunError, match=r"/r was removed while the run wrote into it; nothing was written"),
        output_folder(tmp_path / "r", overwrite=False),
    ):
        shutil.rmtree(tmp_path / "r")
    (tmp_path / "s").mkdir()
    with (
        pytest.raises(RunError, match=r"/s was removed while the run wrote into it; nothing was written"),
        output_file(tmp_path / "s" / "scores.json", overwrite=False),
    ):
        shutil.rmtree(tmp_path / "s")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("write", [output_folder, output_file])
def test_a_full_disk_names_the_file(write: Any, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left") as error, write(tmp_path / "r", overwrite=False):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert message_of(error.value) == f"No space left on device ({tmp_path / 'r'})"


def test_an_error_that_is_not_of_the_disk_names_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConnectionError) as error, output_folder(tmp_path / "r", overwrite=False):
        raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
    assert message_of(error.value) == "Connection refused"
