"""Camera files: what is written is read back, and what is wrong is named."""

import json
import os

import cv2
import numpy as np
import pytest
import yaml

from tsuiseki.tracking.cameras.camera_files import PlacedCamera, read_projective_cameras, write_cameras
from tsuiseki.tracking.cameras.lens_files import read_intrinsics, write_intrinsics
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError

CAMERA = PinholeCamera.look_at(np.array([4.0, 1.0, 1.5]), np.array([0.0, 0.0, 1.0]), 693.3, 800, 600)
MATRIX = np.array([[700.0, 0.0, 399.5], [0.0, 690.0, 299.5], [0.0, 0.0, 1.0]])


def test_cameras_survive_a_round_trip(tmp_path):
    placed = [PlacedCamera("left", CAMERA, 15.0, 0.25), PlacedCamera("right", CAMERA)]
    write_cameras(tmp_path / "cameras.yaml", placed)
    left, right = read_projective_cameras(tmp_path / "cameras.yaml")
    assert (left.name, left.frame_rate, left.offset) == ("left", 15.0, 0.25)
    assert (right.name, right.frame_rate, right.offset) == ("right", None, 0.0)
    np.testing.assert_allclose(left.camera.matrix, CAMERA.matrix, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda e: e.pop("rotation"), "camera 1: expected the field rotation, found none"),
        (lambda e: e.update(focal=[1.0]), "camera 1: focal: expected 2 finite numbers"),
        (lambda e: e.update(focal=[True, 600.0]), "camera 1: focal: expected 2 finite numbers"),
        (lambda e: e.update(position=["a", 1, 2]), "camera 1: position: expected 3 finite numbers"),
        (lambda e: e.update(rotation=[[1, 0, 0], [0, 1, 0], [0, 0, 2]]), "expected a rotation matrix"),
        (lambda e: e.update(model="fisheye"), "expected model projective"),
        (lambda e: e.update(frame_rate=0), "expected a frame_rate above 0"),
        (lambda e: e.update(offset="soon"), "expected an offset in seconds"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, change, reason):
    path = tmp_path / "cameras.yaml"
    write_cameras(path, [PlacedCamera("left", CAMERA)])
    content = yaml.safe_load(path.read_text())
    change(content["cameras"][0])
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(RequestError, match=reason):
        read_projective_cameras(path)


@pytest.mark.parametrize("text", ["", "cameras: []", "[1, 2]", "a: [", "cameras: [3]"])
def test_a_file_that_is_no_camera_file_is_refused(tmp_path, text):
    (tmp_path / "cameras.yaml").write_text(text)
    with pytest.raises(RequestError, match="expected"):
        read_projective_cameras(tmp_path / "cameras.yaml")


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_opencv_intrinsics_are_imported_with_their_half_pixel(tmp_path, suffix):
    path = str(tmp_path / f"lens{suffix}")
    storage = cv2.FileStorage(path, cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 800)
    storage.write("image_height", 600)
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", np.array([[-0.2, 0.05, 0.001, 0.002]]))
    storage.release()
    lens = read_intrinsics(tmp_path / f"lens{suffix}")
    assert (lens.width, lens.height) == (800, 600)
    np.testing.assert_allclose(lens.principal_point, [400.0, 300.0])
    np.testing.assert_allclose(lens.distortion, [-0.2, 0.05, 0.001, 0.002, 0.0])
    expected, _ = cv2.projectPoints(np.array([[0.3, -0.2, 2.0]]), np.zeros(3), np.zeros(3), MATRIX, lens.distortion)
    camera = PinholeCamera(800, 600, lens.focal, lens.principal_point, np.eye(3), np.zeros(3), lens.distortion)
    np.testing.assert_allclose(camera.project(np.array([[0.3, -0.2, 2.0]]))[0], expected[0] + 0.5, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"K": MATRIX.tolist(), "D": [0.0] * 7, "resolution": [800, 600]}, "4, 5, 8 or 12 distortion coefficients"),
        ({"K": MATRIX.tolist()}, "image_width"),
        ({"K": [[1, 2], [3, 4]], "resolution": [8, 6]}, "3x3 matrix"),
        ({"resolution": [8, 6]}, "3x3 matrix"),
        ([1], "named intrinsics"),
    ],
)
def test_wrong_intrinsics_are_refused(tmp_path, content, reason):
    path = tmp_path / "lens.json"
    path.write_text(json.dumps(content))
    with pytest.raises(RequestError, match=reason):
        read_intrinsics(path)


def test_a_lens_is_written_and_read_under_a_name_that_is_not_utf8(tmp_path):
    path = tmp_path / os.fsdecode(b"caf\xe9.yaml")
    lens = PinholeCamera(800, 600, np.array([700.0, 690.0]), np.array([400.0, 300.0]))
    try:
        write_intrinsics(path, lens, 0.2)
    except OSError:
        pytest.skip("this file system takes names of UTF-8 only")
    assert path.read_text(encoding="utf-8").startswith("%YAML")
    np.testing.assert_allclose(read_intrinsics(path).focal, lens.focal)
