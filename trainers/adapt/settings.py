"""What `tsuiseki adapt` may be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tsuiseki.tracking.errors import RequestError


@dataclass(frozen=True)
class LabelSettings:
    """Which tracks become labels.

    Attributes:
        sure: least mean score of a track's detections.
        least: seconds of detections that a track needs.
        moving: least share of a box that differs from the empty view, the median over the track. What differs less is
            part of the view: it never moves.
        still: what never moves is background to learn from, or left out of the learning (``ignored``), where people
            may sit through most of the video.
        onto_silhouettes: share of the way that boxes are moved onto silhouettes: their own where one can be told, or
            as boxes usually lie off them.
    """

    sure: float = 0.5
    least: float = 0.6
    moving: float = 0.2
    still: Literal["background", "ignored"] = "background"
    onto_silhouettes: float = 0.5

    def __post_init__(self) -> None:
        shares = (self.sure, self.moving, self.onto_silhouettes)
        if not (all(0 <= share <= 1 for share in shares) and self.least >= 0):
            raise RequestError(
                "`labels`: expected sure, moving and onto_silhouettes from 0 to 1 and least from 0, "
                f"got {self.sure:g}, {self.moving:g}, {self.onto_silhouettes:g} and {self.least:g}"
            )


@dataclass(frozen=True)
class LearningSettings:
    """How the detector is fine-tuned in each round.

    Attributes:
        steps: of each round.
        batch_size: windows of a step.
        window: their sides, as a share of the detector's input.
        learning_rate: at the end of the warm-up of the first round; halved in each later one.
        generated_people: rendered to be composed onto the empty view beside the camera's own.
    """

    steps: int = 100
    batch_size: int = 6
    window: float = 1.0
    learning_rate: float = 1e-3
    generated_people: int = 200

    def __post_init__(self) -> None:
        if min(self.steps, self.batch_size) < 1 or self.generated_people < 1 or not self.learning_rate > 0:
            raise RequestError(
                "`learning`: expected steps, batch_size and generated_people from 1 and a learning_rate above 0, got "
                f"{self.steps}, {self.batch_size}, {self.generated_people} and {self.learning_rate:g}"
            )
        if not 0.2 <= self.window <= 1:
            raise RequestError(f"`learning`: expected a window from 0.2 to 1, got {self.window:g}")


@dataclass(frozen=True)
class AdaptSettings:
    """How a camera is learnt.

    Attributes:
        rounds: at most.
        pictures: kept of the videos together, evenly spread; labels are taken from them.
        held_out: share of each video, its end, that nothing is learnt from and that says which round is best.
        calibrated: share of each video, before that end, that no weight is learnt from and that says what scores mean.
        score_threshold: of the detections that are tracked.
        labels: which tracks become labels.
        learning: how the detector is fine-tuned.
        seed: of all chance.
        threads: CPU cores; 0 takes all.
    """

    rounds: int = 3
    pictures: int = 400
    held_out: float = 0.15
    calibrated: float = 0.1
    score_threshold: float = 0.3
    labels: LabelSettings = field(default_factory=LabelSettings)
    learning: LearningSettings = field(default_factory=LearningSettings)
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        if self.rounds < 1 or self.pictures < 20 or self.threads < 0:
            raise RequestError(
                "expected `rounds` from 1, `pictures` from 20 and `threads` from 0, "
                f"got {self.rounds}, {self.pictures} and {self.threads}"
            )
        kept = 0.05 <= self.held_out <= 0.5 and 0.05 <= self.calibrated <= 0.3
        if not (kept and 0 < self.score_threshold < 1):
            raise RequestError(
                "expected `held_out` from 0.05 to 0.5, `calibrated` from 0.05 to 0.3 and `score_threshold` between 0 "
                f"and 1, got {self.held_out:g}, {self.calibrated:g} and {self.score_threshold:g}"
            )

    @property
    def kept_back(self) -> float:
        """Share of each video, its end, that the detector learns no weight from."""
        return self.held_out + self.calibrated
