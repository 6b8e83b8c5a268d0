"""People who are hidden behind others, with places that a test knows."""

import numpy as np
import pytest

from tests.tracking.counts.walkers import walker
from tsuiseki.tracking.counts.companions import with_hidden
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine
from tsuiseki.tracking.result import Result

SIZE, RATE, LENGTH = (640, 480), 10.0, 60
X = 100.0 + 5 * np.arange(LENGTH)
NEAR = walker(np.column_stack([X, np.full(LENGTH, 205.0)]))
FAR = np.column_stack([X + 3, np.full(LENGTH, 203.0)])
SCENE = Scene([SceneLine("door", np.array([[250.0, 100], [250, 400]]))])


def seen(*frames, number=2, away=0.0):
    """The person behind the near one, as far as they are seen."""
    return walker(FAR[list(frames)] + [away, 0], number, np.array(frames))


def chains(*tracks):
    found = with_hidden([NEAR, *tracks], SIZE, LENGTH, RATE)
    return [[part.frames.tolist() for part in chain] for chain in found][1:]


def test_who_vanishes_behind_somebody_and_comes_out_there_is_one_person():
    one, other = seen(*range(20)), seen(*range(40, 60), number=3)
    assert chains(one, other) == [[list(range(20)), list(range(40, 60))]]
    found = count(Result([NEAR, one, other], "", RATE, SIZE), SCENE)
    assert found.tables["lines"]["count"] == [0, 2]
    assert sorted(found.tables["crossings"]["id"]) == [1, 2]
    assert found.tables["people"]["id"] == [1, 2, 3]


def test_who_walks_along_unseen_came_and_goes_with_the_other():
    assert chains(seen(*range(20, 40))) == [[list(range(20)), list(range(20, 40)), list(range(40, 60))]]
    found = count(Result([NEAR, seen(*range(35, 60))], "", RATE, SIZE), SCENE)
    assert found.tables["lines"]["count"] == [0, 2]


@pytest.mark.parametrize(
    "track",
    [
        seen(*range(20, 40), away=60.0),
        # In the other direction: the near one only passes by.
        walker(FAR[20] - np.outer(np.arange(20), [5, 0]), 2, np.arange(20, 40)),
        walker(FAR[20] + [[0, 5]] * 20, 2, np.arange(20, 40), height=150.0),
        walker(FAR[20] + [[0, 20]] * 20, 2, np.arange(20, 40)),
    ],
    ids=["far away", "passing by", "standing", "nearer"],
)
def test_others_are_left_as_they_are(track):
    assert chains(track) == [[track.frames.tolist()]]


def test_at_the_border_of_the_picture_and_of_the_video_people_come_and_go():
    assert chains(seen(*range(60))) == [[list(range(60))]]
    border = with_hidden([NEAR, seen(*range(30, 60))], (260, 480), LENGTH, RATE)
    assert [len(chain) for chain in border] == [1, 1]
    assert with_hidden([], SIZE, 0, RATE) == []


def test_of_two_who_vanish_behind_somebody_the_last_one_comes_out():
    """One who comes out was one who vanished, not two."""
    first, last, out = seen(*range(15)), seen(*range(5, 25), number=3, away=-1.0), seen(*range(40, 60), number=4)
    joined = [chain[-2:] for chain in chains(first, last, out) if list(range(40, 60)) in chain]
    assert joined == [[list(range(5, 25)), list(range(40, 60))]]
