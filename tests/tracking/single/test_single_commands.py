"""`tsuiseki track single` and `tsuiseki evaluate single` as a user types them."""

import json
import signal

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.report import drawing
from tsuiseki.tracking.single.settings import METHODS


@pytest.mark.slow
def test_track_and_evaluate(labelled_square, tmp_path, capsys):
    out = tmp_path / "Square"
    assert main(["track", "single", str(labelled_square), "--out", str(out), "--plot", "--overlay"]) == 0
    assert {p.name for p in out.iterdir()} == {
        "boxes.txt",
        "report",
        "report.html",
        "run.json",
        "peaks.png",
        "overlay.webm",
    }
    record = json.loads((out / "run.json").read_text())
    assert record["frames"]["frame"] == list(range(1, 9))
    assert len(record["frames"]["score"]) == len(record["frames"]["status"]) == 8
    capsys.readouterr()
    scores = tmp_path / "scores.json"
    curves = tmp_path / "curves.png"
    command = ["evaluate", "single", str(labelled_square), str(out), "--json", str(scores), "--plot", str(curves)]
    assert main(command) == 0
    assert "precision at 20 px" in capsys.readouterr().out
    assert json.loads(scores.read_text())["Square"]["groups"]["ALL"]["auc"] > 0.7
    assert curves.stat().st_size > 0


def test_a_box_without_labels(labelled_square, tmp_path):
    words = ["track", "single", str(labelled_square / "img"), "--out", str(tmp_path / "o"), "--method", "kcf"]
    assert main([*words, "--box", "20,30,30,35", "--frames", "1-4"]) == 0
    assert len((tmp_path / "o" / "boxes.txt").read_text().splitlines()) == 4


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_interrupt_ends_the_wait_for_a_drawn_box(labelled_square, tmp_path, monkeypatch, number):
    monkeypatch.setattr(drawing, "_has_display", lambda: True)
    monkeypatch.setattr(drawing.webbrowser, "open", lambda _: signal.raise_signal(number))
    assert (
        main(["track", "single", str(labelled_square / "img"), "--select", "--out", str(tmp_path / "o")])
        == 128 + number
    )
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "expected --box X,Y,W,H"),
        (["--box", "1,2,3"], "expected X,Y,W,H in pixels"),
        (["--box", "500,500,20,20"], "expected a box inside the 140x100 image"),
        (["--box", "20,20,0,20"], "expected a positive width and height"),
        (["--box", "0,0,300,20"], "expected a box that fits into the 140x100 image"),
        (["--box", "20,20,9,9", "--select"], "expected one of --box and --select"),
        (
            ["--box", "20,20,9,9", "--method", "kcf", "--objectness", "x"],
            "--objectness: expected with --method kcf-particle",
        ),
        (
            ["--box", "20,20,9,9", "--method", "csk", "--scale", "true"],
            "--scale: expected with --method combined, regularised, kcf-particle or kcf",
        ),
        (["--box", "20,20,9,9", "--preset", "paper"], "--preset paper: expected with the method kcf, got combined"),
        (["--box", "20,20,9,9", "--method", "struck"], "--method"),
    ],
)
def test_wrong_requests_are_one_line_and_status_2(labelled_square, tmp_path, capsys, options, said):
    assert main(["track", "single", str(labelled_square / "img"), "--out", str(tmp_path / "o"), *options]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert said in error[-1]
    assert not (tmp_path / "o").exists()


def constant(folder, sizes):
    """A folder of grey pictures of these sizes (height, width)."""
    folder.mkdir()
    for t, size in enumerate(sizes):
        cv2.imwrite(str(folder / f"{t + 1:04d}.png"), np.full((*size, 3), 128, np.uint8))
    return folder


def test_a_video_that_changes_its_size_is_one_line(labelled_square, tmp_path, capsys):
    folder = constant(tmp_path / "v", [(90, 120)] * 3)
    for k, image in enumerate(sorted((labelled_square / "img").iterdir())[:2]):
        (folder / f"{k + 1:04d}.png").write_bytes(image.read_bytes())
    out = tmp_path / "o"
    assert main(["track", "single", str(folder), "--out", str(out), "--box", "20,30,30,35"]) != 0
    error = capsys.readouterr().err.strip().splitlines()
    assert error[-1].endswith("0003.png: expected 140x100 pixels as in 0001.png, got 120x90")
    assert len([line for line in error if line.startswith("tsuiseki:")]) == 1
    assert not out.exists()


@pytest.mark.parametrize("method", sorted({*METHODS} - {"siamese"}))
def test_constant_images_are_refused_at_the_start_and_followed_later(labelled_square, tmp_path, capsys, method):
    folder = constant(tmp_path / "v", [(100, 140)] * 4)
    words = ["track", "single", str(folder), "--out", str(tmp_path / "o"), "--box", "20,30,30,35", "--method", method]
    assert main(words) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.endswith(
        "frame 1: expected a picture of the target, got one colour everywhere; start at a later frame with --frames"
    )
    first = sorted((labelled_square / "img").iterdir())[0]
    (folder / "0001.png").write_bytes(first.read_bytes())
    assert main(words) == 0
    assert np.isfinite(np.loadtxt(tmp_path / "o" / "boxes.txt", delimiter=",")).all()


@pytest.mark.slow
def test_the_network_of_people_is_not_asked_about_a_square(labelled_square, tmp_path, capsys):
    words = ["track", "single", str(labelled_square), "--frames", "1-4", "--recognise", "--method", "kcf"]
    assert main([*words, "--out", str(tmp_path / "square")]) == 0
    assert "the network of people was not asked" in capsys.readouterr().err
    assert main([*words, "--out", str(tmp_path / "upright"), "--box", "25,20,15,45"]) == 0
    assert "not asked" not in capsys.readouterr().err


def test_a_result_of_another_length_is_said(labelled_square, tmp_path, capsys):
    (tmp_path / "r.txt").write_text("21,31,30,35\n" * 3)
    assert main(["evaluate", "single", str(labelled_square), str(tmp_path / "r.txt")]) == 0
    assert "3 results for 8 boxes: the frames without one are misses" in capsys.readouterr().err


@pytest.mark.slow
def test_objectness_is_learnt_from_folders_and_needs_enough_boxes(labelled_square, tmp_path, capsys):
    pytest.importorskip("sklearn", reason="training needs the train extra")
    words = ["train", "objectness", "--out", str(tmp_path / "m.json"), "--interval", "1"]
    assert main([*words, "--data", str(labelled_square)]) == 2
    assert "expected at least 20 labelled boxes" in capsys.readouterr().err
    assert not (tmp_path / "m.json").exists()
    assert (
        main(
            [*words, "--data", ",".join([str(labelled_square)] * 4), "--test", str(labelled_square), "--plot", "r.txt"]
        )
        == 2
    )
    assert main([*words, "--data", ",".join([str(labelled_square)] * 4), "--test", str(labelled_square)]) == 0
    assert "windows  boxes found" in capsys.readouterr().out
    track = [
        "track",
        "single",
        str(labelled_square),
        "--objectness",
        str(tmp_path / "m.json"),
        "--preset",
        "printed",
        "--method",
        "kcf-particle",
    ]
    assert main([*track, "--out", str(tmp_path / "o")]) == 0
