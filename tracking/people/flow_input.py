"""Detections as the flow takes them: without duplicates, as if the camera stood still, with their noise and worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np
from pydantic import NonNegativeFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.camera_from_boxes import LEAST, MOVING, CameraSteps, doubt_of, steps_from_boxes
from tsuiseki.tracking.association.costs import ProbabilityCost, ScoreCost
from tsuiseki.tracking.association.detection_tables import DetectionRows, DetectionTable, Measurements, rows_of
from tsuiseki.tracking.association.flow_rounds import FirstCosts
from tsuiseki.tracking.association.flow_window import FlowCosts, FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.nearby import DENSE, hidden_parts, near_pairs, sizes
from tsuiseki.tracking.association.smoothing import SmoothingSettings, fit_smoothing
from tsuiseki.tracking.association.video_evidence import DetectionCost, VideoEvidence
from tsuiseki.tracking.bounds import SETTINGS, PositiveSeconds, Seconds
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath, CameraTrajectory
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray, Track

# Deviation of the place of a box where the camera stands still and nothing says otherwise, heights.
STILL = 0.002
# By how much further off, in r, a box of probability 0 is than one of probability 1.
UNSURE = 1.5
# By how much further off, in r, a box that is quite hidden is than one in full view.
HIDDEN = 0.75
# Seconds that stay undecided beyond the longest link, for the motion on both sides of what is decided.
SETTLE = 0.7
# Deviation of the camera's place, in heights of a box, after a step that its images do not tell.
LOST = 3.0
# Of two boxes of a frame that overlap by more (intersection over union), the one of the lower score is left out.
DUPLICATE = 0.95
# Fewest detections of a track, unless the video itself has fewer frames.
FEWEST = 3
# How often the boxes of a dense frame may cover their place.
MOST_TIMES = 5.0


@pydantic_dataclass(frozen=True, config=SETTINGS)
class InputSettings:
    """How detections are prepared.

    Attributes:
        detection: how scores become probabilities.
        follow_camera: remove the camera's motion from the boxes; otherwise the camera is taken to stand still.
        any_speed: links are weighed for targets as fast as those of the video; otherwise for those of the settings.
        box_noise: standard deviation of the centre of a box, heights, where boxes tell the camera's motion; see
            `steps_from_boxes`.
    """

    detection: DetectionCost = field(default_factory=DetectionCost)
    follow_camera: bool = True
    any_speed: bool = True
    box_noise: NonNegativeFloat = 0.0


@dataclass
class FlowInput:
    """Turns the detections of one segment of frames after the other into rows.

    Attributes:
        settings: of the preparation.
        inferences: frames with inference; what follows counts these as its frames.
        size: width and height of the image; None where not known.
        path: the camera's motion from images, of which several may read; None takes the boxes.
        standing: pictures that tell where the camera stands still, whatever the boxes say; several may read them.
        observation: learnt costs of scores, taken for their calibration; None lets the video calibrate them.
        camera: the trajectory so far.
        evidence: what the video says of its detections so far.
        duplicates: boxes left out so far.
        stood_still: frames so far that the camera stood still before, by pictures.
        names: of the classes so far.
    """

    settings: InputSettings
    inferences: InferenceTimes
    size: tuple[int, int] | None
    path: CameraPath | None = None
    standing: StandingCamera | None = None
    observation: ScoreCost | None = None
    duplicates: int = 0
    names: Mapping[int, str] = field(default_factory=dict)
    _last: Detections = field(default_factory=Detections.empty)
    _count: int = 0
    _step: CameraStep | None = None
    _stood: bool = True

    def __post_init__(self) -> None:
        if not self.settings.follow_camera:
            self.standing = None
        self.camera = CameraTrajectory("boxes" if self.path is None else "images")
        self.evidence = VideoEvidence(self.settings.detection, self.frame_rate)
        self._shifts: list[float] = []
        # CameraSteps to inferences whose detections have not come to `rows` yet, and the one that has begun.
        self._steps: list[CameraStep] = []
        self._still: list[bool] = []
        self.stood_still = 0

    @property
    def frame_rate(self) -> float:
        """Inferences a second."""
        return self.inferences.rate

    def skip(self) -> None:
        """Take a frame without inference."""
        self._follow(self.inferences.frame)
        self.inferences.skip()

    def meet(self, time: float | None = None) -> None:
        """Ask the images how the camera came to the next frame; its detections may come to `rows` much later.

        Raises:
            RequestError: see `Clock.now`.
        """
        frame = self.inferences.frame
        self.inferences.add(time)
        self._follow(frame)
        if self._step is not None:
            self._steps.append(self._step)
        if self.standing is not None:
            self._still.append(self._stood)
        self._step, self._stood = None, True

    def _follow(self, frame: int) -> None:
        """Add how the camera came to a frame."""
        if self.path is not None:
            step = self.path.step(frame)
            self._step = step if self._step is None else self._step.and_then(step)
        if self.standing is not None:
            self._stood = self._stood and self.standing.stands_still(frame)

    def copy(self) -> FlowInput:
        """A copy that goes on by itself."""
        clone = copy(self)
        clone._steps, clone._still, clone.inferences = [*self._steps], [*self._still], self.inferences.copy()
        clone.camera, clone.evidence = self.camera.copy(), self.evidence.copy()
        return clone

    def rows(self, detections: Sequence[Detections]) -> tuple[DetectionTable, FloatArray, IntArray]:
        """The detections of the next frames, their scores, and where they come from.

        Args:
            detections: of at least one frame.
        """
        first = len(self.camera)
        rows = rows_of(detections, first, self._count)
        unique = ~duplicates(rows.frames, rows.boxes, rows.scores)
        self.duplicates += int((~unique).sum())
        origin = np.concatenate([entry.origin for entry in detections])[unique]
        self.names = {**self.names, **{number: name for entry in detections for number, name in entry.names.items()}}
        rows = rows.select(unique)
        rows = replace(rows, numbers=self._count + np.arange(len(rows)))
        self._count += len(rows)
        self._follow_camera(rows, first, len(detections))
        boxes = self.camera.to_first(rows.boxes, rows.frames)
        times = None if self.inferences.even else self.inferences.seconds(rows.frames)
        self.evidence.add(rows.frames, boxes, rows.scores, len(self.camera) - 1, times)
        last = rows.frames == len(self.camera) - 1
        self._last = Detections(rows.boxes[last], rows.scores[last])
        # By how much more than r each measurement deviates.
        noise = (
            1 + UNSURE * (1 - self.evidence.probability(rows.scores)) + HIDDEN * hidden_parts(rows.frames, rows.boxes)
        )
        measured = Measurements(
            self.inferences.seconds(rows.frames),
            np.concatenate([centres(boxes), np.log(sizes(boxes))], axis=1),
            noise,
            self.camera.variance(rows.frames),
        )
        table = DetectionTable(
            rows.numbers,
            rows.frames,
            rows.boxes,
            boxes,
            measured,
            rows.features,
            self.frame_rate,
            self.size,
            rows.actions,
            self.inferences.even,
        )
        return table, rows.scores, origin

    def on_grid(self, track: Track) -> Track:
        """A track whose frames are as far apart as its times."""
        return track if self.inferences.even else replace(track, frames=self.inferences.ticks(track.frames))

    def smoothing(self, tracks: Sequence[Track]) -> SmoothingSettings:
        """By how much it suits tracks to be smoothed, see `fit_smoothing`."""
        return fit_smoothing(
            [self.on_grid(track) for track in tracks], self.frame_rate, self.inferences.ticks_per_inference
        )

    def probability(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` of detections of ``(N,)`` scores being right: as learnt, and by the video where nothing is."""
        if self.observation is None:
            return self.evidence.probability(scores)
        least = self.settings.detection.least
        odds = np.exp(self.observation(np.nan_to_num(scores)) - self.observation.b)
        return np.clip(1 / (1 + odds), least, 1 - least)

    def first_costs(self, scores: FloatArray) -> FirstCosts | None:
        """How likely detections of ``(N,)`` scores are right though not detected again; None where speeds are given.

        A detector that misses a person in every third frame is right more often than the video bears it out.
        """
        if not self.settings.any_speed:
            return None
        probability = self.probability(scores)
        right = self.evidence.right(scores) if self.observation is None else probability
        costs = self.settings.detection
        return FirstCosts(right, costs(right, self.frame_rate) - costs(probability, self.frame_rate))

    def logits(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` logits of the probabilities of ``(N,)`` scores."""
        probability = self.probability(scores)
        return np.asarray(np.log(probability / (1 - probability)))

    def costs(self, scores: FloatArray) -> FloatArray:
        """``(N,)`` what using detections of ``(N,)`` scores costs."""
        return self.settings.detection(self.probability(scores), self.frame_rate)

    def flow_costs(self, costs: FlowCosts) -> FlowCosts:
        """What the flow costs where targets move as fast as in this video."""
        if not self.settings.any_speed:
            return costs
        return replace(costs, link=costs.link.at_speed(self.evidence.speed()))

    def _follow_camera(self, rows: DetectionRows, first: int, count: int) -> None:
        """Extend the trajectory by ``count`` frames from ``first`` on."""
        if self.path is not None:
            self._follow_images(rows, count)
            return
        if not self.settings.follow_camera:
            for _ in range(count):
                self.camera.append(np.eye(3)[:2])
            return
        boxes = np.concatenate([self._last.boxes, rows.boxes])
        frames = np.append(np.zeros(len(self._last), np.int64), rows.frames - first + 1)
        rate = np.append(self.frame_rate, self.inferences.rates(first, count))
        steps = steps_from_boxes(frames, boxes, count + 1, rate, self.settings.box_noise)
        still, self._still = self._still[:count], self._still[count:]
        for index in range(1, count + 1):
            if index <= len(still) and still[index - 1]:
                self.stood_still += 1
                self._shifts = [*self._shifts, 0.0][-round(max(self.frame_rate, 2)) :]
                self.camera.append(np.eye(3)[:2])
            else:
                self._append_step(steps, index, float(rate[index]))

    def _follow_images(self, rows: DetectionRows, count: int) -> None:
        height = float(np.median(sizes(rows.boxes).max(axis=1))) if len(rows) else 1.0
        while len(self._steps) < count:
            self.meet()
        steps, self._steps = self._steps[:count], self._steps[count:]
        for step in steps:
            measured = np.isfinite(step.deviation)
            deviation = step.deviation / height if measured else LOST
            self.camera.append(step.similarity, deviation, reliable=measured, moving=not measured)

    def _append_step(self, steps: CameraSteps, index: int, rate: float) -> None:
        shift, support = float(steps.shift[index]), float(steps.support[index])
        # By how much the camera moved in an average interval of the last second, heights of a box.
        usual, times = median(self._shifts or [0.0]), self.frame_rate / rate
        moving = usual * self.frame_rate > MOVING
        if support >= LEAST:
            self._shifts = [*self._shifts, shift / times][-round(max(self.frame_rate, 2)) :]
            self.camera.append(steps.similarity[index])
        elif moving and support > 0:
            doubt = doubt_of(support, rate, self.settings.box_noise)
            self.camera.append(steps.similarity[index], doubt, reliable=False, moving=True)
        else:
            self.camera.append(None, usual * times if moving else STILL, moving=moving)


def solve_window(window: FlowWindow, flow_input: FlowInput, scores: FloatArray, rounds: int | None = None) -> None:
    """Alternate between the flow of what is not decided and the costs of its links.

    Args:
        window: holds the detections.
        flow_input: knows what their scores are worth.
        scores: ``(N,)`` of the detections that the window keeps.
        rounds: how often costs of links are computed again at most; by default see `FlowWindow.solve`.
    """
    free = window.free()
    if free.any():
        logit = None if window.changes is None else flow_input.logits(scores)
        window.solve(flow_input.costs(scores), logit, rounds, flow_input.first_costs(scores[free]))


def refuse_heaps(detections: Detections) -> None:
    """Refuse boxes of a frame that lie on each other many times over, which no links tell apart.

    Raises:
        RequestError: they do.
    """
    if len(detections) <= DENSE:
        return
    low, high = detections.boxes[:, :2].min(axis=0), detections.boxes[:, 2:].max(axis=0)
    times = float(sizes(detections.boxes).prod(axis=1).sum() / (high - low).prod())
    if times > MOST_TIMES:
        raise RequestError(
            f"{len(detections)} boxes of a frame cover their place {times:.0f} times over, as a detector's do before "
            "it suppresses those that overlap; suppress them, or leave low scores out"
        )


def duplicates(frames: IntArray, boxes: FloatArray, scores: FloatArray) -> BoolArray:
    """``(N,)`` boxes that lie on another one of their frame that scores more, or as much and comes first.

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)``, NaN where there is none.
    """
    double = np.zeros(len(frames), dtype=np.bool_)
    if len(frames) == 0:
        return double
    i, j = near_pairs(frames, centres(boxes), sizes(boxes) * (1 - DUPLICATE), 0)
    same = (i < j) & (iou_pairs(boxes[i], boxes[j]) > DUPLICATE)
    i, j = i[same], j[same]
    ranks = np.nan_to_num(scores, nan=-np.inf)
    double[np.where(ranks[j] > ranks[i], i, j)] = True
    return double


@pydantic_dataclass(frozen=True, config=SETTINGS)
class FlowSettings:
    """Settings of the flow tracker. Times are in seconds, so that they hold at any frame rate.

    Attributes:
        input: how detections are prepared: their probabilities, the motion of the camera, duplicates.
        costs: costs of the flow over detections.
        min_time: shortest time of detections of a track, seconds.
        fill: longest gap that is filled on a straight line, seconds.
        smoothing: smooth boxes by as much as suits the video; otherwise they are reported as detected.
        standing: keep tracks that stand and score less than those that move; otherwise they are taken for clutter,
            see `standing_clutter`.
        decide_every: least time between two decisions, seconds; None solves all frames at once in the end.
    """

    input: InputSettings = field(default_factory=InputSettings)
    costs: FlowCosts = field(default_factory=FlowCosts)
    min_time: Seconds = 0.16
    fill: Seconds = 2.0
    smoothing: bool = True
    standing: bool = False
    decide_every: PositiveSeconds | None = 20.0

    def alike(self) -> FlowSettings:
        """These settings with entry and exit costs that take all places alike."""
        return replace(self, costs=replace(self.costs, places=False))

    def fewest(self, frame_rate: float, frames: int | None = None) -> int:
        """Detections that a track needs in a video of so many frames."""
        needed = max(FEWEST, round(self.min_time * frame_rate))
        return needed if frames is None else max(min(needed, frames), 1)


def least_logit(observation: ScoreCost | None) -> float:
    """Mean logit of the probability of a track's detections under which it is clutter, by what scores cost.

    Where the video itself says what scores are worth, anything will do.
    """
    if observation is None:
        return -np.inf
    # Somebody far away is detected with a probability of 0.65 in every frame, a logit of 0.62.
    return 0.5 if isinstance(observation, ProbabilityCost) else 1.0
