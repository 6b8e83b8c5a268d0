"""Settings of `tsuiseki adapt`."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import NO_OPTION, Shared
from tsuiseki.tracking.types.frame_range import check_frame_rate


@dataclass(frozen=True)
class AdaptSettings(Shared):
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

    rounds: int = 3
    steps: int = 100
    pictures: int = 400
    score_threshold: float = 0.3
    sitting: bool = False
    seed: int = field(default=0, metadata=NO_OPTION)
    threads: int = 0
    device: Device = "auto"
    fps: float | None = None

    def check(self) -> None:
        if min(self.rounds, self.steps) < 1 or self.pictures < 20 or self.threads < 0:
            raise RequestError(
                "expected `rounds` and `steps` from 1, `pictures` from 20 and `threads` from 0, "
                f"got {self.rounds}, {self.steps}, {self.pictures} and {self.threads}"
            )
        if not 0 < self.score_threshold < 1:
            raise RequestError(f"expected a `score_threshold` between 0 and 1, got {self.score_threshold:g}")
        check_frame_rate(self.fps)
