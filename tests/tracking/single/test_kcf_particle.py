"""KCF with a particle filter: when it searches, what weighs its particles, and when the target is lost."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, overlaps, run, walk
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single import kcf_particle
from tsuiseki.tracking.single.kcf import KcfTracker
from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST, KcfParticle


def test_the_printed_preset_holds_the_thesis_s_constants():
    assert (PRINTED.switch, PRINTED.plain_frames, PRINTED.stored, PRINTED.particles) == (0.2, 50, 20, 200)
    assert PRINTED.past_share == 0.5
    assert (PRINTED.convergence, PRINTED.response_share, PRINTED.hypotheses) == (0.03, 0.3, 20)
    assert PRINTED.kcf.scale_step == 1.0
    assert not PRINTED.past_by_score
    assert not PRINTED.additions


WITHOUT_OBJECTS = replace(PRINTED, response_share=1.0)


@pytest.mark.parametrize("settings", [WITHOUT_OBJECTS, ROBUST])
def test_a_confident_filter_tracks_as_kcf_does(settings):
    images, boxes = clip(walk(15))
    combined = KcfParticle(replace(settings, switch=-1.0))
    alone = KcfTracker(settings.kcf)
    for a, b in zip(run(combined, images, boxes[0]), run(alone, images, boxes[0]), strict=True):
        np.testing.assert_array_equal(a.box, b.box)
    assert combined.searched_frames == 0


@pytest.mark.parametrize("settings", [WITHOUT_OBJECTS, ROBUST])
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
    tracker = KcfParticle(replace(WITHOUT_OBJECTS, switch=10.0, convergence=1e9, plain_frames=8))
    searched = []
    tracker.start(images[0], boxes[0])
    for image in images[1:]:
        before = tracker.searched_frames
        tracker.follow(image)
        searched.append(tracker.searched_frames > before)
    starts = np.flatnonzero(searched)
    assert len(starts) > 1
    assert (np.diff(starts) == 9).all()  # every search ends in its first frame, then 8 without


def test_a_target_that_does_not_come_back_is_lost(monkeypatch):
    monkeypatch.setattr(kcf_particle, "LOST_AFTER", 5)
    images, boxes = clip(walk(30, 3.0), hidden=range(10, 30))
    statuses = [s.status for s in run(KcfParticle(ROBUST), images, boxes[0])]
    assert "searching" in statuses
    assert statuses[-1] == "lost"


def test_a_new_look_is_followed_after_the_longest_search(monkeypatch):
    """The target turns blue for good: nothing explains it any more, so the filter goes on, and says that it doubts."""
    images, boxes = clip(walk(40))
    changed = [image if t < 12 else np.ascontiguousarray(image[..., ::-1]) for t, image in enumerate(images)]
    monkeypatch.setattr(kcf_particle, "LONGEST_SEARCH", 6)
    tracker = KcfParticle(ROBUST)
    statuses = [s.status for s in run(tracker, changed, boxes[0])]
    assert statuses[8] == "tracking"
    assert "searching" in statuses[12:20]
    assert tracker.searched_frames < 28


def test_a_wider_search_finds_a_target_that_jumped(monkeypatch):
    """It jumps two of its widths, beyond the window of the filter."""
    path = np.concatenate([np.tile([[50.0, 80.0]], (12, 1)), np.tile([[100.0, 80.0]], (12, 1))])
    images, boxes = clip(path)
    monkeypatch.setattr(kcf_particle, "REACH", 2)
    assert overlaps(run(KcfParticle(ROBUST), images, boxes[0]), boxes)[-1] > 0.6
    assert overlaps(run(KcfTracker(ROBUST.kcf), images, boxes[0]), boxes)[-1] == 0


def test_the_same_seed_gives_the_same_boxes():
    images, boxes = clip(walk(25), hidden=range(12, 16))
    first, second = (run(KcfParticle(ROBUST, seed=3), images, boxes[0]) for _ in range(2))
    assert [s.box.tolist() for s in first] == [s.box.tolist() for s in second]
