"""A camera from drawn pictures of a checkerboard, and lenses of 8 and 12 coefficients against OpenCV."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.calibration import fit_checkerboards
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, read_projective_cameras, write_cameras
from tsuiseki.tracking.cameras.lens_files import read_intrinsics
from tsuiseki.tracking.cameras.projective import PinholeCamera, distort, largest_radius, undistort
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError

LENSES = {
    5: np.array([-0.25, 0.08, 0.001, -0.0005, -0.01]),
    8: np.array([0.4, -0.1, 0.001, -0.0005, 0.02, 0.6, 0.05, 0.01]),
    12: np.array([0.4, -0.1, 0.001, -0.0005, 0.02, 0.6, 0.05, 0.01, 0.002, -0.001, 0.001, 0.0005]),
}
POINTS = np.random.default_rng(0).uniform(-0.6, 0.6, (200, 2))


@pytest.mark.parametrize("coefficients", LENSES.values(), ids=LENSES)
def test_lenses_agree_with_opencv_and_invert(coefficients: np.ndarray) -> None:
    space = np.column_stack([POINTS, np.ones(len(POINTS))])
    theirs, _ = cv2.projectPoints(space, np.zeros(3), np.zeros(3), np.eye(3), coefficients)
    ours = distort(POINTS, coefficients)
    np.testing.assert_allclose(ours, theirs.reshape(-1, 2), atol=1e-12)
    np.testing.assert_allclose(undistort(ours, coefficients), POINTS, atol=1e-9)


def test_a_rational_lens_is_told_up_to_where_it_turns_back() -> None:
    coefficients = LENSES[8].copy()
    coefficients[:2] = -0.5, 0.0
    limit = largest_radius(coefficients)
    radii = np.linspace(0.01, 2 * limit, 4000)
    grown = cv2.projectPoints(
        np.column_stack([radii, 0 * radii, 1 + 0 * radii]), np.zeros(3), np.zeros(3), np.eye(3),
        np.where(np.arange(8) == 2, 0, np.where(np.arange(8) == 3, 0, coefficients)),
    )[0][:, 0, 0]  # fmt: skip
    assert radii[np.argmax(np.diff(grown) < 0)] == pytest.approx(limit, rel=2e-3)
    assert np.isnan(distort(np.array([[1.01 * limit, 0.0]]), coefficients)).all()


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve pictures of a board of 9 x 6 inner corners, one of which shows no board; focal length 500, k1 = -0.2."""
    folder, rng = tmp_path_factory.mktemp("board"), np.random.default_rng(1)
    board = np.kron((np.indices((7, 10)).sum(axis=0) % 2) * 255, np.ones((40, 40))).astype(np.uint8)
    board = np.pad(board, 40, constant_values=255)
    lens = np.array([-0.2, 0, 0, 0, 0.0])
    camera = PinholeCamera(640, 480, np.full(2, 500.0), np.array([320.0, 240.0]), np.eye(3), np.zeros(3), lens)
    pixels = np.stack(np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5), axis=-1).reshape(-1, 2)
    ideal = camera.normalised(pixels)
    for number in range(12):
        turn, _ = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))
        middle = np.array([rng.uniform(-60, 60), rng.uniform(-40, 40), rng.uniform(500, 700)])
        # Pixels of the picture to the board's plane.
        plane = np.linalg.inv(np.column_stack([turn[:, 0], turn[:, 1], middle]))
        at = np.column_stack([ideal, np.ones(len(ideal))]) @ plane.T
        maps = (at[:, :2] / at[:, 2:] + [240, 180]).astype(np.float32).reshape(480, 640, 2)
        image = cv2.remap(board, maps, None, cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT, borderValue=128)
        image = cv2.GaussianBlur(np.full((480, 640), 128, np.uint8) if number == 5 else image, (0, 0), 0.8)
        cv2.imwrite(str(folder / f"{number:02d}.png"), image)
    return folder


@pytest.mark.slow
def test_the_command_finds_the_camera(pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "intrinsics.yaml"
    assert main(["calibrate", "checkerboard", str(pictures), "--corners", "9,6", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "the board in 11 of 12 pictures" in printed
    found = read_intrinsics(out)
    np.testing.assert_allclose(found.focal, 500, rtol=0.01)
    np.testing.assert_allclose(found.principal_point, [320, 240], atol=4)
    assert found.distortion[0] == pytest.approx(-0.2, abs=0.04)
    assert (found.width, found.height) == (640, 480)
    assert main(["calibrate", "checkerboard", str(pictures), "--corners", "6,6", "--out", str(out), "--overwrite"]) == 2
    assert "--corners: expected two different numbers" in capsys.readouterr().err


def test_a_few_pictures_fix_no_camera() -> None:
    with pytest.raises(RequestError, match="expected the whole board in at least 4 pictures, found it in 1"):
        fit_checkerboards([np.zeros((54, 2))], (9, 6), (640, 480))
    flat = np.mgrid[:9, :6].T.reshape(-1, 2) * 30.0 + 100
    with pytest.raises(RequestError, match="from different sides"):
        fit_checkerboards([flat, flat + 5, flat + 9, flat - 7], (9, 6), (640, 480))


@pytest.mark.parametrize("coefficients", [8, 12])
def test_wide_lenses_go_through_files(coefficients: int, pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / "wide.yaml"
    words = ["calibrate", "checkerboard", str(pictures), "--corners", "9,6", "--coefficients", str(coefficients)]
    assert main([*words, "--out", str(out)]) == 0
    intrinsics = read_intrinsics(out)
    assert intrinsics.distortion.shape == (coefficients,)
    camera = PinholeCamera(
        640, 480, intrinsics.focal, intrinsics.principal_point, np.eye(3), np.zeros(3), LENSES[coefficients]
    )
    write_cameras(tmp_path / "cameras.yaml", [PlacedCamera("wide", camera)])
    (read,) = read_projective_cameras(tmp_path / "cameras.yaml")
    np.testing.assert_array_equal(read.camera.distortion, LENSES[coefficients])
