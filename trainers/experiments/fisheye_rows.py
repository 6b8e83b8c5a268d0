"""Rooms under ceiling fisheye cameras as the networks observe them, and the rows of Table 4.3 over the observations.

Rows are ways to track that differ in what they match by, with the settings chosen on other rooms.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import FrameTruth, ground_truth
from tsuiseki.datamodules.scenes.room_clip import SIZES, Room, RoomClip, RoomSettings, plan_room
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import PersonModel, build_table
from tsuiseki.tracking.evaluation.multi import PeopleScores, SequencePair, evaluate_sequences
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import FisheyeTracker, flow_on_floor
from tsuiseki.tracking.fisheye.unrolled import looking
from tsuiseki.tracking.fisheye.view import CeilingView, Crops
from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.people.tracker import run_tracker
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.trainers.experiments.store import Store

# Frames per second of the rooms (thesis 4.3.1), and people of each sequence; the small room's vary as in Table 4.2.
RATE = 15
PEOPLE: dict[Room, tuple[int, ...]] = {"large": (6,), "small": (4, 10, 3, 6)}
QUALITY = 95
# Detections below it are not kept: the lowest score that the experiment chooses from.
LEAST_SCORE = 0.2
CROPS: tuple[Crops, ...] = ("image", "upright")
STAGES = ("detect", "look up", "rectify", "describe")


@dataclass(frozen=True)
class CeilingClip:
    """One camera of one room.

    Attributes:
        room: large or small.
        seed: of the room.
        seconds: length.
        rate: frames per second that are kept, 1 or 15.
        camera: 0 or 1.
        calibration: lens file; None takes an equidistant lens.
    """

    room: Room
    seed: int
    seconds: int
    rate: int
    camera: int
    calibration: Path | None

    def plan(self) -> RoomClip[OmnidirectionalCamera]:
        """The room; its people walk alike at every rate."""
        people = PEOPLE[self.room]
        settings = RoomSettings(
            size=SIZES[self.room],
            frames=self.seconds * RATE,
            frame_rate=float(RATE),
            people=people[self.seed % len(people)],
        )
        return plan_room(settings, 10_000 + self.seed, read_lens(self.calibration) if self.calibration else None)

    def pictures(self) -> Iterator[tuple[int, ImageArray, FrameTruth]]:
        """Frame number in the room, picture ``(H, W, 3)`` uint8 RGB as a camera's JPEG has it, and truth."""
        room = self.plan()
        view = room.view(self.camera)
        for frame in range(0, self.seconds * RATE, RATE // self.rate):
            drawn, truth = room.draw_frame(view, frame)
            jpeg = cv2.imencode(".jpg", drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), dtype=np.uint8)[..., ::-1]
            yield frame, np.ascontiguousarray(image), truth


class CpuTimes(StageTimes):
    """Seconds of the processor instead of the clock, which other programs change."""

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Add the processor's time inside the ``with`` block to ``stage``."""
        start = time.process_time()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.process_time() - start


@dataclass(frozen=True)
class CeilingModels:
    """Files of the networks.

    Attributes:
        detector: file.
        appearance: file.
    """

    detector: Path
    appearance: Path


@dataclass(frozen=True)
class Observed:
    """The observations of a sequence, and the truth of one frame in every second.

    Attributes:
        rate: frames per second.
        found: of each frame, without features.
        features: by kind of crop, of each frame, in half precision.
        truth: its frames count seconds.
        seconds: of each stage, over all frames.
    """

    rate: int
    found: list[FloorDetections]
    features: dict[str, list[FloatArray]]
    truth: GroundTruth
    seconds: dict[str, float]

    def described(self, crops: str, least_score: float) -> list[FloorDetections]:
        """The detections from a score on, with the features of a kind of crop; ``none`` goes without."""
        result = []
        for frame, each in enumerate(self.found):
            kept = each.detections.scores >= least_score
            detections = each.detections.select(kept)
            if crops != "none":
                wide = self.features[crops][frame][kept].astype(np.float64)
                unit = wide / np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-9)
                detections = detections.with_features(unit)
            result.append(FloorDetections(detections, each.rotated[kept], each.places[kept]))
        return result


def observe(clip: CeilingClip, models: CeilingModels) -> Observed:
    """What the networks make of the pictures of a sequence."""
    room = clip.plan()
    camera = room.cameras[clip.camera]
    appearance = Appearance(models.appearance, threads=1)
    table = build_table(camera, room.floor)
    views = {crops: CeilingView(camera, table, PersonModel(), appearance, crops) for crops in CROPS}
    detector = looking(Detector(models.detector, LEAST_SCORE, threads=1), camera, "unrolled")
    times, unmeasured = CpuTimes(dict.fromkeys(STAGES, 0.0)), CpuTimes()
    found, truths = list[FloorDetections](), list[FrameTruth]()
    features: dict[str, list[FloatArray]] = {crops: [] for crops in CROPS}
    for frame, image, truth in clip.pictures():
        with times.measure("detect"):
            detected = detector.detect([image])[0]
        located = views["upright"].locate(detected, times)
        for crops, each in views.items():
            own = each.describe(image, located, times if crops == "upright" else unmeasured).detections.features
            features[crops].append((np.empty((0, 128)) if own is None else own).astype(np.float16))
        plain = Detections(located.detections.boxes, detected.scores)
        found.append(FloorDetections(plain, located.rotated, located.places))
        truths += [truth] if frame % RATE == 0 else []
    return Observed(clip.rate, found, features, ground_truth(truths), times.seconds)


# Seconds that all rows keep a track without a detection, and that a new one needs detections in a row.
PATIENCE, CONFIRM = 3.0, 0.2
# The largest distance 1 - IoU of DeepSORT's second stage.
ANY_OVERLAP = 0.99
# The largest cosine distance of a match by place, of 2, 1, 0.8, 0.65 and 0.5 the one of the best MOTA on the validation
# rooms with the other settings of both parts.
PLACE_GATE = 0.5
Choice = dict[str, float]
Tracking = Callable[[Sequence[FloorDetections], float, Choice], list[Track]]


@dataclass(frozen=True)
class FloorRow:
    """One way to track.

    Attributes:
        name: as in the table.
        crops: what the appearance comes from: ``image``, ``upright`` or ``none``.
        track: detections of a sequence, its rate and a choice of settings to tracks.
        grid: what the settings are chosen from.
        like: the row whose settings it takes instead of choosing; empty for its own.
        least_score: of its detections, where it is not the common one.
    """

    name: str
    crops: str
    track: Tracking
    grid: Mapping[str, Sequence[float]]
    like: str = ""
    least_score: float | None = None

    def choices(self) -> Iterator[Choice]:
        """Every combination of the grid."""
        for values in itertools.product(*self.grid.values()):
            yield dict(zip(self.grid, values, strict=True))


def _hungarian(by_appearance: bool, by_place: bool, **fixed: float) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[Track]:
        # As in the thesis, the second stage asks for the place alone, unless a row says otherwise.
        given = {"start_score": 0.0, "place_feature_gate": 2.0, **choice, **fixed}
        settings = FisheyeSettings(by_appearance, by_place, confirm=CONFIRM, max_age=PATIENCE, **given)
        return _online(found, rate, settings)

    return track


def _online(found: Sequence[FloorDetections], rate: float, settings: FisheyeSettings) -> list[Track]:
    tracker = FisheyeTracker(rate, settings)
    for each in found:
        tracker.update(each)
    return [each.track for each in tracker.tracks()]


def _lifecycle(rate: float, choice: Choice) -> LifecycleSettings:
    hits, age = max(1, round(CONFIRM * rate)), round(PATIENCE * rate)
    return LifecycleSettings(hits, age, choice.get("start_score", 0.0), "detected")


def _motion(rate: float, walk: float) -> BoxMotion:
    """A Kalman filter of people who change their velocity by ``walk`` heights a second within a second."""
    return BoxMotion(acceleration=walk / rate**1.5, start_velocity=walk / rate)


def _sort(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[Track]:
    settings = SortSettings(choice["min_iou"], _lifecycle(rate, choice), _motion(rate, choice["walk"]))
    return run_tracker((f.detections for f in found), Sort(settings))


def _deepsort(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[Track]:
    growth = choice["growth"] / rate
    settings = DeepSortSettings(
        feature_gate=choice["feature_gate"],
        position_gate=ANY_OVERLAP,
        reach=choice["reach"] + growth,
        reach_growth=growth,
        memory=0.7,
        lifecycle=_lifecycle(rate, choice),
        motion=_motion(rate, choice["walk"]),
    )
    return run_tracker((f.detections for f in found), DeepSort(settings))


# Chosen values are meant to lie within these. A cosine distance of 1 is as good as no gate, an overlap of .01 as any.
# Heights and metres are of the image and of the floor; what grows does so in a second.
LOOKS = {"feature_gate": (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)}
WORLD = {"reach": (0.25, 0.5, 0.9, 1.4, 2.0, 2.8), "speed": (0.4, 0.8, 1.4, 2.0, 3.0)}
OVERLAP = {"min_iou": (0.01, 0.03, 0.1, 0.2, 0.3), "walk": (0.03, 0.1, 0.3, 1.0, 3.0)}
IMAGE = {"reach": (0.25, 0.5, 1.0, 2.0), "growth": (0.5, 1.0, 2.0, 4.0), "walk": (0.03, 0.1)}
STARTS = (0.0, 0.45, 0.5, 0.55, 0.6, 0.7)
GATED = "both, appearance in both stages"
# What `track fisheye` takes of its detector.
SHIPPED_SCORE = 0.3
_ROWS: tuple[FloorRow, ...] = (
    FloorRow("baseline", "image", _hungarian(True, False), LOOKS),
    FloorRow("SORT", "none", _sort, OVERLAP),
    FloorRow("DeepSORT", "image", _deepsort, {**LOOKS, **IMAGE}),
    FloorRow("rectification", "upright", _hungarian(True, False), LOOKS),
    FloorRow("world", "none", _hungarian(False, True), WORLD),
    FloorRow("both", "upright", _hungarian(True, True), {**LOOKS, **WORLD}),
    FloorRow(GATED, "upright", _hungarian(True, True, place_feature_gate=PLACE_GATE), {**LOOKS, **WORLD}, like="both"),
    # As the command does it, whatever validation says.
    FloorRow("track fisheye", "upright", lambda found, rate, _: _online(found, rate, FisheyeSettings()), {},
             least_score=SHIPPED_SCORE),
    FloorRow("track fisheye, flow", "upright", lambda found, rate, _: [t.track for t in flow_on_floor(found, rate)], {},
             least_score=SHIPPED_SCORE),
)  # fmt: skip
ROWS = {row.name: row for row in _ROWS}


def each_second(tracks: Sequence[Track], rate: int) -> list[Track]:
    """Tracks in the frames that have a truth, counted in seconds."""
    kept = [(t, t.frames % rate == 0) for t in tracks]
    return [Track(t.id, t.frames[k] // rate, t.boxes[k], t.scores[k]) for t, k in kept if k.any()]


def run_row(row: FloorRow, observed: Observed, choice: Choice, least_score: float) -> list[Track]:
    """The tracks of a sequence in the seconds that have a truth."""
    least = least_score if row.least_score is None else row.least_score
    tracks = row.track(observed.described(row.crops, least), float(observed.rate), choice)
    return each_second(tracks, observed.rate)


def pair_of(name: str, observed: Observed, tracks: Sequence[Track], where: Any = None) -> SequencePair:
    """Truth and tracks of a sequence; ``where`` keeps the boxes ``(N, 4)`` for which it is True."""
    truth, plain = observed.truth, list(tracks)
    if where is not None:
        truth = truth.select(where(truth.boxes))
        kept = [(t, where(t.boxes)) for t in plain]
        plain = [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t, k in kept if k.any()]
    return SequencePair(name, truth, plain, len(observed.found) // observed.rate)


def score(pairs: Sequence[SequencePair]) -> PeopleScores:
    """Scores over all sequences together."""
    return evaluate_sequences(pairs).combined


LEAST_SCORES = (0.2, 0.3, 0.4, 0.5, 0.6)


@dataclass(frozen=True)
class Graded:
    """Settings of a row, and its scores on the validation rooms with them.

    Attributes:
        choice: settings by name.
        mota: up to 1.
        idf1: in [0, 1].
    """

    choice: Choice
    mota: float
    idf1: float


def grades(name: str, validation: Sequence[Observed], choices: Sequence[Choice], least: float) -> list[Graded]:
    """The scores of some settings of the row ``name`` on the validation sequences."""
    graded = []
    for choice in choices:
        found = score([pair_of(str(k), o, run_row(ROWS[name], o, choice, least)) for k, o in enumerate(validation)])
        graded.append(Graded(choice, found.mota, found.idf1))
    return graded


def best_choice(row: FloorRow, graded: Callable[[list[Choice]], list[Graded]]) -> Graded:
    """The choice of the row's grid of the best MOTA, and the score to start a track before and after the rest."""

    def best(choices: list[Choice]) -> Graded:
        return max(graded(choices), key=lambda one: one.mota)

    grid = list(row.choices())
    if not row.grid:
        return best(grid)
    start = best(_starts(grid[len(grid) // 2])).choice["start_score"]
    found = best([{**choice, "start_score": start} for choice in grid])
    return best(_starts(found.choice))


def _starts(choice: Choice) -> list[Choice]:
    return [{**choice, "start_score": start} for start in STARTS]


def lowest_score(store: Store, names: Sequence[str], validation: Sequence[Observed]) -> float:
    """The lowest score of a detection with which some rows have the best mean MOTA on the validation sequences.

    Each row has the middle of its grid, so that the score suits none better than the others, and the score to start a
    track that is best then: weak detections help a row only where they start nothing.
    """

    def mean_mota(least: float) -> float:
        found = []
        for name in names:
            grid = list(ROWS[name].choices())
            found.append(store.recall(grades, name, validation, _starts(grid[len(grid) // 2]), least))
        return float(np.mean([max(one.mota for one in each) for each in found]))

    return max(LEAST_SCORES, key=mean_mota)


def select(store: Store, row: FloorRow, validation: Sequence[Observed], least: float) -> Graded:
    """The settings of a row of the best MOTA on the validation sequences."""
    return best_choice(row, lambda choices: store.recall(grades, row.name, validation, choices, least))


def tracked(row: tuple[str, Choice, float], observed: Observed) -> list[Track]:
    """The tracks of a row by its name, choice and lowest score in a sequence, in the seconds that have a truth."""
    name, choice, least = row
    return run_row(ROWS[name], observed, choice, least)
