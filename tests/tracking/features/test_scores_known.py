"""Whose scores the shipped costs know, and whose are probabilities already."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import onnx
import pytest

from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores, scores_are_probabilities
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.weights import shipped


@pytest.fixture(scope="module")
def own_camera(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A detector that says that its scores are probabilities of its own camera."""
    model = onnx.load(shipped("detector_street"))
    entry = next(p for p in model.metadata_props if p.key == METADATA_KEY)
    card = ModelCard.from_json(entry.value)
    entry.value = dataclasses.replace(card, settings={**card.settings, "calibrated": True}).to_json()
    path = tmp_path_factory.mktemp("models") / "own.onnx"
    onnx.save(model, path)
    return path


def test_the_shipped_costs_know_the_shipped_detector() -> None:
    detector = open_detector(shipped("detector_street"), threads=1)
    for given in (detector, ViewedDetector(detector)):
        assert knows_scores(given)
        assert not scores_are_probabilities(given)


def test_scores_of_an_own_camera_are_probabilities(own_camera: Path) -> None:
    detector = open_detector(own_camera, threads=1)
    for given in (detector, ViewedDetector(detector)):
        assert not knows_scores(given)
        assert scores_are_probabilities(given)


def test_a_detector_that_has_learnt_its_camera_is_shown_nothing_enlarged(own_camera: Path) -> None:
    for path, enlarge in ((shipped("detector_street"), True), (own_camera, False)):
        assert ViewedDetector(open_detector(path, threads=1)).enlarge is enlarge


def test_of_any_other_detector_nobody_knows() -> None:
    for given in (None, lambda image: image):
        assert not knows_scores(given)
        assert not scores_are_probabilities(given)
