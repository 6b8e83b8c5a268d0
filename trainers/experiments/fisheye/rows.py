"""The rows of Table 4.3: ways to track that differ in what they match by, their settings selected on other rooms."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.association.pairwise_flow import GateSettings, HandSetCost, PairwiseCosts, pairwise_tracks
from tsuiseki.tracking.evaluation.multi import PeopleScores, SequencePair, evaluate_sequences
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.fisheye.settings import DEFAULT_FLOW, FisheyeSettings, FloorFlowSettings
from tsuiseki.tracking.fisheye.tracker import FisheyeTracker, flow_on_floor
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.people.tracker import run_tracker
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack
from tsuiseki.trainers.experiments.fisheye.observations import Observed, restricted

# Seconds that all rows keep a track without a detection, and that a new one needs detections in a row.
PATIENCE, CONFIRM = 3.0, 0.2
# Scale of the difference of two detected centres, in heights, for the flow over boxes in the image.
IMAGE_NOISE = 0.1
# Heights that such a box may move besides those of the time that has passed.
IMAGE_REACH = 0.5
# The largest distance 1 - IoU of DeepSORT's second stage.
ANY_OVERLAP = 0.99
# The largest cosine distance of a match by place, of 2, 1, 0.8, 0.65 and 0.5 the one of the best MOTA on the validation
# rooms with the other settings of both parts.
PLACE_GATE = 0.5
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
        starts: scores from which a detection may start a track, chosen from before the grid and after; none for the
            flow, whose costs weigh scores.
        least_score: of its detections, where it is not the common one.
    """

    name: str
    crops: str
    place: str
    track: Tracking
    grid: Mapping[str, Sequence[float]]
    like: str = ""
    starts: Sequence[float] = ()
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


def _shipped(settings: FisheyeSettings) -> Tracking:
    """As ``tsuiseki track fisheye --method hungarian`` does it, whatever validation says."""

    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        del choice
        return _online(found, rate, settings)

    return track


def _shipped_flow(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
    """As ``tsuiseki track fisheye --method flow`` does it."""
    del choice
    return flow_on_floor(found, rate)


def _lifecycle(rate: float, boxes: Boxes, choice: Choice) -> LifecycleSettings:
    hits, age = max(1, round(CONFIRM * rate)), round(PATIENCE * rate)
    return LifecycleSettings(hits, age, choice.get("start_score", 0.0), boxes)


def _motion(rate: float, walk: float) -> BoxMotion:
    """A Kalman filter of people who change their velocity by ``walk`` heights a second within a second."""
    return BoxMotion(acceleration=walk / rate**1.5, start_velocity=walk / rate)


def _sort(boxes: Boxes) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        settings = SortSettings(choice["min_iou"], _lifecycle(rate, boxes, choice), _motion(rate, choice["walk"]))
        return _with_places(run_tracker((f.detections for f in found), Sort(settings)), found)

    return track


def _deepsort(boxes: Boxes) -> Tracking:
    def track(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
        growth = choice["growth"] / rate
        settings = DeepSortSettings(
            feature_gate=choice["feature_gate"],
            position_gate=ANY_OVERLAP,
            reach=choice["reach"] + growth,
            reach_growth=growth,
            memory=0.7,
            lifecycle=_lifecycle(rate, boxes, choice),
            motion=_motion(rate, choice["walk"]),
        )
        return _with_places(run_tracker((f.detections for f in found), DeepSort(settings)), found)

    return track


def _image_flow(found: Sequence[FloorDetections], rate: float, choice: Choice) -> list[FloorTrack]:
    growth = choice["growth"] / rate
    gate = GateSettings(round(PATIENCE * rate), IMAGE_REACH + growth, growth, 3.0)
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


# Chosen values are meant to lie within these. A cosine distance of 1 is as good as no gate, an overlap of .01 as any.
# Heights and metres are of the image and of the floor; what grows does so in a second.
LOOKS = {"feature_gate": (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)}
WORLD = {"reach": (0.25, 0.5, 0.9, 1.4, 2.0, 2.8), "speed": (0.4, 0.8, 1.4, 2.0, 3.0)}
OVERLAP = {"min_iou": (0.01, 0.03, 0.1, 0.2, 0.3), "walk": (0.03, 0.1, 0.3, 1.0, 3.0)}
IMAGE = {"reach": (0.25, 0.5, 1.0, 2.0), "growth": (0.5, 1.0, 2.0, 4.0), "walk": (0.03, 0.1)}
BIAS = (-3.0, -1.0, 1.0, 3.0)
COSTS = {"appearance": (1.0, 2.0, 4.0, 8.0, 16.0), "neutral": (0.05, 0.1, 0.3, 0.5, 0.7), "bias": BIAS}
PACE = {"pace": (0.6, 1.2, 2.4)}
PLANE = {"growth": (4.0, 8.0, 16.0), "pace": (0.3, 1.0, 3.0), "size": (0.3, 0.6, 1.2), "bias": (-3.0, -1.0, 1.0)}
STARTS = (0.0, 0.45, 0.5, 0.55, 0.6, 0.7)
GATED, UNGATED = "both, appearance in both stages", "track fisheye, place alone in its second stage"
# What `track fisheye` takes of its detector.
SHIPPED_SCORE = 0.3
ROWS: tuple[Row, ...] = (
    Row("baseline", "image", "none", _hungarian(True, False), LOOKS, starts=STARTS),
    Row("SORT", "none", "image", _sort("detected"), OVERLAP, starts=STARTS),
    Row("DeepSORT", "image", "image", _deepsort("detected"), {**LOOKS, **IMAGE}, starts=STARTS),
    Row("rectification", "upright", "none", _hungarian(True, False), LOOKS, starts=STARTS),
    Row("world", "none", "world", _hungarian(False, True), WORLD, starts=STARTS),
    Row("both", "upright", "world", _hungarian(True, True), {**LOOKS, **WORLD}, starts=STARTS),
    Row("both, standing crops", "standing", "world", _hungarian(True, True), {**LOOKS, **WORLD}, starts=STARTS),
    Row(
        GATED, "upright", "world", _hungarian(True, True, place_feature_gate=PLACE_GATE),
        {**LOOKS, **WORLD}, like="both",
    ),
    Row("SORT, filtered boxes", "none", "image", _sort("filtered"), OVERLAP, like="SORT"),
    Row("DeepSORT, filtered boxes", "image", "image", _deepsort("filtered"), {**LOOKS, **IMAGE}, like="DeepSORT"),
    Row("flow: baseline", "image", "none", _floor_flow(False), COSTS),
    Row("flow: SORT", "none", "image", _image_flow, PLANE),
    Row("flow: DeepSORT", "image", "image", _image_flow, {**PLANE, "appearance": (2.0, 4.0, 8.0)}),
    Row("flow: rectification", "upright", "none", _floor_flow(False), COSTS),
    Row("flow: world", "none", "world", _floor_flow(True), {**PACE, "noise": (0.07, 0.15, 0.3), "bias": BIAS}),
    Row("flow: both", "upright", "world", _floor_flow(True), {**PACE, **COSTS}),
    Row("track fisheye", "upright", "world", _shipped(FisheyeSettings()), {}, least_score=SHIPPED_SCORE),
    Row(UNGATED, "upright", "world", _shipped(FisheyeSettings(place_feature_gate=2.0)), {}, least_score=SHIPPED_SCORE),
    Row("track fisheye, flow", "upright", "world", _shipped_flow, {}, least_score=SHIPPED_SCORE),
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
    least = least_score if row.least_score is None else row.least_score
    tracks = row.track(observed.described(row.crops, least), float(observed.rate), choice)
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
