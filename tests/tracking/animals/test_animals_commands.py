"""`tsuiseki track animals`, from a film of drawn animals to the files of SLEAP and DeepLabCut, and wrong requests."""

from __future__ import annotations

import csv
import re

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.review.session import Session

FRAMES = 30


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """Images of a dark animal that walks to the right, and its points as ours."""
    folder = tmp_path_factory.mktemp("film") / "arena"
    folder.mkdir()
    rows = ["frame,id,x,y,head_x,head_y,tail_x,tail_y"]
    for t in range(FRAMES):
        image, x = np.full((120, 200, 3), 190, np.uint8), 40 + 4 * t
        cv2.ellipse(image, (x, 60), (18, 7), 0, 0, 360, (40, 40, 40), -1)
        cv2.imwrite(str(folder / f"{t + 1:04d}.png"), image)
        rows.append(f"{t + 1},1,{x},60,{x + 18},60,{x - 18},60")
    (folder.parent / "labels.csv").write_text("\n".join(rows) + "\n")
    return folder


def states(folder):
    with (folder / "states.csv").open() as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_a_film_is_tracked_in_millimetres_and_evaluated(film, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["track", "animals", str(film), "--fps", "10", "--scale", "0.5", "--overlay", "--out", str(out)]
    assert main(words) == 0
    assert {path.name for path in out.iterdir()} == {"states.csv", "report", "report.html", "run.json", "overlay.webm"}
    page = (out / "report.html").read_text()
    text = re.sub(r"<style>.*?</style>|<svg.*?</svg>|<[^>]+>|data:[^\"]+", " ", page, flags=re.DOTALL)
    assert "people" not in text.lower()
    assert "person" not in text.lower()
    assert re.findall(r"<h2>(.*?)</h2>", page)[1:7] == [
        "Animals", "How many at a time", "All paths", "Where they were", "Who was followed when", "Speed",
    ]  # fmt: skip
    for name in ("speed, mm/s", "path, mm"):
        assert f"<th scope=col>{name}</th>" in page
    assert (out / "report/counts.csv").read_text().startswith("time,animals,most\n")
    with (out / "report/motion.csv").open() as file:
        moved = list(csv.DictReader(file))
    assert float(moved[15]["speed_mm_s"]) == pytest.approx(20.0, abs=2.0)
    drawn = cv2.imread(str(out / "report/paths.png"))
    assert drawn.shape[1] / drawn.shape[0] > 2.5, "cropped to the strip in which it walked"
    rows = states(out)
    assert all(0 < float(row["score"]) < 1 for row in rows)
    assert len(rows) == FRAMES
    assert {row["id"] for row in rows} == {"1"}
    middle = rows[FRAMES // 2]
    # Four pixels a frame of half a millimetre, ten frames a second.
    assert float(middle["speed_mm_s"]) == pytest.approx(20.0, abs=2.0)
    assert float(middle["a_mm"]) == pytest.approx(float(middle["a"]) / 2, abs=1e-3)
    assert abs(float(middle["theta"])) < 0.1
    assert main(["evaluate", "states", str(film.parent / "labels.csv"), str(out), "--distance", "3"]) == 0
    assert "1.000" in capsys.readouterr().out


@pytest.mark.slow
def test_a_few_labels_place_the_points_in_every_frame(film, tmp_path):
    few = tmp_path / "few.csv"
    lines = (film.parent / "labels.csv").read_text().splitlines()
    few.write_text("\n".join([lines[0], lines[5], lines[20]]) + "\n")
    out = tmp_path / "out"
    words = ["track", "animals", str(film), "--fps", "10", "--labels", str(few), "--centre", "head"]
    assert main([*words, "--out", str(out)]) == 0
    assert max(abs(float(row["a"]) - (58 + 4 * t)) for t, row in enumerate(states(out))) < 3.0
    placed = read_poses_file(out / "points.dlc.csv")
    assert placed.nodes == ("head", "tail")
    np.testing.assert_allclose(placed.points[:, 1, 0], 22 + 4 * np.arange(FRAMES), atol=3.0)


@pytest.mark.slow
def test_advice_is_that_of_the_points_where_points_were_given(film, tmp_path, capsys):
    (tmp_path / "one.csv").write_text("track,frame_idx,head.x,head.y,tail.x,tail.y\na,3,58,60,30,60\n")
    words = ["track", "animals", str(film), "--fps", "10", "--points", str(tmp_path / "one.csv")]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "0 animals" in out
    assert "one.csv make none: an animal takes two in a frame, in several frames" in out
    assert "threshold" not in out


@pytest.mark.slow
def test_points_of_sleap_are_observations(film, tmp_path):
    rng = np.random.default_rng(0)
    rows = ["track,frame_idx,head.x,head.y,mid.x,mid.y,tail.x,tail.y"]
    for t in range(FRAMES):
        x = 40 + 4 * t
        values = np.array([x + 18, 60, x, 60, x - 18, 60]) + rng.normal(0, 0.3, 6)
        cells = [f"{value:.2f}" for value in values]
        if t == 10:
            cells[4:] = ["", ""]
        rows.append(",".join([f"guess{t}", str(t), *cells]))
    (tmp_path / "sleap.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path / "out"
    words = ["track", "animals", str(film), "--fps", "10", "--points", str(tmp_path / "sleap.csv"), "--centre", "mid"]
    assert main([*words, "--out", str(out)]) == 0
    placed = read_poses_file(out / "points.sleap.csv")
    assert set(placed.tracks) == {"track_1"}
    assert len(placed) == FRAMES
    # The tail that was not seen is where head and middle put it.
    assert np.linalg.norm(placed.points[10, 2] - [40 + 40 - 18, 60]) < 3.0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--scale", "0"], "--scale: expected a number greater than 0"),
        (["--centre", "head"], "give --points or --labels"),
        (["--labels", "none.csv"], "found no file"),
        (["--animals.smallest", "2"], "--animals.smallest: expected a number less than 1"),
        (["--threshold", "400"], "threshold in (0, 255)"),
        (["--contrast", "red"], "contrast"),
    ],
)
def test_wrong_requests(film, tmp_path, capsys, words, expected):
    assert main(["track", "animals", str(film), "--fps", "10", "--out", str(tmp_path / "out"), *words]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.slow
def test_identities_are_corrected_and_done_again(film, tmp_path, capsys):
    """A second animal walks below; they are exchanged, one box is moved, and a new run does the same."""
    pair = tmp_path / "pair"
    pair.mkdir()
    for path in sorted(film.iterdir()):
        image = cv2.imread(str(path))
        cv2.imwrite(str(pair / path.name), np.vstack([image, image[:, ::-1]]))
    words = ["track", "animals", str(pair), "--fps", "10", "--labels", str(film.parent / "labels.csv")]
    assert main([*words, "--scale", "0.5", "--out", str(tmp_path / "out")]) == 0
    before = {(row["frame"], row["id"]): row for row in states(tmp_path / "out")}
    session = Session(tmp_path / "out")
    assert session.noun == "animal"
    assert session.questions() == [], "no flow of candidates solved them"
    session.correct(session.made("switch", [1, 2], 15))
    session.correct(session.made("box", [2], 20, box=(50, 60, 40, 40)))
    session.correct(session.made("name", [1], 3, name="Anna"))
    session.close()
    after = {(row["frame"], row["id"]): row for row in states(tmp_path / "out")}
    for frame, one, other in (("10", "1", "1"), ("10", "2", "2"), ("18", "1", "2"), ("30", "2", "1")):
        assert after[frame, one] == {**before[frame, other], "id": one}
    assert [float(after["21", "2"][name]) for name in ("a", "b", "a_mm", "b_mm")] == [70, 80, 35, 40]
    assert main([*words, "--scale", "0.5", "--out", str(tmp_path / "again"), "--corrections",
                 str(tmp_path / "out/corrections.jsonl")]) == 0  # fmt: skip
    assert "corrections" not in capsys.readouterr().err
    assert states(tmp_path / "again") == [after[row["frame"], row["id"]] for row in states(tmp_path / "again")]
    placed = read_poses_file(tmp_path / "again/points.sleap.csv")
    where = dict(zip(zip(placed.frames.tolist(), placed.tracks, strict=True), placed.points[:, 0, 1], strict=True))
    assert where[9, "track_1"] < 120 < where[29, "track_1"] or where[29, "track_1"] < 120 < where[9, "track_1"]
    session = Session(tmp_path / "again")
    for _ in range(3):
        session.undo()
    session.close()
    assert states(tmp_path / "again") == list(before.values())
