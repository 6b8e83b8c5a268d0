"""What runs cameras as a service: the steps of the Dockerfile in a plain environment, the compose file, the unit."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest
import yaml

from tsuiseki.tracking.cli.request import request_of

REPOSITORY = Path(__file__).resolve().parents[3]
DEPLOY = REPOSITORY / "docs/deploy"


def instructions() -> list[tuple[str, str]]:
    """Each instruction of the Dockerfile with its words, continued lines joined."""
    text = (DEPLOY / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(word, " ".join(rest.split())) for word, _, rest in (line.partition(" ") for line in lines)]


def test_the_dockerfile_has_at_most_25_lines_and_runs_as_somebody_without_rights() -> None:
    assert len((DEPLOY / "Dockerfile").read_text().splitlines()) <= 25
    words = dict(instructions())
    assert words["FROM"].startswith("python:3.")
    assert words["USER"] == "tsuiseki"
    assert words["STOPSIGNAL"] == "SIGINT"
    assert json.loads(words["ENTRYPOINT"]) == ["tsuiseki"]


@pytest.mark.parametrize("camera", ["entrance", "yard"])
def test_commands_of_the_compose_file_are_right_and_ask_for_their_own_health(
    camera: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    service = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"][camera]
    watching = request_of(shlex.split(service["command"])).arguments.arguments["watching"]
    checked = service.get("healthcheck", {}).get("test", [dict(instructions())["HEALTHCHECK"]])[-1]
    assert f":{watching.page}/health" in checked


def test_the_unit_starts_a_command_that_there_is_and_stops_it_by_an_interrupt() -> None:
    unit = configparser.ConfigParser(interpolation=None, strict=False)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(DEPLOY / "tsuiseki@.service")
    service = unit["Service"]
    assert re.search(r"tsuiseki track people --config /etc/tsuiseki/%i\.yaml --roll 1 --out \S+", service["ExecStart"])
    assert (service["KillSignal"], service["Restart"]) == ("SIGINT", "always")


@pytest.mark.slow
@pytest.mark.paced
def test_the_steps_of_the_dockerfile_give_a_run_that_is_healthy(tmp_path: Path) -> None:
    """Wheel, environment, start and health check, as the Dockerfile has them; the packages are of this environment."""
    build = [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path / "dist"), str(REPOSITORY)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = (tmp_path / "dist").glob("tsuiseki-*.whl")
    (install,) = (words for word, words in instructions() if word == "RUN" and "pip install" in words)
    assert re.search(r'pip install --no-cache-dir "\$\{wheel\}\[events,review\]"', install)
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", str(environment)], check=True)
    # This environment's packages are seen from that one; the wheel itself comes from the file.
    packages = next(path for path in map(Path, sys.path) if (path / "numpy").is_dir())
    place = next((environment / "lib").glob("python*")) / "site-packages"
    (place / "packages.pth").write_text(f"{packages}\n")
    plain = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    pip = [str(environment / "bin/python"), "-m", "pip", "install", "--quiet", "--no-deps", "--ignore-installed"]
    subprocess.run([*pip, str(wheel)], check=True, env=plain)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (command,) = json.loads(dict(instructions())["ENTRYPOINT"])
    program = [str(environment / "bin" / command)]
    subprocess.run([*program, "demo", "--clip", "street.mp4", "--frames", "60"], check=True, cwd=tmp_path, env=plain)
    words = ["track", "people", "street.mp4", "--method", "sort", "--page", str(port), "--out", "out"]
    with subprocess.Popen([*program, *words], cwd=tmp_path, env=plain, stderr=subprocess.PIPE) as process:
        answers, end = list[str](), time.monotonic() + 120
        while process.poll() is None and time.monotonic() < end:
            try:
                with urlopen(f"http://127.0.0.1:{port}/health", timeout=5) as answer:
                    answers.append(json.load(answer)["status"])
            except (URLError, ConnectionError):
                pass
            time.sleep(0.05)
        assert process.wait(60) == 0
    assert "ok" in answers
    code = json.loads(dict(instructions())["HEALTHCHECK"].partition("CMD ")[2])[-1]
    compile(code, "HEALTHCHECK", "exec")
