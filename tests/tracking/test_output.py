"""Results are whole or not there, and never replace others unasked."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.output import RunRecord, output_file, output_folder, whole_file


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
