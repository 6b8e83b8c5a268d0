"""Many videos give what each gives by itself, whatever dies on the way."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from tsuiseki.tracking.batch import run
from tsuiseki.tracking.batch.executors import Processes
from tsuiseki.tracking.batch.jobs import STATE, Job
from tsuiseki.tracking.batch.run import BatchOptions, run_batch
from tsuiseki.tracking.batch.tasks import BatchTask
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RunError


def facts(folder: Path) -> dict[str, Any]:
    """What ``run.json`` says but for time that it took."""
    record = json.loads((folder / "run.json").read_text())
    record["facts"].pop("view", None)
    return {name: record[name] for name in record if name not in ("seconds", "settings")}


@pytest.mark.slow
def test_segments_of_five_videos_give_what_one_process_gives(
    videos: Path, networks: list[str], tmp_path: Path, here: Any
) -> None:
    words = [*networks, "--view", "1", "--score-threshold", "0.05", "--threads", "1"]
    assert (
        main(["batch", "track", "people", str(videos), *words, "--segment", "0.6", "--out", str(tmp_path / "all")]) == 0
    )
    assert here.kinds().count("begin") == here.kinds().count("finish") == 5
    assert here.kinds().count("detect") > 15
    for source in videos.iterdir():
        assert main(["track", "people", str(source), *words, "--out", str(tmp_path / source.stem)]) == 0
        whole, parts = tmp_path / source.stem, tmp_path / "all" / source.stem
        assert (parts / "tracks.txt").read_bytes() == (whole / "tracks.txt").read_bytes()
        assert (parts / "tracks.txt").stat().st_size > 1000
        assert facts(parts) == facts(whole)


@pytest.mark.slow
@pytest.mark.parametrize(
    "more", [["--moving-camera", "--view", "1"], ["--method", "sort", "--frames", "11-48"], ["--overlay"]]
)
def test_so_do_other_options(videos: Path, networks: list[str], tmp_path: Path, here: Any, more: list[str]) -> None:
    networks = networks if "sort" not in more else networks[:2]
    words = [str(videos / "coded.mp4"), *networks, "--score-threshold", "0.05", "--threads", "1", *more]
    assert main(["batch", "track", "people", *words, "--segment", "0.4", "--out", str(tmp_path / "all")]) == 0
    assert main(["track", "people", *words, "--out", str(tmp_path / "one")]) == 0
    assert here.kinds().count("detect") >= 3
    for name in ("tracks.txt", *(["overlay.webm"] if "--overlay" in more else [])):
        assert (tmp_path / "all/coded" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()


@pytest.mark.slow
def test_a_killed_process_costs_its_segment(videos: Path, networks: list[str], tmp_path: Path) -> None:
    class Deadly(Processes):
        killed = 0

        def submit(self, task: BatchTask) -> None:
            super().submit(task)
            if task.kind == "detect" and task.part == 1 and self.killed < 2:
                self.killed += 1
                worker = next(worker for worker in self._workers if worker.task is task)
                os.kill(worker.process.pid or 0, signal.SIGKILL)

    executor = Deadly(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "_executor", lambda _: (executor, False))
        found = run_batch([str(videos / "still.avi")], people(networks), BatchOptions(out=tmp_path / "o", segment=1.0))
    assert (found[0].status, executor.killed) == ("done", 2)
    events = journal(tmp_path / "o")
    assert [event["kind"] for event in events if event["event"] == "lost"] == ["detect", "detect"]
    detected = [event["part"] for event in events if event["event"] == "done" and event["kind"] == "detect"]
    assert sorted(detected) == [*range(len(detected))]


@pytest.mark.slow
def test_what_kills_every_process_is_one_failed_row(videos: Path, networks: list[str], tmp_path: Path) -> None:
    class Fatal(Processes):
        def submit(self, task: BatchTask) -> None:
            super().submit(task)
            if task.job.name == "web":
                os.kill(self._workers[0].process.pid or 0, signal.SIGKILL)

    executor = Fatal(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "_executor", lambda _: (executor, False))
        sources = [str(videos / "web.webm"), str(videos / "still.avi")]
        found = run_batch(sources, people(networks), BatchOptions(out=tmp_path / "o"))
    assert [row.status for row in found] == ["failed", "done"]
    assert "ended from outside" in found[0].line


def people(networks: list[str]) -> Job:
    names = [word[2:] for word in networks[::2]]
    return Job(("track", "people"), "", "", {"view": "1", **dict(zip(names, networks[1::2], strict=True))})


def journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / STATE / "journal.jsonl").read_text().splitlines()]


@pytest.mark.slow
def test_the_same_command_goes_on_after_a_kill(
    videos: Path, networks: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "o"
    words = [
        "batch",
        "track",
        "people",
        str(videos / "pictures"),
        *networks,
        "--view",
        "1",
        "--segment",
        "0.16",
        "--workers",
        "1",
        "--out",
        str(out),
    ]
    program = f"import sys; from tsuiseki.tracking.cli import main; sys.exit(main({words!r}))"
    driver = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True)
    wait_for(lambda: (out / STATE / "journal.jsonl").exists() and count(out, "detect") >= 2)
    assert main(words) == 2
    assert "another batch is writing" in capsys.readouterr().err
    driver.send_signal(signal.SIGINT)
    assert (
        driver.communicate(timeout=30)[1]
        == "tsuiseki: interrupted; what is finished is kept; the same command goes on\n"
    )
    driver = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.DEVNULL)
    detected = count(out, "detect")
    wait_for(lambda: count(out, "detect") > detected)
    driver.kill()
    driver.wait()
    before = count(out, "detect")
    assert before < 15
    assert main(["batch", "status", str(out)]) == 0
    assert capsys.readouterr().out.startswith("not running: 0 of 1 videos done, 1 begun")
    assert main(words) == 0
    # The worker may finish a segment after its driver was killed: no journal names that one, and it is kept, too.
    assert 14 <= count(out, "detect") <= 17
    assert main(["batch", "status", str(out)]) == 0
    assert "1 of 1 videos done" in capsys.readouterr().out
    alone = ["track", "people", str(videos / "pictures"), *networks, "--view", "1", "--out", str(tmp_path / "alone")]
    assert main(alone) == 0
    assert (out / "pictures/tracks.txt").read_bytes() == (tmp_path / "alone/tracks.txt").read_bytes()


def count(out: Path, kind: str) -> int:
    text = (out / STATE / "journal.jsonl").read_text()
    return len(re.findall(rf'"event": "done".*"kind": "{kind}"', text))


def wait_for(true: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
def test_results_are_known_by_content(
    videos: Path, networks: list[str], tmp_path: Path, here: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "clip.avi"
    video.write_bytes((videos / "still.avi").read_bytes())
    words = ["batch", "track", "people", str(video), *networks, "--view", "1", "--out", str(tmp_path / "o")]
    assert main(words) == 0
    os.utime(video, (1, 1))
    here.tasks.clear()
    assert main(words) == 0
    assert here.kinds() == ["begin"]
    assert "clip: kept" in capsys.readouterr().out
    assert main([*words, "--ground", "off"]) == 2
    assert "a result of other settings (ground auto, now off)" in capsys.readouterr().err
    video.write_bytes((videos / "web.webm").read_bytes())
    assert main(words) == 1
    assert "clip: failed" in capsys.readouterr().out
    assert main([*words, "--overwrite"]) == 0


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_a_broken_video_fails_alone(
    videos: Path, networks: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "broken.mp4").write_bytes(b"nothing")
    whole = (videos / "still.avi").read_bytes()
    (folder / "cut.avi").write_bytes(whole[: len(whole) // 2])
    (folder / "fine.avi").write_bytes(whole)
    out = tmp_path / "o"
    assert (
        main(["batch", "track", "people", str(folder), *networks, "--view", "1", "--segment", "1", "--out", str(out)])
        == 1
    )
    rows = [line.split(",", 2)[:2] for line in (out / "summary.csv").read_text().splitlines()[1:]]
    assert rows == [["broken", "failed"], ["cut", "failed"], ["fine", "done"]]
    page = (out / "index.html").read_text()
    assert 'href="fine/report.html"' in page
    assert "expected a video that FFmpeg can decode" in page
    assert "breaks off after frame" in page
    # What was there before the break is kept, as by `track people`.
    assert json.loads((out / "cut/run.json").read_text())["partial"] is True
    capsys.readouterr()
    assert main(["batch", "status", str(out)]) == 0
    assert "2 failed" in capsys.readouterr().out


@pytest.mark.slow
def test_a_full_disk_stops_and_the_same_goes_on(
    videos: Path, networks: list[str], tmp_path: Path, here: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tsuiseki.tracking.batch import segments

    class Full:
        def __init__(self, write: Any) -> None:
            self.write, self.left = write, 2

        def __call__(self, *values: Any, **more: Any) -> None:
            self.left -= 1
            if self.left < 0:
                raise OSError(28, "No space left on device")
            self.write(*values, **more)

    how = BatchOptions(out=tmp_path / "o", segment=1.0)
    with monkeypatch.context() as patch:
        patch.setattr(segments.np, "savez", Full(segments.np.savez))
        with pytest.raises(RunError, match=r"no space is left .* it goes on"):
            run_batch([str(videos / "still.avi")], people(networks), how)
    assert [path.name for path in (tmp_path / "o/.batch/still").iterdir() if path.name.endswith("unfinished")] == []
    here.tasks.clear()
    assert run_batch([str(videos / "still.avi")], people(networks), how)[0].status == "done"
    assert here.kinds().count("detect") == 4


def test_fewer_than_no_workers_are_refused_by_their_name(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="workers"):
        BatchOptions(out=tmp_path / "o", workers=-1)
