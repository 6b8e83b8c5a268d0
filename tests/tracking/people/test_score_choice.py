"""The beginning of a video tells the threshold of a network whose scores are not known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from tests.tracking.people.families import LIFECYCLE
from tsuiseki import track_people
from tsuiseki.tracking.association.clutter import LOWEST, ScoreChoice, score_choice
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.opening import open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.people.sort import SortSettings
from tsuiseki.tracking.types import Detections, ImageArray
from tsuiseki.tracking.video.source import open_source

FRAMES, RATE = 260, 10.0


class Walkers:
    """Five walkers at 0.7, standing boxes at 0.2, by the number that the picture shows, above its threshold."""

    def __init__(self) -> None:
        self.score_threshold = 0.3

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        found = []
        for image in images:
            t = int(image[0, 0, 0]) + int(image[0, -1, 0])
            corner = np.array([[30 * n + 2 * t, 60 * n] for n in range(5)] + [[7 * n, 300] for n in range(30)], float)
            scores = np.array([0.7] * 5 + [0.2] * 30)
            found.append(Detections(np.concatenate([corner, corner + np.array([20, 50])], 1), scores))
        return [each.select(each.scores >= self.score_threshold) for each in found]


def opened(folder: Path, moving: bool = False) -> Any:
    """A picture a frame whose first row tells its number, before a wall that a camera passes where it is moving."""
    wall = cv2.resize(np.random.default_rng(0).integers(30, 220, (9, 60, 3), np.uint8), (1920, 96))
    for t in range(FRAMES):
        image = wall[:, 5 * t * moving :][:, :160].copy()
        image[0, :80], image[0, 80:] = min(t, 200), max(t - 200, 0)
        cv2.imwrite(str(folder / f"{t:04}.png"), image)
    return open_source(str(folder), frame_rate=RATE)


def test_the_rest_of_the_video_goes_by_the_threshold_of_its_beginning(tmp_path: Path) -> None:
    network = Walkers()
    choice = ScoreChoice(network, network, None)  # type: ignore[arg-type]
    inputs = PeopleInputs(opened(tmp_path), network, choice=choice)
    counts = [len(found) for _, found in inputs.detections()]
    assert counts == [5] * FRAMES
    assert choice.floor is not None
    assert LOWEST < choice.threshold == network.score_threshold <= 0.7
    assert f"{choice.threshold:.2f}" in str(choice)


def test_where_nothing_moves_the_usual_threshold_is_taken(tmp_path: Path) -> None:
    network = Walkers()
    still = SimpleNamespace(detect=lambda images: [each.select(slice(5, None)) for each in network.detect(images)])
    choice = ScoreChoice(still, network, None)  # type: ignore[arg-type]
    assert sum(len(found) for _, found in PeopleInputs(opened(tmp_path), still, choice=choice).detections()) == 0
    assert choice.floor is None
    assert choice.threshold == 0.3


def test_before_a_camera_that_moves_clutter_moves_too_and_the_usual_threshold_is_taken(tmp_path: Path) -> None:
    network = Walkers()
    choice = ScoreChoice(network, network, None)  # type: ignore[arg-type]
    counts = [
        len(found) for _, found in PeopleInputs(opened(tmp_path, moving=True), network, choice=choice).detections()
    ]
    assert counts == [5] * FRAMES
    assert choice.floor is None
    assert choice.threshold == 0.3
    assert "the camera moves too much" in str(choice)


def test_functions_and_given_detections_keep_their_own_threshold() -> None:
    assert score_choice([Detections.empty()], None) is None
    assert score_choice(Walkers(), None) is None
    assert score_choice(object.__new__(ForeignDetector), None) is not None


SCALES = {
    "logits": lambda score: np.log(score / (1 - score)),
    "percent": lambda score: 100 * score,
    "below any start score": lambda score: 0.3 * score,
    "negative": lambda score: score - 3,
}


def walkers_and_flicker(t: int) -> Detections:
    """Five walkers at 0.7, and five boxes at 0.2 that are elsewhere in every frame."""
    rng = np.random.default_rng(t)
    corner = np.concatenate([[[30 * n + 2 * t, 60 * n] for n in range(5)], rng.uniform([500, 0], [1900, 900], (5, 2))])
    return Detections(np.concatenate([corner, corner + np.array([20, 50])], axis=1), np.repeat([0.7, 0.2], 5))


@pytest.mark.parametrize("method", LIFECYCLE)
@pytest.mark.parametrize("scale", SCALES)
def test_scores_of_any_scale_are_tracked_alike(method: Any, scale: str) -> None:
    images = [np.zeros((1000, 2000, 3), np.uint8)] * 60
    plain = [walkers_and_flicker(t) for t in range(60)]
    given = [Detections(found.boxes, SCALES[scale](found.scores)) for found in plain]
    usual = {"frame_rate": 10, "appearance": "none"} if method == "deepsort" else {"frame_rate": 10}
    expected = track_people(images, method, detections=plain, **usual)
    result = track_people(images, method, detections=given, **usual)
    assert len(result) == 5
    assert [track.boxes.tolist() for track in result] == [track.boxes.tolist() for track in expected]
    assert "a scale of their own" in result.facts["scores"]
    assert "scores" not in expected.facts


def test_a_function_may_score_by_logits_and_a_start_score_of_ones_own_stays() -> None:
    images = (np.full((1000, 2000, 3), t, np.uint8) for t in range(60))

    def logits(image: ImageArray) -> Detections:
        found = walkers_and_flicker(int(image[0, 0, 0]))
        return Detections(found.boxes, found.scores - 3)

    assert len(track_people(images, "sort", detector=logits, frame_rate=10)) == 5
    settings = Linking(method="sort", sort=SortSettings(start_score=-2.5))
    finding = PeopleFinding(detections=[walkers_and_flicker(0)])  # type: ignore[arg-type]
    source = open_source([np.zeros((1000, 2000, 3), np.uint8)])
    assert open_people(source, finding, settings, 0).inputs.scale is None


def test_a_threshold_of_ones_own_goes_for_functions_and_given_detections_too() -> None:
    images = [np.zeros((1000, 2000, 3), np.uint8)] * 20
    given = [np.column_stack([found.boxes, found.scores]) for found in map(walkers_and_flicker, range(20))]
    for least, rows in ((0.1, 200), (0.5, 100), (0.9, 0)):
        source, calls = open_source(images), iter(given)
        for finding in ({"detections": given}, {"detector": lambda _, calls=calls: next(calls)}):
            wanted = PeopleFinding(**finding, score_threshold=least)  # type: ignore[arg-type]
            inputs = open_people(source, wanted, Linking(method="sort"), 0).inputs
            assert sum(len(found) for _, found in inputs.detections()) == rows
