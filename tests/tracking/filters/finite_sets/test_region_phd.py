"""Coloured targets in images: what the weights mean, who survives, and clips with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.scenes.blob_clip import HUES, BlobClip, as_ground_truth
from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings as SceneSettings
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS, ColourImage, ColourRange, colour_pixels
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    Calibrated,
    Equalised,
    Regions,
    WithoutOthers,
    as_printed,
    calibrated,
)
from tsuiseki.tracking.filters.finite_sets.region_phd import AnywhereBirths, PatchBirths, RegionPhdFilter
from tsuiseki.tracking.filters.point_motion import SteppingBox
from tsuiseki.tracking.filters.resampling import logarithms
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.points import tracker as points_tracker
from tsuiseki.tracking.points.settings import BlobSettings
from tsuiseki.tracking.points.tracker import BlobTracker, SingleBlobTracker
from tsuiseki.tracking.types import Frame

SCENE = SceneSettings(frames=40, width=320, height=240, objects=3, enter=0.0, stay=True, speed=2.0, clutter=4)


def regions(mass, likelihood, background=0.05):
    """One cluster of four particles for each entry."""
    mass, likelihood = np.repeat(mass, 4) / 4, np.repeat(likelihood, 4)
    return Regions(logarithms(mass), logarithms(likelihood), np.arange(len(mass) // 4) * 4, background, detection=0.95)


def masses(update, *args, **kwargs):
    return np.exp(update(regions(*args, **kwargs))).reshape(-1, 4).sum(axis=1)


def test_the_printed_likelihood_can_only_shrink_the_count():
    after = masses(as_printed, [1.0, 1.0], [1.0, 0.4])
    np.testing.assert_allclose(after, [1.0, 0.05 + 0.95 * 0.4])
    assert masses(as_printed, [1.0], [0.0])[0] == pytest.approx(0.05)


def test_the_ratio_gives_a_seen_target_a_weight_of_about_one_whatever_its_purity():
    np.testing.assert_allclose(masses(calibrated, [0.5, 0.5], [0.9, 0.4]), 1.0, atol=1e-3)
    # At the level of the background the image says nothing; below it the target goes.
    np.testing.assert_allclose(masses(calibrated, [0.5], [0.05]), 0.5)
    assert masses(calibrated, [0.5], [0.0])[0] == pytest.approx(0.025 / 0.525)
    # A weak prior needs more evidence: by (45), m' = m g / (1 - m + m g).
    ratio = 0.05 + 0.95 * 2.0
    assert masses(Calibrated(1.0), [0.1], [0.1])[0] == pytest.approx(0.1 * ratio / (0.9 + 0.1 * ratio))


def test_a_hidden_target_keeps_its_weight():
    np.testing.assert_allclose(masses(calibrated, [0.7], [np.nan]), 0.7)


def test_equalisation_gives_every_target_the_same_top_and_leaves_clutter_alone():
    after = masses(Equalised(as_printed), [1.0, 1.0, 1.0], [0.8, 0.4, 0.01])
    assert after[0] == pytest.approx(after[1])
    assert after[2] == pytest.approx(0.05 + 0.95 * 0.01)
    assert masses(Equalised(as_printed), [], []).size == 0


def follow(tracker, scene, seed):
    truth = []
    for index, ((image,), boxes) in enumerate(BlobClip(scene, seed).frames()):
        tracker.update(Frame(index, index / 25, image))
        truth.append(boxes)
    return np.stack(truth)


def expected_and_seen(scene, seed):
    """Mean expected count and mean number of objects at least half in view, from the sixth frame on."""
    tracker = BlobTracker(NAMED_COLOURS["red"], BlobSettings(particles=300), seed)
    labels = as_ground_truth(follow(tracker, scene, seed))
    seen = np.bincount(labels.frames[labels.visibility >= 0.5], minlength=scene.frames)
    return np.mean(tracker.expected[5:]), seen[5:].mean(), tracker, labels


@pytest.mark.slow
def test_expected_count_on_blobs_is_the_number_of_targets_seen():
    """Objects of unequal purity that enter and cross; one wrong object in five for the whole clip would be 0.2 off."""
    found = [expected_and_seen(SceneSettings(frames=60), seed)[:2] for seed in range(4)]
    expected, seen = np.transpose(found)
    np.testing.assert_allclose(expected, seen, atol=0.35)
    assert expected.mean() == pytest.approx(seen.mean(), abs=0.2)


def test_each_object_has_one_track_where_it_is():
    _, _, tracker, labels = expected_and_seen(SCENE, 0)
    tracks = tracker.tracks()
    assert len(tracks) == 3
    centres = (labels.boxes[:, :2] + labels.boxes[:, 2:]) / 2
    for track in tracks:
        middle = (track.boxes[:, :2] + track.boxes[:, 2:]) / 2
        nearest = [
            np.linalg.norm(centres[labels.frames == f] - m, axis=1).min()
            for f, m in zip(track.frames, middle, strict=True)
        ]
        assert np.median(nearest) < 8.0


def still(boxes, weight=0.9):
    """A filter without births and noise, and a cluster of ten equal particles on each box."""
    boxes = np.repeat(np.asarray(boxes, dtype=float), 10, axis=0)
    centres, sizes = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    nothing = AnywhereBirths(mass=0.0, count=0, size=(20.0, 20.0))
    chosen = RegionPhdFilter(SteppingBox(1e-6, 1e-6), nothing, WithoutOthers(), survival=1.0)
    labels = np.repeat(np.arange(1, len(boxes) // 10 + 1), 10)
    state = chosen.init(np.concatenate([centres, centres, sizes], axis=1), labels, weight * len(boxes) / 10)
    return chosen, state


def square(x):
    mask = np.zeros((100, 200), dtype=bool)
    mask[40:60, x : x + 20] = True
    return ColourImage.of_mask(mask)


def test_a_target_behind_another_is_carried_on_and_one_beside_it_is_not():
    rng = np.random.default_rng(0)
    chosen, state = still([[50, 40, 70, 60], [51, 41, 70, 60]])
    _, info = chosen.step(state, square(50), rng)
    assert info.expected_count == pytest.approx(1.9, abs=1e-2)  # seen: one; hidden: as before
    chosen, state = still([[50, 40, 70, 60], [66, 40, 86, 60]])
    _, info = chosen.step(state, square(50), rng)
    assert info.estimates.ids.tolist() == [1]
    # Nor is what was never seen hidden by a target.
    chosen, state = still([[50, 40, 70, 60]])
    both = chosen.init(np.concatenate([state.particles, state.particles]), np.repeat([1, 2], 10), 1.1)
    both = replace(both, log_weights=np.log(np.repeat([0.1, 0.01], 10)))
    _, info = chosen.step(both, square(50), rng)
    assert info.expected_count == pytest.approx(1.0, abs=1e-2)


def test_what_is_born_on_a_target_is_that_target():
    chosen, state = still([[50, 40, 60, 60]])
    births = replace(chosen, births=PatchBirths())
    state, info = births.step(state, square(50), np.random.default_rng(0))
    assert set(info.posterior.labels.tolist()) == {1}
    _, info = births.step(state, square(120), np.random.default_rng(0))
    assert set(info.posterior.labels.tolist()) == {1, 2}


def test_with_the_printed_likelihood_the_count_means_nothing():
    tracker = BlobTracker(NAMED_COLOURS["red"], BlobSettings(preset="paper", particles=100), 0)
    follow(tracker, SceneSettings(**{**vars(SCENE), "frames": 15}), 0)
    # It can never exceed the births that are still there, 0.05 a frame, however many targets are in view.
    assert max(tracker.expected) <= 0.05 * 15
    assert tracker.tracks(), "a share of the particles still shows where targets are"


def test_one_target_is_found_followed_and_searched_for_again(monkeypatch):
    monkeypatch.setattr(points_tracker, "PATIENCE", 3)
    scene = SceneSettings(**{**vars(SCENE), "objects": 1, "purity": (0.9, 0.9), "clutter": 0, "frames": 30})
    tracker = SingleBlobTracker(NAMED_COLOURS["red"], BlobSettings(preset="single", particles=500))
    truth = follow(tracker, scene, 0)
    last = tracker.estimates[-1]
    assert last.status == "tracking"
    assert np.linalg.norm((last.box[:2] + last.box[2:] - truth[-1, 0, :2] - truth[-1, 0, 2:]) / 2) < 8.0
    grey = np.full((240, 320, 3), 128, dtype=np.uint8)
    for index in range(8):
        tracker.update(Frame(30 + index, 0.0, grey))
    assert [e.status for e in tracker.estimates[-8:]] == ["searching"] * 3 + ["lost"] * 5
    image = grey.copy()
    image[100:132, 150:182] = (220, 20, 20)
    for index in range(12):
        tracker.update(Frame(38 + index, 0.0, image))
    assert tracker.estimates[-1].status == "tracking"


@pytest.mark.parametrize(
    "colour", [ColourRange((0, 360), (0, 1), (0, 1)), ColourRange((300, 301), (0.99, 1), (0.99, 1))]
)
@pytest.mark.parametrize("preset", ["calibrated", "paper", "single"])
def test_a_colour_of_everything_or_nothing_finds_nothing(colour, preset):
    tracker = (SingleBlobTracker if preset == "single" else BlobTracker)(
        colour, BlobSettings(preset=preset, particles=50)
    )
    rng = np.random.default_rng(0)
    for index in range(5):
        tracker.update(Frame(index, 0.0, rng.integers(30, 220, (60, 80, 3), dtype=np.uint8)))
    assert tracker.tracks() == []


def test_particles_cost_the_same_whatever_their_size():
    """The sums come from an integral image: no pixel of a box is visited, so a huge box is as valid as a small one."""
    image = ColourImage.of_mask(np.ones((50, 50), dtype=bool))
    coloured, _ = image.counts(np.array([[0.0, 0, 1e9, 1e9]]))
    assert coloured[0] == 2500


@pytest.mark.parametrize("bad", [{"preset": "best"}, {"smallest": 0.0}, {"size": (2.0, 9.0)}, {"particles": 0}])
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValidationError, match=next(iter(bad))):
        BlobSettings(**bad)


@pytest.mark.parametrize("colour", HUES)
def test_natural_clutter_has_little_of_a_named_colour_and_the_object_much(colour):
    scene = SceneSettings(frames=1, objects=1, clutter=0, enter=0.0, colour=colour)
    (image,), boxes = next(BlobClip(scene, 0).frames())
    mask = colour_pixels(image, NAMED_COLOURS[colour]) > 0
    x1, y1, x2, y2 = np.round(boxes[0]).astype(int)
    assert mask[y1:y2, x1:x2].mean() > 0.8
    mask[y1:y2, x1:x2] = False
    assert mask.mean() < 0.01


def test_clips_are_written_read_and_repeatable(tmp_path):
    scene = SceneSettings(**{**vars(SCENE), "frames": 3})
    folder = write_clip(tmp_path / "clip", BlobClip(scene, 4))
    sequence = read_sequence(folder)
    assert (sequence.length, sequence.width, sequence.height) == (3, 320, 240)
    truth = read_ground_truth(sequence.ground_truth_path)
    first, second = (list(BlobClip(scene, 4).frames()) for _ in range(2))
    np.testing.assert_array_equal(first[2][0], second[2][0])
    np.testing.assert_allclose(truth.boxes[truth.frames == 2], first[2][1][np.isfinite(first[2][1][:, 0])], atol=1e-3)
    with pytest.raises(RequestError, match="overwrite"):
        write_clip(folder, BlobClip(scene, 4))


@pytest.mark.parametrize(
    "bad", [{"colour": "pink"}, {"purity": (0.0, 1.0)}, {"objects": 0}, {"width": 20}, {"clutter": -1}]
)
def test_scenes_refuse_what_they_cannot_draw(bad):
    with pytest.raises(ValidationError, match="Input should be"):
        SceneSettings(**bad)
