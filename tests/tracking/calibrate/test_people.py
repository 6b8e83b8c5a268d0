"""Cameras from people: projected people give them back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

import tsuiseki
from tests.tracking.calibrate.walking_people import SIZE, across, filmed, looking, walks
from tsuiseki.tracking.calibrate.people import PeopleCalibration
from tsuiseki.tracking.cameras.camera_files import read_cameras
from tsuiseki.tracking.cameras.people_views import NUMBERS, feet, on_floor, picture, pinhole, sight
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import Track

CAMERAS = [looking(1, 1100), looking(6, 950)]
WALKS = walks(3, 16, 60)
CAMERA = np.array([np.log(1000), 640, 360, 0.3, 0.05, np.log(4), 0.7, 2, -3, 0, 0])


def floor_error(found: PeopleCalibration, cameras) -> float:
    """Median metres between the floors of found cameras and of the true ones, laid on each other."""
    ours, theirs = [], []
    for k, camera in enumerate(cameras):
        number, view = found.numbers[k], found.views[k]
        foot = picture(number, feet(number, view.boxes, 1.7), 0.0)
        ours.append(found.places(k))
        theirs.append(camera.ground(foot)[:, :2] @ [1, 1j])
    a, b = np.concatenate(ours), np.concatenate(theirs)
    turn = np.exp(1j * np.angle(np.vdot(a - a.mean(), b - b.mean())))
    return float(np.median(np.abs(turn * (a - a.mean()) + b.mean() - b)))


def test_the_numbers_of_a_camera_are_a_pinhole_camera():
    rng = np.random.default_rng(0)
    places = rng.uniform([-3, 4], [3, 12], (20, 2)) @ [1, 1j]
    world = CAMERA[7] + 1j * CAMERA[8] + np.exp(1j * CAMERA[6]) * places
    points = np.column_stack([world.real, world.imag, np.full(20, 1.2)])
    assert np.allclose(pinhole(CAMERA, SIZE).project(points)[0], picture(CAMERA, places, 1.2))
    assert np.allclose(sight(CAMERA, picture(CAMERA, places, 0.0)), places)


def test_a_box_about_a_leaning_person_gives_the_foot():
    place = np.array([3 + 5j])
    low, high = picture(CAMERA, place, 0.0)[0], picture(CAMERA, place, 1.7)[0]
    middle = (low[0] + high[0]) / 2
    assert abs(low[0] - middle) > 5
    box = np.array([[middle - 20, high[1], middle + 20, low[1]]])
    world = CAMERA[7] + 1j * CAMERA[8] + np.exp(1j * CAMERA[6]) * place
    assert abs(on_floor(CAMERA, box, 1.7) - world)[0] < 0.01


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_projected_people_give_back_the_camera_to_one_percent(seed):
    camera = looking(seed)
    found = tsuiseki.calibrate_people([filmed(camera, across(seed, 40))])
    assert np.exp(found.numbers[0, NUMBERS.index("log_focal")]) == pytest.approx(1100, rel=0.01)
    assert np.exp(found.numbers[0, NUMBERS.index("log_height")]) == pytest.approx(camera.position[2], rel=0.01)


@pytest.mark.slow
def test_two_cameras_find_their_floor_and_clock():
    sources = [filmed(CAMERAS[0], WALKS, noise=0.01), filmed(CAMERAS[1], WALKS, noise=0.01, offset=3.3, seed=1)]
    found = tsuiseki.calibrate_people(sources, reach=6)
    assert floor_error(found, CAMERAS) < 0.1
    assert found.errors.max() < 0.05
    assert found.cameras[1].offset == pytest.approx(3.3, abs=0.05)
    apart = np.linalg.norm(CAMERAS[1].position - CAMERAS[0].position)
    places = [one.camera.position for one in found.cameras]
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(apart, rel=0.05)
    assert (found.deviations[1, :10] > 0).all()


@pytest.mark.slow
def test_a_given_camera_that_was_moved_is_named():
    sources = [filmed(CAMERAS[0], WALKS), filmed(CAMERAS[1], WALKS, seed=1), filmed(looking(3), WALKS, seed=2)]
    found = tsuiseki.calibrate_people(sources, reach=2)
    right = [replace(one, camera=camera) for one, camera in zip(found.cameras, [*CAMERAS, looking(3)], strict=True)]
    assert not any(one.wrong for one in tsuiseki.check_cameras(right, found))
    moved = replace(CAMERAS[1], position=np.add(CAMERAS[1].position, [1.5, 0, 0]))
    told = tsuiseki.check_cameras([right[0], replace(right[1], camera=moved), right[2]], found)
    assert [one.wrong for one in told] == [False, True, False]
    assert told[1].error == pytest.approx(1.5, abs=0.2)
    late = tsuiseki.check_cameras([right[0], replace(right[1], offset=0.5), right[2]], found)
    assert [one.wrong for one in late] == [False, True, False]


@pytest.mark.slow
def test_clocks_that_run_apart_are_said():
    sources = [filmed(CAMERAS[0], WALKS), filmed(CAMERAS[1], WALKS, drift=0.01, seed=1)]
    with pytest.warns(InputWarning, match=r"runs apart .* by 0\.\d+ s over the video; frame_rate 4\.95"):
        found = tsuiseki.calibrate_people(sources, reach=2)
    assert found.cameras[1].frame_rate == pytest.approx(5 / 1.01, rel=5e-4)


def level(count: int) -> list[Track]:
    """People who walk along one row."""
    frames = np.arange(30)
    x = 100 + 20 * frames
    boxes = np.column_stack([x, np.full(30, 200), x + 40, np.full(30, 300)]).astype(float)
    return [Track(k + 1, frames + 40 * k, boxes, np.ones(30)) for k in range(count)]


def test_what_says_too_little_is_refused():
    one = filmed(CAMERAS[0], WALKS)
    few = replace(one, tracks=one.tracks[:1])
    with pytest.raises(RequestError, match="at least 2 people"):
        tsuiseki.calibrate_people([few])
    with pytest.raises(RequestError, match="all at one distance, 100 to 100 pixels high"):
        tsuiseki.calibrate_people([replace(one, tracks=level(4))])
    with pytest.raises(RequestError, match="the same people in 1 "):
        tsuiseki.calibrate_people([one, one])
    with pytest.raises(RequestError, match="got none"):
        tsuiseki.calibrate_people([replace(one, tracks=[])])
    with pytest.raises(RequestError, match="give `fps`"):
        tsuiseki.calibrate_people([replace(one, frame_rate=0.0)])
    with pytest.raises(RequestError, match="give `image_size`"):
        tsuiseki.calibrate_people([replace(one, size=None)])
    other = filmed(CAMERAS[1], walks(99, 16, 60))
    with pytest.raises(RequestError, match="seen by two cameras at a time"):
        tsuiseki.calibrate_people([one, other], reach=0)


@pytest.mark.slow
def test_the_command_writes_cameras_and_a_plan_and_checks(tmp_path, capsys):
    for k, camera in enumerate(CAMERAS):
        tsuiseki.write_tracks(tmp_path / f"c{k}.txt", filmed(camera, WALKS, seed=k))
    given = [str(tmp_path / f"c{k}.txt") for k in (0, 1)]
    words = ["calibrate", "people", *given, "--fps", "5", "--image-size", "1280,720", "--reach", "1"]
    out, plan = tmp_path / "cameras.yaml", tmp_path / "plan.png"
    assert main([*words, "--out", str(out), "--plot", str(plan)]) == 0
    assert "c1: " in capsys.readouterr().out
    assert plan.stat().st_size > 1000
    assert [one.name for one in read_cameras(out)] == ["c0", "c1"]
    assert yaml.safe_load(out.read_text())["cameras"][1]["interval_95"]["x"] > 0
    assert main([*words, "--cameras", str(out)]) == 0
    assert "c1: agrees" in capsys.readouterr().out
