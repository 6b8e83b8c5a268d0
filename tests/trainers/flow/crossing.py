"""A video of two people who meet and turn round."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.flow.graphs import DetectedVideo


def crossing(seed: int, frames: int = 40) -> DetectedVideo:
    """Two people of a height of 100 pixels who meet and turn round: constant velocity says that they pass.

    They are missed while they meet, now and then elsewhere, and a false box stands beside.
    """
    rng = np.random.default_rng(seed)
    meeting = frames // 2 + int(rng.integers(-3, 4))
    speed = rng.uniform(3.0, 5.0)
    detections, labels = [], []
    for frame in range(frames):
        away = 6 + speed * abs(frame - meeting)
        x = np.array([300 - away, 300 + away])
        boxes = np.stack([x - 20, [100, 104], x + 20, [200, 204]], axis=1)
        labels.append(boxes)
        found = rng.random(2) > (0.9 if abs(frame - meeting) < 4 else 0.05)
        shown = (boxes + rng.normal(0, 2.0, (2, 4)))[found]
        scores = rng.uniform(0.7, 1, len(shown))
        if meeting - 8 <= frame < meeting - 4:
            shown = np.concatenate([shown, [[420, 90, 450, 170]]])
            scores = np.append(scores, 0.5)
        detections.append(Detections(shown, scores))
    every = np.ones(2 * frames, dtype=np.bool_)
    frame_of, ids = np.repeat(np.arange(frames), 2), np.tile([1, 2], frames)
    truth = GroundTruth(frame_of, ids, np.concatenate(labels), every, ~every, np.ones(2 * frames))
    return DetectedVideo(f"crossing {seed}", detections, truth, 25.0, (640, 480))
