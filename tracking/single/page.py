"""A video of one target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.report.overlay import Overlay
from tsuiseki.tracking.types import Estimate, Frame, Track
from tsuiseki.tracking.video.webm import VideoWriter

# Estimates that the trail goes back.
TRAIL = 50


def write_target_overlay(path: Path, frames: Iterable[Frame], estimates: Sequence[Estimate], frame_rate: float) -> None:
    """Write a video with the target's box, dashed where it is searched for or lost, and its trail.

    Args:
        path: of the video.
        frames: to draw on.
        estimates: one a frame.
        frame_rate: of the video.
    """
    with VideoWriter(path, frame_rate) as writer:
        for number, frame in enumerate(frames):
            writer.write(Overlay([_track(estimates[max(0, number - TRAIL + 1) : number + 1])], 25.0).draw(frame))


def _track(estimates: Sequence[Estimate]) -> Track:
    return Track(
        1,
        np.array([e.frame for e in estimates]),
        np.array([e.box for e in estimates]),
        np.array([e.score for e in estimates]),
        np.array([e.status == "tracking" for e in estimates]),
    )
