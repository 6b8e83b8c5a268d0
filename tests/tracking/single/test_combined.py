"""The combined tracker: its doubt, its search by particles, and its return."""

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, mean_colours, overlaps, run, walk
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single import combined
from tsuiseki.tracking.single.combined import Combined, CombinedSettings, Evidence
from tsuiseki.tracking.single.regularised import RegularisedTracker


def test_the_combined_tracker_without_doubt_is_its_filter():
    images, boxes = clip(walk(20))
    combined = Combined(CombinedSettings(doubt=0.0))
    alone = RegularisedTracker()
    for a, b in zip(run(combined, images, boxes[0]), run(alone, images, boxes[0]), strict=True):
        np.testing.assert_array_equal(a.box, b.box)
    assert combined.searched_frames == 0


def test_the_combined_tracker_says_that_a_hidden_target_is_lost_and_when_it_is_back():
    images, boxes = clip(walk(44, 2.0), hidden=range(15, 25))
    seen = run(Combined(), images, boxes[0])
    statuses = [s.status for s in seen]
    assert set(statuses[:13]) == {"tracking"}
    assert statuses[15] != "tracking"
    assert statuses[22] == "lost"
    assert statuses[-1] == "tracking"
    assert iou_pairs(seen[-1].box, boxes[-1]) > 0.6


def test_particles_take_the_combined_tracker_to_a_target_that_jumped(monkeypatch):
    """It jumps four of its widths, beyond the window of its filter."""
    monkeypatch.setattr(combined, "REACH", 2)
    path = np.concatenate([np.tile([[50.0, 80.0]], (12, 1)), np.tile([[145.0, 80.0]], (14, 1))])
    images, boxes = clip(path)
    assert overlaps(run(RegularisedTracker(), images, boxes[0]), boxes)[-1] == 0
    assert overlaps(run(Combined(), images, boxes[0]), boxes)[-1] > 0.6


def test_doubt_needs_both_witnesses():
    tracker = Combined()
    images, boxes = clip(walk(12))
    run(tracker, images, boxes[0])
    peak, colour = np.median(tracker._evidence.peaks), np.median(tracker._evidence.colours)
    for peak_share, colour_share, doubts in [(0.5, 0.9, True), (0.5, 1.0, False), (0.7, 0.9, False)]:
        found = replace(tracker.target, peak=peak * peak_share, colour_score=colour * colour_share)
        assert tracker._doubts(found) == doubts


def test_the_first_frames_are_no_evidence():
    target = replace(_started().target, peak=0.01, colour_score=0.01)
    evidence = Evidence()
    for shares in [(1.0, 1.0)] * 4 + [(0.02, 0.02)]:
        evidence.add(replace(target, peak=0.5, colour_score=0.5))
        assert evidence.shares(target) == pytest.approx(shares)


def _started():
    images, boxes = clip(walk(2))
    tracker = Combined()
    tracker.start(images[0], boxes[0])
    return tracker


@pytest.mark.slow
def test_the_same_seed_gives_the_same_boxes():
    images, boxes = clip(walk(30), hidden=range(12, 20))
    first, second = (run(Combined(seed=3), images, boxes[0]) for _ in range(2))
    assert [s.box.tolist() for s in first] == [s.box.tolist() for s in second]


def test_a_challenge_that_was_won_wrongly_is_given_back():
    """The target is taken to be where it is not: after the probation the place before is taken again."""
    images, boxes = clip(walk(44))
    tracker = Combined()
    run(tracker, images[:24], boxes[0])
    former = tracker.target
    tracker.take_over(replace(former, centre=former.centre + 60))
    for image in images[24:]:
        found = tracker.follow(image)
    assert iou_pairs(found.box, boxes[-1]) > 0.6


def test_a_challenger_that_looks_like_the_surroundings_does_not_win():
    images, boxes = clip(walk(24))
    tracker = Combined()
    run(tracker, images, boxes[0])
    elsewhere = replace(tracker.target, centre=tracker.target.centre + 60)
    assert not tracker._likelier(images[-1], elsewhere, tracker.target)
    assert tracker._likelier(images[-1], tracker.target, elsewhere)


@pytest.mark.slow
def test_a_lost_target_is_found_where_the_witness_sees_it_again():
    """It is hidden for a second and comes back two of its sides away, where the filter alone does not look."""
    path = np.concatenate([walk(20), np.tile([[150.0, 110.0]], (40, 1))])
    images, boxes = clip(path, hidden=range(20, 40))
    assert overlaps(run(RegularisedTracker(), images, boxes[0]), boxes)[-1] == 0
    tracker = Combined(describe=mean_colours)
    seen = run(tracker, images, boxes[0])
    assert {s.status for s in seen[34:39]} == {"lost"}
    assert seen[-1].status == "tracking"
    assert overlaps(seen, boxes)[-1] > 0.6


def test_a_lost_target_is_looked_for_as_it_was_when_it_was_certain():
    """Its size comes to be wrong while it is hidden."""
    images, boxes = clip(walk(24))
    tracker = Combined(describe=mean_colours)
    run(tracker, images, boxes[0])
    certain = tracker._certain
    tracker.target = replace(tracker.target, size=2.0)
    places = tracker.heaviest_places(images[-1], 4, replace(certain, centre=tracker.target.centre))
    assert {place.size for place in places} == {certain.size}
    assert max(iou_pairs(tracker.box(place), boxes[-1]) for place in places) > 0.6
