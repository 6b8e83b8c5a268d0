"""The rows of Table 4.3: ways to track that differ in what they match by, with the settings chosen on other rooms."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsuiseki.tracking.evaluation.multi import PeopleScores, SequencePair, evaluate_sequences
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import FisheyeTracker, flow_on_floor
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.people.tracker import run_tracker
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack
from tsuiseki.trainers.experiments.fisheye_rooms import Observed
from tsuiseki.trainers.experiments.store import Store

# Seconds that all rows keep a track without a detection, and that a new one needs detections in a row.
PATIENCE, CONFIRM = 3.0, 0.2
# The largest distance 1 - IoU of DeepSORT's second stage.
ANY_OVERLAP = 0.99
# The largest cosine distance of a match by place, of 2, 1, 0.8, 0.65 and 0.5 the one of the best MOTA on the validation
# rooms with the other settings of both parts.
PLACE_GATE = 0.5
Choice = dict[str, float]
Tracking = Callable[[Sequence[FloorDetections], float, Choice], list[FloorTrack]]


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
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        # As in the thesis, the second stage asks for the place alone, unless a row says otherwise.
        given = {"start_score": 0.0, "place_feature_gate": 2.0, **choice, **fixed}
        settings = FisheyeSettings(by_appearance, by_place, confirm=CONFIRM, max_age=PATIENCE, **given)
        return _online(found, rate, settings)

    return track


def _online(found: Sequence[FloorDetections], rate: float, settings: FisheyeSettings) -> list[FloorTrack]:
    tracker = FisheyeTracker(rate, settings)
    for each in found:
        tracker.update(each)
    return tracker.tracks()


def _lifecycle(rate: float, choice: Choice) -> LifecycleSettings:
    hits, age = max(1, round(CONFIRM * rate)), round(PATIENCE * rate)
    return LifecycleSettings(hits, age, choice.get("start_score", 0.0), "detected")


def _motion(rate: float, walk: float) -> BoxMotion:
    """A Kalman filter of people who change their velocity by ``walk`` heights a second within a second."""
    return BoxMotion(acceleration=walk / rate**1.5, start_velocity=walk / rate)


def _sort(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
    settings = SortSettings(choice["min_iou"], _lifecycle(rate, choice), _motion(rate, choice["walk"]))
    return _with_places(run_tracker((f.detections for f in found), Sort(settings)), found)


def _deepsort(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
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
    return _with_places(run_tracker((f.detections for f in found), DeepSort(settings)), found)


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
    FloorRow("track fisheye, flow", "upright", lambda found, rate, _: flow_on_floor(found, rate), {},
             least_score=SHIPPED_SCORE),
)  # fmt: skip
ROWS = {row.name: row for row in _ROWS}


def _with_places(tracks: Sequence[Track], found: Sequence[FloorDetections]) -> list[FloorTrack]:
    """Tracks in the image, with the places of the detections that their boxes overlap most."""
    result = []
    for track in tracks:
        rotated, places = np.zeros((len(track), 5)), np.full((len(track), 2), np.nan)
        for k, (frame, box) in enumerate(zip(track.frames.tolist(), track.boxes, strict=True)):
            here = found[frame]
            if len(here):
                best = int(iou_matrix(box[None], here.detections.boxes)[0].argmax())
                rotated[k], places[k] = here.rotated[best], here.places[best]
        result.append(FloorTrack(track, rotated, places))
    return result


def each_second(tracks: Sequence[FloorTrack], rate: int) -> list[FloorTrack]:
    """Tracks in the frames that have a truth, counted in seconds."""
    result = []
    for t in tracks:
        kept = t.track.frames % rate == 0
        if kept.any():
            track = Track(t.track.id, t.track.frames[kept] // rate, t.track.boxes[kept], t.track.scores[kept])
            result.append(FloorTrack(track, t.rotated[kept], t.places[kept]))
    return result


def run_row(row: FloorRow, observed: Observed, choice: Choice, least_score: float) -> list[FloorTrack]:
    """The tracks of a sequence in the seconds that have a truth."""
    least = least_score if row.least_score is None else row.least_score
    tracks = row.track(observed.described(row.crops, least), float(observed.rate), choice)
    return each_second(tracks, observed.rate)


def pair_of(name: str, observed: Observed, tracks: Sequence[FloorTrack], where: Any = None) -> SequencePair:
    """Truth and tracks of a sequence; ``where`` keeps the boxes ``(N, 4)`` for which it is True."""
    truth, plain = observed.truth, [t.track for t in tracks]
    if where is not None:
        truth = truth.select(where(truth.boxes))
        kept = [(t, where(t.boxes)) for t in plain]
        plain = [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t, k in kept if k.any()]
    return SequencePair(name, truth, plain, len(observed.found) // observed.rate)


def score(pairs: Sequence[SequencePair]) -> PeopleScores:
    """Scores over all sequences together."""
    return evaluate_sequences(pairs).combined


def world_errors(observed: Observed, tracks: Sequence[FloorTrack]) -> FloatArray:
    """``(M,)`` metres between the places of tracked boxes and of the labelled boxes they overlap by half."""
    errors: list[float] = []
    for frame in np.unique(observed.truth.frames):
        rows = np.flatnonzero(observed.truth.frames == frame)
        here = [(t, int(k)) for t in tracks for k in np.flatnonzero(t.track.frames == frame)]
        if not here:
            continue
        overlaps = iou_matrix(observed.truth.boxes[rows], np.array([t.track.boxes[k] for t, k in here]))
        best = overlaps.argmax(axis=1)
        for row, column in zip(rows[overlaps.max(axis=1) >= 0.5], best[overlaps.max(axis=1) >= 0.5], strict=True):
            track, k = here[column]
            errors.append(float(np.linalg.norm(track.places[k] - observed.places[row])))
    values = np.array(errors, dtype=np.float64)
    return values[np.isfinite(values)]


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


def tracked(row: tuple[str, Choice, float], observed: Observed) -> list[FloorTrack]:
    """The tracks of a row by its name, choice and lowest score in a sequence, in the seconds that have a truth."""
    name, choice, least = row
    return run_row(ROWS[name], observed, choice, least)
