"""The beginning of a video tells the threshold of a network whose scores are not known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from tsuiseki.tracking.association.clutter import LOWEST, ScoreChoice, score_choice
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.people.inputs import PeopleInputs
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


def opened(folder: Path) -> Any:
    for t in range(FRAMES):
        image = np.zeros((16, 16, 3), np.uint8)
        image[:, :8], image[:, 8:] = min(t, 200), max(t - 200, 0)
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


def test_functions_and_given_detections_keep_their_own_threshold() -> None:
    assert score_choice([Detections.empty()], None) is None
    assert score_choice(Walkers(), None) is None
    assert score_choice(object.__new__(ForeignDetector), None) is not None
