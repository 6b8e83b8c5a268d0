"""Answers in closed form."""

import inspect
from dataclasses import replace

import numpy as np
import pytest

import tsuiseki
from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.settings import CountSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types.tracks import exact_track

ENTRANCE = SceneLine("entrance", np.array([[0.0, 100.0], [200.0, 100.0]]))
EXIT = SceneLine("exit", np.array([[0.0, 300.0], [200.0, 300.0]]), ("out", "back"))
SHOP = SceneZone("shop", np.array([[0.0, 100], [200, 100], [200, 300], [0, 300]]))
SCENE = Scene([ENTRANCE, EXIT], [SHOP], (640, 480))


def answers(*tracks, scene=SCENE, rate=10.0, length=None, **settings):
    frames = {"frame": list(range(length))} if length else {}
    return count(Result(tracks, "v", rate, (640, 480), frames=frames), scene, CountSettings(**settings))


def rows(table):
    return list(zip(*table.values(), strict=True))


def test_who_walks_through_a_shop_is_in_every_table():
    found = answers(walker(down(50, range(51, 400, 10)), 7), length=40)
    assert found.count("entrance", "in")[0] == found.count("exit", "out")[0] == 1
    assert found.count("entrance", "out") == (0, 0, 0)
    assert rows(found.tables["turns"]) == [("entrance", "exit", 1)]
    # In the shop from y = 101, frame 5, to y = 291, frame 24.
    assert rows(found.tables["stays"]) == [("shop", 7, 0.5, 2.5, 2.0, 0.0, True, True, 0.0)]
    assert found.occupancy["shop"].tolist() == [0] * 5 + [1] * 20 + [0] * 15
    zone = {name: values[0] for name, values in found.tables["zones"].items()}
    assert (zone["entries"], zone["exits"], zone["people"], zone["most"]) == (1, 1, 0.5, 1)
    assert (zone["stay"], zone["longest"], zone["density"]) == (2.0, 2.0, None)
    assert [row[:2] for row in rows(found.tables["crossings"])] == [(0.5, 6), (2.5, 26)]
    assert found.tables["occupancy"]["people"] == [0.5, 1.0, 0.5, 0.0]
    assert found.tables["people"]["path"][0] == pytest.approx(350)


def test_flows_are_summed_by_interval_up_to_the_end_of_the_video():
    found = answers(
        *(walker(down(50, [60, 140]), k + 1, np.array([10 * k, 10 * k + 1])) for k in range(3)), interval=1.5
    )
    entered = [row for row in rows(found.tables["flows"]) if row[2:4] == ("entrance", "in")]
    assert [(start, end, number) for start, end, _, _, number in entered] == [(0, 1.5, 2), (1.5, 2.2, 1)]


def test_who_is_there_at_the_start_and_the_end_stays_from_first_to_last():
    found = answers(walker([(50, 200)] * 30))
    assert rows(found.tables["stays"]) == [("shop", 1, 0.0, 3.0, 3.0, 3.0, False, False, 0.0)]
    assert found.tables["occupancy"]["waiting"] == [1, 1, 1]
    assert answers(walker([(50, 200)] * 30), waiting=0.0).tables["occupancy"]["waiting"] == [0, 0, 0]


def test_going_to_and_fro_on_a_border_is_one_stay():
    sway = 100 + 8 * np.sin(np.arange(50))
    found = answers(walker(down(50, [60, *sway, 200, 200, *sway, 60])))
    assert len(found.tables["stays"]["id"]) == 1
    assert (found.tables["zones"]["entries"], found.tables["zones"]["exits"]) == ([1], [1])


def test_a_scale_gives_metres_speed_and_density():
    scene = Scene([ENTRANCE], [SHOP], (640, 480), scale=0.01)
    found = answers(walker(down(50, 110 + 4.0 * np.arange(40))), scene=scene)
    assert found.tables["people"]["speed"][0] == pytest.approx(0.4)
    assert found.tables["people"]["metres"][0] == pytest.approx(1.6, rel=0.02)
    assert found.tables["zones"]["density"][0] == pytest.approx(1 / 4, abs=1e-3)


def test_three_who_stand_together_gather_and_two_do_not():
    three = [walker([(50 + 20 * k, 200)] * 60, k + 1) for k in range(3)]
    found = answers(*three, walker([(400, 200)] * 60, 4), walker([(420, 200)] * 60, 5))
    (only,) = rows(found.tables["gatherings"])
    assert only[2:] == (3, 3, 70, 200, "1 2 3")
    assert rows(answers(*three, gathering=0.1).tables["gatherings"]) == []
    assert (
        rows(
            answers(*(walker(down(50 + 20 * k, range(60)), k + 1, np.arange(60) + 70 * k) for k in range(3))).tables[
                "gatherings"
            ]
        )
        == []
    )


def test_what_was_filled_in_at_a_line_widens_the_interval_and_a_path_that_breaks_off_before_it_does():
    ys = np.arange(40, 400, 6.0)
    sure = answers(*(walker(down(50, ys), k + 1) for k in range(20)))
    number, low, high = sure.count("entrance", "in")
    filled = np.abs(ys - 100) > 40
    unsure = answers(*(walker(down(50, ys), k + 1, observed=filled) for k in range(20)))
    wide = unsure.count("entrance", "in")
    assert number == wide[0] == 20
    assert wide[1] < low <= 20 <= high
    zones = [{name: values[0] for name, values in one.tables["zones"].items()} for one in (sure, unsure)]
    for name in ("people", "stay"):
        widths = [zone[f"{name}_high"] - zone[f"{name}_low"] for zone in zones]
        assert 0 < widths[0] < widths[1]
    seconds = [one.tables["occupancy"] for one in (sure, unsure)]
    assert all(
        low <= people <= high for low, people, high in zip(*map(seconds[0].get, ("low", "people", "high")), strict=True)
    )
    assert sum(seconds[1]["high"]) > sum(seconds[0]["high"])
    broken = answers(
        *(walker(down(50, ys[ys < 94]), k + 1, np.arange((ys < 94).sum()) + 5) for k in range(20)), length=90
    )
    assert broken.count("entrance", "in")[2] > broken.count("entrance", "in")[0]


def test_nobody_gives_zeros_and_tables_without_rows():
    found = answers(length=20)
    assert found.count("entrance", "in") == (0, 0, 0)
    assert found.occupancy["shop"].tolist() == [0] * 20
    assert not found.tables["people"]["id"]


def test_bad_requests_are_refused():
    track = walker(down(50, [60, 140]))
    for wrong in ({"rate": 0.0}, {"anchor": "floor"}, {"anchor": "knee"}, {"band": -1.0}, {"interval": float("nan")}):
        with pytest.raises(ValueError, match=next(iter(wrong)).replace("_", ".")):
            answers(track, **wrong)
    with pytest.raises(RequestError, match="entrance in, entrance out, exit out, exit back, got door in"):
        answers(track).count("door", "in")
    with pytest.raises(RequestError, match="the video has 64x48"):
        count(Result([track], "v", 10.0, (64, 48)), SCENE)
    beyond = replace(track, boxes=track.boxes * 1000)
    with pytest.raises(RequestError, match="in the picture of 640x480, got all 2 outside of it"):
        count([beyond], SCENE, frame_rate=10)
    with pytest.raises(RequestError, match="expected boxes in pixels, got one that reaches"):
        count([replace(track, boxes=track.boxes * 1e9)], replace(SCENE, size=None), frame_rate=10)
    with pytest.raises(RequestError, match="tracks of boxes"):
        count([object()], SCENE, frame_rate=10)


def test_animals_are_counted_by_their_middle():
    ys = np.arange(50.0, 150, 10)
    states = np.column_stack([0 * ys + 60, ys, 0 * ys, 0 * ys + 30, 0 * ys + 10])
    one = exact_track(1, np.arange(len(ys)), states)
    result = Result([one], "v", 10.0, (640, 480), names=("a", "b", "theta", "length", "width"))
    found = count(result, SCENE)
    assert found.count("entrance", "in")[0] == 1
    assert found.tables["crossings"]["y"] == [110]
    with pytest.raises(RequestError, match="got BodyTrack; track people, animals or blobs"):
        count(replace(result, names=("a", "b", "bend", "x", "y")), SCENE)


def test_origins_and_destinations_are_the_sides_of_the_picture():
    found = answers(walker([(10, 240), (300, 240)]), walker([(320, 300), (320, 479)], 2), walker([(5, 9)], 3))
    assert rows(found.tables["sides"]) == [("left", "left", 1), ("left", "within", 1), ("within", "bottom", 1)]
    assert rows(found.tables["counts"]) == [(0.0, 2.5, 3)]


def test_the_names_are_public():
    assert inspect.unwrap(tsuiseki.count) is count
    assert tsuiseki.Scene is Scene
