"""Which tiles a video needs, by inference on its frames at several scales.

One frame may mislead, and a street may be empty when the video begins. So frames some seconds apart are tried, until
three of these trials have detected people; the median of their choices is taken from then on. Of its tiles, those are
used that show nearly all the people of late; once a second all of them are.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.features.exported import Detector, SizedDetect
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.tiles import (
    EVERY_TILE,
    LARGEST_SCALE,
    MOST_COLUMNS,
    TiledDetector,
    TileView,
    busy_tiles,
    merge,
    shown_in,
    view_of,
)
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, ImageArray

# Up to `LARGEST_SCALE` more tiles are worth their time where they find this many times the people.
WORTH = 1.1
# Most pixels of the input for one of the frame beyond that.
ENLARGED_SCALE = 4.0
# There tiles must find this many times the people,
WORTH_ENLARGED = 1.5
# and so many people more.
MORE_ENLARGED = 1.0
# Score from which a detection counts as a person.
_CERTAIN = 0.3
# Height over width from which a person stands.
_UPRIGHT = 1.5
# Trials with people after which the view is settled, and frames of a trial at most.
_TRIALS = 3
# Below this many people in a frame the trial goes on: all of them may be too small so far.
_SOMEBODY = 0.5
# Seconds from the first trial to the next; twice as many each time.
_FIRST_WAIT = 0.15
# Least seconds between trials once a person was detected.
_SPREAD = 1.0
# Most seconds between trials.
_LONGEST_WAIT = 60.0
# Seconds from one inference on all tiles to the next.
_ALL_TILES = 1.0
# Inferences on all tiles from which on the busy tiles follow.
_ENOUGH = 3
# Latest such inferences that they follow from.
_LATELY = 30


@dataclass(frozen=True)
class ViewChoice:
    """A view, and what it takes.

    Attributes:
        view: the tiles.
        milliseconds: that the detector took a frame; None where the whole frame was taken without trying.
        people: expected in a frame at each number of tiles across that was tried.
    """

    view: TileView
    milliseconds: float | None
    people: dict[int, float]

    @property
    def sees_somebody(self) -> bool:
        """Whether somebody is likely to be there."""
        return self.people.get(self.view.columns, 0.0) >= _SOMEBODY

    def __str__(self) -> str:
        tiles = "the whole frame" if len(self.view) == 1 else f"{len(self.view)} tiles a frame"
        cost = "" if self.milliseconds is None else f", about {self.milliseconds:.0f} ms a frame"
        return f"{tiles}{cost}"


def choose_view(
    images: Sequence[ImageArray], detector: SizedDetect, workers: int = 1, enlarge: bool = True
) -> ViewChoice:
    """The fewest tiles beyond which more do not find more people, as far as the detector can tell.

    The number of people expected is the sum of the scores from 0.3 on. Where most of them stand, only those who stand
    are counted: wide boxes that come with more tiles are often of things. From the whole frame on, one more tile across
    is taken as long as `worth_more` says so; frames that two tiles across show larger than at the largest scale stay
    whole.

    Args:
        images: the first frames, of one size; `_TRIALS` of them are tried.
        detector: finds people.
        workers: calls of ``detector`` at a time.
        enlarge: whether tiles may show the frame at up to `ENLARGED_SCALE`, and not `LARGEST_SCALE` alone.
    """
    size = images[0].shape[:2]
    tried = images[:: max(1, len(images) // _TRIALS)][:_TRIALS]
    chosen, cost = view_of(size, 1, 1.0), None
    usual = most_columns(size, detector.input_size)
    largest = most_columns(size, detector.input_size, ENLARGED_SCALE) if enlarge else usual
    if largest == 1 or detector.input_size is None:
        return ViewChoice(chosen, None, {})
    people: dict[int, float] = {}
    standing: dict[int, float] = {}
    for columns in range(1, largest + 1):
        if columns > usual and people[chosen.columns] < _SOMEBODY:
            break
        view = view_of(size, columns, detector.input_size[1] / detector.input_size[0])
        detections, milliseconds = _timed(TiledDetector(detector, view, workers), tried)
        people[columns], standing[columns] = (count / len(tried) for count in _people(detections))
        most_stand = 2 * standing[chosen.columns] >= people[chosen.columns] > 0
        counted = standing if most_stand else people
        if columns == 1 or worth_more(counted[chosen.columns], counted[columns], enlarged=columns > usual):
            chosen, cost = view, milliseconds
        elif people[chosen.columns] >= _SOMEBODY:
            break
    return ViewChoice(chosen, cost, people)


def _people(detections: Sequence[Detections]) -> tuple[float, float]:
    """How many people are expected, and how many of them stand."""
    boxes, scores = np.concatenate([d.boxes for d in detections]), np.concatenate([d.scores for d in detections])
    certain = scores >= _CERTAIN
    upright = boxes[:, 3] - boxes[:, 1] >= _UPRIGHT * (boxes[:, 2] - boxes[:, 0])
    return float(scores[certain].sum()), float(scores[certain & upright].sum())


def worth_more(people: float, with_more: float, enlarged: bool) -> bool:
    """Whether more tiles are worth their time.

    Args:
        people: expected in a frame without them.
        with_more: expected with them.
        enlarged: whether they show the frame larger than at `LARGEST_SCALE`.
    """
    if enlarged:
        peopled = people >= _SOMEBODY
        return peopled and with_more > WORTH_ENLARGED * people and with_more - people > MORE_ENLARGED
    return with_more > WORTH * people


@dataclass
class ViewHistory:
    """The trials on a video's frames of one size, and the choice of tiles.

    Attributes:
        frame_rate: frames a second.
        choice: the view by now.
        peopled: choices of the trials that detected people.
        changes: 0-based frame, counted from the first one, from which each view was taken.
        frames: so far.
        due: frame of the next trial; None where none is needed any more.
        enlarge: see `choose_view`.
        stride: frames of the video from one image to the next.
    """

    frame_rate: float
    choice: ViewChoice | None = None
    peopled: list[ViewChoice] = field(default_factory=list)
    changes: list[tuple[int, ViewChoice]] = field(default_factory=list)
    frames: int = 0
    due: float | None = 0.0
    enlarge: bool = True
    stride: float = 1.0
    _wait: float = _FIRST_WAIT
    _visible: deque[tuple[BoolArray, FloatArray]] = field(default_factory=lambda: deque(maxlen=_LATELY))
    _of: TileView | None = None
    _all_due: float = 0.0

    def take(self, images: Sequence[ImageArray], detector: SizedDetect, workers: int = 1) -> ViewChoice:
        """The view of ``images``, the next ones of the video, after a trial where one is due."""
        if self.choice is None or (self.due is not None and self.frames >= self.due):
            # The first frames lie side by side; later ones are tried one by one.
            tried = images if self.choice is None else images[:1]
            self._add(choose_view(tried, detector, workers, self.enlarge))
        assert self.choice is not None
        self.frames += round(self.stride * len(images))
        return self.choice

    def busy(self, images: Sequence[ImageArray], detector: TiledDetector) -> TiledDetector:
        """The detector on the tiles that show nearly all the people of late.

        Args:
            images: those that were taken last.
            detector: on all tiles of the choice.
        """
        view, now = detector.view, self.frames - round(self.stride * len(images))
        if view is not self._of:
            self._visible.clear()
            self._of, self._all_due = view, now
        first = None
        if now >= self._all_due:
            (detections,) = detector.in_tiles(images[:1])
            first = merge(detections, view.tiles, detector.across)
            self._visible.append((shown_in(detections, first, view.tiles), first.scores))
            self._all_due = now + _ALL_TILES * self.frame_rate
        if len(self._visible) >= _ENOUGH:
            visible, scores = (np.concatenate(part) for part in zip(*self._visible, strict=True))
            view = TileView(view.columns, view.tiles[busy_tiles(visible, scores)])
        return TiledDetector(detector.detector, view, first=first)

    def _add(self, trial: ViewChoice) -> None:
        if trial.sees_somebody:
            self.peopled.append(trial)
        # The lower median; where no person was detected so far, the last trial may have detected more than those
        # before.
        ordered = sorted(self.peopled, key=lambda choice: choice.view.columns)
        chosen = ordered[(len(ordered) - 1) // 2] if ordered else trial
        if self.choice is None or chosen.view.columns != self.choice.view.columns:
            self.changes.append((self.frames, chosen))
            self.choice = chosen
        wait = max(self._wait, _SPREAD) if self.peopled else self._wait
        self._wait = min(2 * wait, _LONGEST_WAIT)
        settled = not trial.people or len(self.peopled) >= _TRIALS
        self.due = None if settled else self.frames + wait * self.frame_rate

    def __str__(self) -> str:
        parts = [str(choice) if not n else f"from frame {n + 1} on {choice}" for n, choice in self.changes]
        unseen = self.choice is not None and len(self.choice.people) > 1 and not self.peopled
        return ", ".join(parts) + (", but no person was detected at any scale" if unseen else "")


class ViewedDetector:
    """A detector of frames of any size in as many tiles as they need.

    Args:
        detector: finds people in pictures.
        tiles: across and down (None: as many as cover the frame), see `parse_view`; by default chosen by trials.
        frame_rate: frames a second, by which the trials are spread.
        enlarge: see `choose_view`. One that has learnt its camera knows people as large as they are there, and never
            sees them larger.
        sparing: pass over tiles without people of their own; for consecutive frames of a video.
        stride: frames of the video from one image to the next.

    Attributes:
        enlarge: as given, but never for such a one.
        histories: of the frames of each height and width.
    """

    def __init__(
        self,
        detector: SizedDetect,
        tiles: tuple[int, int | None] | None = None,
        frame_rate: float = 25.0,
        enlarge: bool = True,
        sparing: bool = False,
        stride: float = 1.0,
    ) -> None:
        self.enlarge, self.sparing = enlarge and not scores_are_probabilities(detector), sparing
        self.stride = stride
        self.detector, self.tiles, self.frame_rate = detector, tiles, frame_rate
        self.histories: dict[tuple[int, ...], ViewHistory] = {}

    @property
    def choices(self) -> dict[tuple[int, ...], ViewChoice]:
        """The view by now, by the height and width of the frames."""
        return {size: history.choice for size, history in self.histories.items() if history.choice is not None}

    @property
    def summary(self) -> str:
        """The views in words; empty before the first frame."""
        return "; ".join(map(str, self.histories.values()))

    def prepare(self, images: Sequence[ImageArray], workers: int = 1) -> ViewChoice:
        """The view for ``images``, the next ones of a video, which are counted; see `prepared`."""
        size = images[0].shape[:2]
        if size not in self.histories:
            self.histories[size] = ViewHistory(self.frame_rate, enlarge=self.enlarge, stride=self.stride)
            if self.tiles is not None:
                choice = self._fixed_view(self.tiles, images[0])
                self.histories[size] = ViewHistory(self.frame_rate, choice, changes=[(0, choice)], due=None)
        return self.histories[size].take(images, self.detector, workers)

    def _fixed_view(self, tiles: tuple[int, int | None], image: ImageArray) -> ViewChoice:
        """The view that was asked for, and what it takes."""
        size = image.shape[:2]
        high, wide = self.detector.input_size or size
        columns = most_columns(size, self.detector.input_size) if tiles == EVERY_TILE else tiles[0]
        view = view_of(size, columns, wide / high, tiles[1])
        if len(view) == 1:
            return ViewChoice(view, None, {})
        return ViewChoice(view, _timed(TiledDetector(self.detector, view), [image])[1], {})

    def prepared(self, images: Sequence[ImageArray], workers: int = 1) -> TiledDetector:
        view = self.prepare(images, workers).view
        detector = TiledDetector(self.detector, view, workers)
        if self.sparing and len(view) > 1:
            return self.histories[images[0].shape[:2]].busy(images, detector)
        detector.workers = 1
        return detector

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, the next ones of a video, each ``(H, W, 3)`` uint8 RGB, all of one size."""
        return self.prepared(images).detect(images) if images else []


def knows_scores(detect: object) -> bool:
    """Whether the scores of ``detect`` mean what those of the shipped detectors do."""
    inner = inner_detector(detect)
    return isinstance(inner, Detector) and not inner.calibrated


def scores_are_probabilities(detect: object) -> bool:
    """Whether ``detect`` says that its scores are probabilities in the video of its own camera."""
    inner = inner_detector(detect)
    return isinstance(inner, Detector) and inner.calibrated


def inner_detector(detect: object) -> object:
    """The detector inside a `ViewedDetector`; any other detector itself."""
    return detect.detector if isinstance(detect, ViewedDetector) else detect


def devices_of(*models: object) -> dict[str, str]:
    """What the networks among ``models`` run on, as a fact of a run; empty where there is none."""
    devices = {getattr(inner_detector(model), "device", None) for model in models} - {None}
    return {"device": " and ".join(sorted(map(str, devices)))} if devices else {}


def _timed(detector: TiledDetector, images: Sequence[ImageArray]) -> tuple[list[Detections], float]:
    """The detections, and the milliseconds that an image took."""
    start = time.perf_counter()
    detections = detector.detect(images)
    return detections, 1000 * (time.perf_counter() - start) / len(images)


def most_columns(size: tuple[int, ...], input_size: tuple[int, int] | None, largest: float = LARGEST_SCALE) -> int:
    """Most tiles across at which the input shows the frame at no more than ``largest``; 1 where two show more.

    Args:
        size: height and width of the frame, pixels.
        input_size: those of the input; None where it takes any.
        largest: pixels of the input for one of the frame.
    """
    if input_size is None:
        return 1
    largest_count = 1
    for columns in range(2, MOST_COLUMNS + 1):
        x1, y1, x2, y2 = view_of((size[0], size[1]), columns, input_size[1] / input_size[0]).tiles[-1].tolist()
        if min(input_size[1] / max(x2 - x1, 1), input_size[0] / max(y2 - y1, 1)) > largest:
            break
        largest_count = columns
    return largest_count


def report_models(detect: object, *others: object) -> dict[str, Any]:
    """What the networks run on, and how the file of ``detect`` is read, for ``run.json``.

    What is not the usual way is printed, too: a GPU, and a file that was recognised.
    """
    facts = dict[str, Any](devices_of(detect, *others))
    if "cuda" in facts.get("device", ""):
        print(f"networks run on {facts['device']}", flush=True)
    network = inner_detector(detect)
    if isinstance(network, ForeignDetector):
        facts["detector"] = network.facts
        print(f"{network.path.name} is read as {network}", flush=True)
    return facts


def report_blank(detect: object) -> None:
    """Print that the file of ``detect`` has given nothing for any picture, where that is so."""
    network = inner_detector(detect)
    if isinstance(network, ForeignDetector) and network.blank:
        print(
            f"{network.path.name} gave no box of any class for any picture; check that it is the right export and that "
            f"its pictures are {network.input}",
            flush=True,
        )
