"""Fitting what actions cost: people in a row who do different things, and people who do the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.drone import action_cost_fit
from benchmarks.drone.action_cost_fit import LinkSamples, fit_action_cost, fit_action_costs, link_samples
from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.drone.observations import Observation
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth

SIZE = np.array([10.0, 22.0])


def row_of_people(seed: int, frames: int = 40, people: int = 6) -> tuple[list[Observation], GroundTruth]:
    """People side by side, close enough to be mistaken for each other, each with an action of their own."""
    rng, observations, rows = np.random.default_rng(seed), [], []
    for frame in range(frames):
        centre = np.column_stack([60 + 22.0 * np.arange(people), np.full(people, 200.0)])
        boxes = np.concatenate([centre - SIZE, centre + SIZE], axis=1)
        rows += [(frame, k + 1, *boxes[k]) for k in range(people)]
        noisy = boxes + rng.normal(0, 2, (people, 1))
        actions = rng.uniform(0, 0.6, (2, people, 3))
        actions[:, np.arange(people), np.arange(people) % 3] += 0.4
        still = CameraStep(np.eye(3)[:2])
        observations.append(Observation(frame, Detections(noisy, np.full(people, 0.9)), actions, still))
    table = np.array(rows)
    yes = np.ones(len(table), dtype=np.bool_)
    truth = GroundTruth(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:], yes, ~yes, yes.astype(float))
    return observations, truth


def test_links_of_one_person_differ_less_and_means_are_surer() -> None:
    found = link_samples(*row_of_people(0), 30.0, (320, 240))
    assert found.same.any()
    assert not found.same.all()
    for distance in (found.single, found.means):
        assert distance[found.same].mean() < distance[~found.same].mean()
    apart = [np.median(d[~found.same]) / np.median(d[found.same]) for d in (found.single, found.means)]
    assert apart[1] > apart[0]


def test_logistic_regression_finds_what_made_the_links() -> None:
    rng = np.random.default_rng(0)
    cost, distance = rng.normal(0, 2, 40_000), rng.uniform(0, 1, 40_000)
    same = rng.random(40_000) < 1 / (1 + np.exp(0.5 * cost + 4 * (distance - 0.3)))
    fitted = fit_action_cost([LinkSamples(cost, distance, distance, same)])
    # Of 40,000 samples the coefficients are known to a few percent.
    np.testing.assert_allclose(fitted.weight, [8, 8], rtol=0.1)


def test_links_of_one_kind_are_refused() -> None:
    one = LinkSamples(np.zeros(3), np.zeros(3), np.zeros(3), np.ones(3, np.bool_))
    with pytest.raises(RequestError, match="one kind only"):
        fit_action_cost([one])
    observations, truth = row_of_people(0, 3)
    bare = [Observation(one.frame, one.detections) for one in observations]
    with pytest.raises(RequestError, match="without actions"):
        link_samples(bare, truth, 30.0, (320, 240))


def test_no_cost_of_actions_prices_the_tracks_that_it_is_fitted_to() -> None:
    """Whatever was fitted to a clip before, its links and the tracks along which means are taken stay the same."""
    clip = row_of_people(1)
    settings = DroneSettings()
    flow = settings.flow
    heavy = ActionCost("one-sided", weight=(500.0, 900.0), neutral=(0.0, 0.0))
    costs = replace(flow.costs, link=replace(flow.costs.link, action=heavy))
    plain, priced = (
        link_samples(*clip, 30.0, (320, 240), one)
        for one in (settings, replace(settings, flow=replace(flow, costs=costs)))
    )
    for name in ("cost", "single", "means", "same"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(priced, name))


@pytest.mark.slow
def test_the_file_holds_the_cost_of_actions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    observations, truth = row_of_people(0)
    clip = tmp_path / "fit" / "one"
    write_ground_truth(clip / "gt" / "gt.txt", truth)
    write_sequence_info(clip, "one", 30.0, 40, 320, 240)
    monkeypatch.setattr(action_cost_fit, "video_observations", lambda *_: iter(observations))
    out = tmp_path / "drone.yaml"
    fit_action_costs([tmp_path / "fit"], out)
    fitted = fit_action_cost([link_samples(observations, truth, 30.0, (320, 240))])
    term = yaml.safe_load(out.read_text())["drone"]["flow"]["costs"]["link"]["action"]
    np.testing.assert_allclose(term["weight"], fitted.weight, rtol=0.05)
