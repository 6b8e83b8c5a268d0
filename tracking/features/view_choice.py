"""Which tiles a video needs, from a look at its first frames at several scales."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from tsuiseki.tracking.features.networks.exported import Detect, Detector
from tsuiseki.tracking.features.views import MOST_COLUMNS, TiledDetector, View, view_of
from tsuiseki.tracking.types import Detections, ImageArray

# A pixel of the frame becomes at most this many of the input: a larger picture shows nothing more.
LARGEST_SCALE = 1.5
# More tiles are worth their time where they find this many times the people.
WORTH = 1.25
_CERTAIN = 0.3
_LOOKS = 3
# Below this many people in a frame the look goes on: all of them may be too small so far.
_SOMEBODY = 0.5


class SizedDetect(Detect, Protocol):
    """A detector that knows the size of its input."""

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Height and width, pixels; None where it takes any."""


@dataclass(frozen=True)
class ViewChoice:
    """A view, and what it takes.

    Attributes:
        view: the tiles.
        milliseconds: that the detector took a frame; None where the whole frame was taken without trying.
        people: expected in a frame at each number of tiles across that was tried.
    """

    view: View
    milliseconds: float | None
    people: dict[int, float]

    def __str__(self) -> str:
        tiles = "the whole frame" if len(self.view) == 1 else f"{len(self.view)} tiles a frame"
        cost = "" if self.milliseconds is None else f", about {self.milliseconds:.0f} ms a frame"
        return f"{tiles}{cost}"


def choose_view(images: Sequence[ImageArray], detector: SizedDetect, batch_size: int = 4) -> ViewChoice:
    """The fewest tiles beyond which more do not find more people, as far as the detector can tell.

    The number of people expected is the sum of the scores from 0.3 on. From the whole frame on, one more tile across
    is taken as long as it raises that number by `WORTH`; frames that the input shows at `LARGEST_SCALE` need no tiles.

    Args:
        images: the first frames, of one size; `_LOOKS` of them are looked at.
        detector: finds people.
        batch_size: most pictures of one call of ``detector``.
    """
    size = images[0].shape[:2]
    looked = images[:: max(1, len(images) // _LOOKS)][:_LOOKS]
    chosen, cost = view_of(size, 1, 1.0), None
    most = _most_columns(size, detector.input_size)
    if most == 1 or detector.input_size is None:
        return ViewChoice(chosen, None, {})
    people: dict[int, float] = {}
    for columns in range(1, most + 1):
        view = view_of(size, columns, detector.input_size[1] / detector.input_size[0])
        found, taken = _timed(TiledDetector(detector, view, batch_size=batch_size), looked)
        people[columns] = sum(_expected(d) for d in found) / len(looked)
        if columns == 1 or people[columns] > WORTH * people[chosen.columns]:
            chosen, cost = view, taken
        elif people[chosen.columns] >= _SOMEBODY:
            break
    return ViewChoice(chosen, cost, people)


class ViewedDetector:
    """A detector that looks at frames of any size in as many tiles as they need.

    Args:
        detector: finds people in pictures.
        wanted: tiles across and down (None: as many as cover the frame); by default chosen from the first frames.
        batch_size: most pictures of one call of ``detector``.

    Attributes:
        choices: made so far, by the height and width of the frames.
    """

    def __init__(
        self, detector: SizedDetect, wanted: tuple[int, int | None] | None = None, batch_size: int = 4
    ) -> None:
        self.detector, self.wanted, self.batch_size = detector, wanted, batch_size
        self.choices: dict[tuple[int, ...], ViewChoice] = {}

    @property
    def summary(self) -> str:
        """The views that are more than the whole frame, in words."""
        return ", ".join(str(choice) for choice in self.choices.values() if len(choice.view) > 1)

    def prepare(self, images: Sequence[ImageArray]) -> ViewChoice:
        """Choose the view for frames like ``images``, once for each size."""
        size = images[0].shape[:2]
        if size not in self.choices:
            if self.wanted is None:
                self.choices[size] = choose_view(images, self.detector, self.batch_size)
            else:
                self.choices[size] = self._as_wanted(self.wanted, images[0])
        return self.choices[size]

    def _as_wanted(self, wanted: tuple[int, int | None], image: ImageArray) -> ViewChoice:
        """The view that was asked for, and what it takes."""
        size = image.shape[:2]
        high, wide = self.detector.input_size or size
        view = view_of(size, wanted[0], wide / high, wanted[1])
        if len(view) == 1:
            return ViewChoice(view, None, {})
        return ViewChoice(view, _timed(TiledDetector(self.detector, view, batch_size=self.batch_size), [image])[1], {})

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB, all of one size."""
        if not images:
            return []
        return TiledDetector(self.detector, self.prepare(images).view, batch_size=self.batch_size).detect(images)


def knows_scores(detect: object) -> bool:
    """Whether the scores of ``detect`` mean what those of the shipped detectors do."""
    inner = _inner(detect)
    return isinstance(inner, Detector) and not inner.calibrated


def scores_are_probabilities(detect: object) -> bool:
    """Whether ``detect`` says that its scores are probabilities in the video of its own camera."""
    inner = _inner(detect)
    return isinstance(inner, Detector) and inner.calibrated


def _inner(detect: object) -> object:
    return detect.detector if isinstance(detect, ViewedDetector) else detect


def _timed(detector: TiledDetector, images: Sequence[ImageArray]) -> tuple[list[Detections], float]:
    """What is found, and the milliseconds that an image took."""
    start = time.perf_counter()
    found = detector.detect(images)
    return found, 1000 * (time.perf_counter() - start) / len(images)


def _most_columns(size: tuple[int, ...], wanted: tuple[int, int] | None) -> int:
    """Tiles across at which the input shows the frame at `LARGEST_SCALE`; 1 where the whole frame nearly does."""
    if wanted is None:
        return 1
    most = 1
    for columns in range(2, MOST_COLUMNS + 1):
        x1, y1, x2, y2 = view_of((size[0], size[1]), columns, wanted[1] / wanted[0]).tiles[-1].tolist()
        if min(wanted[1] / max(x2 - x1, 1), wanted[0] / max(y2 - y1, 1)) > LARGEST_SCALE:
            break
        most = columns
    return most


def _expected(found: Detections) -> float:
    return float(found.scores[found.scores >= _CERTAIN].sum())
