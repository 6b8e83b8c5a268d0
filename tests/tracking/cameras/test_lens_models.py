"""Calibrations of OpenCV and ROS put points where those programs do, or are refused by the name of their model."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import HALF_PIXEL, locate_camera
from tsuiseki.tracking.cameras.lens_files import read_intrinsics, read_lens, read_lens_file, read_lens_fitted
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, UnifiedLens
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError

POINTS = np.array([[0.1, -0.2, 1.0], [0.9, 0.3, 0.4], [-1.0, 0.5, 0.1], [0.8, -0.9, -0.3]])
# cv2.omnidir.projectPoints of opencv-contrib 4.10, with the skew, xi and coefficients of OMNIDIR.
OMNIDIR_PIXELS = [
    [329.325811831, 221.027468557],
    [428.580890251, 276.567984274],
    [189.697498427, 306.01138262],
    [438.924448321, 104.523662944],
]
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
{first}: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 210., 0.8, 320., 0., 212., 240., 0., 0., 1. ]
{second}: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -0.2, 0.05, 0.001, -0.0002 ]
"""
OMNIDIR = OPENCV.format(first="camera_matrix", second="distortion_coefficients") + "xi: 1.2\n"
ROS = """image_width: 640
image_height: 480
camera_name: front
camera_matrix: {{rows: 3, cols: 3, data: [210, 0, 320, 0, 212, 240, 0, 0, 1]}}
distortion_model: {model}
distortion_coefficients: {{rows: 1, cols: {count}, data: {values}}}
"""
ROS_MATRIX = np.array([[210.0, 0, 320], [0, 212, 240], [0, 0, 1]])


def write(folder: Path, text: str) -> Path:
    path = folder / "lens.yaml"
    path.write_text(text)
    return path


def ros(model: str, values: list[float]) -> str:
    return ROS.format(model=model, count=len(values), values=values)


def test_omnidir_projects_as_opencv_does(tmp_path: Path) -> None:
    path = write(tmp_path, OMNIDIR)
    given = read_lens_file(path)
    mirror = UnifiedLens(
        640, 480, given.focal, given.principal_point, given.coefficients, given.skew, given.xi
    )  # fmt: skip
    np.testing.assert_allclose(mirror.project(POINTS) - HALF_PIXEL, OMNIDIR_PIXELS, atol=1e-8)
    lens, residuals = read_lens_fitted(path)
    # The fit to Scaramuzza's polynomial is what is left; it grows towards the rim, where the mirror ends.
    np.testing.assert_allclose(lens.project(POINTS) - HALF_PIXEL, OMNIDIR_PIXELS, atol=1.0)
    assert np.sqrt(np.mean(residuals**2)) < 1


@pytest.mark.parametrize("alpha", [0.0, 0.004])
def test_fisheye_files_project_as_opencv_does(tmp_path: Path, alpha: float) -> None:
    values = [0.01, -0.005, 0.001, -0.0002]
    front = POINTS[:3]
    text = ros("equidistant", values).replace("[210, 0,", f"[210, {210 * alpha},")
    given = read_lens_file(write(tmp_path, text))
    lens = EquidistantLens(640, 480, given.focal, given.principal_point, given.coefficients, given.skew)
    expected, _ = cv2.fisheye.projectPoints(
        front[:, None], np.zeros(3), np.zeros(3), ROS_MATRIX, np.array(values), alpha=alpha
    )
    np.testing.assert_allclose(lens.project(front) - HALF_PIXEL, expected[:, 0], atol=1e-6)
    np.testing.assert_allclose(read_lens(tmp_path / "lens.yaml").project(front), lens.project(front), atol=0.5)


@pytest.mark.parametrize(
    ("model", "values"),
    [
        ("plumb_bob", [0.01, -0.005, 0.001, -0.0002, 0.003]),
        ("plumb_bob", [0.01, -0.005, 0.001, -0.0002]),
        ("rational_polynomial", [0.01, -0.005, 0.001, -0.0002, 0.003, 0.02, 0.001, 0.0004]),
    ],
)
def test_ros_lenses_of_a_pinhole_project_as_opencv_does(tmp_path: Path, model: str, values: list[float]) -> None:
    camera = read_intrinsics(write(tmp_path, ros(model, values)))
    front = POINTS[:1]
    expected, _ = cv2.projectPoints(front, np.zeros(3), np.zeros(3), ROS_MATRIX, np.array(values))
    np.testing.assert_allclose(camera.project(front)[0] - HALF_PIXEL, expected[:, 0], atol=1e-9)


def test_ros_messages_are_read_too(tmp_path: Path) -> None:
    text = "height: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: [0.1, 0, 0, 0, 0]\n"
    text += "K: [210, 0, 320, 0, 212, 240, 0, 0, 1]\n"
    found = read_intrinsics(write(tmp_path, text))
    assert (found.width, found.height, found.distortion[0]) == (640, 480, 0.1)
    np.testing.assert_array_equal(found.focal, [210, 212])


FISHEYE = OPENCV.format(first="K", second="D").replace("0.8", "0.0")
NAMELESS = OPENCV.format(first="camera_matrix", second="distortion_coefficients").replace("0.8", "0.0")
PINHOLE = ros("plumb_bob", [0.1, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("text", "model"),
    [
        (OMNIDIR, "omnidirectional"),
        (FISHEYE, "fisheye"),
        (NAMELESS + "fisheye_model: 1\n", "fisheye"),
        (NAMELESS + "fisheye: 1\n", "fisheye"),
        (NAMELESS + "camera_model: fish-eye\n", "fisheye"),
        (NAMELESS + "model_type: KANNALA_BRANDT\n", "fisheye"),
        (NAMELESS.replace("0.001", "-0.08"), "whose last look like a fisheye's; add the line distortion_model"),
        (ros("equidistant", [0.01, 0, 0, 0]), "fisheye"),
        (ros("fov", [0.9]), "expected a distortion_model of plumb_bob, .* got 'fov'"),
    ],
)
def test_no_other_lens_is_taken_for_a_pinhole(tmp_path: Path, text: str, model: str) -> None:
    with pytest.raises(RequestError, match=model):
        read_intrinsics(write(tmp_path, text))


def test_no_lens_is_written_that_is_far_from_what_was_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsuiseki.tracking.calibrate.run.FAR", 0.1)
    words = ["calibrate", "convert", str(write(tmp_path, OMNIDIR.replace("0.8", "0.0"))), "--to", "kalibr-omni"]
    assert main([*words, "--out", str(tmp_path / "out.yaml")]) == 1
    assert "px rms away; choose another format with --to" in capsys.readouterr().err
    assert not (tmp_path / "out.yaml").exists()


def test_a_pinhole_is_not_taken_for_a_fisheye(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"got a pinhole's of 5 coefficients; .* --projective"):
        read_lens(write(tmp_path, PINHOLE))
    with pytest.raises(RequestError, match="expected four coefficients of the fisheye model, got 5"):
        read_lens(write(tmp_path, ros("equidistant", [0.1, 0, 0, 0, 0])))


def test_four_coefficients_of_no_name_are_told(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="four coefficients are taken as k1, k2, p1, p2; .* distortion_model"):
        assert read_intrinsics(write(tmp_path, NAMELESS)).distortion.tolist() == [-0.2, 0.05, 0.001, -0.0002, 0]
    assert read_lens_file(write(tmp_path, NAMELESS + "fisheye_model: 0\n")).model == "pinhole"
    named = tmp_path / "my_fisheye.yaml"
    named.write_text(NAMELESS)
    assert read_lens_file(named).model == "fisheye"


def test_a_mark_before_the_first_character_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "lens.yaml").write_text(OMNIDIR, encoding="utf-8-sig")
    assert read_lens_file(tmp_path / "lens.yaml").xi == 1.2


def test_columns_of_a_table_locate_a_camera(tmp_path: Path) -> None:
    """OpenCV takes no slices of a larger array."""
    intrinsics = read_intrinsics(write(tmp_path, PINHOLE))
    points = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 4], (8, 3))
    table = np.column_stack([points, intrinsics.project(points)[0]])
    found = locate_camera(table[:, :3], table[:, 3:], intrinsics)
    assert found.root_mean_square < 1e-6
    np.testing.assert_allclose(found.camera.position, 0, atol=1e-6)


def test_the_shared_cases(data_folder: Path) -> None:
    folder = data_folder / "cases" / "calib"
    assert read_lens(folder / "calib_bom.txt").width == 640
    assert read_lens_file(folder / "cv_omnidir.yml").model == "omnidirectional"
    assert read_lens(folder / "ros_equi.yaml").width == 640
    assert read_intrinsics(folder / "ros_plumb.yaml").distortion[1] == -0.005


def test_a_circle_that_ends_inside_the_picture_is_a_field(tmp_path: Path) -> None:
    circle = OMNIDIR.replace("210.,", "105.,").replace("212.,", "105.,").replace("0.05, 0.001, -0.0002", "0., 0., 0.")
    lens, away = read_lens_fitted(write(tmp_path, circle))
    assert lens.field is not None
    assert 1.7 < lens.field < 2.6
    assert away.max() < 0.5
