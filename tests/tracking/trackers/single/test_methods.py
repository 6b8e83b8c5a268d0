"""Trackers of one target on clips with known motion, and what they do when there is nothing to see."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.filters.correlation.kernelised_correlation import respond
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.likelihoods.response import ResponseMaps
from tsuiseki.tracking.trackers.single import kcf
from tsuiseki.tracking.trackers.single.combined import Combined, Evidence
from tsuiseki.tracking.trackers.single.combined_settings import CombinedSettings
from tsuiseki.tracking.trackers.single.interface import follow_target
from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
from tsuiseki.tracking.trackers.single.kcf_particle_settings import PRINTED, ROBUST, THESIS
from tsuiseki.tracking.trackers.single.kcf_tracker import KcfTracker
from tsuiseki.tracking.trackers.single.matching import MEASURES, active_search, colour_bins, match
from tsuiseki.tracking.trackers.single.methods import METHODS, make_tracker
from tsuiseki.tracking.trackers.single.observation_model import SearchView
from tsuiseki.tracking.trackers.single.particles import dispersion
from tsuiseki.tracking.trackers.single.regularised import Model, RegularisedTracker
from tsuiseki.tracking.trackers.single.regularised_settings import RegularisedSettings
from tsuiseki.tracking.types import Frame

SIZE = (160, 200)


def texture(seed, height, width, tint):
    noise = np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(70 * smooth / smooth.std() + tint, 0, 255).astype(np.uint8)


def clip(path, height=36, width=24, sizes=None, hidden=(), shape=SIZE):
    """Images and boxes of a reddish texture that moves over a bluish one; in ``hidden`` frames it is not drawn."""
    background = texture(0, *shape, (60, 90, 150))
    sprite = texture(1, 72, 48, (170, 80, 50))
    images, boxes = [], []
    for t, (x, y) in enumerate(path):
        size = 1.0 if sizes is None else sizes[t]
        w, h = round(width * size), round(height * size)
        left, top = round(x - w / 2), round(y - h / 2)
        image = background.copy()
        if t not in hidden:
            drawn = cv2.resize(sprite, (w, h), interpolation=cv2.INTER_AREA)
            x1, y1, x2, y2 = max(left, 0), max(top, 0), min(left + w, shape[1]), min(top + h, shape[0])
            if x1 < x2 and y1 < y2:
                image[y1:y2, x1:x2] = drawn[y1 - top : y2 - top, x1 - left : x2 - left]
        images.append(image)
        boxes.append([left, top, left + w, top + h])
    return images, np.array(boxes, dtype=float)


def walk(frames, speed=2.0):
    t = np.arange(frames)
    return np.column_stack([60 + speed * t, 70 + 6 * np.sin(t / 4)])


def run(tracker, images, box):
    tracker.start(images[0], box)
    return [tracker.follow(image) for image in images[1:]]


def overlaps(seen, boxes):
    return iou_pairs(np.array([s.box for s in seen]), boxes[1:])


# Mean shift climbs on hues alone, which this noise shares between target and background.
LEAST_OVERLAP = {"meanshift": 0.0, "camshift": 0.0, "colour-particle": 0.4, "histogram": 0.5, "mil": 0.4}


@pytest.mark.parametrize("method", METHODS)
def test_every_method_follows_a_moving_texture(method):
    images, boxes = clip(walk(20))
    seen = run(make_tracker(method), images, boxes[0])
    found = overlaps(seen, boxes)
    assert found.mean() > LEAST_OVERLAP.get(method, 0.75)
    assert all(np.isfinite(s.box).all() and np.isfinite(s.score) for s in seen)


@pytest.mark.parametrize("method", METHODS)
def test_same_seed_same_answers_whatever_else_runs(method):
    images, boxes = clip(walk(8))
    alone = run(make_tracker(method, seed=3), images, boxes[0])
    tracker, other = (make_tracker(method, seed=seed) for seed in (3, 4))
    for one in (tracker, other):
        one.start(images[0], boxes[0])
    for before, image in zip(alone, images[1:], strict=True):
        seen = tracker.follow(image)
        other.follow(image)
        np.testing.assert_array_equal(seen.box, before.box)
        assert seen.score == before.score


@pytest.mark.parametrize("method", ["meanshift", "camshift"])
def test_mean_shift_follows_a_colour(method):
    path = walk(20)
    images = []
    for x, y in path:
        image = np.full((*SIZE, 3), (40, 90, 160), dtype=np.uint8)
        cv2.rectangle(image, (round(x) - 12, round(y) - 18), (round(x) + 11, round(y) + 17), (220, 40, 40), -1)
        images.append(image)
    boxes = np.round(path)[:, [0, 1, 0, 1]] + [-12, -18, 12, 18]
    assert overlaps(run(make_tracker(method), images, boxes[0]), boxes).mean() > 0.75


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_image_breaks_nothing(method):
    image = np.full((60, 80, 3), 128, dtype=np.uint8)
    for seen in run(make_tracker(method), [image] * 4, np.array([20, 20, 40, 50.0])):
        assert np.isfinite(seen.box).all()
        assert (seen.box[2:] > seen.box[:2]).all()


@pytest.mark.parametrize(
    "method",
    [
        "combined",
        "regularised",
        "kcf-particle",
        "kcf",
        "mosse",
        "template",
        "histogram",
        "colour-particle",
        "medianflow",
    ],
)
def test_a_target_may_leave_the_image_in_part(method):
    images, boxes = clip(np.column_stack([np.linspace(150, 195, 16), np.full(16, 70.0)]))
    seen = run(make_tracker(method), images, boxes[0])
    assert np.isfinite([s.box for s in seen]).all()


@pytest.mark.parametrize("growth", [0.6, 1.7])
def test_scale_search_follows_growing_and_shrinking(growth):
    sizes = growth ** np.linspace(0, 1, 50)
    # it walks: a background that stays the same around a standing target holds the size by the 5 % that it must win by
    images, boxes = clip(np.column_stack([np.linspace(70, 130, 50), np.full(50, 80.0)]), sizes=sizes)
    tracker = KcfTracker(kcf.KcfSettings())
    run(tracker, images, boxes[0])
    # the sizes tried are 5 % apart, and a change of size must win by as much
    assert tracker.state.size == pytest.approx(growth, rel=0.15)


def test_of_two_changed_sizes_one_is_taken_and_not_both(monkeypatch):
    images, boxes = clip(walk(2))
    tracker = KcfTracker(kcf.KcfSettings())
    tracker.start(images[0], boxes[0])

    def both_better(bank, windows, kernel):
        responses = respond(bank, windows, kernel)
        return responses * np.array([0.5, 1.5, 2.0], dtype=np.float32)[:, None, None]

    monkeypatch.setattr(kcf, "respond", both_better)
    tracker.follow(images[1])
    assert tracker.state.size == pytest.approx(1.05)


@pytest.mark.parametrize(("width", "height"), [(6, 9), (24, 36), (300, 450), (4, 40), (900, 30)])
def test_template_size_does_not_depend_on_the_target(width, height):
    window = kcf.Kcf.of(kcf.KcfSettings(), width, height).window
    assert max(window.rows, window.columns) == 24
    assert min(window.rows, window.columns) >= 4
    assert window.cell_pixels(1) == pytest.approx(2.5 * max(width, height) / 24)


@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_tiny_and_large_targets_are_followed(scale):
    path, shape = walk(12) * scale, (int(SIZE[0] * scale), int(SIZE[1] * scale))
    images, boxes = clip(path, height=round(36 * scale), width=round(24 * scale), shape=shape)
    assert overlaps(run(KcfTracker(kcf.KcfSettings()), images, boxes[0]), boxes).mean() > 0.6


def test_grey_images_are_followed():
    images, boxes = clip(walk(12))
    grey = [np.repeat(image.mean(axis=2, keepdims=True).astype(np.uint8), 3, axis=2) for image in images]
    assert overlaps(run(KcfTracker(kcf.KcfSettings()), grey, boxes[0]), boxes).mean() > 0.75


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


@pytest.mark.parametrize("growth", [0.6, 1.7])
def test_the_regularised_filter_follows_growing_and_shrinking(growth):
    sizes = growth ** np.linspace(0, 1, 50)
    images, boxes = clip(np.column_stack([np.linspace(70, 130, 50), np.full(50, 80.0)]), sizes=sizes)
    tracker = RegularisedTracker()
    run(tracker, images, boxes[0])
    # as above: sizes are 3 % apart, and what was learnt of the sizes before holds them back
    assert tracker.target.size == pytest.approx(growth, rel=0.15)


def test_one_size_is_kept_where_no_others_are_tried():
    images, boxes = clip(walk(10))
    for seen in run(RegularisedTracker(RegularisedSettings(sizes=1)), images, boxes[0]):
        np.testing.assert_allclose(seen.box[2:] - seen.box[:2], boxes[0, 2:] - boxes[0, :2])


def test_a_size_that_the_size_filter_does_not_see_is_seen_by_the_colours():
    """It shrinks at once by more than the filter's five steps of 3 %; without the far look its size stays."""
    images, boxes = clip(walk(40), sizes=[1.0] * 12 + [0.6] * 28)
    found = []
    for reach in (24, 0):
        tracker = RegularisedTracker(RegularisedSettings(size_reach=reach))
        run(tracker, images, boxes[0])
        found.append(tracker.target.size)
    assert found[0] == pytest.approx(0.6, rel=0.1)
    assert found[1] > 0.75


@pytest.mark.parametrize(("width", "height"), [(6, 9), (24, 36), (300, 450), (4, 40), (900, 30)])
def test_the_regularised_window_does_not_grow_with_the_target(width, height):
    model = Model.of(RegularisedSettings(), width, height)
    assert max(model.shape) == 24
    assert min(model.shape) >= 4
    assert (np.array(model.shape[::-1]) * model.cell_pixels(1) >= [width, height]).all()


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


def test_particles_take_the_combined_tracker_to_a_target_that_jumped():
    """It jumps four of its widths, beyond the window of its filter."""
    path = np.concatenate([np.tile([[50.0, 80.0]], (12, 1)), np.tile([[145.0, 80.0]], (14, 1))])
    images, boxes = clip(path)
    assert overlaps(run(RegularisedTracker(), images, boxes[0]), boxes)[-1] == 0
    assert overlaps(run(Combined(CombinedSettings(reach=2)), images, boxes[0]), boxes)[-1] > 0.6


def test_particles_with_sizes_find_a_target_that_came_back_larger():
    """It jumps four of its widths and is a fifth larger there; the particles take its size, too."""
    path = np.concatenate([np.tile([[50.0, 80.0]], (12, 1)), np.tile([[145.0, 80.0]], (4, 1))])
    images, boxes = clip(path, sizes=[1.0] * 12 + [1.2] * 4)
    sizes = {}
    for spread in (0.0, 0.05):
        settings = CombinedSettings(reach=2, renewed=0.0, size_spread=spread, filter=RegularisedSettings(sizes=1))
        tracker = Combined(settings)
        assert overlaps(run(tracker, images, boxes[0]), boxes)[-1] > 0.5
        sizes[spread] = tracker.target.size
    assert sizes[0.0] == 1.0
    assert 1.1 < sizes[0.05] < 1.35


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
    assert Evidence((0.5,) * 4, (0.5,) * 4).shares(target) == (1.0, 1.0)
    assert Evidence((0.5,) * 5, (0.5,) * 5).shares(target) == pytest.approx((0.02, 0.02))


def _started():
    images, boxes = clip(walk(2))
    tracker = Combined()
    tracker.start(images[0], boxes[0])
    return tracker


def test_the_same_seed_gives_the_same_boxes_of_the_combined_tracker():
    images, boxes = clip(walk(30), hidden=range(12, 20))
    first, second = (run(Combined(seed=3), images, boxes[0]) for _ in range(2))
    assert [s.box.tolist() for s in first] == [s.box.tolist() for s in second]


@pytest.mark.parametrize("measure", MEASURES)
def test_matching_finds_an_exact_copy(measure):
    area = np.random.default_rng(0).integers(1, 256, (20, 25), dtype=np.uint8)
    likeness = match(area, area[6:13, 9:19].copy(), measure)
    assert np.unravel_index(np.argmax(likeness), likeness.shape) == (6, 9)
    # OpenCV's sum of squares comes out of a transform: some thousandths of a grey value remain
    assert likeness.max() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(("rows", "columns"), [(6, 25), (20, 9)])
def test_an_area_smaller_than_what_is_looked_for_is_refused(rows, columns):
    area, template = np.zeros((rows, columns), dtype=np.uint8), np.zeros((7, 10), dtype=np.uint8)
    said = f"expected an area of at least 7 x 10, got {rows} x {columns}"
    for measure in MEASURES:
        with pytest.raises(ValueError, match=said):
            match(area, template, measure)
    with pytest.raises(ValueError, match=said):
        active_search(area, np.ones(64) / 64, 7, 10)


@pytest.mark.parametrize("seed", range(3))
def test_active_search_finds_what_looking_everywhere_finds(seed):
    image = texture(seed, 40, 50, (120, 120, 120))
    bins = colour_bins(image)
    reference = np.bincount(bins[8:24, 20:32].ravel(), minlength=64) / (16 * 12)
    row, column, value = active_search(bins, reference, 16, 12)
    best = max(
        np.minimum(np.bincount(bins[y : y + 16, x : x + 12].ravel(), minlength=64) / 192, reference).sum()
        for y in range(25)
        for x in range(39)
    )
    assert value == pytest.approx(best)
    assert (row, column) == (8, 20)


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ([300, 300, 310, 310], "inside the 200x160 image"),
        ([-30, 10, 0, 20], "inside the 200x160 image"),
        ([50, 50, 50, 80], "positive width and height"),
        ([50, 50, 40, 80], "positive width and height"),
        ([0, 0, 201, 80], "fits into the 200x160 image"),
        ([5, 5, 6, 60], "at least 2 x 2"),
        ([np.nan, 5, 6, 60], "positive width and height"),
    ],
)
def test_a_wrong_first_box_is_refused(box, said):
    image = np.zeros((*SIZE, 3), dtype=np.uint8)
    with pytest.raises(RequestError, match=said):
        list(follow_target([Frame(0, 0.0, image)], np.array(box, dtype=float), make_tracker("kcf")))


def test_a_video_that_changes_its_size_is_refused():
    rng = np.random.default_rng(0)
    shapes = [(60, 80, 3), (60, 90, 3)]
    frames = [Frame(t, 0.0, rng.integers(0, 256, shape, dtype=np.uint8)) for t, shape in enumerate(shapes)]
    with pytest.raises(RunError, match="frame 2: expected 80x60 pixels as before, got 90x60"):
        list(follow_target(frames, np.array([5, 5, 30, 30.0]), make_tracker("kcf")))
