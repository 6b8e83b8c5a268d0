"""``states.csv``."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.body_states import read_states, write_states
from tsuiseki.tracking.types.tracks import BodyTrack, exact_track

FIELDS = ("a", "b", "theta", "phi")


def test_states_survive_the_file(tmp_path):
    states = np.random.default_rng(0).normal(size=(3, 4)) * 50
    lost = BodyTrack(2, np.array([0, 4]), states[:2], np.array([0.25, 0.5]), ("tracking", "lost"))
    write_states(tmp_path / "s.csv", [lost, exact_track(1, np.arange(3), states)], FIELDS)
    one, two = read_states(tmp_path / "s.csv", FIELDS)
    assert (one.id, two.id) == (1, 2)
    assert one.frames.tolist() == [0, 1, 2]
    assert two.frames.tolist() == [0, 4]
    assert one.states == pytest.approx(states, abs=1e-4)
    assert two.scores.tolist() == [0.25, 0.5]
    assert two.statuses == ("tracking", "lost")
    assert (tmp_path / "s.csv").read_text().splitlines()[:2][0] == "frame,id,a,b,theta,phi,score,status"


def test_score_and_status_may_be_missing(tmp_path):
    (tmp_path / "s.csv").write_text("frame,id,a,b,theta,squash\n2,1,3,4,0,0.5\n")
    (track,) = read_states(tmp_path / "s.csv")
    assert track.frames.tolist() == [1]
    assert track.states.tolist() == [[3, 4, 0, 0.5]]
    assert track.statuses == ("tracking",)


def test_any_component_may_have_any_name(tmp_path):
    (tmp_path / "s.csv").write_text("frame,id,x1,time\n2,7,3,0.5\n1,7,4,0.25\n")
    (track,) = read_states(tmp_path / "s.csv")
    assert (track.id, track.states.tolist()) == (7, [[4, 0.25], [3, 0.5]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected the columns"),
        ("frame,id,a,b,theta\n", "frame,id,a,b,theta,phi"),
        ("frame,id,a,b,theta,phi\n", "at least one state"),
        ("frame,id,a,b,theta,phi\n0,1,1,1,1,1\n", "whole number from 1 to 10000000 in column frame"),
        ("frame,id,a,b,theta,phi\n1,1,nan,1,1,1\n", "finite number in column a"),
        ("frame,id,a,b,theta,phi\n1,1,1,1,1,1\n1,1,1,1,1,1\n", "id 1 twice in frame 1"),
        ("frame,id,a,b,theta,phi,status\n1,1,1,1,1,1,asleep\n", "expected a status of"),
    ],
)
def test_wrong_files_are_refused_in_one_line(tmp_path, text, message):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(RequestError, match=message) as error:
        read_states(tmp_path / "s.csv", FIELDS)
    assert "\n" not in str(error.value)


def test_no_file_is_refused(tmp_path):
    with pytest.raises(RequestError, match="found no such file"):
        read_states(tmp_path / "none.csv")
