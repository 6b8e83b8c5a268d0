"""What the README shows works: its Python lines run, its configurations and links exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street
from tsuiseki.tracking.cli.models import shipped
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.report.webm import VideoWriter
from tsuiseki.tracking.video import open_source

REPOSITORY = Path(__file__).resolve().parent.parent
TEXT = (REPOSITORY / "README.md").read_text(encoding="utf-8")


def test_the_python_lines_track_a_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = write_street(tmp_path / "street", StreetSettings(frames=12), seed=100)
    with VideoWriter(tmp_path / "street.mp4.webm", 25.0) as writer:
        for frame in open_source(clip).frames():
            writer.write(frame.image)
    (tmp_path / "street.mp4.webm").rename(tmp_path / "street.mp4")
    for kind in ("detector", "appearance", "affinity"):
        (tmp_path / f"{kind}.onnx").symlink_to(shipped(kind))
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    assert len([line for line in code.splitlines() if line and "import" not in line]) <= 10
    exec(compile(code, "README.md", "exec"), {})
    assert read_tracks(tmp_path / "tracks.txt")


def test_files_that_the_readme_names_exist() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    named = re.findall(r"\b((?:configs|benchmarks)/[\w.]+\.(?:yaml|py))", TEXT)
    assert links
    assert named
    for name in {*links, *named}:
        assert (REPOSITORY / name).exists(), name
