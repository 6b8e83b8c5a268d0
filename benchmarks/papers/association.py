"""Methods of association on given detections, on six real data sets (`association`).

The ignore rules are those of `read_ground_truth`, by the columns of each ``gt.txt``: MOT17's distractors are neither
right nor wrong, boxes that MOT15 marks with 0 in column 7 do not count, and KITTI's files hold the class itself alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.peer_programs import LINKERS
from benchmarks.papers.peers import Peer, find_peer, skipped
from benchmarks.papers.store import Cached, Store
from benchmarks.papers.tables import Table
from tsuiseki.datamodules.scenes.people.walkers import Motion
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.association.smoothing import fill_gaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import owners_of
from tsuiseki.tracking.evaluation.multi import SequencePair, restrict
from tsuiseki.tracking.evaluation.paired_bootstrap import COUNTS, SCORES, paired_bootstrap, score_sums, scores_of
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth, write_detections
from tsuiseki.tracking.formats.mot_sequence import read_sequence, write_sequence_info
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.people.contract import shifted
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.types.labels import GroundTruth

SAMPLES = 2000


@dataclass(frozen=True)
class DataSet:
    """Sequences that are scored together.

    Attributes:
        key: its name as an option.
        title: its name in tables.
        folder: of its sequences, below the folder of all data.
        names: of its sequences; by default every folder there.
        frames: the frames that are tracked and scored, counted from 1; by default all.
        logits: scores are no probabilities but their logits.
        drawn: length and motion of a generated set, see `write_streets`; None for a real one.
    """

    key: str
    title: str
    folder: str
    names: tuple[str, ...] = ()
    frames: str | None = None
    logits: bool = False
    drawn: tuple[int, Motion] | None = None


STREETS = DataSet("streets", "generated streets", "streets", drawn=(120, "walk"))
DATA_SETS = (
    DataSet("mot17", "MOT17 val-half", "mot/mot17-val-half"),
    DataSet("mot15", "MOT15", "mot/mot15"),
    DataSet("kitti-pedestrians", "KITTI pedestrians", "mot/kitti/Pedestrian", logits=True),
    DataSet("kitti-cars", "KITTI cars", "mot/kitti/Car", logits=True),
    DataSet("pets", "PETS09-S2L1 301–400", "mot", ("PETS09-S2L1-first",), "301-400"),
    DataSet("tud", "TUD", "mot", ("TUD-Campus", "TUD-Stadtmitte")),
    STREETS,
    DataSet("dance", "generated dance", "dance", drawn=(100, "dance")),
    DataSet("sport", "generated sport", "sport", drawn=(100, "sport")),
)


@dataclass(frozen=True)
class GivenSequence:
    """A sequence with its detections, some frames of each second left out if wanted.

    Attributes:
        name: of the sequence.
        detections: det.txt.
        labels: gt.txt.
        length: number of frames before any is left out.
        frame_rate: of the sequence, frames a second.
        size: width and height of the image, pixels; 0 where unknown.
        frames: the frames that are tracked and scored, counted from 1; None is all.
        every: one frame in so many is kept.
        pictures: the sequence's folder, where it has images.
    """

    name: str
    detections: Path
    labels: Path
    length: int
    frame_rate: float
    size: tuple[int, int]
    frames: str | None = None
    every: int = 1
    pictures: Path | None = None

    @property
    def rate(self) -> float:
        """Frames a second that are kept."""
        return self.frame_rate / self.every

    @property
    def kept(self) -> range:
        """0-based frames of the sequence that are tracked."""
        wanted = parse_frames(self.frames).within(self.length)
        assert wanted.last is not None
        return range(wanted.first, wanted.last + 1, self.every)

    @property
    def filmed(self) -> dict[str, Any]:
        """Frame rate and size, None where unknown, as trackers take them."""
        return {"frame_rate": self.rate, "size": self.size if min(self.size) > 0 else None}

    def at(self, rate: float) -> GivenSequence:
        """The same at about ``rate`` frames a second: the nearest that leaving out frames evenly gives."""
        return replace(self, every=max(1, round(self.frame_rate / rate)))


def find_given(data: Path, one: DataSet) -> list[GivenSequence]:
    """The sequences of a data set, by name; none where its folder is not there.

    Raises:
        RequestError: a sequence has no labels or no detections.
    """
    found, home = list[GivenSequence](), data / one.folder
    for folder in filter(Path.is_dir, [home / name for name in one.names] or sorted(home.glob("*"))):
        known = read_sequence(folder)
        paths = known.detections_path, known.ground_truth_path
        if missing := [path.relative_to(folder) for path in paths if not path.is_file()]:
            raise RequestError(f"{folder}: expected {missing[0]} of a sequence with detections, found none")
        end = known.length or int(max(np.loadtxt(p, delimiter=",", usecols=0, ndmin=1).max() for p in paths))
        size, pictures = (known.width, known.height), folder if known.images else None
        found.append(GivenSequence(known.name, *paths, end, known.frame_rate, size, one.frames, pictures=pictures))
    return found


def find_sets(store: Store, data: Path, keys: Iterable[str]) -> dict[DataSet, list[GivenSequence]]:
    """The sequences of the data sets that are there, and of generated ones, from the store.

    Raises:
        RequestError: none of the real ones is, or a sequence has no labels or no detections.
    """
    asked = [one for key in keys for one in DATA_SETS if one.key == key]
    found = {one: find_given(data, one) for one in asked if one.drawn is None}
    if found and not any(found.values()):
        raise RequestError(f"`data`: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    for one in asked:
        if one.drawn is not None:
            found[one] = find_given(store.made(one.folder, write_streets, 10, *one.drawn).parent, one)
    return {one: sequences for one, sequences in found.items() if sequences}


def given_detections(given: GivenSequence) -> list[Detections]:
    """The detections of the frames that are kept; boxes without an area are left out."""
    every = read_detections(given.detections, given.length)
    return [every[frame] for frame in given.kept]


def given_labels(given: GivenSequence) -> GroundTruth:
    """The labels of the frames that are kept, numbered from 0 as the tracks are."""
    (truth,) = read_truths(given.labels, parse_frames(given.frames).within(given.length))
    moved = truth.labels.frames - given.kept.start
    return replace(truth.labels, frames=moved // given.every).select((moved >= 0) & (moved % given.every == 0))


def as_written(tracks: Sequence[Track]) -> list[Track]:
    """The tracks as a file has them: by id, boxes to hundredths of a pixel."""
    ordered = sorted(tracks, key=lambda track: track.id)
    return [replace(one, boxes=np.round(one.boxes, 2), scores=np.round(one.scores, 4)) for one in ordered]


def flow_over(given: GivenSequence, **more: Any) -> FlowTracker:
    """The flow, with ``more`` arguments, after all detections of a sequence."""
    tracker = FlowTracker(**more, **given.filmed)
    for detections in given_detections(given):
        tracker.update(detections)
    return tracker


def tracks_over(
    detections: Sequence[Detections], rate: float, size: tuple[int, int], method: PeopleMethod = "flow", **more: Any
) -> list[Track]:
    """The tracks of `track_people` over the detections of each frame, without pictures."""
    with tempfile.TemporaryDirectory() as folder:
        write_sequence_info(Path(folder), "given", rate, len(detections), *size)
        return list(track_people(folder, method, detections=detections, **more))


def track_sums(given: GivenSequence, tracks: Sequence[Track]) -> FloatArray:
    """``(83,)`` sums of the scores of tracks, see `score_sums`."""
    count = len(given.kept)
    inside = restrict(list(tracks), FrameRange(0, count - 1))
    return score_sums(SequencePair(given.name, given_labels(given), inside, count))


def sums_of(store: Store, compute: Callable[..., FloatArray], jobs: Sequence[tuple[Any, ...]]) -> FloatArray:
    """``(S, 83)`` sums that ``compute`` gives for the arguments of S sequences."""
    return np.array([store.recall(compute, *job) for job in jobs])


def right_sums(given: GivenSequence, seconds: float, bridged: bool) -> FloatArray:
    """Sums of the right links over the detections across gaps of up to so many seconds, filled where ``bridged``."""
    right = right_links(given_detections(given), given_labels(given), max(1.0, seconds * given.rate))
    return track_sums(given, [fill_gaps(track, given.length) for track in right] if bridged else right)


def right_links(detections: Sequence[Detections], truth: GroundTruth, longest: float = np.inf) -> list[Track]:
    """The tracks that the right links over the detections give.

    A box belongs to the label it overlaps by at least 0.5, one to one; boxes on ignored labels and false positives are
    left out. The right links join the boxes of one identity in the order of their frames.

    Args:
        detections: of each frame.
        truth: the labels, their frames counted as those of the detections.
        longest: most frames from one detection to the next of the same track; 1 allows no gap.
    """
    every = rows_of(detections, 0, 0)
    owners, frames = owners_of(every.frames, every.boxes, truth), every.frames
    tracks: list[Track] = []
    for identity in np.unique(owners[owners >= 0]):
        mine = np.flatnonzero(owners == identity)
        for part in np.split(mine, np.flatnonzero(np.diff(frames[mine]) > longest) + 1):
            tracks.append(Track(len(tracks) + 1, frames[part], every.boxes[part], every.scores[part]))
    return tracks


def combined_scores(sums: FloatArray) -> dict[str, float]:
    """The scores of all sequences together, from ``(S, 83)`` sums."""
    return {name: float(value) for name, value in scores_of(sums.sum(axis=0)).items()}


def score_table(title: str, rows: Mapping[str, FloatArray], base: str) -> Table:
    """Scores of all sequences together, and how far each row is above one of them, with 95 % intervals over sequences.

    Args:
        title: of the data set.
        rows: ``(S, 83)`` sums of each sequence, see `score_sums`.
        base: name of the row that all others are compared with.
    """
    lines = []
    for name, sums in rows.items():
        found = combined_scores(sums)
        cells = [*(f"{found[key]:.3f}" for key in SCORES), *(str(int(found[key])) for key in COUNTS[:3])]
        lines.append([name, *cells, *([""] * 4 if base == name else _gains(sums, rows[base]))])
    above = [f"{what} − {base}" for what in ("HOTA", "MOTA", "IDF1", "IDSW")]
    return Table("", (title, "HOTA", "DetA", "AssA", "MOTA", "IDF1", "IDSW", "FP", "FN", *above), lines)


def _gains(ours: FloatArray, theirs: FloatArray) -> list[str]:
    """Differences of HOTA, MOTA and IDF1, and of the switches as a share of theirs."""
    found = paired_bootstrap(ours, theirs, SAMPLES, np.random.default_rng(0))
    one, other = (np.asarray(scores_of(sums)["id_switches"]) for sums in (ours, theirs))
    drawn = np.random.default_rng(0).multinomial(len(one), np.full(len(one), 1 / len(one)), SAMPLES)
    low, high = np.quantile(drawn @ one / np.maximum(drawn @ other, 1) - 1, (0.025, 0.975))
    gaps = [(found[key].difference, found[key].low, found[key].high, "+.3f") for key in ("hota", "mota", "idf1")]
    gaps.append((one.sum() / max(other.sum(), 1) - 1, low, high, "+.0%"))
    cells = [f"{gap:{form}} [{low:{form}}, {high:{form}}]" for gap, low, high, form in gaps]
    # Samples of one sequence say nothing.
    return cells if len(one) > 1 else [cell.partition(" ")[0] for cell in cells]


FAULTS = {
    "jitter": (0.02, 0.045),
    "steady": (0.7, 0.9),
    "missed": (0.03, 0.35),
    "hidden": (0.5, 0.95),
    "false_alarms": (0.2, 4.0),
    "persistence": (0.5, 0.9),
    "doubled": (0.0, 0.1),
}
"""Of the detectors of streets: within what the detections of MOT17, MOT15, KITTI, PETS and TUD are off their labels."""


def write_streets(folder: Path, clips: int, frames: int, motion: Motion = "walk") -> None:
    """Clips without pictures, ``street-N``: labels, and det.txt of detectors from good to poor, at many rates.

    Args:
        folder: is made.
        clips: how many.
        frames: of each.
        motion: of people.
    """
    for number in range(clips):
        rng = np.random.default_rng([number, 1])
        rate, people, occluders = float(rng.choice([7, 10, 14, 25, 30])), rng.integers(8, 22), rng.integers(3, 11)
        settings = StreetSettings(
            320, 240, frames, rate, people=int(people), occluders=int(occluders), person_height=(16.0, 90.0),
            samples=1, motion=motion,
        )  # fmt: skip
        home = folder / f"street-{number:02d}"
        clip = StreetClip(settings, number)
        clip.write_truth(home, home.name, [truth for _, truth in clip.frames()])
        truth = read_ground_truth(home / "gt" / "gt.txt")
        faults = DetectorFaults(**{name: float(rng.uniform(*ends)) for name, ends in FAULTS.items()})
        detections = simulate_detections(rng, truth, frames, settings.width, settings.height, faults)
        (home / "det").mkdir(parents=True)
        write_detections(home / "det" / "det.txt", detections)


FLOW, UNFILLED, BOXES_ALONE = "flow", "flow, nothing filled in", "flow, boxes alone"
METHODS: tuple[PeopleMethod, ...] = ("sort", "bytetrack", "ocsort", "flow")
RATES = (30.0, 15.0, 10.0, 5.0)
SetKey: TypeAlias = Literal["mot17", "mot15", "kitti-pedestrians", "kitti-cars", "pets", "tud", "dance", "sport"]
SETS: tuple[SetKey, ...] = ("mot17", "mot15", "kitti-pedestrians", "kitti-cars", "pets", "tud")
# Seconds after which the flow answers; None is the end.
DELAYS = {"flow, all": None, "0.5 s": 0.5, "1 s": 1.0, "2 s": 2.0, "5 s": 5.0}
Part: TypeAlias = Literal["methods", "rates", "delays"]
PARTS: tuple[Part, ...] = get_args(Part)
Ways: TypeAlias = Mapping[str, Callable[[GivenSequence], list[Track]]]
# Longest gap that the right links bridge, seconds.
GAP = 2.0


def reproduce(
    *,
    store: Cached,
    data: Path = Path("../shared/data"),
    sets: Sequence[SetKey] = SETS,
    parts: Sequence[Part] = PARTS,
    peer: str | None = None,
) -> Outcome:
    """Methods of association on the given detections of six data sets: HOTA, MOTA and IDF1, beside peers.

    DIR gets results.json (every row on every sequence) and tables.md.

    Args:
        store: of what was computed.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti and so on; a set that is not there is passed
            over.
        sets: of mot17, mot15, kitti-pedestrians, kitti-cars, pets and tud, and of dance and sport, which are generated.
        parts: methods (all rows), rates (mot17 at 30, 15, 10 and 5 frames a second), delays (the flow that answers
            after 0.5, 1, 2 and 5 seconds on mot17 and pets).
        peer: python of an environment with the packages trackers, whose ByteTrack, C-BIoU, SORT and OC-SORT are
            measured beside, and arcsort; by default this one, if it has them.

    Raises:
        RequestError: an unknown set or part, no data, or a python without the packages.
    """
    environment = find_peer(peer, "links")
    there = find_sets(store, data, [key for key in get_args(SetKey) if key in sets])
    tables, values = list[Table](), dict[str, Any]()
    for one, sequences in there.items():
        rows = _scored(store, sequences, _tracks(store, one, sequences, environment))
        for way in (False, True):
            limit = sums_of(store, right_sums, [(one, GAP, way) for one in sequences])
            rows[f"right links up to {GAP:g} s{', filled' if way else ''}"] = limit
        values[one.key] = {
            name: combined_scores(sums)
            | {"sequences": {g.name: combined_scores(own[None]) for g, own in zip(sequences, sums, strict=True)}}
            for name, sums in rows.items()
        }
        if "methods" in parts:
            tables.append(score_table(one.title, rows, FLOW))
        for title, own, ways, base in _more(one, sequences, parts):
            found = store.study(ways, own, title)
            tables.append(score_table(title, _scored(store, own, found), base))
    missing = [one for one in DATA_SETS if one.key in sets and one not in there]
    notes = [f"{one.title}: no {one.folder} in the data, passed over" for one in missing]
    notes += [] if environment else [skipped("links")]
    return Outcome({"peer": environment and environment.version, "sets": values}, tables, notes=notes)


def _more(
    one: DataSet, sequences: Sequence[GivenSequence], parts: Sequence[str]
) -> Iterator[tuple[str, Sequence[GivenSequence], Ways, str]]:
    """Title, sequences, ways and their base, of the tables of one data set of the wanted parts but the first."""
    for rate in RATES if "rates" in parts and one.key == "mot17" else ():
        slower = [given.at(rate) for given in sequences]
        kept = ", ".join(sorted({f"{given.rate:.3g}" for given in slower}, key=float))
        ways = {str(method): partial(linked, method) for method in METHODS}
        yield f"{one.title} at {rate:g} frames a second (kept {kept})", slower, ways, FLOW
    if "delays" in parts and one.key in ("mot17", "pets"):
        delays = {name: partial(linked, "flow", delay=delay) for name, delay in DELAYS.items()}
        yield f"{one.title}: delay of the flow", sequences, delays, "flow, all"


def linked(
    method: PeopleMethod, given: GivenSequence, delay: float | None = None, pictures: bool = True
) -> list[Track]:
    """The tracks of `tsuiseki track people --detections … --method METHOD`, as it writes them.

    Args:
        method: of the command.
        given: the sequence.
        delay: seconds after which it answers; None is the end.
        pictures: compare appearance where the sequence has pictures and all its frames are kept, as the command does.
    """
    detections = given_detections(given)
    if pictures and given.pictures is not None and given.every == 1:
        first = given.kept.start
        whole = [Detections.empty()] * first + detections
        tracks = track_people(given.pictures, method, detections=whole, frames=given.frames, threads=1, delay=delay)
        return as_written([shifted(track, -first) for track in tracks])
    return as_written(tracks_over(detections, given.rate, given.size, method, delay=delay))


def peer_tracks(peer: Peer, given: GivenSequence, logistic: bool) -> dict[str, list[Track]]:
    """The tracks of each tracker of the peer; boxes without an area are left out.

    Args:
        peer: its environment.
        given: the sequence.
        logistic: scores are logits and become probabilities first.
    """
    rows = rows_of(given_detections(given), 0, 0)
    scores = 1 / (1 + np.exp(-rows.scores)) if logistic else rows.scores
    boxes = np.column_stack([rows.frames, rows.boxes, scores]).tolist()
    tracks = {}
    for name, found in peer.answer({"boxes": boxes, "length": len(given.kept), "rate": given.rate}).items():
        table = np.array(found, dtype=np.float64).reshape(-1, 7)
        table = table[(table[:, 4] > table[:, 2]) & (table[:, 5] > table[:, 3])]
        parts = [table[table[:, 1] == number] for number in np.unique(table[:, 1])]
        tracks[name] = as_written([Track(int(p[0, 1]), p[:, 0].astype(int), p[:, 2:6], p[:, 6]) for p in parts])
    return tracks


def _tracks(
    store: Store, one: DataSet, sequences: Sequence[GivenSequence], environment: Peer | None
) -> dict[str, list[list[Track]]]:
    """The tracks of every row by sequence."""
    ways = {str(method): partial(linked, method) for method in METHODS}
    if any(given.pictures for given in sequences):
        ways[BOXES_ALONE] = partial(linked, "flow", pictures=False)
    tracks = store.study(ways, sequences, one.title)
    tracks[UNFILLED] = [
        [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t in each for k in [t.observed] if k.any()]
        for each in tracks[FLOW]
    ]
    for logistic in (False, True)[: 1 + one.logits] if environment else ():
        jobs = [(environment, given, logistic) for given in sequences]
        answers = store.each(peer_tracks, jobs, f"{one.title}, peers")
        of = ", probabilities" if logistic else ""
        tracks |= {f"{name} (peer){of}": [found[name] for found in answers] for name in LINKERS}
    return tracks


def _scored(
    store: Store, sequences: Sequence[GivenSequence], tracks: Mapping[Any, Sequence[Sequence[Track]]]
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of every row."""
    return {name: sums_of(store, track_sums, list(zip(sequences, own, strict=True))) for name, own in tracks.items()}
