"""The ball tracker on small exact images: found, followed, and not pulled away by a covered camera."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.cameras.volume import common_volume, in_view
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.point_motion import Ballistic, ConstantVelocity3D
from tsuiseki.tracking.sphere.points import triangulate
from tsuiseki.tracking.sphere.run import check_start
from tsuiseki.tracking.sphere.search import find_ball
from tsuiseki.tracking.sphere.settings import check_lengths
from tsuiseki.tracking.sphere.tracker import SphereTracker, TimedViews, with_velocities
from tsuiseki.tracking.sphere.views import PointLikelihood, SphereContourLikelihood

RADIUS = 0.1
CAMERAS = [
    PinholeCamera.look_at(np.array(place), np.array([0.0, 0.0, 1.0]), 200.0, 240, 180)
    for place in ([2.6, 0.6, 1.3], [0.4, -2.6, 1.5], [-2.0, 1.6, 1.4])
]
TIMES = np.arange(24) / 15
PATH = np.column_stack([0.4 * np.cos(2 * TIMES), 0.4 * np.sin(2 * TIMES), 1.0 + 0.2 * np.sin(3 * TIMES)])


def picture(camera, centre, rng, radius=RADIUS):
    """Speckled wall with an exact silhouette of the ball on it."""
    clean = np.full((180, 240, 3), 105.0)
    at = (np.arange(480) + 0.5) / 2, (np.arange(360) + 0.5) / 2
    rays = camera.rays(np.stack(np.meshgrid(*at), axis=-1).reshape(-1, 2))
    toward = centre - camera.position
    hit = (toward @ toward - (rays @ toward) ** 2 < radius**2).reshape(360, 480).astype(np.float32)
    share = cv2.resize(hit, (240, 180), interpolation=cv2.INTER_AREA)[:, :, None]
    clean = clean * (1 - share) + share * [190, 70, 50]
    return np.clip(clean + rng.normal(0, 3, clean.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def film():
    rng = np.random.default_rng(0)
    return [[picture(camera, point, rng) for camera in CAMERAS] for point in PATH]


def follow(film, change=lambda _, views: views, cameras=2, seed=0, particles=400):
    tracker = SphereTracker(SphereContourLikelihood(CAMERAS[:cameras], RADIUS))
    rng = np.random.default_rng(seed)
    state = tracker.start_at(PATH[0], 0.03, particles, cameras, rng, TIMES[0])
    found = []
    for k, time in enumerate(TIMES):
        state, info = tracker.step(state, TimedViews(time, change(k, list(film[k][:cameras]))), rng)
        found.append(info)
    return found


def errors(positions):
    return np.linalg.norm([p.point for p in positions] - PATH[: len(positions)], axis=1)


def test_two_cameras_follow_the_ball_to_a_fraction_of_a_pixel(film):
    found = follow(film)
    # A pixel is 1.3 cm here; the outline of 15 pixels averages it down.
    assert errors(found).mean() < 0.010
    assert all(p.status == "tracking" for p in found)
    assert all((p.open > 0.9).all() for p in found)


def test_the_stated_covariance_holds_the_truth(film):
    found = follow(film)
    away = [p.point - t for p, t in zip(found, PATH, strict=True)]
    square = [a @ np.linalg.solve(p.covariance, a) for a, p in zip(away, found, strict=True)]
    # The 99.9 % quantile of chi-square with 3 degrees of freedom is 16; the filter may be cautious but not blind.
    assert np.median(square) < 16


@pytest.mark.slow
def test_the_same_seed_gives_the_same_track(film):
    first, second = follow(film, seed=3), follow(film, seed=3)
    np.testing.assert_array_equal([p.point for p in first], [p.point for p in second])
    assert not np.array_equal(first[-1].point, follow(film, seed=4)[-1].point)


def test_a_covered_camera_stops_contributing_and_comes_back(film):
    board = np.random.default_rng(9).integers(60, 120, (180, 240, 3), dtype=np.uint8)

    def cover(k, views):
        return [board, *views[1:]] if 8 <= k < 16 else views

    found = follow(film, cover, cameras=3)
    assert errors(found).max() < 0.03
    assert all(p.open[0] < 0.5 for p in found[9:16])
    assert found[-1].open[0] > 0.9


@pytest.mark.slow
def test_a_ball_of_seven_pixels_is_followed_where_a_fixed_level_loses_it():
    small = 0.044  # 3.5 pixels from 2.5 m at a focal length of 200
    rng = np.random.default_rng(1)
    film = [[picture(camera, point, rng, small) for camera in CAMERAS[:2]] for point in PATH]
    away = {}
    for faint in (None, False):
        tracker = SphereTracker(SphereContourLikelihood(CAMERAS[:2], small, faint=faint))
        rng = np.random.default_rng(0)
        state = tracker.start_at(PATH[0], 0.03, 400, 2, rng, TIMES[0])
        found = []
        for time, views in zip(TIMES, film, strict=True):
            state, info = tracker.step(state, TimedViews(time, views), rng)
            found.append(info)
        away[faint] = errors(found)
    # A pixel is 1.3 cm.
    assert away[None].mean() < 0.013
    assert away[None].mean() < 0.5 * away[False].mean()


def test_dropped_frames_are_bridged(film):
    def drop(k, views):
        return [None if (k + camera) % 3 == 0 else view for camera, view in enumerate(views)]

    assert errors(follow(film, drop)).mean() < 0.02


def test_without_any_image_the_ball_is_searched_then_lost(film):
    found = follow(film, lambda k, views: [None, None] if k > 2 else views)
    statuses = [p.status for p in found]
    assert statuses[0] == "tracking"
    assert "searching" in statuses
    assert statuses[-1] == "lost" if TIMES[-1] > 2 else statuses[-1] in ("searching", "lost")


@pytest.mark.slow
def test_the_whole_volume_is_searched(film):
    likelihood = SphereContourLikelihood(CAMERAS, RADIUS)
    volume = np.array([[-1.5, -1.5, 0.2], [1.5, 1.5, 2.0]])
    rng = np.random.default_rng(0)
    positions = find_ball(likelihood, likelihood.broad(), CAMERAS, RADIUS, volume, 400, film[0], rng)
    state = SphereTracker(likelihood).init(with_velocities(positions, 0.3, rng), 3)
    _, info = SphereTracker(likelihood).step(state, TimedViews(0.0, film[0]), rng)
    assert np.linalg.norm(info.point - PATH[0]) < 0.01
    assert info.status == "tracking"


def test_point_measurements_agree_with_triangulation():
    point = np.array([[0.2, -0.1, 1.1]])
    pixels = np.stack([c.project(point)[0] for c in CAMERAS], axis=1)
    tracker = SphereTracker(PointLikelihood(CAMERAS, np.full(3, 1.0)))
    rng = np.random.default_rng(0)
    state = tracker.start_at(point[0] + 0.03, 0.05, 4000, 3, rng, speed=0.01)
    for _ in range(3):
        state, info = tracker.step(state, TimedViews(0.0, list(pixels[0])), rng)
    _, covariance = triangulate(CAMERAS, pixels)
    assert np.linalg.norm(info.point - point[0]) < 0.01
    # Three looks at the same pixels hold a third of the variance of one.
    assert np.trace(info.covariance) == pytest.approx(np.trace(covariance[0]) / 3, rel=0.25)


def test_the_volume_holds_what_two_cameras_see_and_refuses_cameras_that_share_nothing():
    low, high = common_volume(CAMERAS, RADIUS)
    assert (low < PATH.min(axis=0)).all()
    assert (high > PATH.max(axis=0)).all()
    ends = [(np.array([x, 0.0, 1.0]), np.array([9 * x, 0.0, 1.0])) for x in (-9, 9)]
    away = [PinholeCamera.look_at(place, target, 200.0, 240, 180) for place, target in ends]
    with pytest.raises(RequestError, match="no such place"):
        common_volume(away, 0.01)
    assert in_view(CAMERAS[0], PATH).all()


def test_a_start_behind_or_beside_the_cameras_is_refused():
    placed = [PlacedCamera(f"camera{k + 1}", c) for k, c in enumerate(CAMERAS[:2])]
    check_start(PATH[0], placed)
    with pytest.raises(RequestError, match="lies behind camera1"):
        check_start(np.array([9.0, 2.0, 2.0]), placed)
    with pytest.raises(RequestError, match="in 0 of 2 images"):
        check_start(np.array([0.0, 0.0, 4.0]), placed)


def test_videos_of_different_length_are_refused():
    check_lengths([np.arange(30) / 15, np.arange(31) / 15], ["a", "b"])
    with pytest.raises(RequestError, match=r"a ends at 1\.93 s and b at 3\.93 s"):
        check_lengths([np.arange(30) / 15, np.arange(60) / 15], ["a", "b"])


@pytest.mark.slow
def test_a_bouncing_ball_is_found_again_after_the_frames_of_its_bounce_are_lost():
    motion = Ballistic(RADIUS, floor=0.3, restitution=0.8, agitation=0.5)
    times = np.arange(16) / 30
    state = np.array([[-0.3, 0.1, 1.0, 1.2, 0.0, -1.0]])
    still = Ballistic(RADIUS, floor=0.3, restitution=0.8, agitation=1e-9)
    path = np.concatenate([still(state, t, np.random.default_rng(0))[:, :3] for t in times])
    bounce = int(path[:, 2].argmin())
    rng = np.random.default_rng(5)
    lost = range(bounce - 1, bounce + 3)
    away = {}
    for name, model in (("ballistic", motion), ("level", ConstantVelocity3D(0.5))):
        tracker = SphereTracker(SphereContourLikelihood(CAMERAS[:2], RADIUS), model)
        now = tracker.start_at(path[0], 0.02, 500, 2, rng, times[0], speed=1.0)
        for k, time in enumerate(times):
            views = [None, None] if k in lost else [picture(camera, path[k], rng) for camera in CAMERAS[:2]]
            now, info = tracker.step(now, TimedViews(time, views), rng)
            if k == lost[-1]:
                away[name] = np.linalg.norm(info.point - path[k])
        away[f"{name} at the end"] = np.linalg.norm(info.point - path[-1])
    # Half a radius is as far as an outline is noticed (the reach of the samples).
    assert away["ballistic"] < 0.05
    assert away["level"] > 3 * away["ballistic"]
    assert away["ballistic at the end"] < 0.02


def test_a_camera_without_frames_for_long_does_not_count_as_seeing():
    rng = np.random.default_rng(0)
    # So wide a limit that the deviation alone would always call the position known.
    tracker = SphereTracker(PointLikelihood(CAMERAS[:2], np.ones(2)), ConstantVelocity3D(0.1), largest_deviation=50.0)
    pixels = [camera.project(PATH[:1])[0][0] for camera in CAMERAS[:2]]
    state = tracker.start_at(PATH[0], 0.05, 300, 2, rng, 0.0)
    statuses = []
    for time in np.arange(0.0, 4.0, 0.1):
        views = pixels if time < 1.0 else [pixels[0], None]
        state, info = tracker.step(state, TimedViews(float(time), views), rng)
        statuses.append(info.status)
    # Known up to a second after the last frame at 0.9 s, then searched for a second, then lost.
    assert statuses[:19] == ["tracking"] * 19
    assert set(statuses[20:29]) == {"searching"}
    assert set(statuses[31:]) == {"lost"}
