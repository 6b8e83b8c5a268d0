"""Scores of bodies: what can be counted by hand, and files of the kinds that there are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.states import Poses, evaluate_states, read_poses
from tsuiseki.tracking.types.frame_range import FrameRange

FRAMES = 10


def poses(*bodies: tuple[int, float, float, float], frames: int = FRAMES) -> Poses:
    """Bodies ``(id, x, y, heading)`` that stand still."""
    count = len(bodies)
    ids, x, y, heading = np.tile(np.array(bodies), (frames, 1)).T
    return Poses(np.repeat(np.arange(frames), count), ids.astype(np.int64), np.column_stack([x, y]), heading)


TRUTH = poses((1, 0, 0, 0.0), (2, 100, 0, 3.1))


def test_errors_of_what_is_found() -> None:
    # Three pixels right and four down; the heading turns over the border of its range.
    found = poses((7, 3, 4, np.radians(10)), (8, 100, 30, -3.1))
    scores = evaluate_states(TRUTH, found)
    assert scores.success == 0.5
    assert (scores.followed, scores.bodies, scores.false, scores.switches) == (1, 2, FRAMES, 0)
    assert scores.position_mean == scores.position_median == scores.position_95 == pytest.approx(5)
    assert scores.angle_mean == pytest.approx(10)
    assert scores.idf1 == 0.5
    wider = evaluate_states(TRUTH, found, distance=31)
    assert wider.success == 1
    assert wider.angle_mean == pytest.approx((10 + np.degrees(2 * np.pi - 6.2)) / 2)


def test_the_other_way_round_is_said() -> None:
    scores = evaluate_states(TRUTH, poses((1, 0, 0, np.pi), (2, 100, 0, 3.1)))
    assert (scores.reversed, scores.angle_median) == (0.5, pytest.approx(90))


def test_identities_that_are_swapped_half_way_count() -> None:
    found = poses((1, 0, 0, 0.0), (2, 100, 0, 3.1))
    later = found.frames >= FRAMES // 2
    found.ids[later] = 3 - found.ids[later]
    scores = evaluate_states(TRUTH, found)
    assert (scores.success, scores.switches, scores.followed, scores.idf1) == (1, 2, 0, 0.5)
    assert evaluate_states(TRUTH, found, frames=FrameRange(0, FRAMES // 2 - 1)).followed == 2


def test_nothing_found_is_nought_and_no_error_of_position() -> None:
    scores = evaluate_states(TRUTH, poses((1, 0, 0, 0.0), frames=0))
    assert (scores.success, scores.idf1, scores.followed) == (0, 0, 0)
    assert scores.values()["position_mean"] is None
    with pytest.raises(RequestError, match="in frames 21-30, got none"):
        evaluate_states(TRUTH, TRUTH, frames=FrameRange(20, 29))


def test_files_of_trackers_and_of_labelled_points(tmp_path: Path) -> None:
    (tmp_path / "states.csv").write_text(
        "frame,id,a,b,theta,phi,score,status\n2,1,5,6,0.5,0,1,tracking\n1,1,3,4,0.4,0,1,tracking\n3,1,9,9,0,0,0,lost\n"
    )
    found = read_poses(tmp_path / "states.csv")
    assert found.frames.tolist() == [0, 1]
    assert found.points.tolist() == [[3, 4], [5, 6]]
    assert found.headings.tolist() == [0.4, 0.5]
    (tmp_path / "points.csv").write_text(
        "frame,id,x,y,head_x,head_y,abdomen_x,abdomen_y,leg_x,leg_y\n1,2,5,6,5,10,5,2,,\n"
    )
    (heading,) = read_poses(tmp_path / "points.csv").headings
    assert heading == pytest.approx(np.pi / 2)
    (tmp_path / "bare.csv").write_text("frame,id,x,y\n1,2,5,6\n")
    assert np.isnan(read_poses(tmp_path / "bare.csv").headings).all()


def test_the_command_compares_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, shift in (("truth", 0), ("near", 6), ("far", 60)):
        (tmp_path / name).mkdir()
        rows = [f"{k + 1},1,{k + shift},50,0.1\n" for k in range(FRAMES)]
        (tmp_path / name / "states.csv").write_text("frame,id,a,b,theta\n" + "".join(rows))
    out = tmp_path / "scores.json"
    words = ["evaluate", "states", *(str(tmp_path / name) for name in ("truth", "near", "far"))]
    assert main([*words, "--json", str(out)]) == 0
    assert "1 of 1" in capsys.readouterr().out
    values = json.loads(out.read_text())
    assert values["near"]["position_mean"] == pytest.approx(6)
    assert (values["near"]["success"], values["far"]["success"], values["far"]["angle_mean"]) == (1, 0, None)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--distance", "0"], "--distance: expected a number greater than 0"),
        (["--frames", "40-50"], "expected bodies in frames 40-50, got none"),
    ],
)
def test_wrong_requests_get_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    file = tmp_path / "states.csv"
    file.write_text("frame,id,a,b\n1,1,2,3\n")
    assert main(["evaluate", "states", str(file), str(file), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    file.write_text("frame,id,theta\n1,1,2\n")
    assert main(["evaluate", "states", str(file), str(file)]) == 2
    assert "expected the columns a,b or x,y" in capsys.readouterr().err


@pytest.mark.integration
def test_labels_of_real_flies_are_taken(data_folder: Path) -> None:
    flies = read_poses(data_folder / "animals" / "flies-first" / "states.csv")
    assert len(flies.frames) == 2 * 430
    assert np.isfinite(flies.headings).all()
    # The head lies before the thorax, so a body moves the way it heads, if it moves fast.
    for fly in (1, 2):
        own = flies.ids == fly
        steps = np.diff(flies.points[own], axis=0)
        fast = np.linalg.norm(steps, axis=1) > 4
        ahead = np.cos(np.arctan2(steps[:, 1], steps[:, 0]) - flies.headings[own][:-1])
        assert ahead[fast].mean() > 0.5
