"""`tsuiseki count` from end to end."""

import json
import re

import pytest

from tsuiseki.tracking.cli import main

SCENE = """
size: [64, 48]
lines:
- {name: door, from: [0, 24], to: [64, 24]}
zones:
- {name: shop, corners: [[0, 24], [64, 24], [64, 48], [0, 48]]}
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def tracks(tmp_path):
    path = tmp_path / "tracks.txt"
    path.write_text("".join(f"{n},1,20,{n},8,12,0.9,-1,-1,-1\n" for n in range(1, 31)))
    return path


@pytest.mark.slow
def test_the_command_writes_tables_plots_and_a_page(tmp_path, scene, tracks, capsys):
    out = tmp_path / "out"
    assert main(["count", str(tracks), "--scene", str(scene), "--fps", "10", "--out", str(out)]) == 0
    assert "door in: 1" in capsys.readouterr().out
    assert (out / "lines.csv").read_text().splitlines()[1].startswith("door,in,1,")
    record = json.loads((out / "run.json").read_text())
    assert {"answers.json", "report.html", "places.png", "stays.csv"} <= set(record["files"])


@pytest.mark.slow
def test_a_tracked_folder_knows_its_rate_and_length(tmp_path, inputs, scene, capsys):
    words = ["track", "people", str(inputs.images), "--fps", "4", "--detections", str(inputs.detections)]
    assert main([*words, "--method", "sort", "--out", str(tmp_path / "run")]) == 0
    assert main(["count", str(tmp_path / "run"), "--scene", str(scene), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"shop: 1 people on average \(\S+\), 1 at most", printed)
    assert not re.search(r"[1-9]\.\d\d", printed.partition("shop:")[2].partition("\n")[0])
    assert printed.endswith(f"open {tmp_path / 'out/report.html'}\n")
    times = (tmp_path / "out/occupancy.csv").read_text().splitlines()
    assert len(times) == 1 + 3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "frame rate"),
        (["--fps", "0"], "--fps: expected a number greater than 0"),
        (["--fps", "10", "--anchor", "floor"], "needs a scale or a camera"),
        (["--fps", "10", "--anchor", "knee"], "anchor"),
        (["--fps", "10", "--band", "-1"], "band"),
    ],
)
def test_a_bad_request_is_one_line(tmp_path, scene, tracks, capsys, words, said):
    assert main(["count", str(tracks), "--scene", str(scene), "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line
    assert not (tmp_path / "out").exists()


def test_what_is_no_result_is_refused(tmp_path, scene, capsys):
    words = ["--scene", str(scene), "--fps", "10", "--out", str(tmp_path / "out")]
    for place in (tmp_path, tmp_path / "none"):
        assert main(["count", str(place), *words]) == 2
        assert "expected" in capsys.readouterr().err
