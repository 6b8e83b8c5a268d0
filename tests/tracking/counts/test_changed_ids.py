"""People whose id changes from one frame to the next are one path."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import tsuiseki
from tests.tracking.counts.test_online import frames_of
from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.counts.continued import chained, continued
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone, read_scene
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types.tracks import exact_track

SIZE = (640, 480)
DOOR = SceneLine("door", np.array([[0.0, 200], [640, 200]]))
GATE = SceneLine("gate", np.array([[0.0, 300], [640, 300]]))
SHOP = SceneZone("shop", np.array([[0.0, 200], [640, 200], [640, 300], [0, 300]]))
SCENE = Scene([DOOR, GATE], [SHOP], SIZE)


def parts(ys, *changes, x=300.0, number=1, **settings):
    """The tracks of somebody who walks down and changes their id in some frames."""
    edges = [0, *changes, len(ys)]
    return [
        walker(down(x, ys[start:end]), number + k, np.arange(start, end), **settings)
        for k, (start, end) in enumerate(pairwise(edges))
    ]


def counted(*tracks):
    """Crossings of both lines, entries and exits; compared with the counter of live video."""
    found, counter = count(Result(tracks, "v", 10.0, SIZE), SCENE), tsuiseki.Counter(SCENE)
    for targets in frames_of(tracks, max(int(track.frames[-1]) for track in tracks) + 1):
        counter.update(targets)
    zones = found.tables["zones"]
    assert [*counter.counts["door"].values(), *counter.counts["gate"].values()] == found.tables["lines"]["count"]
    assert [*counter.counts["shop"].values()] == [zones["entries"][0], zones["exits"][0]]
    return found


@pytest.mark.parametrize("step", [1.0, 4.0, 12.0, 30.0])
def test_ten_people_whose_ids_change_at_a_line_are_ten_crossings(step):
    ys = np.arange(100.5, 420, step)
    at_door = int(np.searchsorted(ys, 200))
    tracks = [t for k in range(10) for t in parts(ys, at_door, x=50.0 + 55 * k, number=1 + 2 * k)]
    found = counted(*tracks)
    assert [row[2] for row in zip(*found.tables["lines"].values(), strict=True)] == [10, 0, 10, 0]
    assert found.count("door", "in")[1] >= 8


def test_ids_that_change_again_and_again_are_still_one_path():
    ys = np.arange(100.5, 420, 4.0)
    found = counted(*parts(ys, 20, 24, 25, 26, 30, 49, 50))
    assert found.tables["lines"]["count"] == [1, 0, 1, 0]
    assert (found.tables["zones"]["entries"], found.tables["zones"]["exits"]) == ([1], [1])


def test_who_turns_from_line_to_line_under_two_ids_is_one_turn():
    found = counted(*parts(np.arange(100.5, 420, 4.0), 37))
    assert found.tables["turns"] == {"origin": ["door"], "destination": ["gate"], "count": [1]}


def test_two_who_walk_side_by_side_keep_their_own_paths():
    ys = np.arange(100.5, 420, 4.0)
    left, right = parts(ys, 25, x=300.0), parts(ys[::-1], 60, x=312.0, number=3)
    tracks = [left[0], right[0], left[1], right[1]]
    assert continued(tracks) == {0: 2, 1: 3}
    assert counted(*tracks).tables["lines"]["count"] == [1, 1, 1, 1]


def test_each_track_goes_on_as_the_nearest_and_only_one():
    first = walker(down(300, np.arange(100.0, 180, 4)), 1)
    near, nearer = (walker([(300 + aside, 180.0)] * 5, k, np.arange(20, 25)) for aside, k in ((6, 2), (1, 3)))
    assert continued([first, near, nearer]) == {0: 2}
    assert chained({0: 2}, 3) == [[0, 2], [1]]


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (walker([(340, 180)] * 5, 2, np.arange(20, 25)), "elsewhere"),
        (walker([(300, 180)] * 5, 2, np.arange(22, 27)), "later"),
        (walker([(300, 180)] * 5, 2, np.arange(19, 24)), "at the same time"),
        (replace(walker([(300, 180)] * 5, 2, np.arange(20, 25)), origin=np.full((5, 2), 7)), "of another class"),
    ],
)
def test_others_stay_others(other, why):
    first = replace(walker(down(300, np.arange(100.0, 180, 4)), 1), origin=np.full((20, 2), 3))
    assert continued([first, other]) == {}, why


def test_animals_whose_id_changes_are_one_path_too():
    ys = np.arange(100.5, 420, 4.0)
    states = np.column_stack([0 * ys + 300, ys, 0 * ys, 0 * ys + 30, 0 * ys + 10])
    tracks = [exact_track(1, np.arange(25), states[:25]), exact_track(2, np.arange(25, len(ys)), states[25:])]
    found = count(Result(tracks, "v", 10.0, SIZE, names=("a", "b", "theta", "length", "width")), SCENE)
    assert found.tables["lines"]["count"] == [1, 0, 1, 0]


@pytest.mark.integration
def test_the_switch_at_the_line_of_the_cases_is_one_crossing(data_folder):
    folder = data_folder / "cases/round2/03-count"
    found = count(Result.load(folder / "switch"), read_scene(folder / "scene.yaml"), frame_rate=25)
    assert found.count("door", "in")[0] == 1
