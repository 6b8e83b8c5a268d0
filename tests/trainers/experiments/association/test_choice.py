"""Settings chosen without the set that they are scored on."""

from __future__ import annotations

from collections.abc import Mapping

from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.trainers.experiments.association.choice import DEFAULT, Scores, candidates, chosen_without


def test_every_candidate_is_another_setting() -> None:
    found = candidates()
    assert found[DEFAULT] == FlowSettings()
    assert len(set(map(repr, found.values()))) == len(found)


def test_the_set_left_out_has_no_say() -> None:
    scores: Mapping[str, Scores] = {
        "a": {"x": (0.5, 0.5), "y": (0.5, 0.5), "z": (0.5, 0.5)},
        "b": {"x": (0.9, 0.9), "y": (0.4, 0.5), "z": (0.4, 0.5)},
        "c": {"x": (0.0, 0.0), "y": (0.6, 0.5), "z": (0.5, 0.5)},
    }
    assert [chosen_without(scores, key) for key in ("x", "y", "z")] == ["c", "b", "b"]
