"""`tsuiseki evaluate` on files and folders."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tsuiseki.tracking.cli import main

FRAMES = 12


def rows(shift: float = 0.0, score: float = 1.0, tail: str = "1,-1,-1,-1", number: int | None = None) -> str:
    """Two people who walk for `FRAMES` frames, in the 10-column layout."""
    lines = []
    for frame in range(1, FRAMES + 1):
        for person, x in ((1, 10), (2, 200)):
            name = person if number is None else number
            lines.append(f"{frame},{name},{x + frame + shift},20,30,80,{tail if number is None else score}")
    return "\n".join(lines) + "\n"


def sequence(folder: Path, name: str) -> Path:
    path = folder / name
    (path / "gt").mkdir(parents=True)
    (path / "gt" / "gt.txt").write_text(rows())
    (path / "seqinfo.ini").write_text(f"[Sequence]\nname={name}\nseqLength={FRAMES}\nframeRate=10\n")
    return path


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """Two sequences."""
    for name in ("A", "B"):
        sequence(tmp_path / "truth", name)
    return tmp_path / "truth"


def scores_of(tmp_path: Path, *words: str | Path) -> dict[str, dict[str, dict[str, float]]]:
    """What the command writes as JSON."""
    file = tmp_path / "scores.json"
    assert main(["evaluate", "people", *map(str, words), "--json", str(file), "--overwrite"]) == 0
    values: dict[str, dict[str, dict[str, float]]] = json.loads(file.read_text())
    return values


@pytest.mark.parametrize("place", ["{name}.txt", "{name}/tracks.txt", "{name}/gt/gt.txt", "{name}/{name}.txt"])
def test_results_are_found_in_their_usual_places(tmp_path: Path, truth: Path, place: str) -> None:
    for name in ("A", "B"):
        path = tmp_path / "results" / place.format(name=name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(rows())
    scores = scores_of(tmp_path, truth, tmp_path / "results")["results"]
    assert scores["combined"]["hota"] == 1
    assert scores["combined"]["labelled"] == 4 * FRAMES
    assert set(scores["sequences"]) == {"A", "B"}


def test_one_sequence_takes_a_file_or_a_result_folder(tmp_path: Path, truth: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "tracks.txt").write_text(rows(shift=1))
    by_file = scores_of(tmp_path, truth / "A", folder / "tracks.txt")["run"]["combined"]
    by_folder = scores_of(tmp_path, truth / "A" / "gt" / "gt.txt", folder)["run"]["combined"]
    assert by_file == by_folder
    assert by_file["motp"] == pytest.approx(29 / 31)


@pytest.mark.parametrize("partial", [True, False])
def test_a_partial_result_is_said_to_be_one(
    tmp_path: Path, truth: Path, capsys: pytest.CaptureFixture[str], partial: bool
) -> None:
    (tmp_path / "tracks.txt").write_text(rows())
    (tmp_path / "run.json").write_text(json.dumps({"partial": partial}))
    assert main(["evaluate", "people", str(truth / "A"), str(tmp_path / "tracks.txt")]) == 0
    assert ("is a partial result" in capsys.readouterr().err) == partial


def test_a_result_of_other_frames_is_said_to_be_one(
    tmp_path: Path, truth: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tracks.txt").write_text(rows())
    run = {"partial": False, "files": ["tracks.txt"], "frames": {"frame": [3, 4, 5]}}
    (tmp_path / "run.json").write_text(json.dumps(run))
    words = ["evaluate", "people", str(truth / "A"), str(tmp_path / "tracks.txt")]
    assert main(words) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert f"of frames 3-5 alone, but 1-{FRAMES} are scored" in line
    assert line.endswith("--frames 3-5")
    assert main([*words, "--frames", "3-5"]) == 0
    assert not capsys.readouterr().err


def test_only_the_asked_frames_are_scored(tmp_path: Path, truth: Path) -> None:
    result = tmp_path / "r.txt"
    result.write_text("\n".join(line for line in rows().splitlines() if int(line.split(",")[0]) <= 6) + "\n")
    whole = scores_of(tmp_path, truth / "A", result)["r"]["combined"]
    first = scores_of(tmp_path, truth / "A", result, "--frames", "1-6")["r"]["combined"]
    rest = scores_of(tmp_path, truth / "A", result, "--frames", "7-")["r"]["combined"]
    assert (whole["recall"], first["recall"], rest["recall"]) == (0.5, 1, 0)
    assert (first["labelled"], rest["labelled"]) == (12, 12)


def test_several_results_are_compared(tmp_path: Path, truth: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, shift in (("x/run", 0), ("y/run", 3)):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "tracks.txt").write_text(rows(shift))
    plot = tmp_path / "plot.png"
    scores = scores_of(tmp_path, truth / "A", tmp_path / "x/run", tmp_path / "y/run", "--plot", plot)
    assert list(scores) == ["x/run", "y/run"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    shown = capsys.readouterr().out
    assert "x/run   1.000" in shown
    assert "0.818" in shown  # MOTP of a shift by 3 of 30 pixels: 27 / 33


def test_detections_are_scored(tmp_path: Path, truth: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("A", "B"):
        (tmp_path / "d" / name).mkdir(parents=True)
        (tmp_path / "d" / name / "detections.txt").write_text(rows(score=0.75, number=-1))
    file = tmp_path / "s.json"
    assert main(["evaluate", "detection", str(truth), str(tmp_path / "d"), "--json", str(file)]) == 0
    values = json.loads(file.read_text())["d"]
    assert values["combined"]["average_precision"] == 1
    assert values["combined"]["boxes"] == 4 * FRAMES
    assert np.allclose(values["sequences"]["A"]["scores"], 0.75)
    assert "AP50" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("missing r.txt", "found no missing"),
        ("truth/A missing.txt", "found no missing.txt"),
        ("truth r.txt", "expected a folder with the results of several sequences"),
        ("truth/A truth/B/gt", "expected the result of A as"),
        ("truth/A r.txt --frames 9-99", "expected frames within 1-12"),
        ("truth/A r.txt r.txt", "got one twice"),
        ("truth/A r.txt --plot p.gif", "ending in .png"),
        ("truth/A r.txt --json r.txt", "already exists"),
        ("truth/A detections.txt", "are these detections?"),
        ("truth/A late.txt", "got a box in frame 13"),
        ("truth/A binary.txt", "something binary"),
    ],
)
def test_a_wrong_request_gets_one_line_and_writes_nothing(
    tmp_path: Path,
    truth: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    line: str,
) -> None:
    assert truth.is_dir()
    monkeypatch.chdir(tmp_path)
    Path("r.txt").write_text(rows())
    Path("detections.txt").write_text(rows(number=-1))
    Path("late.txt").write_text("13,1,5,5,10,10,1\n")
    Path("binary.txt").write_bytes(bytes(range(256)))
    before = sorted(tmp_path.rglob("*"))
    assert main(["evaluate", "people", *words.split()]) == 2
    captured = capsys.readouterr()
    assert line in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
    assert sorted(tmp_path.rglob("*")) == before


GROUND_TRUTHS = {
    "only class -1": (
        "1,1,5,5,10,10,1,-1,1\n2,1,5,5,10,10,1,-1,1\n",
        "expected class 1 (pedestrian) in column 8, got only -1",
    ),
    "id twice": ("1,1,5,5,10,10,1,1,1\n1,1,9,5,10,10,1,1,1\n", "id 1 stands twice in frame 1"),
    "empty": ("", "is empty"),
    "nothing counts": ("1,1,5,5,10,10,0,-1,-1,-1\n", "no usable box"),
}


@pytest.mark.parametrize("broken", list(GROUND_TRUTHS))
def test_a_broken_ground_truth_is_no_score(tmp_path: Path, capsys: pytest.CaptureFixture[str], broken: str) -> None:
    text, line = GROUND_TRUTHS[broken]
    file = tmp_path / "gt.txt"
    file.write_text(text)
    (tmp_path / "r.txt").write_text(rows())
    for what in ("people", "detection"):
        assert main(["evaluate", what, str(file), str(tmp_path / "r.txt")]) == 2
        captured = capsys.readouterr()
        assert line in captured.err
        assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("what", "row"),
    [("points", "{k},1,{x},20"), ("floor", "{k},1,{x},20"), ("states", "{k},1,{x},20"), ("single", "")],
)
def test_a_result_of_which_nothing_is_right_is_told(
    what: str, row: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heading = {"points": "frame,id,x,y", "floor": "time,id,x,y", "states": "frame,id,a,b"}.get(what, "")
    for name, x in (("there", 10), ("elsewhere", 9000)):
        lines = [heading, *(row.format(k=k, x=x) for k in range(1, 9))]
        if what == "single":
            lines = [f"{k},1,{x},20,10,30,1,-1,-1,-1" for k in range(1, 9)]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    truth = tmp_path / "there.csv"
    if what == "single":
        truth = tmp_path / "sequence"
        (truth / "img").mkdir(parents=True)
        for k in range(8):
            Image.new("RGB", (64, 64)).save(truth / "img" / f"{k + 1:04}.png")
        (truth / "groundtruth_rect.txt").write_text("10,20,10,30\n" * 8)
    results = [str(tmp_path / f"{name}.csv") for name in ("there", "elsewhere")]
    of_many = ["--of-many"] * (what == "single")
    assert main(["evaluate", what, str(truth), *results, *of_many]) == 0
    said = capsys.readouterr().err
    assert "note: elsewhere: nothing in it is on a label" in said
    assert "note: there" not in said


@pytest.mark.integration
def test_reference_values_through_the_command(data_folder: Path, tmp_path: Path) -> None:
    for name in ("TUD-Campus", "TUD-Stadtmitte"):
        (tmp_path / "truth").mkdir(exist_ok=True)
        (tmp_path / "truth" / name).symlink_to(data_folder / "mot" / name)
        (tmp_path / "cem").mkdir(exist_ok=True)
        (tmp_path / "cem" / f"{name}.txt").symlink_to(data_folder / "mot" / name / "cem-result" / "test.txt")
    combined = scores_of(tmp_path, tmp_path / "truth", tmp_path / "cem")["cem"]["combined"]
    expected = {"mota": 0.555116, "idf1": 0.624296, "hota": 0.399957}
    assert {name: combined[name] for name in expected} == pytest.approx(expected, abs=1e-6)
