"""Crossings of lines and borders, in closed form."""

import numpy as np
import pytest

from tests.tracking.counts.walkers import HEIGHT, down, walker
from tsuiseki.tracking.counts.borders import border_crossings
from tsuiseki.tracking.counts.crossings import line_crossings
from tsuiseki.tracking.counts.paths import paths_of
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.settings import CountSettings

LINE = SceneLine("door", np.array([[0.0, 100.0], [200.0, 100.0]]))
ZONE = SceneZone("shop", np.array([[0.0, 100], [200, 100], [200, 300], [0, 300]]))
SCENE = Scene([LINE], [ZONE], (640, 480))


def crossed(*tracks, scene=SCENE, band=0.2, **settings):
    paths = paths_of(tracks, scene, CountSettings(**settings))
    found = line_crossings(paths, scene, scene.lines[0], band)
    return list(
        zip(paths.ids[found.rows].tolist(), paths.frames[found.rows].tolist(), found.sides.tolist(), strict=True)
    )


def test_a_person_who_walks_across_counts_once_in_the_right_direction_and_frame():
    # Looking from (0, 100) to (200, 100), the right is below: y grows.
    assert crossed(walker(down(50, [61, 81, 101, 121]))) == [(1, 2, 1)]
    assert crossed(walker(down(50, [141, 121, 99, 61]))) == [(1, 2, -1)]


@pytest.mark.parametrize("x", [-1.0, 201.0])
def test_who_passes_beside_the_ends_does_not_cross(x):
    assert crossed(walker(down(x, [60, 90, 110, 140]))) == []


def test_who_goes_round_an_end_and_comes_back_through_the_line_counts_once():
    ring = [(50, 60), (-30, 60), (-30, 140), (50, 140), (50, 60)]
    assert crossed(walker(ring)) == [(1, 4, -1)]


def test_dithering_within_the_band_counts_for_nothing_and_the_crossing_around_it_once():
    sway = 100 + 9.9 * np.sin(np.arange(400))
    assert crossed(walker(down(50, np.concatenate([[60], sway, [60]])))) == []
    found = crossed(walker(down(50, np.concatenate([[60], sway, [140]]))))
    assert [(who, side) for who, _, side in found] == [(1, 1)]
    assert crossed(walker(down(50, sway * 0 + 100 + 4.9 * np.sin(np.arange(400))))) == []


def test_every_way_beyond_the_band_counts():
    assert [side for _, _, side in crossed(walker(down(50, [80, 120] * 5)))] == [1, -1] * 4 + [1]


def test_where_a_path_begins_and_ends_its_side_counts_even_within_the_band():
    assert len(crossed(walker(down(50, [99, 101, 140])))) == 1
    assert len(crossed(walker(down(50, [60, 99, 101])))) == 1
    assert crossed(walker(down(50, [101, 99, 140]))) == []


def test_a_gap_is_bridged_and_the_moment_lies_on_the_straight_way():
    assert crossed(walker([(50, 60), (50, 140)], frames=np.array([10, 18]))) == [(1, 15, 1)]
    assert crossed(walker([(190, 60), (250, 140)], frames=np.array([0, 8]))) == []


def test_people_do_not_run_into_each_other():
    above, below = walker(down(50, [60, 60]), 1), walker(down(50, [140, 140]), 2)
    assert crossed(above, below) == []


@pytest.mark.parametrize(("anchor", "count"), [("feet", 1), ("centre", 0), ("head", 0)])
def test_the_anchor_is_what_crosses(anchor, count):
    assert len(crossed(walker(down(50, [80, 120])), anchor=anchor)) == count


def test_outside_the_region_nobody_counts_and_what_lies_between_is_not_bridged():
    region = np.array([[0.0, 0], [640, 0], [640, 480], [0, 480]])
    ignored = [np.array([[0.0, 90], [200, 90], [200, 110], [0, 110]])]
    scene = Scene([LINE], (), (640, 480), region=region, ignored=ignored)
    assert crossed(walker(down(50, [60, 80, 100, 120])), scene=scene) == []
    assert len(crossed(walker(down(50, [60, 80, 100, 120])))) == 1


def test_metres_by_a_scale_change_nothing():
    line = SceneLine("door", 0.05 * LINE.ends)
    scene = Scene([line], (), (640, 480), "metres", scale=0.05)
    assert crossed(walker(down(50, [61, 81, 101, 121])), scene=scene) == [(1, 2, 1)]
    assert crossed(walker(down(50, [61, 81, 101, 121])), scene=Scene([LINE], (), None, scale=0.05).on_floor()) == [
        (1, 2, 1)
    ]


def test_a_border_is_crossed_by_who_enters_and_leaves():
    paths = paths_of([walker(down(50, [60, 90, 110, 200, 290, 310, 360]))], SCENE, CountSettings())
    found = border_crossings(paths, ZONE, 0.2)
    assert (paths.frames[found.rows].tolist(), found.sides.tolist()) == ([2, 5], [1, -1])


def test_random_walks_agree_with_counting_one_step_after_the_other():
    rng = np.random.default_rng(0)
    tracks = [walker(100 + np.cumsum(rng.normal(0, 12, (300, 2)), axis=0), number + 1) for number in range(20)]
    wide = Scene([SceneLine("door", np.array([[-1e4, 100.0], [1e4, 100.0]]))], (), None)
    found = crossed(*tracks, scene=wide)
    for track in tracks:
        distances, side, expected = track.boxes[:, 3] - 100, 0, []
        for frame, distance in enumerate(distances):
            width = 0.2 * HEIGHT * (frame not in (0, len(distances) - 1))
            now = int(np.sign(distance)) if abs(distance) > width else 0
            if now and side and now != side:
                expected.append(now)
            side = now or side
        assert [s for who, _, s in found if who == track.id] == expected
    assert len(found) > 20


def test_no_detection_supports_the_places_in_a_gap():
    paths = paths_of([walker(down(50, [60, 80, 140]), frames=np.array([3, 4, 7]))], SCENE, CountSettings())
    assert paths.frames.tolist() == [3, 4, 5, 6, 7]
    assert paths.observed.tolist() == [True, True, False, False, True]
    np.testing.assert_allclose(paths.points[:, 1], [60, 80, 100, 120, 140])
