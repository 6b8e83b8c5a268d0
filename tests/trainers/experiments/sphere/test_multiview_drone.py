"""The drone's experiment on the real data: clocks and cameras from the first half hold in the second."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tsuiseki.datamodules.readers.multiview_drone import DroneFlight, read_drone_flight
from tsuiseki.tracking.cameras.moving_target import TimedCamera, calibrate_by_path
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.sphere.flights import (
    LAGS,
    FlightScores,
    Trial,
    calibrate_flight,
    chosen,
    half_of,
    score_course,
    surveyed_errors,
)
from tsuiseki.trainers.experiments.sphere.look_ahead import look_ahead
from tsuiseki.trainers.experiments.sphere.multiview_filter import FlightSettings, track_points
from tsuiseki.trainers.experiments.study import Watch


@pytest.fixture(scope="module")
def flight(data_folder):
    return read_drone_flight(data_folder / "stereo" / "multiview-drone-3")


@pytest.mark.integration
@pytest.mark.slow
def test_two_cameras_calibrated_on_the_first_half_hold_in_the_second(flight):
    pair = DroneFlight(flight.times, flight.points, (flight.views[3], flight.views[5]))
    cameras = calibrate_flight(pair, Watch())
    times, pixels, truth = half_of(pair, cameras, first=False)
    for camera, seen in zip(cameras, pixels.transpose(1, 0, 2), strict=True):
        away = np.linalg.norm(camera.camera.project(truth)[0] - seen, axis=1)
        # The pixels' own scatter is 0.7 and 0.8; RTK stands still for a few tenths of a second at times.
        assert np.nanmedian(away) < 2.0
    stretch = slice(0, 1000)
    triangulated, _ = triangulate([c.camera for c in cameras], pixels[stretch])
    rng, settings = np.random.default_rng(0), FlightSettings(particles=500)
    course = track_points(cameras, times[stretch], pixels[stretch], triangulated, settings, rng)
    scores = score_course(2, course, settings.lag, triangulated, truth[stretch])
    assert scores.filter_median < 0.3
    assert scores.filter_acceleration < scores.triangulation_acceleration
    rows = look_ahead(pair, cameras, course, triangulated, truth[stretch])
    assert [row.ahead for row in rows] == list(LAGS)
    # Both are smoothed, so both are far calmer than the plain points; and both stay near the truth.
    assert all(row.fit_median < 0.3 and row.filter_median < 0.3 for row in rows)
    assert rows[-1].fit_acceleration < 0.5 * scores.triangulation_acceleration


def test_a_known_clock_and_camera_are_found_again():
    from tsuiseki.tracking.cameras.calibration import Intrinsics

    rng = np.random.default_rng(0)
    knots = np.arange(0, 61.0)
    path = CubicSpline(knots, np.array([0, 0, 15]) + np.cumsum(rng.normal(0, 2.0, (61, 3)), axis=0))
    camera = PinholeCamera.look_at(np.array([60.0, -20.0, 1.0]), path(30.0), 1500.0, 1920, 1080)
    frames = np.arange(0.0, 1500.0, 2.0)
    pixels, _ = camera.project(path(np.clip(frames / 30 * 1.0005 + 4.3, 0, 60)))
    inside = np.isfinite(pixels).all(axis=1)
    lens = Intrinsics(1920, 1080, camera.focal, camera.principal_point, np.zeros(5))
    noisy = pixels[inside] + rng.normal(0, 0.5, (inside.sum(), 2))
    found = calibrate_by_path(path, (0.0, 60.0), frames[inside], noisy, lens, 30.0, np.arange(0.0, 10.0, 0.5))
    assert found.offset == pytest.approx(4.3, abs=0.02)
    assert found.period * 30 == pytest.approx(1.0005, abs=5e-4)
    np.testing.assert_allclose(found.camera.position, camera.position, atol=0.5)


def test_a_survey_in_another_frame_is_laid_upon_the_cameras():
    from dataclasses import dataclass

    @dataclass
    class Placed:
        camera: PinholeCamera

    places = np.random.default_rng(1).uniform(-50, 50, (6, 3))
    cameras = [Placed(PinholeCamera.look_at(p, p + np.array([1.0, 0, 0]), 1.0, 2, 2)) for p in places]
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    np.testing.assert_allclose(surveyed_errors(cameras, places @ turn.T + [5, 6, 7]), 0, atol=1e-9)


def test_a_missing_data_set_is_refused(tmp_path):
    with pytest.raises(RequestError, match=r"rtk\.txt: expected a table"):
        read_drone_flight(tmp_path)


@pytest.mark.parametrize("manoeuvres", [1.0, 0.0], ids=["motion with manoeuvres", "calm motion, looked for anew"])
def test_a_calm_filter_follows_a_sharp_turn(manoeuvres):
    times = np.arange(0.0, 5.0, 0.04)
    leg = np.minimum(times, 3.0)
    path = np.column_stack([8 * leg - 20, 8 * (times - leg), np.full(len(times), 15.0)])
    places = np.array([[60.0, -20, 2], [-50.0, -30, 2], [10.0, 70, 2], [-40.0, 50, 2]])
    views = [PinholeCamera.look_at(p, np.array([0, 0, 15.0]), 1500.0, 1920, 1080) for p in places]
    cameras = [TimedCamera(view, 0.0, 0.04, np.full(9, 1.0)) for view in views]
    rng = np.random.default_rng(0)
    pixels = np.stack([view.project(path)[0] for view in views], axis=1)
    pixels += rng.normal(0, 0.8, pixels.shape)
    triangulated, _ = triangulate(views, pixels)
    settings = FlightSettings(agitation=0.5, manoeuvres=manoeuvres, kick=4.0, inflation=1.0)
    course = track_points(cameras, times, pixels, triangulated, settings, rng)
    away = np.linalg.norm(course.means[:, :3] - path, axis=1)
    assert (course.stretch == 0).all()
    assert away[times < 3.0].max() < 0.5
    # Half a second after the turn; a filter that goes straight on would be 4 m away by then.
    assert away[times > 3.5].max() < 0.5


def test_settings_are_chosen_by_both_criteria_and_then_by_the_median():
    def trial(median, acceleration):
        return Trial(FlightSettings(), FlightScores(2, 9, median, 0.10, 0.3, 0.3, acceleration, 20.0, 0, 0.0, 0.0), 0.0)

    jumps, good, worse, off = trial(0.05, 30.0), trial(0.08, 10.0), trial(0.09, 2.0), trial(0.11, 2.0)
    assert chosen([jumps, worse, good, off]) is good
    assert chosen([off, jumps]) is jumps
