"""Learning the costs of the drone tracker: actions count, and the camera does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.association.affinity import FEATURE_SETS
from tsuiseki.tracking.association.tracklets.action_refinement import Prices
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.motion.camera_trajectory import move_boxes
from tsuiseki.tracking.pipelines.observations import Observation
from tsuiseki.tracking.trackers.drone import DroneTracker
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.affinity.affinity import BoostingSettings
from tsuiseki.trainers.affinity.affinity_drone import fit_drone_affinity, labelled_clip
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections

SIZE = np.array([10.0, 22.0])
BOOSTING = BoostingSettings(trees=20)


def acted(seed: int, *, moving: bool, frames: int = 60, people: int = 6) -> tuple[list[Observation], GroundTruth]:
    """People in a row who do different things, dressed alike, under a camera that may jerk."""
    rng = np.random.default_rng(seed)
    path, observations, rows = np.eye(3), [], []
    for frame in range(frames):
        step = np.eye(3)
        if moving and frame:
            step[:2, 2] = rng.uniform(-30, 30, 2)
        path = step @ path
        centre = np.column_stack([60 + 45.0 * np.arange(people), np.full(people, 200.0)])
        boxes = np.concatenate([centre - SIZE, centre + SIZE], axis=1)
        boxes = move_boxes(boxes, np.repeat(path[None, :2], people, axis=0))
        rows += [(frame, k + 1, *boxes[k]) for k in range(people)]
        seen = np.flatnonzero(rng.random(people) < 0.8)
        noisy = boxes[seen] + rng.normal(0, 6, (len(seen), 1))
        false = rng.uniform(0, 400, (1, 2))
        every = np.concatenate([noisy, np.concatenate([false, false + 2 * SIZE], axis=1)])
        actions = rng.uniform(0, 0.5, (2, len(every), 3))
        actions[:, np.arange(len(seen)), seen % 3] += 0.5
        looks = np.tile([1.0, 0.0], (len(every), 1))
        scores = np.append(rng.uniform(0.6, 1, len(seen)), rng.uniform(0.3, 0.8))
        motion = step[:2] if frame else None
        observations.append(Observation(frame, Detections(every, scores, looks), actions, motion))
    table = np.array(rows)
    yes = np.ones(len(table), dtype=np.bool_)
    truth = GroundTruth(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], yes, ~yes, yes.astype(float))
    return observations, truth


def clips(*, moving: bool) -> list[LabelledDetections]:
    return [labelled_clip(*acted(seed, moving=moving)) for seed in range(3)]


def test_a_labelled_clip_is_as_if_the_camera_had_stood_still() -> None:
    (observations, truth) = acted(0, moving=True)
    clip = labelled_clip(observations, truth)
    assert clip.actions is not None
    assert clip.actions.shape == (len(clip), 3)
    for person in range(1, 7):
        middle = clip.boxes[clip.ids == person][:, [0, 2]].mean(axis=1)
        # Where they stand in the first frame, but for the noise of the detections.
        assert np.abs(middle - (60 + 45 * (person - 1))).mean() < 8
    one = next(o for o in observations if o.frame == 7)
    assert one.actions is not None
    here = clip.frames == 7
    np.testing.assert_allclose(np.sort(clip.actions[here, 0]), np.sort(one.actions.mean(axis=0)[:, 0]), atol=1e-6)


def test_costs_learn_what_actions_say(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    learnt = clips(moving=True)
    plain = fit_drone_affinity(learnt, tmp_path / "plain.onnx", "thesis", boosting=BOOSTING)
    single = fit_drone_affinity(learnt, tmp_path / "saf.onnx", boosting=BOOSTING)
    prices = Prices(single.observation, single)
    multi = fit_drone_affinity(learnt, tmp_path / "maf.onnx", multi=prices, boosting=BOOSTING)
    assert single.card.class_names == multi.card.class_names == FEATURE_SETS["thesis_action"]
    assert single.card.settings["auc"] > plain.card.settings["auc"]
    assert single.observation.b == -0.5
    assert capsys.readouterr().out.count("on unseen clips AUC") == 3
    observations, truth = acted(9, moving=True)
    tracker = DroneTracker(prices=Prices(single.observation, single, multi))
    for one in observations:
        assert one.actions is not None
        tracker.update(replace(one.detections, actions=one.actions.mean(axis=0)), one.motion)
    assert len(truth) == 360
    assert 5 <= len(tracker.tracks()) <= 9


def test_request_errors(tmp_path: Path) -> None:
    found = [replace(clip, actions=None) for clip in clips(moving=False)]
    with pytest.raises(RequestError, match="need action streams"):
        fit_drone_affinity(found, tmp_path / "a.onnx")
    (tmp_path / "b.onnx").touch()
    with pytest.raises(RequestError, match="already exists"):
        fit_drone_affinity(found, tmp_path / "b.onnx", "thesis")
