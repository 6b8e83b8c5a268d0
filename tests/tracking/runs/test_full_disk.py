"""Disks that fill, folders that vanish and memory that ends: what was finished stays, and the line says what and where.

The limit on the size of a file stands for a disk that fills: writing fails in the same way, wherever it happens.
"""

from __future__ import annotations

import errno
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import pytest

from tests.tracking.runs.test_run import at_call, commands, lines_of, record_of, square_on_noise
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.points.tracker import BlobTracker
from tsuiseki.tracking.runs.files import RunFiles
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.video.webm import VideoWriter

SCENE = "size: [640, 480]\nlines:\n- {name: gate, from: [300, 0], to: [300, 480]}\n"


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return square_on_noise(tmp_path / "clip")


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def tracks(path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(f"{n},1,{40 * n},200,20,60,1,-1,-1,-1\n" for n in range(1, 13)))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("size", [400, 3_000, 20_000])
def test_a_finished_count_stays_whole_where_the_next_one_fills_the_disk(
    size: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    words = ["count", str(tracks(tmp_path / "t" / "tracks.txt")), "--scene", str(tmp_path / "scene.yaml"), "--fps", "5"]
    words += ["--out", str(tmp_path / "o")]
    assert main(words) == 0
    before = contents(tmp_path / "o")
    assert record_of(tmp_path / "o")["partial"] is False
    capsys.readouterr()
    with files_of_at_most(size):
        assert main([*words, "--overwrite"]) == 1
    assert contents(tmp_path / "o") == before
    (line,) = lines_of(capsys)
    assert line.startswith(f"tsuiseki: File too large ({tmp_path / 'o'}")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["people", "blobs", "single"])
def test_a_finished_result_stays_whole_where_the_next_one_breaks_off(
    name: str, clip: Path, tmp_path: Path, drone_models: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    words, file = commands(clip, drone_models)[name]
    assert main([*words, "--out", str(tmp_path / "o")]) == 0
    before = contents(tmp_path / "o")
    capsys.readouterr()

    def full() -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(VideoWriter, "write", at_call(4, full, VideoWriter.write))
    assert main([*words, "--overlay", "--out", str(tmp_path / "o"), "--overwrite"]) == 1
    assert contents(tmp_path / "o") == before
    assert record_of(tmp_path / "o.partial")["partial"] is True
    assert (tmp_path / "o.partial" / file).is_file()
    (line,) = [line for line in lines_of(capsys) if "note:" not in line]
    assert f"is in {tmp_path / 'o.partial'}, marked in its run.json; the whole one in {tmp_path / 'o'} stays" in line
    assert f"No space left on device ({tmp_path / 'o'}/overlay.webm)" in line


@pytest.mark.parametrize("to", ["sleap", "sleap-analysis"])
@pytest.mark.parametrize("size", [0, 100, 1_000, 2_500, 5_000])
def test_a_disk_that_fills_ends_hdf5_in_a_line_and_not_in_a_crash(to: str, size: int, tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    code = (
        "import resource, sys; from pathlib import Path; import numpy as np\n"
        "from tsuiseki.tracking.formats.sleap_hdf5 import write_sleap_analysis, write_sleap_project\n"
        "from tsuiseki.tracking.formats.tracked_video import TrackedVideo\n"
        "from tsuiseki.tracking.types.tracks import PointTable\n"
        "rng = np.random.default_rng(0)\n"
        "table = PointTable(('nose', 'tail'), np.arange(200), ('a',) * 200, rng.normal(size=(200, 2, 2)),"
        " rng.random((200, 2)))\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))\n"
        f"path = Path({str(tmp_path / 'a.h5')!r})\n"
        "try:\n"
        f"    write_sleap_analysis(path, table, 200) if {to!r} == 'sleap-analysis' else write_sleap_project(path,"
        " TrackedVideo([], 'a.mp4', 25.0, (64, 48), 200, points=table))\n"
        "except OSError as error:\n"
        "    print(error.strerror)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "File too large\n", "")


@pytest.mark.parametrize("name", ["people", "single", "blobs", "deformable", "drone"])
@pytest.mark.parametrize("call", [1, 2])
def test_an_output_folder_that_is_removed_is_said_and_nothing_is_claimed(
    name: str, call: int, clip: Path, drone_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    words, _ = commands(clip, drone_models)[name]
    monkeypatch.setattr(RunFiles, "write", at_call(call, lambda: shutil.rmtree(tmp_path / "o"), RunFiles.write))
    assert main([*words, "--out", str(tmp_path / "o")]) == 1
    said = capsys.readouterr()
    assert [line for line in said.err.splitlines() if line.startswith("tsuiseki:") and "note:" not in line] == [
        f"tsuiseki: {tmp_path / 'o'} was removed while the run wrote into it; nothing was written"
    ]
    assert f"{tmp_path / 'o'}/" not in said.out
    assert not (tmp_path / "o").exists()


LACKS = [MemoryError(), cv2.error("OpenCV: error: (-4:Insufficient memory) Failed to allocate 307200 bytes"),
         RuntimeError("std::bad_alloc")]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("error", LACKS)
@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("blobs", (BlobTracker, "update")),
        ("deformable", (DeformableTracker, "update_edges")),
        ("people", (FlowTracker, "update")),
    ],
)
def test_where_memory_ends_in_a_step_those_before_are_the_result(
    name: str, where: tuple[Any, str], error: Exception, clip: Path, drone_models: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    def fail() -> None:
        raise error

    words, file = commands(clip, drone_models)[name]
    monkeypatch.setattr(*where, at_call(7, fail, getattr(*where)))
    assert main([*words, "--out", str(tmp_path / "o")]) == 1
    record = record_of(tmp_path / "o")
    assert record["partial"] is True
    assert record["reason"].startswith("not enough memory")
    assert record["frames"]["frame"] == [1, 2, 3, 4, 5, 6]
    rows = (tmp_path / "o" / file).read_text().splitlines()
    assert all(int(row.split(",")[0]) <= 6 for row in rows if row[0].isdigit())
    (line,) = [line for line in lines_of(capsys) if "note:" not in line]
    assert line.startswith("tsuiseki: not enough memory")
    assert f"the partial result up to frame 7 is in {tmp_path / 'o'}" in line or "up to frame 6" in line


def test_in_the_first_step_it_is_said_and_nothing_is_written(
    clip: Path, drone_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(BlobTracker, "update", fail)
    assert main([*commands(clip, drone_models)["blobs"][0], "--out", str(tmp_path / "o")]) == 1
    assert lines_of(capsys) == ["tsuiseki: not enough memory"]
    assert not (tmp_path / "o").exists()


def test_a_mistake_of_ours_is_no_partial_result(
    clip: Path, drone_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise RuntimeError("something else")

    monkeypatch.setattr(BlobTracker, "update", at_call(7, fail, BlobTracker.update))
    with pytest.raises(RuntimeError, match="something else"):
        main([*commands(clip, drone_models)["blobs"][0], "--out", str(tmp_path / "o")])
    assert not (tmp_path / "o").exists()


def test_an_error_goes_on_where_steps_are_of_no_run() -> None:
    steps: list[Callable[[], Iterator[int]]] = [lambda: iter([1, 2]), lambda: (n for n in (1, 2))]
    for make in steps:
        numbers = make()
        with pytest.raises(MemoryError), reported_to(numbers):
            raise MemoryError


LATE_IMPORTS = """
import sys
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.runs.run import Run
steps, before = Run.steps, set()

def watched(self, items, *values, **named):
    for item in steps(self, items, *values, **named):
        before.update(() if before else sys.modules)
        yield item

Run.steps = watched
status = main(sys.argv[1:])
native = {name for name, module in sys.modules.items() if str(getattr(module, "__file__", "")).endswith(".so")}
print(status, *sorted(native - before))
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["people", "sort", "single", "blobs", "deformable"])
def test_no_library_is_loaded_after_the_first_step(name: str, clip: Path, drone_models: Path, tmp_path: Path) -> None:
    words = commands(clip, drone_models)["people" if name == "sort" else name][0]
    words = [*words[:5], "--method", "sort"] if name == "sort" else words
    command = [sys.executable, "-c", LATE_IMPORTS, *words, "--out", str(tmp_path / "o")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0"
