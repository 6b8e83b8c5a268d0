"""What tells people apart is learnt on tracks, tried where nothing was learnt, and taken where it is better."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import numpy_helper

from tests.trainers.adapt import street
from tsuiseki.tracking.association.costs import ProbabilityCost
from tsuiseki.tracking.features.networks.exported import open_appearance
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt import linking as module
from tsuiseki.trainers.adapt.examples import coexisting, first_held_out, joined, named, people_of, with_gaps
from tsuiseki.trainers.adapt.find import Found, Models
from tsuiseki.trainers.adapt.foreground import foreground_of
from tsuiseki.trainers.adapt.labels import TAKEN
from tsuiseki.trainers.adapt.learn_appearance import Projection, export_projected, learn_projection, separation
from tsuiseki.trainers.adapt.learn_appearance import ProjectionSettings as Settings
from tsuiseki.trainers.adapt.learn_costs import Stretch, identity_kept
from tsuiseki.trainers.adapt.linking import LinkScores, Seen, learn_links, seen_in
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import Watched, watch
from tsuiseki.trainers.affinity.affinity_samples import NOBODY, LabelledDetections

LENGTH = 16


def looks(person: int, rng: np.random.Generator) -> np.ndarray:
    """What a network says of somebody: a little of who it is, much of the light."""
    row = np.zeros(LENGTH)
    row[person] = 0.5
    row[8:] = rng.normal(0, 0.6, 8)
    return np.asarray(row / np.linalg.norm(row))


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("camera")
    return watch(str(street.write_video(folder / "street")), EVERY_FRAME, folder / "kept", 40)


@pytest.fixture(scope="module")
def seen(watched: Watched) -> Seen:
    """Two people who are found in every frame, and a false detection now and then."""
    rng = np.random.default_rng(0)
    detections = []
    for frame in range(street.FRAMES):
        features = [looks(person, rng) for person in range(2)]
        boxes, scores = street.people(frame), [0.9, 0.85]
        if frame % 7 == 0:
            boxes = np.concatenate([boxes, [[60.0, 2.0, 74.0, 28.0]]])
            features, scores = [*features, looks(5, rng)], [*scores, 0.32]
        detections.append(Detections(boxes, np.array(scores), np.array(features)))
    found = Found(detections, 0, [street.track_of(n) for n in range(2)], 1)
    return seen_in(watched, foreground_of(watched), found, AdaptSettings())


def test_detections_are_named_by_the_taken_tracks(seen: Seen) -> None:
    assert [v.verdict for v in seen.labels.verdicts] == [TAKEN, TAKEN]
    samples = named(seen.found, seen.labels)
    assert set(samples.ids.tolist()) == {1, 2, NOBODY}
    false = samples.ids == NOBODY
    np.testing.assert_array_equal(samples.frames[false], np.arange(0, street.FRAMES, 7))
    assert not samples.right[false].any()


def test_only_those_who_meet_are_known_to_be_different() -> None:
    frames, ids = np.array([0, 0, 1, 5]), np.array([1, 2, 1, 3])
    expected = np.zeros((4, 4), dtype=bool)
    expected[[0, 1, 2, 1], [1, 0, 1, 2]] = True
    np.testing.assert_array_equal(coexisting(frames, ids), expected)


def test_people_of_two_videos_never_meet(seen: Seen) -> None:
    samples = people_of(named(seen.found, seen.labels))
    both = joined([samples, samples])
    assert len(both) == 2 * len(samples)
    different = coexisting(both.frames, both.ids)
    assert not different[: len(samples), len(samples) :].any()
    assert len(set(both.ids.tolist())) == 4


def test_the_last_layer_separates_people_on_frames_it_did_not_see(seen: Seen) -> None:
    learnt, held_out = module._examples([seen], AdaptSettings())
    projection = learn_projection(learnt[0], Settings(stay=0.1), seed=0)
    assert projection is not None
    before, after = separation(held_out[0]), separation(held_out[0], projection)
    assert before is not None
    assert after is not None
    assert before < 0.9
    assert after > before + 0.03


def test_where_nobody_meets_nothing_is_learnt(seen: Seen) -> None:
    samples = named(seen.found, seen.labels)
    one = LabelledDetections(
        *(
            getattr(samples, name)[samples.ids == 1]
            for name in ("frames", "boxes", "scores", "features", "ids", "right")
        )
    )
    assert learn_projection(one, Settings(), 0) is None
    assert separation(one) is None


def test_a_layer_that_changes_nothing_leaves_distances_or_scales_all_alike() -> None:
    features = np.random.default_rng(0).normal(size=(5, 4))
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    features[4] = np.nan
    for scale in (1.0, 0.6):
        moved = Projection(np.eye(4), np.zeros(4), scale)(features)
        np.testing.assert_allclose(1 - moved @ moved.T, scale * (1 - features @ features.T), atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(moved[:4], axis=1), 1)
        assert np.isnan(moved[4]).all()


def test_different_people_stay_as_far_apart_as_link_costs_know(seen: Seen) -> None:
    people = people_of(module._examples([seen], AdaptSettings())[0][0])
    assert people.features is not None
    # Whatever is seen, most of it is the same: learning takes that out and drives all apart.
    alike = people.features + 3 * np.eye(LENGTH)[0]
    alike /= np.linalg.norm(alike, axis=1, keepdims=True)
    projection = learn_projection(replace(people, features=alike), Settings(stay=0.1), seed=0)
    assert projection is not None
    assert projection.scale < 0.8
    other = coexisting(people.frames, people.ids)
    before, after = (1 - (rows @ rows.T)[other].mean() for rows in (alike, projection(alike)))
    np.testing.assert_allclose(after, before)


def test_the_exported_network_is_the_old_one_and_the_layer(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    projection = Projection(np.eye(128) + 0.05 * rng.normal(size=(128, 128)), 0.05 * rng.normal(size=128), 0.8)
    export_projected(shipped("appearance_people"), projection, tmp_path / "learnt.onnx")
    image = rng.integers(0, 256, (90, 120, 3), dtype=np.uint8)
    boxes = np.array([[5.0, 5, 35, 80], [50, 10, 90, 85]])
    before = open_appearance(shipped("appearance_people"), 1).describe(image, boxes)
    after = open_appearance(tmp_path / "learnt.onnx", 1).describe(image, boxes)
    # float32 sums of 128 products of numbers below 1.
    np.testing.assert_allclose(after, projection(before), atol=1e-5)
    weight = {t.name: numpy_helper.to_array(t) for t in onnx.load(tmp_path / "learnt.onnx").graph.initializer}
    np.testing.assert_allclose(weight["projection.weight"], projection.weight.T, atol=1e-6)


def test_a_learnt_network_can_be_learnt_on_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    image, boxes = (
        rng.integers(0, 255, (200, 100, 3), np.uint8),
        np.array([[10.0, 20.0, 50.0, 120.0], [30, 60, 80, 190]]),
    )
    network, expected = (
        shipped("appearance_people"),
        open_appearance(shipped("appearance_people"), 1).describe(image, boxes),
    )
    for name in ("once", "twice"):
        length = expected.shape[1]
        projection = Projection(
            np.eye(length) + rng.normal(0, 0.05, (length, length)), rng.normal(0, 0.01, length), 0.9
        )
        export_projected(network, projection, tmp_path / f"{name}.onnx")
        network, expected = tmp_path / f"{name}.onnx", projection(expected)
    np.testing.assert_allclose(open_appearance(network, 1).describe(image, boxes), expected, atol=1e-5)


def test_what_is_not_better_is_not_taken(seen: Seen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    models = Models(Path("detector.onnx"), affinity=Path("none"))
    monkeypatch.setattr(module, "learn_projection", lambda *_: Projection(np.zeros((LENGTH, LENGTH)), np.ones(LENGTH)))
    monkeypatch.setattr(module, "fit_costs", lambda *_: None)
    again, kept, scores = learn_links([seen], models, tmp_path, AdaptSettings(), 0)
    assert kept == models
    assert again == [seen]
    assert scores.separation_learnt == pytest.approx(0.5)
    assert not scores.better_appearance
    assert not list(tmp_path.iterdir())


def test_what_is_better_is_taken_and_looked_with(seen: Seen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The network that is learnt is exported, describes the detections, and costs are fitted on what it says."""
    written = []
    monkeypatch.setattr(module, "export_projected", lambda *given: written.append(given[2]))
    monkeypatch.setattr(module, "ProjectionSettings", lambda: Settings(stay=0.1))
    kept_so_far = iter([0.7, 0.78, 0.8, 0.9, 0.6, 0.75])
    monkeypatch.setattr(module, "identity_kept", lambda *_, **__: next(kept_so_far))
    again, kept, scores = learn_links([seen], Models(Path("d.onnx")), tmp_path, AdaptSettings(), 0)
    assert scores.better_appearance
    assert scores.better_costs
    assert kept.appearance == tmp_path / "appearance.onnx" == written[0]
    assert kept.affinity == tmp_path / "affinity.onnx"
    assert kept.affinity.is_file()
    assert again[0].found.costs is not None
    first, later = (each.found.detections[0].features for each in (seen, again[0]))
    assert first is not None
    assert later is not None
    assert later.shape == (len(first), LENGTH + 1)
    assert not np.allclose(first, later[:, :LENGTH])
    assert len(again[0].labels.tracks) == 2


def test_costs_that_help_in_the_end_and_lose_identities_in_the_whole_video_are_not_taken(
    seen: Seen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "learn_projection", lambda *_: None)
    tried = iter([0.8, 0.9, 0.9, 0.8])
    monkeypatch.setattr(module, "identity_kept", lambda *_, **__: next(tried))
    _, kept, scores = learn_links([seen], Models(Path("d.onnx")), tmp_path, AdaptSettings(), 0)
    assert (scores.identity, scores.identity_learnt) == (0.9, 0.8)
    assert not scores.better_costs
    assert kept.affinity is None


def test_costs_are_not_taken_where_nobody_is_in_the_held_out_end(
    seen: Seen, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "learn_projection", lambda *_: None)
    tried = iter([None, None, 0.8, 0.9])
    monkeypatch.setattr(module, "identity_kept", lambda *_, **__: next(tried))
    _, kept, scores = learn_links([seen], Models(Path("d.onnx")), tmp_path, AdaptSettings(), 0)
    assert scores.identity is None
    assert not scores.better_costs
    assert kept.affinity is None


def test_identities_that_are_kept_score_one_and_lost_ones_less(seen: Seen) -> None:
    plain = [Detections(d.boxes, d.scores) for d in seen.found.detections]
    found = replace(seen.found, detections=plain)
    stretch = Stretch(seen.watched, found, seen.labels, first_held_out(seen.watched, found, 0.15))
    kept = identity_kept([stretch], 0.3, None, ProbabilityCost())
    assert kept is not None
    assert kept > 0.95
    # With a threshold that hides one of them, half of the boxes have nobody.
    lost = identity_kept([stretch], 0.87, None, ProbabilityCost())
    assert lost is not None
    assert 0.5 < lost < 0.8
    nobody = Stretch(seen.watched, found, seen.labels, street.FRAMES + 5)
    assert identity_kept([nobody], 0.3, None, ProbabilityCost()) is None


def test_frames_are_missing_in_turns() -> None:
    frames = [Detections(street.people(f), np.ones(2)) for f in range(7)]
    assert [len(d) for d in with_gaps(frames, 3)] == [2, 2, 2, 0, 0, 0, 2]
    assert [len(d) for d in with_gaps(frames, 1)] == [2, 0, 2, 0, 2, 0, 2]


def test_better_needs_both_numbers_and_a_clear_rise() -> None:
    better = LinkScores(0.9, 0.91, 0.5, 0.6, 0.7, 0.8)
    assert better.better_appearance
    assert better.better_costs
    assert not replace(better, separation_learnt=0.901).better_appearance
    assert not replace(better, separation_learnt=None).better_appearance
    assert not LinkScores(identity=0.6, identity_learnt=0.5).better_costs
    assert not LinkScores(identity=0.5, identity_learnt=0.51).better_costs


def test_a_network_that_separates_more_but_keeps_no_more_identities_is_not_taken() -> None:
    better = LinkScores(0.9, 0.99, followed=0.7, followed_learnt=0.8)
    assert better.better_appearance
    for learnt in (0.74, 0.6, None):
        assert not replace(better, followed_learnt=learnt).better_appearance
