"""Thesis chapter 4 on generated rooms: Tables 4.3, 4.4 and 4.5, Figures 4.4 and 4.5 (`omnidirectional`).

Rows are ways to track that differ in what they match by. Every row gets the same detections, and is scored on the boxes
of those that it puts into tracks. Its settings have the best MOTA on validation rooms, which are not in the tables; the
lowest score of a detection is chosen there too, once for all rows. Pictures, observations, settings and tracks are kept
in the store, in parts.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.store import Cached, Store
from benchmarks.papers.tables import Column, Name, Table, tabulated, with_interval
from tsuiseki.datamodules.scenes.clip import FrameTruth, ground_truth
from tsuiseki.datamodules.scenes.room_clip import CAMERAS, SIZES, Room, RoomClip, RoomSettings, RoomView
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.person_model import build_table
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import coverage
from tsuiseki.tracking.evaluation.multi import PeopleScores, SequencePair, evaluate_sequences
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import FloorMethod, link_on_floor
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, ceiling_detector
from tsuiseki.tracking.fisheye.view import CeilingView, Crops
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.sort import DeepSort, DeepSortSettings, Sort, SortSettings
from tsuiseki.tracking.report.overlay import Overlay, draw_label
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Frame, ImageArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.tracking.weights import shipped

ROOMS: tuple[Room, ...] = ("large", "small")
# Rooms that settings are chosen on, and seconds of each sequence at 15 frames a second.
VALIDATION_SEEDS, FAST_SECONDS = (900, 901), 10
# MOTA of Table 4.3 at 1 and 15 frames a second: large, small, large, small.
PAPER: dict[str, tuple[float, float, float, float]] = {
    "baseline": (8.4, 51.0, -3.5, 48.7),
    "SORT": (-10.5, 24.5, -1.4, 49.9),
    "DeepSORT": (-4.3, 30.9, 6.0, 52.3),
    "rectification": (10.2, 51.8, -3.4, 48.5),
    "world": (8.1, 53.1, -1.1, 49.7),
    "both": (11.7, 53.3, 6.6, 52.0),
}
LABELS = ("large 1 fps", "small 1 fps", "large 15 fps", "small 15 fps")
# Table 4.5, large and small room.
PAPER_STAGES = {"detect": (18.8, 19.9), "look up": (0.3, 0.4), "describe": (64.4, 46.5), "associate": (2.1, 1.0)}
Region = Callable[[FloatArray, FloatArray], BoolArray]
# Table 4.4: where people are in an image of 1280x960, by the middle of their upright boxes; the row, and against which;
# the thesis's gain; whether an angle to the nearest axis, radians, and a distance from the middle are in the region.
# The first two gains are printed as 0.011 and 0.031, which is shares: the whole gain of that row is 1.8 points.
REGIONS: Mapping[str, tuple[str, str, str, float, Region]] = {
    "aligned": ("aligned, at most 22.5° from the image's axes", "rectification", "baseline", 1.1,
                lambda angle, _: angle <= np.pi / 8),
    "oblique": ("oblique, the others", "rectification", "baseline", 3.1, lambda angle, _: angle > np.pi / 8),
    "centre": ("centre, at most 200 px from the image's middle", "world", "SORT", 17.703, lambda _, away: away <= 200),
    "rim": ("rim, 300 to 500 px from it", "world", "SORT", 1.757, lambda _, away: (away > 300) & (away <= 500)),
}  # fmt: skip
# Pixels of a picture of a switch, to each side.
SIDE = 320
# Id of the track on a labelled person, by frame and person.
Named = dict[tuple[int, int], int]
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

    def plan(self) -> RoomClip:
        """The room; its people walk alike at every rate."""
        frames, counts = self.seconds * RATE, PEOPLE[self.room]
        people = counts[self.seed % len(counts)]
        settings = RoomSettings(size=SIZES[self.room], frames=frames, frame_rate=float(RATE), people=people)
        return RoomClip(settings, 10_000 + self.seed, read_lens(self.calibration) if self.calibration else None)

    def pictures(self) -> Iterator[tuple[int, ImageArray, FrameTruth]]:
        """Frame number in the room, picture ``(H, W, 3)`` uint8 RGB as a camera's JPEG has it, and truth."""
        room = self.plan()
        view = RoomView(room, self.camera)
        for frame in range(0, self.seconds * RATE, RATE // self.rate):
            drawn, truth = room.draw_frame(view, frame)
            jpeg = cv2.imencode(".jpg", drawn[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), dtype=np.uint8)[..., ::-1]
            yield frame, np.ascontiguousarray(image), truth


@dataclass(frozen=True)
class Observed:
    """The observations of a sequence, and the truth of one frame in every second.

    Attributes:
        clip: the sequence.
        detections: of each frame, without features.
        features: by kind of crop, of each frame, in half precision.
        truth: its frames count seconds.
        seconds: of each stage, over all frames.
    """

    clip: CeilingClip
    detections: list[FloorDetections]
    features: dict[str, list[FloatArray]]
    truth: GroundTruth
    seconds: dict[str, float]

    def described(self, crops: str, least_score: float) -> list[FloorDetections]:
        """The detections from a score on, with the features of a kind of crop; ``none`` goes without."""
        result = []
        for frame, located in enumerate(self.detections):
            confident = located.detections.scores >= least_score
            selected = located.detections.select(confident)
            if crops != "none":
                wide = self.features[crops][frame][confident].astype(np.float64)
                selected = selected.with_features(wide / np.linalg.norm(wide, axis=1, keepdims=True).clip(1e-9))
            result.append(FloorDetections(selected, located.rotated[confident], located.places[confident]))
        return result


def observe(clip: CeilingClip, detector_file: Path, appearance_file: Path) -> Observed:
    """What the networks of two files make of the pictures of a sequence."""
    room = clip.plan()
    camera = room.cameras[clip.camera]
    assert isinstance(camera, OmnidirectionalCamera)
    appearance = Appearance(appearance_file, threads=1)
    table = build_table(camera, room.floor)
    views = {crops: CeilingView(table, appearance, crops) for crops in CROPS}
    detector = ceiling_detector(Detector(detector_file, LEAST_SCORE, threads=1), camera, "unrolled")
    times = StageTimes(dict.fromkeys(STAGES, 0.0), time.process_time)
    detections, truths = list[FloorDetections](), list[FrameTruth]()
    features: dict[str, list[FloatArray]] = {crops: [] for crops in CROPS}
    for frame, image, truth in clip.pictures():
        with times.measure("detect"):
            detected = detector.detect([image])[0]
        located = views["upright"].locate(detected, times)
        for crops, view in views.items():
            described = view.describe(image, located, times if crops == "upright" else None).detections.features
            features[crops].append((np.empty((0, 128)) if described is None else described).astype(np.float16))
        plain = Detections(located.detections.boxes, detected.scores)
        detections.append(FloorDetections(plain, located.rotated, located.places))
        truths += [truth] if frame % RATE == 0 else []
    return Observed(clip, detections, features, ground_truth(truths), times.seconds)


# Seconds that all rows keep a track without a detection, and that a new one needs detections in a row.
PATIENCE, CONFIRM = 3.0, 0.2
# The largest distance 1 - IoU of DeepSORT's second stage.
ANY_OVERLAP = 0.99
# The largest cosine distance of a match by place, of 2, 1, 0.8, 0.65 and 0.5 the one of the best MOTA on the validation
# rooms with the other settings of both parts.
PLACE_GATE = 0.5
SHIPPED = FisheyeSettings()
Choice = dict[str, float]
Frames = Sequence[FloorDetections]


class RoomRow(NamedTuple):
    """One way to track.

    Attributes:
        crops: what the appearance comes from: ``image``, ``upright`` or ``none``.
        track: detections of a sequence, its rate and a choice of settings to tracks.
        grid: what the settings are chosen from.
        least_score: of its detections, where it is not the common one.
    """

    crops: str
    track: Callable[[Frames, float, Choice], list[Track]]
    grid: Mapping[str, Sequence[float]]
    least_score: float | None = None


def choices_of(row: RoomRow) -> list[Choice]:
    """Every combination of the grid."""
    return [dict(zip(row.grid, values, strict=True)) for values in itertools.product(*row.grid.values())]


def _hungarian(
    by_appearance: bool, by_place: bool, detections: Frames, rate: float, choice: Choice, **fixed: float
) -> list[Track]:
    # As in the thesis, the second stage asks for the place alone, unless a row says otherwise.
    options = {"start_score": 0.0, "place_feature_gate": 2.0, **choice, **fixed}
    settings = FisheyeSettings(by_appearance, by_place, confirm=CONFIRM, max_age=PATIENCE, **options)
    return _command("hungarian", detections, rate, {}, settings)


def _command(
    method: FloorMethod, detections: Frames, rate: float, _: Choice, settings: FisheyeSettings = SHIPPED
) -> list[Track]:
    return [person.track for person in link_on_floor(detections, rate, method, settings, StageTimes())]


S = TypeVar("S", SortSettings, DeepSortSettings)


def _in_frames(settings: S, rate: float, choice: Choice) -> S:
    """Settings whose times and motion are those of the choice at this frame rate."""
    return replace(
        settings,
        min_hits=max(1, round(CONFIRM * rate)),
        max_age=round(PATIENCE * rate),
        start_score=choice.get("start_score", 0.0),
        boxes="detected",
        motion=_motion(rate, choice["walk"]),
    )


def _motion(rate: float, walk: float) -> BoxMotion:
    """A Kalman filter of people who change their velocity by ``walk`` heights a second within a second."""
    return BoxMotion(acceleration=walk / rate**1.5, start_velocity=walk / rate)


def _sort(detections: Frames, rate: float, choice: Choice) -> list[Track]:
    settings = _in_frames(SortSettings(min_iou=choice["min_iou"]), rate, choice)
    return run_tracker((located.detections for located in detections), Sort(settings))


def _deepsort(detections: Frames, rate: float, choice: Choice) -> list[Track]:
    growth = choice["growth"] / rate
    settings = DeepSortSettings(
        feature_gate=choice["feature_gate"],
        position_gate=ANY_OVERLAP,
        reach=choice["reach"] + growth,
        reach_growth=growth,
        memory=0.7,
    )
    return run_tracker((located.detections for located in detections), DeepSort(_in_frames(settings, rate, choice)))


# Chosen values are meant to lie within these. A cosine distance of 1 is as good as no gate, an overlap of .01 as any.
# Heights and metres are of the image and of the floor; what grows does so in a second.
GATES = {"feature_gate": (0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0)}
WORLD = {"reach": (0.25, 0.5, 0.9, 1.4, 2.0, 2.8), "speed": (0.4, 0.8, 1.4, 2.0, 3.0)}
OVERLAP = {"min_iou": (0.01, 0.03, 0.1, 0.2, 0.3), "walk": (0.03, 0.1, 0.3, 1.0, 3.0)}
IMAGE = {"reach": (0.25, 0.5, 1.0, 2.0), "growth": (0.5, 1.0, 2.0, 4.0), "walk": (0.03, 0.1)}
STARTS = (0.0, 0.45, 0.5, 0.55, 0.6, 0.7)
GATED = "both, appearance in both stages"
# What `track fisheye` takes of its detector.
SHIPPED_SCORE = 0.3
ROWS = {
    "baseline": RoomRow("image", partial(_hungarian, True, False), GATES),
    "SORT": RoomRow("none", _sort, OVERLAP),
    "DeepSORT": RoomRow("image", _deepsort, {**GATES, **IMAGE}),
    "rectification": RoomRow("upright", partial(_hungarian, True, False), GATES),
    "world": RoomRow("none", partial(_hungarian, False, True), WORLD),
    "both": RoomRow("upright", partial(_hungarian, True, True), {**GATES, **WORLD}),
    GATED: RoomRow("upright", partial(_hungarian, True, True, place_feature_gate=PLACE_GATE), {**GATES, **WORLD}),
    # As the command does it, whatever validation says.
    "track fisheye": RoomRow("upright", partial(_command, "hungarian"), {}, least_score=SHIPPED_SCORE),
    "track fisheye, flow": RoomRow("upright", partial(_command, "flow"), {}, least_score=SHIPPED_SCORE),
}  # fmt: skip


def each_second(tracks: Sequence[Track], rate: int) -> list[Track]:
    """Tracks in the frames that have a truth, counted in seconds."""
    with_truth = [(t, t.frames % rate == 0) for t in tracks]
    return [Track(t.id, t.frames[k] // rate, t.boxes[k], t.scores[k]) for t, k in with_truth if k.any()]


def tracked(name: str, choice: Choice, least: float, observed: Observed) -> list[Track]:
    """The tracks of a row by its name, choice and lowest score in a sequence, in the seconds that have a truth."""
    how = ROWS[name]
    detections = observed.described(how.crops, least if how.least_score is None else how.least_score)
    return each_second(how.track(detections, float(observed.clip.rate), choice), observed.clip.rate)


def pair_of(name: str, observed: Observed, tracks: Sequence[Track], where: Any = None) -> SequencePair:
    """Truth and tracks of a sequence; ``where`` keeps the boxes ``(N, 4)`` for which it is True."""
    truth, plain = observed.truth, list(tracks)
    if where is not None:
        truth = truth.select(where(truth.boxes))
        inside = [(t, where(t.boxes)) for t in plain]
        plain = [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t, k in inside if k.any()]
    return SequencePair(name, truth, plain, len(observed.detections) // observed.clip.rate)


LEAST_SCORES = (0.2, 0.3, 0.4, 0.5, 0.6)


class Graded(NamedTuple):
    """Settings of a row by name, and its MOTA, up to 1, and IDF1, in [0, 1], on the validation rooms with them."""

    choice: Choice
    mota: float
    idf1: float


def grades(name: str, validation: Sequence[Observed], least: float, choices: Sequence[Choice]) -> list[Graded]:
    """The scores of some settings of the row ``name`` on the validation sequences."""
    graded = []
    for choice in choices:
        pairs = [pair_of(str(k), o, tracked(name, choice, least, o)) for k, o in enumerate(validation)]
        scores = evaluate_sequences(pairs).combined
        graded.append(Graded(choice, scores.mota, scores.idf1))
    return graded


def best_choice(row: RoomRow, graded: Callable[[list[Choice]], list[Graded]]) -> Graded:
    """The choice of the row's grid of the best MOTA, and the score to start a track before and after the rest."""

    def best(choices: list[Choice]) -> Graded:
        return max(graded(choices), key=lambda grade: grade.mota)

    grid = choices_of(row)
    if not row.grid:
        return best(grid)
    start = best(_starts(grid)).choice["start_score"]
    return best(_starts([best([{**choice, "start_score": start} for choice in grid]).choice]))


def _starts(grid: Sequence[Choice]) -> list[Choice]:
    """The middle of a grid with each score to start a track."""
    return [{**grid[len(grid) // 2], "start_score": start} for start in STARTS]


def lowest_score(store: Store, names: Sequence[str], validation: Sequence[Observed]) -> float:
    """The lowest score of a detection with which some rows have the best mean MOTA on the validation sequences.

    Each row has the middle of its grid, so that the score suits none better than the others, and the score to start a
    track that is best then: weak detections help a row only where they start nothing.
    """

    def mean_mota(least: float) -> float:
        choices = {name: _starts(choices_of(ROWS[name])) for name in names}
        graded = [store.recall(grades, name, validation, least, starts) for name, starts in choices.items()]
        return float(np.mean([max(grade.mota for grade in grades_of_row) for grades_of_row in graded]))

    return max(LEAST_SCORES, key=mean_mota)


class FloorResults(NamedTuple):
    """The test sequences of one room and rate, seed by seed all cameras, and their tracks by row."""

    observed: list[Observed]
    tracks: dict[str, list[list[Track]]]


def reproduce(
    *,
    store: Cached,
    seeds: PositiveInt = 6,
    first_seed: NonNegativeInt = 0,
    seconds: PositiveInt = 60,
    fast_seeds: NonNegativeInt = 3,
    calibration: Path | None = None,
) -> Outcome:
    """People under ceiling fisheye cameras, at 1 and 15 frames a second: what upright crops and floor places bring.

    DIR gets results.json, tables.md, prevented.jpg and remaining.jpg like Figs. 4.4 and 4.5.

    Args:
        store: of what was computed.
        seeds: rooms of each size, two cameras each.
        first_seed: of these rooms.
        seconds: of each sequence at 1 frame a second.
        fast_seeds: of these rooms, of which 10 seconds are tracked at 15 frames a second, too; 0 leaves them out.
        calibration: lens of the cameras, any that tsuiseki calibrate convert reads; by default an equidistant one.

    Raises:
        RequestError: a room that settings are chosen on, or a file that cannot be read.
    """
    tested = range(first_seed, first_seed + seeds)
    if set(tested) & set(VALIDATION_SEEDS):
        seeds_named = " and ".join(map(str, VALIDATION_SEEDS))
        raise RequestError(f"`first_seed`: expected rooms without {seeds_named}, on which settings are chosen")
    models = shipped(DETECTORS["unrolled"]), shipped("appearance_people")
    plans = [(room, seed, seconds, 1) for room in ROOMS for seed in (*VALIDATION_SEEDS, *tested)]
    plans += [(room, seed, FAST_SECONDS, 15) for seed in tested[:fast_seeds] for room in ROOMS]
    jobs = [CeilingClip(*plan, camera, calibration) for plan in plans for camera in range(CAMERAS)]
    observed = store.each(observe, [(clip, *models) for clip in jobs], "clips")
    chosen, least = _chosen(store, [entry for entry in observed if entry.clip.seed in VALIDATION_SEEDS])
    rows = {name: partial(tracked, name, entry.choice, least) for name, entry in chosen.items()}
    results = list[FloorResults]()
    for kind in itertools.product((1, 15), ROOMS):
        sequences = [o for o in observed if o.clip.seed in tested and (o.clip.rate, o.clip.room) == kind]
        results += [FloorResults(sequences, store.study(rows, sequences, "tracking"))] if sequences else []
    values: dict[str, Any] = {
        "rooms": {"seeds": list(tested), "seconds": seconds, "fast_seeds": fast_seeds, "fast_seconds": FAST_SECONDS},
        "chosen": {"least_score": least, "rows": {name: part._asdict() for name, part in chosen.items()}},
        "rows": {label: row_values(part) for label, part in zip(LABELS, results, strict=False)},
        "where": where_parts_help(results[0]),
        "milliseconds": {
            room: stage_milliseconds(part, chosen["both"], least) for room, part in zip(ROOMS, results, strict=False)
        },
    }
    note = f"all settings have the best MOTA on rooms of seeds 900 and 901; lowest score of a detection {least:g}"
    return Outcome(values, tables(values), files=switch_pictures(results[0]), notes=[note])


def _chosen(store: Store, observed: Sequence[Observed]) -> tuple[dict[str, Graded], float]:
    """The settings of each row and the lowest score of a detection, chosen on rooms that are not scored."""
    validation = sorted(observed, key=lambda sequence: sequence.clip.seed)
    least, chosen = lowest_score(store, list(PAPER), validation), dict[str, Graded]()
    for name, row in progress(ROWS.items(), "settings", len(ROWS)):
        grade: Any = partial(store.recall, grades, name, validation, least)  # type: ignore[call-arg]
        chosen[name] = chosen["both"] if name == GATED else best_choice(row, grade)
    return chosen, least


def _scores(results: FloorResults, name: str, where: Any = None) -> list[PeopleScores]:
    """Scores of a row for each seed; ``where`` keeps some boxes."""
    sequences = zip(results.observed, results.tracks[name], strict=True)
    pairs = [pair_of(str(k), observed, tracks, where) for k, (observed, tracks) in enumerate(sequences)]
    return [evaluate_sequences(pairs[first : first + CAMERAS]).combined for first in range(0, len(pairs), CAMERAS)]


def row_values(results: FloorResults) -> dict[str, list[dict[str, float]]]:
    """The scores of each row, one a seed; shares in percent."""
    shares = ("mota", "idf1", "hota", "recall", "precision")
    return {
        name: [
            {k: 100 * getattr(s, k) for k in shares} | {"id_switches": s.id_switches} for s in _scores(results, name)
        ]
        for name in results.tracks
    }


def where_parts_help(results: FloorResults) -> dict[str, Any]:
    """Table 4.4: gains of each part alone, in points of MOTA, by direction and distance from the image's middle."""

    def inside(within: Region, boxes: FloatArray) -> BoolArray:
        x, y = ((boxes[:, :2] + boxes[:, 2:]) / 2 - [640, 480]).T
        return within(np.abs((np.arctan2(y, x) + np.pi / 4) % (np.pi / 2) - np.pi / 4), np.hypot(x, y))

    gains = {}
    for label, (_, ours, theirs, _, within) in REGIONS.items():
        pairs = zip(*(_scores(results, row, partial(inside, within)) for row in (ours, theirs)), strict=True)
        gains[label] = {"row": ours, "against": theirs, "by_seed": [100 * (a.mota - b.mota) for a, b in pairs]}
    return gains


def stage_milliseconds(results: FloorResults, chosen: Graded, least: float) -> dict[str, float]:
    """Milliseconds a frame of each stage in the first sequence, both parts with the chosen settings."""
    observed = results.observed[0]
    frames, begin = len(observed.detections), time.process_time()
    tracked("both", chosen.choice, least, observed)
    seconds = {**observed.seconds, "associate": time.process_time() - begin}
    return {
        **{s: 1000 * spent / frames for s, spent in seconds.items()},
        "people": sum(map(len, observed.detections)) / frames,
    }


def tables(values: Mapping[str, Any]) -> list[Table]:
    """Tables 4.3, 4.4 and 4.5 beside the thesis's."""
    result = []
    for label, rows in values["rows"].items():
        paper: dict[Name, float] = {name: line[LABELS.index(label)] for name, line in PAPER.items()}
        people = (
            Column("MOTA", "mota", ".1f", show=with_interval, paper=paper, gain=with_interval),
            Column("IDF1", "idf1", ".1f", gain=with_interval),
            Column("HOTA", "hota", ".1f"),
            Column("switches", "id_switches", ".0f"),
        )
        result.append(tabulated(rows, people, ("row",), f"Table 4.3: {label}", "both"))
    lines = [
        [where, ours, theirs, f"{gain:g}", with_interval(np.array(values["where"][label]["by_seed"]), ".1f")]
        for label, (where, ours, theirs, gain, _) in REGIONS.items()
        if label in values["where"]
    ]
    columns = ("people", "row", "against", "thesis", "here")
    result.append(Table("Table 4.4: points of MOTA gained, large room, 1 fps", columns, lines))
    stages = values["milliseconds"]
    lines = [
        [name, *map(str, PAPER_STAGES.get(name, ("", ""))), *(f"{stages[room][name]:.2f}" for room in stages)]
        for name in (*STAGES, "associate")
    ]
    columns = ("stage", "large, thesis", "small, thesis", "large", "small")
    return [*result, Table("Table 4.5: milliseconds of the processor a frame", columns, lines)]


def switch_pictures(results: FloorResults) -> dict[str, bytes]:
    """``prevented.jpg``: DeepSORT above, both parts below; ``remaining.jpg`` likewise. Missing where there is none."""
    pictures = dict[str, bytes]()
    for observed, *rows in zip(results.observed, results.tracks["DeepSORT"], results.tracks["both"], strict=True):
        theirs, ours = (named(observed, tracks) for tracks in rows)
        spots = {"prevented.jpg": first_switch(theirs, ours), "remaining.jpg": first_switch(ours, None)}
        for name, spot in spots.items():
            if spot is not None and name not in pictures:
                pictures[name] = cv2.imencode(".jpg", _strip(observed, spot, rows)[:, :, ::-1])[1].tobytes()
    return pictures


def named(observed: Observed, tracks: Sequence[Track]) -> Named:
    """The id that tracks give to each labelled person, by frame and person; no box stands for two."""
    return {
        (frame, person.id): number
        for person in coverage(observed.truth, tracks)
        for frame, number in zip(person.frames.tolist(), person.track_ids.tolist(), strict=True)
        if number
    }


def first_switch(switching: Named, keeping: Named | None) -> tuple[int, int] | None:
    """Frame and person of a switch between two frames in a row, which ``keeping`` does not have."""
    for frame, person in sorted(switching):
        ids = [switching.get((at, person)) for at in range(frame - 2, frame + 1)]
        if None in ids or ids[1] == ids[2]:
            continue
        ids_kept = None if keeping is None else {keeping.get((at, person)) for at in range(frame - 2, frame + 1)}
        if ids_kept is None or (len(ids_kept) == 1 and None not in ids_kept):
            return frame, person
    return None


def _strip(observed: Observed, spot: tuple[int, int], rows: Sequence[Sequence[Track]]) -> ImageArray:
    """Three frames up to a switch, cut out around the person, a row for the tracks of each method."""
    frame, person = spot
    room, truth, lines = observed.clip.plan(), observed.truth, list[ImageArray]()
    for tracks in rows:
        overlay, cells = Overlay(tracks, 1.0, trail_seconds=0.0), list[ImageArray]()
        for at in range(frame - 2, frame + 1):
            image = room.draw_frame(RoomView(room, observed.clip.camera), at * RATE)[0]
            drawn = overlay.draw(Frame(at, float(at), image))
            box = truth.boxes[(truth.frames == at) & (truth.ids == person)][0]
            centre = np.round((box[:2] + box[2:]) / 2).astype(int)
            reach = int(0.6 * (box[2:] - box[:2]).max()) + 8
            cv2.circle(drawn, tuple(centre.tolist()), reach, (255, 255, 255), 2, cv2.LINE_AA)
            low = np.clip(centre - SIDE // 2, 0, [drawn.shape[1] - SIDE, drawn.shape[0] - SIDE])
            part = drawn[low[1] : low[1] + SIDE, low[0] : low[0] + SIDE].copy()
            draw_label(part, f"#{at + 1}", (4, SIDE - 4), (60, 60, 60))
            cells.append(part)
        lines.append(np.concatenate(cells, axis=1))
    return np.concatenate(lines, axis=0)
