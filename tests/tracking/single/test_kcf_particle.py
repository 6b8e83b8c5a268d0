"""KCF with a particle filter: when it searches, what weighs its particles, and when the target is lost."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, overlaps, run, walk
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.kcf_particle_settings import PRINTED, ROBUST, THESIS
from tsuiseki.tracking.single.kcf_tracker import KcfTracker
from tsuiseki.tracking.single.observation_model import SearchView
from tsuiseki.tracking.single.particles import dispersion
from tsuiseki.tracking.single.response import ResponseMaps


def test_presets_hold_the_thesis_s_constants():
    assert (THESIS.switch, THESIS.plain_frames, THESIS.stored, THESIS.particles) == (0.2, 50, 20, 200)
    assert (THESIS.divisor, THESIS.past_share) == (10 / 3, 0.5)
    assert (THESIS.convergence, THESIS.response_share, THESIS.hypotheses) == (0.03, 0.3, 20)
    assert THESIS.kcf.scale_step == 1.0
    assert replace(THESIS, covariance="variances", response_scale="printed") == PRINTED
    assert (PRINTED.covariance, PRINTED.response_scale, PRINTED.agreement) == ("variances", "printed", "covariance")
    assert (THESIS.past, THESIS.colour, THESIS.reach, THESIS.spread, THESIS.sharpness) == ("uniform", 0, 0, 1, 1)


@pytest.mark.parametrize(("settings", "same"), [(THESIS, True), (PRINTED, False)])
def test_the_level_of_all_responses_matters_only_as_printed(settings, same):
    images, boxes = clip(walk(2))
    tracker = KcfParticle(replace(settings, response_share=1.0))
    tracker.start(images[0], boxes[0])
    rng, centre = np.random.default_rng(0), tracker.target.centre
    maps = rng.random((1, 1, 24, 24)).astype(np.float32)
    particles = np.column_stack([rng.normal(centre, 3, (5, 2)), np.zeros(5)])
    levels = [
        SearchView(ResponseMaps(maps * k, centre[None], 4.0), images[0], np.empty((0, 4)), tracker.target.bank)
        for k in (1.0, 0.25)
    ]
    high, low = (tracker._log_likelihood(particles, view) for view in levels)
    assert np.allclose(high, low, atol=1e-3) is same


THESIS_WITHOUT_OBJECTS = replace(THESIS, response_share=1.0)


@pytest.mark.parametrize("settings", [THESIS_WITHOUT_OBJECTS, ROBUST])
def test_a_confident_filter_tracks_as_kcf_does(settings):
    images, boxes = clip(walk(15))
    combined = KcfParticle(replace(settings, switch=-1.0, relative_switch=0.0, drift_switch=0.0))
    alone = KcfTracker(settings.kcf)
    for a, b in zip(run(combined, images, boxes[0]), run(alone, images, boxes[0]), strict=True):
        np.testing.assert_array_equal(a.box, b.box)
    assert combined.searched_frames == 0


@pytest.mark.parametrize("settings", [THESIS_WITHOUT_OBJECTS, ROBUST])
def test_the_search_starts_when_the_target_is_hidden_and_finds_it_again(settings):
    images, boxes = clip(walk(40, 2.5), hidden=range(15, 19))
    tracker = KcfParticle(settings)
    tracker.start(images[0], boxes[0])
    searched = []
    for image in images[1:]:
        seen = tracker.follow(image)
        searched.append(tracker.searched_frames)
    assert searched[13] == 0
    assert searched[-1] > 0
    assert iou_pairs(seen.box, boxes[-1]) > 0.5


def test_no_search_starts_in_the_frames_after_one():
    images, boxes = clip(np.tile([[100.0, 80.0]], (40, 1)))
    tracker = KcfParticle(replace(THESIS_WITHOUT_OBJECTS, switch=10.0, convergence=1e9, plain_frames=8))
    searched = []
    tracker.start(images[0], boxes[0])
    for image in images[1:]:
        before = tracker.searched_frames
        tracker.follow(image)
        searched.append(tracker.searched_frames > before)
    starts = np.flatnonzero(searched)
    assert len(starts) > 1
    assert (np.diff(starts) == 9).all()  # every search ends in its first frame, then 8 without


def test_a_filter_that_is_confident_again_ends_the_search_where_the_confidence_is_looked_at_in_every_frame():
    images, boxes = clip(walk(30), hidden=range(12, 15))
    never_agree = replace(THESIS_WITHOUT_OBJECTS, convergence=0.0)
    ends = []
    for settings in (never_agree, replace(never_agree, decides_always=True)):
        tracker = KcfParticle(settings)
        seen = run(tracker, images, boxes[0])
        ends.append((tracker.search is None, tracker.searched_frames))
    (still, long), (over, short) = ends
    assert not still
    assert over
    assert 0 < short < long
    assert iou_pairs(seen[-1].box, boxes[-1]) > 0.5


@pytest.mark.parametrize(("agreement", "spread"), [("pixels", 18.0), ("lengths", 9 / 7.2 + 9 / 10.8)])
def test_c_of_the_agreement_is_lengths_or_square_pixels(agreement, spread):
    """Two groups of particles 6 pixels apart in x and y: a variance of 9 in each."""
    images, boxes = clip(walk(2), height=36, width=24)
    tracker = KcfParticle(replace(THESIS, agreement=agreement))
    tracker.start(images[0], boxes[0])
    particles = np.array([[0.0, 0, 0], [6, 6, 0]])
    found = dispersion(particles, np.array([0.5, 0.5]), tracker._agreement())
    assert found == pytest.approx(spread)


def test_a_target_that_does_not_come_back_is_lost():
    images, boxes = clip(walk(30, 3.0), hidden=range(10, 30))
    statuses = [s.status for s in run(KcfParticle(replace(ROBUST, lost_after=5)), images, boxes[0])]
    assert "searching" in statuses
    assert statuses[-1] == "lost"


def test_a_new_look_is_followed_after_the_longest_search():
    """The target turns blue for good: nothing explains it any more, so the filter goes on, and says that it doubts."""
    images, boxes = clip(walk(40))
    changed = [image if t < 12 else np.ascontiguousarray(image[..., ::-1]) for t, image in enumerate(images)]
    tracker = KcfParticle(replace(ROBUST, longest_search=6))
    statuses = [s.status for s in run(tracker, changed, boxes[0])]
    assert statuses[8] == "tracking"
    assert "searching" in statuses[12:20]
    assert tracker.searched_frames < 28


def test_a_wider_search_finds_a_target_that_jumped():
    """It jumps two of its widths, beyond the window of the filter."""
    path = np.concatenate([np.tile([[50.0, 80.0]], (12, 1)), np.tile([[100.0, 80.0]], (12, 1))])
    images, boxes = clip(path)
    assert overlaps(run(KcfParticle(replace(ROBUST, reach=2)), images, boxes[0]), boxes)[-1] > 0.6
    assert overlaps(run(KcfTracker(ROBUST.kcf), images, boxes[0]), boxes)[-1] == 0


def test_the_same_seed_gives_the_same_boxes():
    images, boxes = clip(walk(25), hidden=range(12, 16))
    first, second = (run(KcfParticle(ROBUST, seed=3), images, boxes[0]) for _ in range(2))
    assert [s.box.tolist() for s in first] == [s.box.tolist() for s in second]
