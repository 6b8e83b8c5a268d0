"""Settings of `tsuiseki adapt`."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.fields import HIDDEN, FrameRate, Options, Threads


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class AdaptSettings(Options):
    """How a camera is learnt.

    Attributes:
        rounds: largest number of rounds; each detects, learns and detects again, as long as agreement rises.
        steps: training steps in each round.
        pictures: number of pictures of all videos, evenly spread, from which labels are taken.
        score_threshold: least score of the detections that are tracked, in (0, 1).
        sitting: people may sit or stand through most of the video; what never moves is then left out of the learning.
        seed: of all random numbers.
        threads: CPU cores; 0 takes all.
        device: what the exported networks run on, as in track people; learning stays on the CPU.
        fps: frames a second, where the videos do not state it or are wrong.
    """

    rounds: PositiveInt = 3
    steps: PositiveInt = 100
    pictures: Annotated[int, Field(ge=20)] = 400
    score_threshold: Annotated[float, Field(gt=0, lt=1)] = 0.3
    sitting: bool = False
    seed: Annotated[int, HIDDEN] = 0
    threads: Threads = 0
    device: Device = "auto"
    fps: FrameRate | None = None
