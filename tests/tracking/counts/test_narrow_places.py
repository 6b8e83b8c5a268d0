"""Zones narrower than the band about their border, lines shorter than it, lines near to each other, and long steps."""

import numpy as np
import pytest

import tsuiseki
from tests.tracking.counts.test_online import frames_of
from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.polygons import border_meetings, width_across
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone, read_scene
from tsuiseki.tracking.result import Result

# Of people 50 pixels high, pixels.
BAND = 10.0
SIZE = (640, 480)


def zone(*corners):
    return SceneZone("zone", np.array(corners, dtype=float))


def visits(place, *tracks):
    """Entries and exits by the count of the finished video, after the counter of live video was compared."""
    scene = Scene([], [place], SIZE)
    zones = count(Result(tracks, "v", 10.0, SIZE), scene).tables["zones"]
    counter = tsuiseki.Counter(scene)
    for targets in frames_of(tracks, max(int(track.frames[-1]) for track in tracks) + 1):
        counter.update(targets)
    assert [*counter.counts["zone"].values()] == [zones["entries"][0], zones["exits"][0]]
    for ends in ("entries", "exits"):
        assert zones[f"{ends}_low"][0] <= zones[ends][0] <= zones[f"{ends}_high"][0]
    return zones["entries"][0], zones["exits"][0]


@pytest.mark.parametrize("step", [2.0, 7.0, 23.0, 60.0, 150.0])
@pytest.mark.parametrize("width", [0.5, 4.0, 19.0, 21.0, 40.0])
@pytest.mark.parametrize("aside", [0.0, 0.6])
def test_who_walks_through_a_zone_enters_and_leaves_once_however_narrow_it_is_and_long_the_steps(step, width, aside):
    ys = np.arange(60.3, 420, step)
    way = np.column_stack([200 + aside * (ys - 60), ys])
    strip = zone((0, 200), (640, 200), (640, 200 + width), (0, 200 + width))
    assert visits(strip, walker(way)) == (1, 1)
    assert visits(strip, walker(way[::-1])) == (1, 1)


@pytest.mark.parametrize("y", [205.0, 250.0, 380.0])
def test_a_thin_triangle_counts_at_its_narrow_and_at_its_wide_end(y):
    wedge = zone((300, 200), (340, 400), (260, 400))
    assert visits(wedge, walker([(x, y) for x in np.arange(200, 400, 5.0)])) == (1, 1)


def test_a_zone_with_a_narrow_corridor_counts_in_the_corridor():
    keyhole = zone((100, 100), (300, 100), (300, 195), (500, 195), (500, 205), (300, 205), (300, 300), (100, 300))
    assert visits(keyhole, walker(down(400, np.arange(100, 300, 6.0)))) == (1, 1)
    assert visits(keyhole, walker(down(200, np.arange(20, 400, 6.0)))) == (1, 1)


def test_who_stands_in_a_narrow_zone_and_goes_back_came_in_and_went_out():
    ys = np.concatenate([np.arange(150, 208, 4.0), np.full(30, 208.0), np.arange(208, 150, -4.0)])
    assert visits(zone((0, 200), (640, 200), (640, 216), (0, 216)), walker(down(300, ys))) == (1, 1)


def test_a_corner_that_is_jumped_over_counts_and_one_that_is_only_touched_does_not():
    square = zone((200, 200), (300, 200), (300, 300), (200, 300))
    assert visits(square, walker([(100, 250), (190, 250), (250, 310), (250, 400)])) == (1, 1)
    assert visits(square, walker([(100, 250), (150, 250), (199, 201), (206, 199), (250, 150), (300, 100)])) == (0, 0)


def test_steps_to_and_fro_on_the_border_of_a_narrow_zone_are_not_counted():
    strip = zone((0, 200), (640, 200), (640, 216), (0, 216))
    sway = 200 + 3.5 * np.sin(np.arange(100))
    assert visits(strip, walker(down(300, [150, *sway, 150]))) == (0, 0)
    # Through the zone, while the box jitters beyond its far border.
    assert visits(strip, walker(down(300, [150, 190, 208, *(220 + 6 * np.sin(np.arange(100))), 260]))) == (1, 1)


def test_a_stay_between_two_frames_lasts_no_time():
    strip = zone((0, 200), (640, 200), (640, 204), (0, 204))
    stays = count(Result([walker(down(300, [150, 190, 230, 270]))], "v", 10.0, SIZE), Scene([], [strip], SIZE))
    (row,) = zip(*stays.tables["stays"].values(), strict=True)
    assert row == ("zone", 1, 0.2, 0.2, 0.0, 0.0, True, True, 0.0)


def test_random_walks_with_long_steps_through_narrow_zones_are_counted_as_they_come():
    rng = np.random.default_rng(0)
    strip = zone((200, 200), (400, 230), (400, 240), (200, 212))
    ways = [np.clip(300 + np.cumsum(rng.normal(0, 18, (150, 2)), axis=0), 20, 460) for _ in range(20)]
    tracks = [walker([*way, (300, 20), (300, 20)], number + 1) for number, way in enumerate(ways)]
    entries, exits = visits(strip, *tracks)
    assert min(entries, exits) > 30


@pytest.mark.parametrize("step", [3.0, 40.0])
@pytest.mark.parametrize("length", [1.0, 5.0, 12.0])
def test_a_line_shorter_than_the_band_counts_who_crosses_it(length, step):
    line = SceneLine("gap", np.array([[300.0, 200], [300 + length, 200]]))
    across = walker(down(300 + 0.5 * length, np.arange(101.5, 320, step)))
    beside = walker(down(300 + 2 * length, np.arange(101.5, 320, step)), 2)
    found = count(Result([across, beside], "v", 10.0, SIZE), Scene([line], [], SIZE))
    assert found.tables["lines"]["count"] == [1, 0]


@pytest.mark.parametrize("step", [3.0, 40.0])
@pytest.mark.parametrize("apart", [1.0, 5.0, 15.0])
def test_two_lines_nearer_than_their_bands_both_count(apart, step):
    lines = [SceneLine(name, np.array([[0.0, y], [640, y]])) for name, y in (("a", 200.0), ("b", 200 + apart))]
    found = count(Result([walker(down(300, np.arange(101.7, 320, step)))], "v", 10.0, SIZE), Scene(lines, [], SIZE))
    assert found.tables["lines"]["count"] == [1, 0, 1, 0]
    assert found.tables["turns"] == {"origin": ["a"], "destination": ["b"], "count": [1]}


def test_width_is_measured_across_to_the_edge_that_faces():
    points = np.array([[5.0, 1], [5, 3], [0.5, 2]])
    strip = np.array([[0.0, 0], [20, 0], [20, 4], [0, 4]])
    assert width_across(points, strip) == pytest.approx([4, 4, 20])
    assert width_across(points, strip[::-1]) == pytest.approx([4, 4, 20])
    right_angle = np.array([[0.0, 0], [20, 0], [0, 20]])
    assert width_across(np.array([[1.0, 2]]), right_angle).tolist() == [np.inf]


def test_ways_meet_a_border_where_they_cross_it_in_their_order():
    starts, ends = np.array([[-10.0, 5], [5, 5], [-5, -5]]), np.array([[30.0, 5], [5, 5], [-5, 20]])
    way, share, inward = border_meetings(starts, ends, np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]]))
    assert (way.tolist(), share.tolist(), inward.tolist()) == ([0, 0], [0.25, 0.5], [True, False])


@pytest.mark.integration
def test_the_thin_zone_of_the_cases_has_one_entry_and_one_exit(data_folder):
    folder = data_folder / "cases/round2/03-count"
    result = Result.load(folder / "once")
    zones = count(result, read_scene(folder / "thin.yaml"), frame_rate=25).tables["zones"]
    assert (zones["entries"], zones["exits"]) == ([1], [1])
