"""Animals drawn as ellipses with exact places: what stands out, who is who through contact, sizes and heads."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.tracking.animals.linking import contacts, exchanged_after_contacts, link_animals
from tsuiseki.tracking.animals.page import AnimalMotion, touching
from tsuiseki.tracking.animals.pose import AnimalPose, ExpectedAnimal, pose_of
from tsuiseki.tracking.animals.run import track_animals
from tsuiseki.tracking.animals.settings import AnimalSettings
from tsuiseki.tracking.animals.tracker import AnimalTracker, find_animals
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.states import read_poses
from tsuiseki.tracking.features import background_difference
from tsuiseki.tracking.features.background_difference import learn_background
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.types.tracks import BodyTrack

SIZE = (240, 160)
SHIFT = 4


def scene(animals, back=40, colour=200, noise=3.0, seed=0):
    """An image with animals ``x, y, theta, length, width`` whose head ends are brighter."""
    rng = np.random.default_rng(seed)
    image = np.full((SIZE[1], SIZE[0], 3), back, np.uint8)
    cv2.rectangle(image, (20, 20), (60, 50), (back + 6,) * 3, -1)
    for x, y, theta, length, width in animals:
        along = np.array([np.cos(theta), np.sin(theta)])
        for part, share, value in ((0.0, 1.0, colour - (colour - back) // 3), (0.15, 0.7, colour)):
            centre = np.array([x, y]) + part * length * along
            fixed = tuple(int(v) for v in np.round(centre * 2**SHIFT))
            axes = (round(share * length / 2 * 2**SHIFT), round(width / 2 * 2**SHIFT))
            cv2.ellipse(image, fixed, axes, float(np.degrees(theta)), 0, 360, (value,) * 3, -1, cv2.LINE_AA, SHIFT)
    return np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)


def followed(paths, **look):
    """Tracks of animals ``(T, K, 5)``; those with a NaN are not there."""
    images = [scene([a for a in row if np.isfinite(a).all()], seed=t, **look) for t, row in enumerate(paths)]
    background = learn_background(images[:: max(1, len(images) // 24)])
    tracker = AnimalTracker(background)
    for t, image in enumerate(images):
        tracker.update(Frame(t, t / 25, image))
    return background, [animal.track for animal in link_animals(tracker.poses, range(len(images)), 25.0, SIZE)]


def crossing(frames=60):
    """A large and a small one meet, lie against each other for a while, and part by where they came from."""
    paths = np.zeros((frames, 2, 5))
    way = 60 * np.abs(np.linspace(-1, 1, frames)) ** 1.5
    paths[:, 0] = np.stack([120 - 14 - way, *np.array([[80, 0, 40, 16]] * frames).T], axis=1)
    paths[:, 1] = np.stack([120 + 14 + way, *np.array([[84, np.pi, 28, 11]] * frames).T], axis=1)
    return paths


def nearest(tracks, paths):
    """For each animal the track on it in every frame, and the distance."""
    out = []
    for k in range(paths.shape[1]):
        ids, away = [], []
        for t in range(len(paths)):
            own = [
                (np.linalg.norm(track.states[track.frames == t][0, :2] - paths[t, k, :2]), track.id)
                for track in tracks
                if (track.frames == t).any()
            ]
            best = min(own, default=(np.inf, 0))
            ids.append(best[1])
            away.append(best[0])
        out.append((ids, np.array(away)))
    return out


@pytest.mark.parametrize(("back", "colour", "contrast"), [(40, 200, "bright"), (210, 60, "dark")])
def test_any_contrast_is_found_and_identities_stay_through_contact(back, colour, contrast):
    paths = crossing()
    background, tracks = followed(paths, back=back, colour=colour)
    assert background.contrast == contrast
    assert [len(track) for track in tracks] == [60, 60]
    for ids, away in nearest(tracks, paths):
        assert len(set(ids)) == 1
        # The drawn head shifts the core of an animal by up to an eighth of its length.
        assert away.max() < 5.0
    lengths = sorted(float(np.median(track.states[:, 3])) for track in tracks)
    np.testing.assert_allclose(lengths, [28, 40], atol=4.0)


def test_the_head_is_where_they_walk_and_stays_when_they_back_off():
    paths = crossing()
    _, tracks = followed(paths)
    large = max(tracks, key=lambda track: np.median(track.states[:, 3]))
    small = min(tracks, key=lambda track: np.median(track.states[:, 3]))
    # Both walk forwards in the first half and backwards, without turning, in the second.
    assert len({round(float(np.cos(h))) for h in large.states[:, 2]}) == 1
    assert len({round(float(np.cos(h))) for h in small.states[:, 2]}) == 1


def test_entering_and_leaving():
    paths = np.full((60, 2, 5), np.nan)
    paths[:, 0] = [60, 40, 0, 36, 14]
    paths[:, 0, 0] += np.linspace(0, 90, 60)
    paths[20:45, 1] = [150, 120, 1.2, 36, 14]
    _, tracks = followed(paths)
    assert [(int(track.frames[0]), int(track.frames[-1])) for track in tracks] == [(0, 59), (20, 44)]


def test_animals_expected_far_away_have_no_part_in_a_region():
    away = np.linspace(0, 100, 12)
    background = learn_background([scene([(60 + x, 90, 0, 36, 14)], seed=k) for k, x in enumerate(away)])
    difference = background.difference(scene([(60, 90, 0, 36, 14)]))

    def found(x):
        expected = [ExpectedAnimal(np.array([x, y]), 0.0, np.array([9.0, 3.5]), 0.0, 36.0) for y in (88.0, 92.0)]
        return len(find_animals(difference, background, 0.3, expected))

    assert (found(60.0), found(160.0)) == (2, 1)


def test_one_that_never_moves_is_seen_beside_one_that_does():
    paths = np.zeros((50, 2, 5))
    paths[:, 0] = [60, 40, 0.3, 36, 14]
    paths[:, 1] = [60, 120, 0, 36, 14]
    paths[:, 1, 0] += np.linspace(0, 120, 50)
    _, tracks = followed(paths)
    assert len(tracks) == 2
    assert all(len(track) == 50 for track in tracks)


def test_an_empty_arena_has_no_animals():
    background, tracks = followed(np.full((12, 1, 5), np.nan))
    assert tracks == []
    assert background.area == 0 or background.threshold >= 8


def pose(x, length, contact=False):
    core = np.array([x, 0.0])
    return AnimalPose(core, 0.0, length, length / 3, core, np.array([8.0, 3.0]), 100.0, np.zeros(2), contact)


def test_looks_exchange_two_that_the_flow_confused():
    rng = np.random.default_rng(0)
    frames, met = 60, range(28, 32)
    poses, labels = [], []
    for t in range(frames):
        large, small = 30 + rng.normal(0, 0.3), 20 + rng.normal(0, 0.3)
        poses.append([pose(0.0, large, t in met), pose(12.0, small, t in met)])
        # The flow hands the ids over in the contact.
        labels.append(np.array([1, 2] if t < 30 else [2, 1]))
    assert contacts(labels, poses)[0][:2] == (28, 31)
    mended, count = exchanged_after_contacts(labels, poses)
    assert count == 1
    assert all((row == [1, 2]).all() for t, row in enumerate(mended) if t not in met)
    # Animals that look alike are left to the flow.
    alike = [[pose(0.0, 25.0, t in met), pose(12.0, 25.0, t in met)] for t in range(frames)]
    assert exchanged_after_contacts(labels, alike)[1] == 0


def test_a_second_contact_is_judged_by_the_names_after_the_first():
    lengths, meetings = (30.0, 20.0, 40.0), {(0, 1): range(28, 32), (1, 2): range(68, 72)}
    rng = np.random.default_rng(0)
    poses, labels = [], []
    for t in range(100):
        met = next((pair for pair, frames in meetings.items() if t in frames), ())
        places = (0.0, 12.0 if t < 50 else 100.0, 112.0)
        poses.append([pose(places[n], lengths[n] + rng.normal(0, 0.3), n in met) for n in range(3)])
        # The flow confuses the first two in their contact, and what it then calls 1 with the third.
        labels.append(np.array([1, 2, 3] if t < 30 else [2, 1, 3] if t < 70 else [2, 3, 1]))
    mended, count = exchanged_after_contacts(labels, poses)
    assert count == 2
    assert all((mended[t] == [1, 2, 3]).all() for t in (20, 50, 90))


def test_a_large_one_that_rests_is_seen_beside_a_small_one_that_shifts_a_little() -> None:
    # What the small one uncovers is a small part of it, so the large one is much larger than what usually stands out.
    rows = [[(60, 80, 0, 46, 18), (170 + 3 * (t // 12), 60, 0, 30, 12)] for t in range(48)]
    background = learn_background([scene(row, seed=t) for t, row in enumerate(rows)][::2])
    assert background.image[65:95, 35:85].max() < 60
    assert background.image[50:70, 150:195].max() < 60


def test_what_shifts_by_a_sliver_is_as_large_as_the_whole_of_it() -> None:
    rows = [[(60, 80, 0, 46, 18), (170 + t // 16, 80, 0, 46, 18)] for t in range(48)]
    background = learn_background([scene(row, seed=t) for t, row in enumerate(rows)][::2])
    assert background.image[60:100].max() < 60
    assert 200 < background.area < 800


@pytest.mark.slow
def test_65_flies_that_hardly_move_in_a_short_clip_are_within_5_pixels(data_folder: Path) -> None:
    folder = data_folder / "animals" / "flies-first"
    truth = read_poses(folder / "states.csv")
    with pytest.warns(InputWarning, match="which end is the head is a guess"):
        result = track_animals(folder / "video.webm", frames="76-105")
    assert [len(track) for track in result.tracks] == [30, 30]
    places = np.stack([track.states[:, :2] for track in result.tracks])
    for fly in (1, 2):
        labels = truth.points[truth.ids == fly][result.tracks[0].frames]
        assert (np.linalg.norm(places - labels, axis=2).min(axis=0) <= 5).mean() >= 0.95


def test_levels_are_of_the_background_that_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last round may still find somebody."""
    rows = [[(60, 80, 0, 46, 18), (170 + 3 * (t // 12), 60, 0, 30, 12)] for t in range(48)]
    images = [scene(row, seed=t) for t, row in enumerate(rows)][::2]
    found, resting = [], background_difference._resting
    monkeypatch.setattr(background_difference, "_resting", lambda *a: found.append(resting(*a)) or found[-1])
    more = learn_background(images)
    rounds = sum(bool(each.any()) for each in found)
    assert 0 < rounds < background_difference.ROUNDS
    monkeypatch.setattr(background_difference, "ROUNDS", rounds)
    just_enough = learn_background(images)
    np.testing.assert_array_equal(just_enough.image, more.image)
    assert (just_enough.threshold, just_enough.core, just_enough.area) == (more.threshold, more.core, more.area)


def test_what_a_resting_animal_never_uncovers_is_no_background() -> None:
    # It walks off in the end by most of its length: its tail stays where its head had rested, an eighth of its area.
    way = 60 + np.maximum(np.arange(48) - 28, 0) * 2.4
    rows = [[(x, 80, 0, 46, 18), (165 + (x - 60) / 2, 30, 0, 46, 18)] for x in way]
    background = learn_background([scene(row, seed=t) for t, row in enumerate(rows)][::2])
    assert background.contrast == "bright"
    # The arena is 40 with a noise of 3, the animal 147 and more.
    assert background.image[65:95, 30:130].max() < 60


def test_in_contact_the_middle_of_the_body_is_that_of_the_frames_around() -> None:
    # The bright core lies 6 pixels ahead of the middle; the run begins in contact, where only cores are known.
    poses = []
    for t in range(40):
        core, contact = np.array([60.0 + 2 * t, 50.0]), t < 10
        place = core if contact else core - [6.0, 0.0]
        length = 20.0 if contact else 30.0
        spread = np.array([8.0, 3.0])
        poses.append([AnimalPose(place, 0.0, length, 10.0, core, spread, 100.0, np.zeros(2), contact)])
    (animal,) = link_animals(poses, range(40), 25.0, (240, 160))
    np.testing.assert_allclose(animal.track.states[:, 0], 54.0 + 2 * animal.track.frames, atol=1e-9)
    np.testing.assert_allclose(animal.track.states[:, 3], 30.0)


@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_that_heads_are_a_guess_is_said_where_nobody_walks(speed: float, recwarn: pytest.WarningsRecorder) -> None:
    link_animals([[pose(60.0 + speed * t, 30.0)] for t in range(40)], range(40), 25.0, (240, 160))
    assert ["which end is the head is a guess" in str(one.message) for one in recwarn] == ([] if speed else [True])


def test_a_wing_held_out_moves_neither_axis_nor_place():
    y, x = np.mgrid[-20:21, -40:41]
    body = (x / 30) ** 2 + (y / 9) ** 2 <= 1
    wing = (np.abs(x + 15) < 5) & (y > 0) & ~body
    values = np.where(body, 200.0, 50.0)
    points = lambda mask: np.stack([x[mask], y[mask]], axis=1).astype(float)  # noqa: E731
    alone = pose_of(points(body), values[body])
    held = pose_of(points(body | wing), values[body | wing])
    assert np.linalg.norm(held.place - alone.place) < 1.0
    assert abs(np.sin(held.axis - alone.axis)) < 0.01


def test_a_wing_folded_behind_the_body_moves_its_middle_by_its_own_contrast_only():
    y, x = np.mgrid[-20:21, -60:41]
    body = (x / 30) ** 2 + (y / 9) ** 2 <= 1
    wing = (x > -50) & (x < 0) & (abs(y) < 6) & ~body
    points = lambda mask: np.stack([x[mask], y[mask]], axis=1).astype(float)  # noqa: E731
    # The outline has its middle at (30 - 49) / 2. Levels go in steps of 10 from the faintest pixel, 20, up to 90; the
    # core begins at 100.
    for contrast, levels in ((25.0, 1), (65.0, 5), (100.0, 8)):
        values = np.where(body, 200.0, contrast)
        values[20, 60] = 20.0
        found = pose_of(points(body | wing), values[body | wing])
        np.testing.assert_allclose(abs(found.place[0]), 9.5 * levels / 8, atol=0.6)


def test_wings_that_open_and_close_behind_do_not_move_the_place():
    y, x = np.mgrid[-20:21, -60:41]
    body = (x / 30) ** 2 + (y / 9) ** 2 <= 1
    poses = []
    for t in range(80):
        # As bright as nearly half the body in every other stretch of frames, and hardly there between.
        wing = (x > -50) & (x < 0) & (abs(y) < 6) & ~body
        values = np.where(body, 200.0, 80.0 if t % 40 < 25 else 30.0)
        values[20, 60] = 20.0
        mask = body | wing
        pixels = np.stack([x[mask] + 3.0 * t, y[mask]], axis=1).astype(float)
        poses.append([pose_of(pixels, values[mask])])
    (animal,) = link_animals(poses, range(80), 25.0, (400, 160))
    seen = np.array([found[0].place[0] for found in poses]) - 3.0 * np.arange(80)
    place = animal.track.states[:, 0] - 3.0 * animal.track.frames
    assert np.ptp(seen) > 4.0
    assert np.ptp(place) < 1.0


def test_wrong_settings_are_refused():
    with pytest.raises(ValidationError, match="smallest"):
        AnimalSettings(smallest=1.0)
    with pytest.raises(RequestError, match="at least one frame"):
        learn_background([])
    background = learn_background([scene([])])
    with pytest.raises(RequestError, match="expected a frame of 240x160"):
        background.difference(np.zeros((10, 10, 3), np.uint8))


def test_a_large_one_is_one_and_two_side_by_side_are_two() -> None:
    frames = 30
    way = np.linspace(0, 60, frames)
    usual = [
        np.stack([x + way, *np.array([[y, 0, 28, 11]] * frames).T], axis=1) for x in (40, 130) for y in (20, 45, 70)
    ]
    large = np.stack([40 + way, *np.array([[120, 0, 40, 16]] * frames).T], axis=1)
    beside = [np.stack([130 + way, *np.array([[y, 0, 28, 11]] * frames).T], axis=1) for y in (100, 109)]
    _, tracks = followed(np.stack([*usual, large, *beside], axis=1))
    assert len(tracks) == 9
    assert sorted(float(np.median(track.states[:, 3])) > 34 for track in tracks) == [False] * 8 + [True]


def moving(identity, places, theta=0.0, length=40.0, width=10.0, first=0):
    """A track that stands for an animal at these ``(T, 2)`` places."""
    places = np.asarray(places, dtype=float)
    states = np.column_stack([places, np.tile([theta, length, width], (len(places), 1))])
    return BodyTrack(
        identity, first + np.arange(len(places)), states, np.ones(len(places)), ("tracking",) * len(places)
    )


def test_speed_distance_and_contact_of_two_animals_in_line():
    """One stands, the other comes 6 pixels a frame nearer, head to tail: they touch within a body's length of 40."""
    steps = np.arange(20)
    still, coming = (
        moving(1, np.tile([[200.0, 50.0]], (20, 1))),
        moving(2, np.column_stack([80 + 6 * steps, 0 * steps + 50])),
    )
    motion = AnimalMotion([still, coming], lambda frames: frames / 10.0, 10.0, scale=0.5)
    away = 120 - 6 * steps
    (pair,) = motion.pairs
    np.testing.assert_allclose(pair.distances, 0.5 * away)
    np.testing.assert_array_equal(pair.contact, away <= 40)
    columns = motion.columns()
    assert columns["path, mm"] == {1: 0.0, 2: pytest.approx(0.5 * 6 * 19)}
    assert columns["speed, mm/s"] == {1: 0.0, 2: pytest.approx(30.0)}
    assert columns["nearest other, mm"] == dict.fromkeys((1, 2), pytest.approx(0.5 * away.mean(), abs=1e-3))
    assert columns["in contact, s"] == dict.fromkeys((1, 2), pytest.approx((away <= 40).sum() / 10))
    table = motion.table()
    assert list(table) == ["frame", "time", "id", "x_mm", "y_mm", "heading", "speed_mm_s", "nearest_mm", "contact"]
    assert table["frame"][:4] == [1, 1, 2, 2]
    assert table["id"][:4] == [1, 2, 1, 2]
    assert sum(table["contact"]) == 2 * (away <= 40).sum()


def test_side_by_side_animals_touch_where_their_widths_meet():
    a = np.array([[50.0, 50, 0, 40, 10]] * 3)
    b = np.array([[50.0, 59.9, 0, 40, 10], [50, 60.1, 0, 40, 10], [50, 74.9, np.pi / 2, 40, 10]])
    assert touching(a, b).tolist() == [True, False, True]


def test_an_animal_alone_has_no_nearest_other():
    motion = AnimalMotion([moving(3, [[1.0, 2.0]])], lambda frames: frames / 10.0, 10.0)
    assert motion.columns() == {"path, px": {3: 0.0}, "speed, px/s": {3: 0.0}}
    assert motion.table()["nearest_px"] == [None]
    apart = AnimalMotion([moving(1, [[1.0, 2.0]]), moving(2, [[1.0, 2.0]], first=5)], lambda f: f / 10.0, 10.0)
    assert apart.pairs == []


def test_the_score_is_the_overlap_of_ellipse_and_pixels():
    x, y = np.meshgrid(np.arange(100) + 0.5, np.arange(60) + 0.5)
    within = ((x - 50) / 30) ** 2 + ((y - 30) / 10) ** 2 <= 1
    whole = np.column_stack([x[within], y[within]])
    assert pose_of(whole, np.full(len(whole), 90.0)).score > 0.85
    rows = whole[:, 1] > 30
    ring = np.column_stack([x.ravel(), y.ravel()])
    assert pose_of(ring, np.full(len(ring), 90.0)).score < 0.85, "a rectangle is no ellipse"
    assert 0 < pose_of(whole[rows], np.full(rows.sum(), 90.0)).score <= 1
