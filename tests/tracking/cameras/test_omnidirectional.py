"""Scaramuzza's camera: closed forms, the exact root, file formats and conversions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from tsuiseki.tracking.cameras import lens_files
from tsuiseki.tracking.cameras.lens_files import read_lens, write_lens
from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, UnifiedLens, fit_omnidirectional, image_rays
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.errors import RequestError

LENS = OmnidirectionalLens(
    640, 480, np.array([160.0, 0.0, -1.2e-3, 1e-6, -5e-9]), np.array([322.5, 238.0]),
    np.array([[1.0, 2e-4], [-3e-4, 1.001]])
)  # fmt: skip


def test_pixels_come_back_through_their_rays():
    pixels = np.random.default_rng(0).uniform(0, 1, (2000, 2)) * [640, 480]
    pixels = pixels[LENS.within_rim(pixels)]
    rays = LENS.rays(pixels)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    # Newton's method doubles the digits of a table that is right to 1e-5 px.
    assert np.abs(LENS.project(rays * 3.7) - pixels).max() < 1e-9


def test_a_constant_polynomial_is_a_pinhole():
    flat = OmnidirectionalLens(640, 480, np.array([200.0]), np.array([320.0, 240.0]))
    points = np.array([[0.3, -0.2, 2.0], [0.0, 0.0, 1.0], [-1.0, 0.4, 1.5]])
    assert np.allclose(flat.project(points), 200 * points[:, :2] / points[:, 2:] + [320, 240])


def test_the_axes_are_right_down_and_forward():
    right, down = LENS.project(np.array([[0.1, 0, 1.0], [0, 0.1, 1.0]])) - LENS.centre
    assert right[0] > 10
    assert abs(right[1]) < 0.1
    assert down[1] > 10
    assert abs(down[0]) < 0.1


def test_nothing_is_seen_outside_the_field():
    narrow = replace(LENS, field=1.0)
    angles = np.array([0.0, 0.99, 1.01, 2.0, np.pi])
    seen = np.isfinite(narrow.project(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1))[:, 0])
    assert seen.tolist() == [True, True, False, False, False]
    assert np.isnan(narrow.rays(np.array([[0.0, 0.0]]))).all()


def test_an_equidistant_polynomial_gives_the_angle():
    focal = 190.0
    lens = fit_omnidirectional(EquidistantLens(640, 480, np.full(2, focal), np.array([320.0, 240.0]), np.zeros(4)))
    angles = np.linspace(0.05, 1.6, 20)
    pixels = lens.project(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1))
    # The polynomial of degree 8 is an approximation of rho / tan(rho / f).
    assert np.abs(pixels[:, 0] - 320 - focal * angles).max() < 0.02


def test_resizing_commutes_with_projection():
    points = np.random.default_rng(1).normal((0.0, 0.0, 2.0), size=(50, 3))
    larger = LENS.resized(1280, 720)
    expected = 2 * LENS.project(points) - [0, 120]
    found = larger.project(points)
    # The cut image's corners, and with them the rim, lie nearer.
    seen = np.isfinite(found[:, 0])
    assert seen.sum() > 40
    assert np.allclose(found[seen], expected[seen], atol=1e-9)


def test_a_wider_image_of_the_same_sensor():
    points = np.random.default_rng(1).normal((0.0, 0.0, 2.0), size=(50, 3))
    wider = LENS.resized(1280, 720, "widen").project(points)
    known = np.isfinite(LENS.project(points)[:, 0])
    assert np.allclose(wider[known], (1.5 * LENS.project(points) + [160, 0])[known], atol=1e-9)


def test_ground_points_project_to_their_pixels():
    camera = OmnidirectionalCamera(LENS, np.diag([1.0, -1.0, -1.0]), np.array([1.0, 2.0, 3.0]))
    floor = np.array([[0.0, 0.0, 0.0], [3.0, 2.5, 0.0], [1.0, 2.0, 0.0]])
    pixels, distance = camera.project(floor)
    assert np.allclose(camera.ground(pixels), floor, atol=1e-9)
    assert np.allclose(distance, np.linalg.norm(floor - camera.position, axis=1))


def test_rays_keep_the_type_of_the_pixels():
    assert LENS.rays(np.array([[300.0, 200.0]], dtype=np.float32)).dtype == np.float32


@pytest.mark.parametrize(("kind", "suffix"), [("ocam", ".txt"), ("py-ocam", ".json")])
def test_its_own_formats_lose_nothing(tmp_path, kind, suffix):
    path = tmp_path / f"lens{suffix}"
    write_lens(path, LENS, kind)
    pixels, rays = image_rays(LENS)
    back = read_lens(path, (640, 480))
    assert np.abs(back.project(rays) - pixels).max() < 1e-5
    # Fitted with 14 coefficients over a field of a hundred degrees.
    assert np.abs(back.project_by_inverse(rays) - pixels).max() < 0.05


@pytest.mark.parametrize(("kind", "suffix"), [("ocam", ".txt"), ("py-ocam", ".json")])
def test_the_residual_is_that_of_what_was_written(tmp_path, monkeypatch, kind, suffix):
    assert 0 < write_lens(tmp_path / f"lens{suffix}", LENS, kind).max() < 1e-8
    # A writer that cuts its digits loses pixels, and the residual says so.
    original = lens_files._rescaled
    rounded = lambda lens, factor: replace(original(lens, factor), centre=np.round(lens.centre))  # noqa: E731
    monkeypatch.setattr(lens_files, "_rescaled", rounded)
    assert write_lens(tmp_path / f"rounded{suffix}", LENS, kind).max() > 0.1


@pytest.mark.parametrize("kind", ["kalibr-equidistant", "opencv"])
def test_an_equidistant_lens_survives_the_way_there_and_back(tmp_path, kind):
    flat = EquidistantLens(
        640, 480, np.array([180.0, 181.0]), np.array([318.0, 243.0]), np.array([0.02, -0.004, 1e-3, 0])
    )
    lens = fit_omnidirectional(flat)
    path = tmp_path / "lens.yaml"
    residuals = write_lens(path, lens, kind)
    pixels, rays = image_rays(lens)
    assert residuals.max() < 0.05
    assert np.abs(read_lens(path, (640, 480)).project(rays) - pixels).max() < 0.1


def test_kalibrs_entry_is_read_without_the_name_of_its_camera(tmp_path):
    flat = EquidistantLens(640, 480, np.array([180.0, 181.0]), np.array([318.0, 243.0]), np.zeros(4))
    write_lens(tmp_path / "named.yaml", fit_omnidirectional(flat), "kalibr-equidistant")
    entry = yaml.safe_load((tmp_path / "named.yaml").read_text())["cam0"]
    (tmp_path / "plain.yaml").write_text(yaml.safe_dump(entry))
    named, plain = (read_lens(tmp_path / f"{name}.yaml") for name in ("named", "plain"))
    assert np.array_equal(named.centre, plain.centre)


def test_a_unified_lens_survives_the_way_there_and_back(tmp_path):
    mirror = UnifiedLens(
        640, 480, np.array([330.0, 331.0]), np.array([318.0, 243.0]), np.array([-0.1, 0.02, 1e-4, 0]), xi=1.1
    )
    lens = fit_omnidirectional(mirror)
    residuals = write_lens(tmp_path / "lens.yaml", lens, "kalibr-omni")
    assert np.sqrt(np.mean(residuals**2)) < 0.05


def test_ocamcalibs_rows_and_signs(tmp_path):
    path = tmp_path / "calib_results.txt"
    path.write_text("# a comment\n\n2 -100 0\n\n2 150 60 \n\n20 30\n1 0 0\n\n40 60\n")
    lens = read_lens(path)
    assert (lens.width, lens.height) == (60, 40)
    assert lens.centre.tolist() == [30.5, 20.5]
    # A point to the right of the axis lies at a greater column: OCamCalib's y.
    assert np.allclose(lens.project(np.array([[0.1, 0.0, 1.0]])), [[40.5, 20.5]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2 -100 0\n2 150 60\n20 30\n", "the row of the affine is missing"),
        ("3 -100 0\n2 150 60\n20 30\n1 0 0\n40 60\n", "expected 3 coefficients"),
        ("2 -100 0\n1574 " + "0 " * 1574 + "\n20 30\n1 0 0\n40 60\n", "calibration has failed"),
        ("2 -100 0\n3 0 0 0\n20 30\n1 0 0\n40 60\n", "not all zero"),
        ("2 100 0\n2 150 60\n20 30\n1 0 0\n40 60\n", "below 0 at 0"),
        ("2 -100 x\n2 150 60\n20 30\n1 0 0\n40 60\n", "expected numbers"),
    ],
)
def test_broken_calibrations_are_named(tmp_path, text, message):
    path = tmp_path / "calib_results.txt"
    path.write_text(text)
    with pytest.raises(RequestError, match=message):
        read_lens(path)


def test_py_ocamcalib_needs_an_image_size(tmp_path):
    path = tmp_path / "lens.json"
    path.write_text(
        json.dumps({"taylor_coefficient": [100.0, 0], "distortion_center": [1, 2], "stretch_matrix": [[1, 0], [0, 1]]})
    )
    with pytest.raises(RequestError, match="image_size"):
        read_lens(path)


@pytest.mark.integration
@pytest.mark.parametrize(("name", "largest"), [("calib_svo_752x480.txt", 0.03), ("calib_vivekmudgal_640x480.txt", 0.6)])
def test_real_calibrations_and_their_inverse_polynomials(data_folder, name, largest):
    lens = read_lens(Path(data_folder) / "fisheye" / "calibrations" / name)
    pixels, rays = image_rays(lens)
    assert np.abs(lens.project(rays) - pixels).max() < 1e-9
    away = np.hypot(*(lens.project_by_inverse(rays) - pixels).T)
    assert 0.005 < away.max() < largest
    assert away[np.hypot(*(pixels - lens.centre).T) < 300].max() < 0.003
