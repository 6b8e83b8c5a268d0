"""What `tsuiseki adapt` may be told, and which end of a video teaches nothing."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError

# Share of each video, its end, that nothing is learnt from and that says which round is best; and the share before it
# that no weight is learnt from and that says what scores mean.
HELD_OUT, CALIBRATED = 0.15, 0.1
KEPT_BACK = HELD_OUT + CALIBRATED


@dataclass(frozen=True)
class AdaptSettings:
    """How a camera is learnt.

    Attributes:
        rounds: at most.
        steps: of learning in each round.
        pictures: kept of the videos together, evenly spread; labels are taken from them.
        score_threshold: of the detections that are tracked, in (0, 1).
        sitting: people may sit or stand through most of the video; what never moves is then left out of the learning.
        seed: of all chance.
        threads: CPU cores; 0 takes all.
        device: what exported networks run on.
    """

    rounds: int = 3
    steps: int = 100
    pictures: int = 400
    score_threshold: float = 0.3
    sitting: bool = False
    seed: int = 0
    threads: int = 0
    device: Device = "auto"

    def __post_init__(self) -> None:
        if min(self.rounds, self.steps) < 1 or self.pictures < 20 or self.threads < 0:
            raise RequestError(
                "expected `rounds` and `steps` from 1, `pictures` from 20 and `threads` from 0, "
                f"got {self.rounds}, {self.steps}, {self.pictures} and {self.threads}"
            )
        if not 0 < self.score_threshold < 1:
            raise RequestError(f"expected a `score_threshold` between 0 and 1, got {self.score_threshold:g}")
