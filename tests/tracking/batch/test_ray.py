"""The same on Ray, on this machine: what dies costs its segment, and Ray keeps its lines to itself."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from tsuiseki.tracking.batch.executors import RayTasks
from tsuiseki.tracking.batch.jobs import STATE
from tsuiseki.tracking.batch.run import BatchOptions, run_batch
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError

from .test_batch import count, people, wait_for

pytestmark = [pytest.mark.ray, pytest.mark.slow, pytest.mark.paced]


def command(videos: Path, networks: list[str], out: Path) -> list[str]:
    words = ["batch", "track", "people", str(videos / "pictures"), str(videos / "still.avi"), *networks, "--view", "1"]
    return [*words, "--segment", "0.4", "--workers", "2", "--ray=here", "--out", str(out)]


def started(words: list[str], **more: Any) -> subprocess.Popen[str]:
    program = f"import sys; from tsuiseki.tracking.cli import main; sys.exit(main({words!r}))"
    return subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True, **more)


def children(driver: subprocess.Popen[str], name: str) -> list[psutil.Process]:
    return [each for each in psutil.Process(driver.pid).children(recursive=True) if name in " ".join(each.cmdline())]


def test_ray_gives_the_same_and_a_killed_worker_costs_a_segment(
    videos: Path, networks: list[str], tmp_path: Path
) -> None:
    driver = started(command(videos, networks, tmp_path / "o"))
    wait_for(lambda: (tmp_path / "o" / STATE / "journal.jsonl").exists() and count(tmp_path / "o", "begin"))
    for worker in children(driver, "ray::_do"):
        worker.kill()
    _, said = driver.communicate(timeout=240)
    assert (driver.returncode, said) == (0, "")
    how = BatchOptions(out=tmp_path / "here", segment=0.4, workers=1)
    run_batch([str(videos / "pictures"), str(videos / "still.avi")], people(networks), how)
    for name in ("pictures", "still"):
        assert (tmp_path / "o" / name / "tracks.txt").read_bytes() == (
            tmp_path / "here" / name / "tracks.txt"
        ).read_bytes()


def test_a_killed_raylet_ends_the_batch_in_a_line_and_the_same_goes_on(
    videos: Path, networks: list[str], tmp_path: Path
) -> None:
    words = command(videos, networks, tmp_path / "o")
    driver = started(words)
    wait_for(lambda: (tmp_path / "o" / STATE / "journal.jsonl").exists() and count(tmp_path / "o", "detect"))
    for raylet in children(driver, "raylet/raylet"):
        raylet.kill()
    _, said = driver.communicate(timeout=180)
    assert driver.returncode == 1
    assert "give the same command again: it goes on" in said
    assert len(said.strip().splitlines()) == 1
    before = count(tmp_path / "o", "detect")
    driver = started([word for word in words if word != "--ray=here"])
    assert driver.wait(120) == 0
    # 8 and 15 segments; two under way and two that waited on Ray are done again.
    assert before < 23 <= count(tmp_path / "o", "detect") <= 27


@pytest.mark.parametrize("address", ["127.0.0.1:{0}", "nowhere", "auto"])
def test_a_ray_that_does_not_answer_is_said_in_a_line(
    videos: Path, tmp_path: Path, address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = address.format(free.getsockname()[1])
    words = ["batch", "track", "people", str(videos), f"--ray={address}", "--out", str(tmp_path / "o")]
    assert main(words) == 2
    said = capsys.readouterr().err
    assert said.startswith("tsuiseki: --ray: ")
    assert len(said.splitlines()) == 1


def test_another_version_is_said_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    def refuse(**_: Any) -> None:
        raise RuntimeError(
            "Version mismatch: The cluster was started with:\n    Ray: 2.9.0\n    Python: 3.10\nThis process"
        )

    monkeypatch.setattr(ray, "init", refuse)
    with pytest.raises(RequestError, match=r"runs Ray 2.9.0, here is .*; install the same"):
        RayTasks("auto", 1)


def test_a_gpu_that_no_machine_has_is_not_waited_for(videos: Path, networks: list[str], tmp_path: Path) -> None:
    how = BatchOptions(out=tmp_path / "o", ray="here", workers=1, gpus=0.5)
    with pytest.raises(RequestError, match="no machine of this Ray has"):
        run_batch([str(videos / "still.avi")], people(networks), how)
