"""Where tracks are cut: trails and ends by hand, then swapped people, then arrival in parts."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.ends import MEMORY, mean_looks, meeting, motion_at_end, trail
from tsuiseki.tracking.association.pieces import Links
from tsuiseki.tracking.association.rows import DetectionRows
from tsuiseki.tracking.association.splitting import SplitSettings, Splitter
from tsuiseki.tracking.association.windows import Decision
from tsuiseki.tracking.filters.kalman import BoxMotion, start_boxes

MOTION = BoxMotion()


def test_a_trail_is_found_by_frames() -> None:
    frames = np.array([0, 1, 2, 4, 5, 40])
    previous = np.array([-1, 0, 1, 2, 3, 4])
    found = trail(np.array([4, 5, 0]), previous, frames)
    assert found.shape == (MEMORY, 3)
    assert found[:6, 0].tolist() == [4, 3, -1, 2, 1, 0]
    assert found[:, 1].tolist() == [5] + [-1] * (MEMORY - 1)
    assert found[:, 2].tolist() == [0] + [-1] * (MEMORY - 1)


def test_motion_at_an_end_is_learnt_from_the_trail() -> None:
    frames = np.arange(10)
    boxes = np.array([[0, 0, 20, 50.0]]) + frames[:, None] * np.array([3, 1, 3, 1])
    found = motion_at_end(trail(np.array([9]), frames - 1, frames), boxes, BoxMotion(0.05, 0.0, 10.0))
    np.testing.assert_allclose(found.boxes[0], boxes[9], atol=1e-2)
    np.testing.assert_allclose(found.velocities[0], [3, 1, 3, 1], atol=1e-2)


def test_mean_looks_pass_over_what_is_not_known() -> None:
    features = np.array([[1.0, 0], [0, 1], [np.nan, np.nan]])
    found = np.full((MEMORY, 2), -1)
    found[:3, 0], found[0, 1] = [0, 1, 2], 2
    looks, count = mean_looks(found, features)
    np.testing.assert_allclose(looks, [[np.sqrt(0.5), np.sqrt(0.5)], [0, 0]])
    assert count.tolist() == [2, 0]


def test_ends_that_meet_are_no_surprise_and_others_are() -> None:
    box = np.array([[0, 0, 20, 50.0]])
    end, gap = start_boxes(box, MOTION), np.array([1])
    surprises = [
        float(meeting(end, start_boxes(box + np.array(move), MOTION), gap, MOTION, 0.1, 5.0)[0][0])
        for move in ([0, 0, 0, 0], [10, 0, 10, 0], [40, 0, 40, 0], [0, -20, 0, 20])
    ]
    assert surprises[0] == 0
    assert 0 < surprises[1] < surprises[2]
    assert surprises[3] > 0


def _swapped_walkers(looks: bool) -> tuple[DetectionRows, Decision]:
    """Two people who walk towards each other and past, with tracks that change over where they meet, in frame 20."""
    frames = np.repeat(np.arange(40), 2)
    right, left = np.arange(40) * 4.0, 160 - np.arange(40) * 4.0
    x = np.stack([right, left], axis=1)
    person = np.tile([0, 1], 40)
    boxes = np.stack([x.ravel(), np.zeros(80), x.ravel() + 20, np.full(80, 50.0)], axis=1)
    boxes += np.random.default_rng(0).normal(0, 0.7, boxes.shape)
    follower = np.append(np.arange(2, 80), [-1, -1])
    follower[[38, 39]] = follower[[39, 38]]
    features = np.eye(2)[person] if looks else None
    rows = DetectionRows(np.arange(80), frames, boxes, np.ones(80), features)
    return rows, Decision(rows.numbers, np.ones(80, np.bool_), follower, np.full(80, -2.0), np.full(80, 0.25))


@pytest.mark.parametrize("looks", [False, True], ids=["motion alone", "motion and looks"])
def test_tracks_that_change_over_are_cut_there(looks: bool) -> None:
    rows, decision = _swapped_walkers(looks)
    splitter = Splitter(SplitSettings(), longest_gap=3)
    splitter.add(rows, decision)
    links = splitter.release(at_end=True)
    cut = np.flatnonzero((links.follower < 0) & (decision.follower >= 0))
    assert len(cut) == 2
    assert np.abs(rows.frames[cut] - 19).max() <= 2
    np.testing.assert_allclose(links.cost[cut], -2.0)
    np.testing.assert_allclose(np.delete(links.cost, cut), -1.75)


def test_a_track_of_one_person_is_not_cut() -> None:
    rows, decision = _swapped_walkers(looks=True)
    follower = np.append(np.arange(2, 80), [-1, -1])
    splitter = Splitter(SplitSettings(), longest_gap=3)
    splitter.add(rows, Decision(rows.numbers, decision.used, follower, decision.cost, decision.link))
    np.testing.assert_array_equal(splitter.release(at_end=True).follower, follower)


def _random_tracks(rng: np.random.Generator) -> tuple[DetectionRows, Decision]:
    """Tracks of boxes and looks that jump about, so that many links are cut."""
    frames = np.sort(rng.integers(0, 120, 400))
    follower = np.full(400, -1)
    taken = np.zeros(400, dtype=bool)
    for i in range(400):
        options = np.flatnonzero((frames > frames[i]) & (frames <= frames[i] + 3) & ~taken)
        if len(options) and rng.random() < 0.97:
            follower[i] = options[0]
            taken[options[0]] = True
    corner = rng.normal(0, 12, (400, 2))
    features = np.eye(4)[rng.integers(0, 4, 400)]
    features[rng.random(400) < 0.2] = np.nan
    rows = DetectionRows(
        np.arange(400), frames, np.hstack([corner, corner + np.array([20, 50])]), np.ones(400), features
    )
    return rows, Decision(rows.numbers, rng.random(400) < 2, follower, rng.normal(size=400), rng.random(400))


@pytest.mark.parametrize("seed", range(6))
def test_cuts_do_not_depend_on_how_detections_arrive(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, decision = _random_tracks(rng)
    whole = Splitter(SplitSettings(limit=0.0), longest_gap=3)
    whole.add(rows, decision)
    expected = whole.release(at_end=True)
    assert (expected.follower != decision.follower).sum() > 10
    parts, given, held = Splitter(SplitSettings(limit=0.0), longest_gap=3), list[Links](), []
    for first in range(0, 120, 1 + 4 * seed):
        part = np.flatnonzero((rows.frames >= first) & (rows.frames < first + 1 + 4 * seed))
        fields = (decision.numbers, decision.used, decision.follower, decision.cost, decision.link)
        parts.add(rows.select(part), Decision(*(field[part] for field in fields)))
        given.append(parts.release())
        held.append(parts.held)
    given.append(parts.release(at_end=True))
    order = np.argsort(np.concatenate([links.numbers for links in given]))
    np.testing.assert_array_equal(np.concatenate([links.numbers for links in given])[order], np.arange(400))
    np.testing.assert_array_equal(np.concatenate([links.follower for links in given])[order], expected.follower)
    np.testing.assert_allclose(np.concatenate([links.cost for links in given])[order], expected.cost)
    assert max(held) < 400


def test_a_copy_goes_on_by_itself() -> None:
    rows, decision = _swapped_walkers(looks=True)
    splitter = Splitter(SplitSettings(), longest_gap=3)
    splitter.add(rows, decision)
    assert len(splitter.copy().release(at_end=True)) == 80
    assert len(splitter.release(at_end=True)) == 80


def test_nothing_in_nothing_out() -> None:
    splitter = Splitter(SplitSettings(), longest_gap=3)
    assert len(splitter.release()) == 0
    assert len(splitter.release(at_end=True)) == 0
