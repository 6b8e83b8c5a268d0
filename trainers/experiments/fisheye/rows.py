"""The rows of Table 4.3: ways to track that differ in what they match by, their settings selected on other rooms."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tsuiseki.tracking.association.costs import HandSetCost
from tsuiseki.tracking.association.flow.pairwise_flow import PairwiseCosts, pairwise_tracks
from tsuiseki.tracking.association.gating import GateSettings
from tsuiseki.tracking.association.rows import rows_of
from tsuiseki.tracking.evaluation.multi import PeopleScores, SequencePair, evaluate_sequences
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.trackers.fisheye import (
    DEFAULT_FLOW,
    FisheyeSettings,
    FisheyeTracker,
    FloorDetections,
    FloorFlowSettings,
    flow_on_floor,
)
from tsuiseki.tracking.trackers.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.trackers.people.flow_output import long_tracks
from tsuiseki.tracking.trackers.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.trackers.people.record import run_tracker
from tsuiseki.tracking.trackers.people.sort import Sort, SortSettings
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.trainers.experiments.fisheye.observations import Observed, restricted

# Seconds that all rows keep a track without a detection, and that a new one needs detections in a row.
PATIENCE, CONFIRM = 3.0, 0.2
# Scale of the difference of two detected centres, in heights, for the flow over boxes in the image.
IMAGE_NOISE = 0.1
Choice = dict[str, float]
Tracking = Callable[[Sequence[FloorDetections], float, Choice], list[FloorTrack]]
Boxes = Literal["filtered", "detected"]


@dataclass(frozen=True)
class Row:
    """One way to track.

    Attributes:
        name: as in the table.
        crops: what the appearance comes from: ``image``, ``upright``, ``standing`` or ``none``.
        place: ``none``, ``image`` or ``world``.
        track: detections of a sequence, its rate and a choice of settings to tracks.
        grid: what the settings are chosen from.
        like: the row whose settings it takes instead of choosing; empty for its own.
    """

    name: str
    crops: str
    place: str
    track: Tracking
    grid: Mapping[str, Sequence[float]]
    like: str = ""

    def choices(self) -> Iterator[Choice]:
        """Every combination of the grid."""
        for values in itertools.product(*self.grid.values()):
            yield dict(zip(self.grid, values, strict=True))


def _hungarian(by_appearance: bool, by_place: bool) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        settings = FisheyeSettings(
            by_appearance=by_appearance, by_place=by_place, confirm=CONFIRM, max_age=PATIENCE, start_score=0.0, **choice
        )
        tracker = FisheyeTracker(rate, settings)
        for each in found:
            tracker.update(each)
        return tracker.tracks()

    return track


def _lifecycle(rate: float, boxes: Boxes) -> LifecycleSettings:
    return LifecycleSettings(max(1, round(CONFIRM * rate)), round(PATIENCE * rate), 0.0, boxes)


def _motion(rate: float, walk: float) -> BoxMotion:
    """A Kalman filter of people who change their velocity by ``walk`` heights a second within a second."""
    return BoxMotion(acceleration=walk / rate**1.5, start_velocity=walk / rate)


def _sort(boxes: Boxes) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        settings = SortSettings(choice["min_iou"], _lifecycle(rate, boxes), _motion(rate, choice["walk"]))
        return _with_places(run_tracker((f.detections for f in found), Sort(settings)), found)

    return track


def _deepsort(boxes: Boxes) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        settings = DeepSortSettings(
            feature_gate=choice["feature_gate"],
            position_gate=choice["position_gate"],
            reach=choice["reach"],
            memory=0.7,
            lifecycle=_lifecycle(rate, boxes),
            motion=_motion(rate, choice["walk"]),
        )
        return _with_places(run_tracker((f.detections for f in found), DeepSort(settings)), found)

    return track


def _image_flow(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
    gate = GateSettings(round(PATIENCE * rate), choice["reach"], 1.0 / rate, 3.0)
    pace = choice["pace"] / rate
    transition = HandSetCost(
        bias=choice["bias"],
        noise=IMAGE_NOISE,
        speed_x=pace,
        speed_y=pace,
        size=choice["size"],
        appearance=choice.get("appearance", 0.0),
        neutral=choice.get("neutral", 0.3),
    )
    rows = rows_of([f.detections for f in found], 0, 0)
    labels = pairwise_tracks(rows, PairwiseCosts(gate, DEFAULT_FLOW.observation, transition))
    chains = long_tracks(labels, max(1, round(CONFIRM * rate)))
    scores = np.nan_to_num(rows.scores)
    tracks = [Track(k, rows.frames[p], rows.boxes[p], scores[p]) for k, p in enumerate(chains, start=1)]
    return _with_places(tracks, found)


def _floor_flow(by_place: bool) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        far: dict[str, Any] = {} if by_place else {"reach": 100.0, "noise": 100.0}
        return flow_on_floor(found, rate, FloorFlowSettings(window=PATIENCE, min_seconds=CONFIRM, **(far | choice)))

    return track


# Chosen gates are meant to lie within these. A cosine distance of 1 is as good as no gate, an overlap of .01 as any.
LOOKS = {"feature_gate": (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)}
WORLD = {"reach": (0.5, 0.9, 1.4, 2.0), "speed": (0.8, 1.4, 2.0, 3.0)}
OVERLAP = {"min_iou": (0.01, 0.03, 0.1, 0.2, 0.3), "walk": (0.1, 0.3, 1.0, 3.0)}
IMAGE = {"position_gate": (0.7, 0.99), "reach": (1.0, 2.0, 4.0, 8.0), "walk": (0.1, 0.3)}
BIAS = {"bias": (-5.0, -3.0, -1.0, 1.0)}
COSTS = {"appearance": (2.0, 4.0, 8.0, 16.0), "neutral": (0.1, 0.2, 0.3, 0.5), **BIAS}
PACE = {"pace": (0.3, 0.6, 1.2)}
PLANE = {"reach": (2.0, 4.0, 8.0), "pace": (0.3, 1.0, 3.0), "size": (0.15, 0.3, 0.6), **BIAS}
ROWS: tuple[Row, ...] = (
    Row("baseline", "image", "none", _hungarian(True, False), LOOKS),
    Row("SORT", "none", "image", _sort("detected"), OVERLAP),
    Row("DeepSORT", "image", "image", _deepsort("detected"), {**LOOKS, **IMAGE}),
    Row("rectification", "upright", "none", _hungarian(True, False), LOOKS),
    Row("world", "none", "world", _hungarian(False, True), WORLD),
    Row("both", "upright", "world", _hungarian(True, True), {**LOOKS, **WORLD}),
    Row("both, standing crops", "standing", "world", _hungarian(True, True), {**LOOKS, **WORLD}),
    Row("SORT, filtered boxes", "none", "image", _sort("filtered"), OVERLAP, like="SORT"),
    Row("DeepSORT, filtered boxes", "image", "image", _deepsort("filtered"), {**LOOKS, **IMAGE}, like="DeepSORT"),
    Row("flow: baseline", "image", "none", _floor_flow(False), COSTS),
    Row("flow: SORT", "none", "image", _image_flow, PLANE),
    Row("flow: DeepSORT", "image", "image", _image_flow, {**PLANE, "appearance": (4.0, 8.0, 16.0)}),
    Row("flow: rectification", "upright", "none", _floor_flow(False), COSTS),
    Row("flow: world", "none", "world", _floor_flow(True), {**PACE, "noise": (0.15, 0.3, 0.6), **BIAS}),
    Row("flow: both", "upright", "world", _floor_flow(True), {**PACE, **COSTS}),
)  # fmt: skip


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


def run_row(row: Row, observed: Observed, choice: Choice, least_score: float) -> list[FloorTrack]:
    """The tracks of a sequence in the seconds that have a truth."""
    tracks = row.track(observed.described(row.crops, least_score), float(observed.rate), choice)
    return each_second(tracks, observed.rate)


def pair_of(name: str, observed: Observed, tracks: Sequence[FloorTrack], where: Any = None) -> SequencePair:
    """Truth and tracks of a sequence; ``where`` keeps the boxes ``(N, 4)`` for which it is True."""
    truth, plain = observed.truth, [t.track for t in tracks]
    if where is not None:
        truth = restricted(truth, np.flatnonzero(where(truth.boxes)))
        kept = [(t, where(t.boxes)) for t in plain]
        plain = [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t, k in kept if k.any()]
    return SequencePair(name, truth, plain, len(observed.found) // observed.rate)


def score(pairs: Sequence[SequencePair]) -> PeopleScores:
    """Scores over all sequences together."""
    return evaluate_sequences(pairs).combined


def select(row: Row, validation: Sequence[Observed], least_score: float) -> tuple[Choice, float]:
    """The choice of the best MOTA over the validation sequences, and that MOTA."""
    best: tuple[Choice, float] | None = None
    for choice in row.choices():
        pairs = [pair_of(str(k), o, run_row(row, o, choice, least_score)) for k, o in enumerate(validation)]
        mota = score(pairs).mota
        if best is None or mota > best[1]:
            best = choice, mota
    assert best is not None
    return best


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
