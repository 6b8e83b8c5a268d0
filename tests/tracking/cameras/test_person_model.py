"""The two-cylinder person, its table, and crops turned upright."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import pose_at
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.person_model import (
    PersonModel,
    build_table,
    cached_table,
    headed,
    outlines,
    stand,
)
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fisheye.view import upright_crops

LENS = OmnidirectionalLens(640, 480, np.array([140.0, 0.0, -1.2e-3, 1e-6, -5e-9]), np.array([320.0, 240.0]))
CAMERA = pose_at(OmnidirectionalCamera(LENS, np.eye(3), np.zeros(3)), 3.0)
FLOOR = np.array([-4.0, -3.0, 4.0, 3.0])
COARSE = (12.0, 0.2)


def test_the_boxes_hold_the_outline():
    feet = np.array([[2.0, 1.0], [0.1, -1.5]])
    upright, rotated, kept = outlines(CAMERA, feet, PersonModel())
    assert np.array_equal(kept, feet)
    for foot, box, (x, y, w, h, angle) in zip(feet, upright, rotated, strict=True):
        points = CAMERA.project(PersonModel().outline() + np.append(foot, 0.0))[0]
        assert np.allclose(np.concatenate([points.min(axis=0), points.max(axis=0)]), box)
        turned = (points - [x, y]) @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        assert (np.abs(turned) <= np.array([w, h]) / 2 + 0.01).all()


def test_the_feet_end_is_the_lower_one():
    feet = np.array([[2.0, 0.0], [-2.0, 0.0], [0.0, 2.0], [0.0, -2.0]])
    rotated = outlines(CAMERA, feet, PersonModel())[1]
    # Seen from above the head lies further out than the feet: to the right of the image for somebody at +x.
    # The box of least area is not quite along the radius.
    turned = (np.degrees(rotated[:, 4]) - [90, 270, 0, 180] + 180) % 360 - 180
    assert np.abs(turned).max() < 10
    assert (rotated[:, 3] > rotated[:, 2]).all()


def test_headed_keeps_the_rectangle():
    box = headed(np.zeros((1, 2)), np.array([[30.0, 10.0]]), np.array([0.2]), np.array([[-1.0, 0.0]]))[0]
    assert box[2:4].tolist() == [10.0, 30.0]
    assert np.isclose(np.cos(box[4] + np.pi / 2 - 0.2), 1)


def test_the_table_finds_where_somebody_stands():
    table = build_table(CAMERA, FLOOR, steps=COARSE)
    feet = np.random.default_rng(0).uniform(-2, 2, (30, 2))
    upright, rotated, feet = outlines(CAMERA, feet, PersonModel(), 0.99)
    found, places = table.look_up(upright)
    # The grids' steps are 12 px and 0.2 m; the nearest of them is at most half a diagonal away.
    assert np.linalg.norm(places - feet, axis=1).max() < 0.2
    assert np.abs(found[:, :2] - rotated[:, :2]).max() < 12


def test_a_projective_camera_serves_too():
    camera = PinholeCamera.look_at(np.array([0.0, -6.0, 3.0]), np.zeros(3), 500, 640, 480)
    _, places = build_table(camera, FLOOR, steps=COARSE).look_up(
        outlines(camera, np.array([[0.5, 0.5]]), PersonModel())[0]
    )
    assert np.allclose(places, [[0.5, 0.5]], atol=0.15)


def test_nothing_to_look_up():
    rotated, places = build_table(CAMERA, FLOOR, steps=COARSE).look_up(np.empty((0, 4)))
    assert (rotated.shape, places.shape) == ((0, 5), (0, 2))


def test_tables_are_kept_by_camera_and_person(tmp_path):
    first = cached_table(tmp_path, CAMERA, FLOOR, PersonModel(), COARSE)
    file = next(tmp_path.glob("person-*.npz"))
    stamp = file.stat().st_mtime_ns
    again = cached_table(tmp_path, CAMERA, FLOOR, PersonModel(), COARSE)
    assert np.array_equal(first.upright, again.upright)
    assert file.stat().st_mtime_ns == stamp
    cached_table(tmp_path, CAMERA, FLOOR, PersonModel(height=1.6), COARSE)
    cached_table(tmp_path, replace(CAMERA, position=np.array([0, 0, 3.1])), FLOOR, PersonModel(), COARSE)
    assert len(list(tmp_path.glob("person-*.npz"))) == 3
    whole = file.read_bytes()
    for broken in (b"broken", whole[: len(whole) // 2]):
        file.write_bytes(broken)
        assert np.array_equal(cached_table(tmp_path, CAMERA, FLOOR, PersonModel(), COARSE).upright, first.upright)


def test_a_camera_no_higher_than_the_person_is_refused():
    with pytest.raises(RequestError, match=r"above the person of 1\.7 m"):
        build_table(pose_at(CAMERA, 1.7), FLOOR)


def test_one_who_stands_by_hand():
    upright, rotated = stand(CAMERA, np.array([2.0, 1.0]), FLOOR)
    both = outlines(CAMERA, np.array([[2.0, 1.0]]), PersonModel())
    assert np.array_equal(upright, both[0][0])
    assert np.array_equal(rotated, both[1][0])


@pytest.mark.parametrize(
    ("camera", "place", "message"),
    [
        (CAMERA, [5.0, 1.0], "on the floor"),
        (replace(CAMERA, lens=replace(LENS, field=0.8)), [2.9, 0.0], "within the lens's rim"),
        (pose_at(CAMERA, 1.2), [0.5, 0.0], "above the person"),
    ],
)
def test_one_who_cannot_stand_there_is_refused(camera, place, message):
    with pytest.raises(RequestError, match=message):
        stand(camera, np.array(place), FLOOR)


def test_people_partly_beyond_the_rim_are_left_out():
    narrow = replace(CAMERA, lens=replace(LENS, field=0.8))
    feet = np.array([[0.5, 0.0], [2.9, 0.0]])
    assert outlines(narrow, feet, PersonModel())[2].tolist() == [[0.5, 0.0]]


def test_a_floor_out_of_view_is_refused():
    narrow = replace(CAMERA, lens=replace(LENS, field=0.8))
    with pytest.raises(RequestError, match="floor in view"):
        build_table(narrow, np.array([30.0, 30.0, 31.0, 31.0]))


def test_places_lie_on_the_floor():
    table = build_table(CAMERA, np.array([0.0, 0.0, 2.0, 1.0]), steps=COARSE)
    assert table.places.min() >= 0
    assert (table.places.max(axis=0) <= [2.0, 1.0]).all()


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, 2.5, -2.0])
def test_a_crop_is_the_box_before_it_was_turned(angle):
    image = np.zeros((300, 300, 3), dtype=np.uint8)
    upward = np.array([np.sin(angle), -np.cos(angle)])
    head, foot = np.array([150, 140]) + 40 * upward, np.array([150, 140]) - 40 * upward
    cv2.circle(image, tuple(np.round(head).astype(int).tolist()), 9, (255, 0, 0), -1)
    cv2.circle(image, tuple(np.round(foot).astype(int).tolist()), 9, (0, 255, 0), -1)
    crop = upright_crops(image, np.array([[150.5, 140.5, 40.0, 120.0, angle]]), 60, 20)[0]
    assert crop[:30, :, 0].sum() > 50 * crop[30:, :, 0].sum()
    assert crop[30:, :, 1].sum() > 50 * crop[:30, :, 1].sum()
    rows = np.flatnonzero(crop[:, 10, 0] > 128)
    # 80 px between the circles' centres in a box of 120 px: the head's lies at a sixth of the height.
    assert abs(rows.mean() - 9.5) < 1.0


def test_an_upright_box_is_cut_out_as_it_is():
    image = np.random.default_rng(0).integers(0, 255, (60, 60, 3)).astype(np.uint8)
    crop = upright_crops(image, np.array([[20.0, 30.0, 10.0, 20.0, 0.0]]), 20, 10)[0]
    assert np.array_equal(crop, image[20:40, 15:25])
