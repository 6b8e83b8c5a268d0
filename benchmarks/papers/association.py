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
from benchmarks.papers.paired_bootstrap import COUNTS, SCORES, paired_bootstrap, score_sums, scores_of
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
class DetectedSequence:
    """A sequence with its detections, some frames of each second left out if wanted.

    Attributes:
        name: of the sequence.
        detections: det.txt.
        labels: gt.txt.
        length: number of frames before any is left out.
        frame_rate: of the sequence, frames a second.
        size: width and height of the image, pixels; 0 where unknown.
        frames: the frames that are tracked and scored, counted from 1; None is all.
        stride: one frame in so many is kept.
        pictures: the sequence's folder, where it has images.
    """

    name: str
    detections: Path
    labels: Path
    length: int
    frame_rate: float
    size: tuple[int, int]
    frames: str | None = None
    stride: int = 1
    pictures: Path | None = None

    @property
    def rate(self) -> float:
        """Frames a second that are kept."""
        return self.frame_rate / self.stride

    @property
    def kept(self) -> range:
        """0-based frames of the sequence that are tracked."""
        chosen = parse_frames(self.frames).within(self.length)
        assert chosen.last is not None
        return range(chosen.first, chosen.last + 1, self.stride)

    @property
    def filmed(self) -> dict[str, Any]:
        """Frame rate and size, None where unknown, as trackers take them."""
        return {"frame_rate": self.rate, "size": self.size if min(self.size) > 0 else None}

    def at(self, rate: float) -> DetectedSequence:
        """The same at about ``rate`` frames a second: the nearest that leaving out frames evenly gives."""
        return replace(self, stride=max(1, round(self.frame_rate / rate)))


def find_sequences(data: Path, data_set: DataSet) -> list[DetectedSequence]:
    """The sequences of a data set, by name; none where its folder is not there.

    Raises:
        RequestError: a sequence has no labels or no detections.
    """
    sequences, home = list[DetectedSequence](), data / data_set.folder
    for folder in filter(Path.is_dir, [home / name for name in data_set.names] or sorted(home.glob("*"))):
        sequence = read_sequence(folder)
        paths = sequence.detections_path, sequence.ground_truth_path
        if missing := [path.relative_to(folder) for path in paths if not path.is_file()]:
            raise RequestError(f"{folder}: expected {missing[0]} of a sequence with detections, found none")
        end = sequence.length or int(max(np.loadtxt(p, delimiter=",", usecols=0, ndmin=1).max() for p in paths))
        size, pictures = (sequence.width, sequence.height), folder if sequence.images else None
        described = sequence.name, *paths, end, sequence.frame_rate, size, data_set.frames
        sequences.append(DetectedSequence(*described, pictures=pictures))
    return sequences


def find_sets(store: Store, data: Path, keys: Iterable[str]) -> dict[DataSet, list[DetectedSequence]]:
    """The sequences of the data sets that are there, and of generated ones, from the store.

    Raises:
        RequestError: none of the real ones is, or a sequence has no labels or no detections.
    """
    chosen = [data_set for key in keys for data_set in DATA_SETS if data_set.key == key]
    sequences_of = {data_set: find_sequences(data, data_set) for data_set in chosen if data_set.drawn is None}
    if sequences_of and not any(sequences_of.values()):
        raise RequestError(f"`data`: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    for data_set in chosen:
        if data_set.drawn is not None:
            home = store.made(data_set.folder, write_streets, 10, *data_set.drawn).parent
            sequences_of[data_set] = find_sequences(home, data_set)
    return {data_set: sequences for data_set, sequences in sequences_of.items() if sequences}


def sequence_detections(sequence: DetectedSequence) -> list[Detections]:
    """The detections of the frames that are kept; boxes without an area are left out."""
    detections = read_detections(sequence.detections, sequence.length)
    return [detections[frame] for frame in sequence.kept]


def sequence_labels(sequence: DetectedSequence) -> GroundTruth:
    """The labels of the frames that are kept, numbered from 0 as the tracks are."""
    (truth,) = read_truths(sequence.labels, parse_frames(sequence.frames).within(sequence.length))
    moved = truth.labels.frames - sequence.kept.start
    return replace(truth.labels, frames=moved // sequence.stride).select((moved >= 0) & (moved % sequence.stride == 0))


def as_written(tracks: Sequence[Track]) -> list[Track]:
    """The tracks as a file has them: by id, boxes to hundredths of a pixel."""
    ordered = sorted(tracks, key=lambda track: track.id)
    return [replace(track, boxes=np.round(track.boxes, 2), scores=np.round(track.scores, 4)) for track in ordered]


def flow_over(sequence: DetectedSequence, **options: Any) -> FlowTracker:
    """The flow, with ``more`` arguments, after all detections of a sequence."""
    tracker = FlowTracker(**options, **sequence.filmed)
    for detections in sequence_detections(sequence):
        tracker.update(detections)
    return tracker


def tracks_over(
    detections: Sequence[Detections], rate: float, size: tuple[int, int], method: PeopleMethod = "flow", **options: Any
) -> list[Track]:
    """The tracks of `track_people` over the detections of each frame, without pictures."""
    with tempfile.TemporaryDirectory() as folder:
        write_sequence_info(Path(folder), "given", rate, len(detections), *size)
        return list(track_people(folder, method, detections=detections, **options))


def track_sums(sequence: DetectedSequence, tracks: Sequence[Track]) -> FloatArray:
    """``(83,)`` sums of the scores of tracks, see `score_sums`."""
    count = len(sequence.kept)
    inside = restrict(list(tracks), FrameRange(0, count - 1))
    return score_sums(SequencePair(sequence.name, sequence_labels(sequence), inside, count))


def sums_of(store: Store, compute: Callable[..., FloatArray], jobs: Sequence[tuple[Any, ...]]) -> FloatArray:
    """``(S, 83)`` sums that ``compute`` gives for the arguments of S sequences."""
    return np.array([store.recall(compute, *job) for job in jobs])


def right_sums(sequence: DetectedSequence, seconds: float, bridged: bool) -> FloatArray:
    """Sums of the right links over the detections across gaps of up to so many seconds, filled where ``bridged``."""
    right = right_links(sequence_detections(sequence), sequence_labels(sequence), max(1.0, seconds * sequence.rate))
    return track_sums(sequence, [fill_gaps(track, sequence.length) for track in right] if bridged else right)


def right_links(detections: Sequence[Detections], truth: GroundTruth, longest: float = np.inf) -> list[Track]:
    """The tracks that the right links over the detections give.

    A box belongs to the label it overlaps by at least 0.5, one to one; boxes on ignored labels and false positives are
    left out. The right links join the boxes of one identity in the order of their frames.

    Args:
        detections: of each frame.
        truth: the labels, their frames counted as those of the detections.
        longest: most frames from one detection to the next of the same track; 1 allows no gap.
    """
    boxes = rows_of(detections, 0, 0)
    owners, frames = owners_of(boxes.frames, boxes.boxes, truth), boxes.frames
    tracks: list[Track] = []
    for identity in np.unique(owners[owners >= 0]):
        mine = np.flatnonzero(owners == identity)
        for part in np.split(mine, np.flatnonzero(np.diff(frames[mine]) > longest) + 1):
            tracks.append(Track(len(tracks) + 1, frames[part], boxes.boxes[part], boxes.scores[part]))
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
        scores = combined_scores(sums)
        cells = [*(f"{scores[key]:.3f}" for key in SCORES), *(str(int(scores[key])) for key in COUNTS[:3])]
        lines.append([name, *cells, *([""] * 4 if base == name else _gains(sums, rows[base]))])
    above = [f"{what} − {base}" for what in ("HOTA", "MOTA", "IDF1", "IDSW")]
    return Table(title, ("method", "HOTA", "DetA", "AssA", "MOTA", "IDF1", "IDSW", "FP", "FN", *above), lines)


def _gains(ours: FloatArray, theirs: FloatArray) -> list[str]:
    """Differences of HOTA, MOTA and IDF1, and of the switches as a share of theirs."""
    gains = paired_bootstrap(ours, theirs, SAMPLES, np.random.default_rng(0))
    our_switches, their_switches = (np.asarray(scores_of(sums)["id_switches"]) for sums in (ours, theirs))
    count = len(our_switches)
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), SAMPLES)
    low, high = np.quantile(drawn @ our_switches / np.maximum(drawn @ their_switches, 1) - 1, (0.025, 0.975))
    gaps = [(gains[key].difference, gains[key].low, gains[key].high, "+.3f") for key in ("hota", "mota", "idf1")]
    gaps.append((our_switches.sum() / max(their_switches.sum(), 1) - 1, low, high, "+.0%"))
    cells = [f"{gap:{form}} [{low:{form}}, {high:{form}}]" for gap, low, high, form in gaps]
    # Samples of one sequence say nothing.
    return cells if len(our_switches) > 1 else [cell.partition(" ")[0] for cell in cells]


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
Ways: TypeAlias = Mapping[str, Callable[[DetectedSequence], list[Track]]]
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
    tables, values, summaries = list[Table](), dict[str, Any](), dict[str, dict[str, Mapping[str, FloatArray]]]()
    for data_set, sequences in there.items():
        rows = _scored(store, sequences, _tracks(store, data_set, sequences, environment))
        for way in (False, True):
            limit = sums_of(store, right_sums, [(data_set, GAP, way) for data_set in sequences])
            rows[f"right links up to {GAP:g} s{', filled' if way else ''}"] = limit
        values[data_set.key] = {
            name: combined_scores(sums)
            | {"sequences": {g.name: combined_scores(subset[None]) for g, subset in zip(sequences, sums, strict=True)}}
            for name, sums in rows.items()
        }
        if "methods" in parts:
            summaries.setdefault("Methods", {})[data_set.title] = rows
            tables.append(score_table(data_set.title, rows, FLOW))
        for heading, column, subset, ways, base in _more(data_set, sequences, parts):
            scored = _scored(store, subset, store.study(ways, subset, f"{heading}, {column}"))
            summaries.setdefault(heading, {})[column] = scored
            tables.append(score_table(f"{heading}: {column}", scored, base))
    tables = [summary_table(heading, columns) for heading, columns in summaries.items()] + tables
    missing = [data_set for data_set in DATA_SETS if data_set.key in sets and data_set not in there]
    notes = [f"{data_set.title}: no {data_set.folder} in the data, passed over" for data_set in missing]
    notes.append(f"peers: {environment.version}" if environment else skipped("links"))
    return Outcome({"peer": environment and environment.version, "sets": values}, tables, notes=notes)


def summary_table(title: str, columns: Mapping[str, Mapping[str, FloatArray]]) -> Table:
    """HOTA/MOTA/IDF1 of all sequences together, from ``(S, 83)`` sums of each row by the heading of the column."""
    lines = {name: [name] for rows in columns.values() for name in rows}
    for rows in columns.values():
        for name, cells in lines.items():
            scores = combined_scores(rows[name]) if name in rows else {}
            cells.append("/".join(f"{scores[key]:.3f}" for key in ("hota", "mota", "idf1") if scores))
    return Table(title, ("HOTA/MOTA/IDF1", *columns), list(lines.values()))


def _more(
    data_set: DataSet, sequences: Sequence[DetectedSequence], parts: Sequence[str]
) -> Iterator[tuple[str, str, Sequence[DetectedSequence], Ways, str]]:
    """Heading, column, sequences, ways and their base, of the tables of a data set beyond the part ``methods``."""
    for rate in RATES if "rates" in parts and data_set.key == "mot17" else ():
        slower = [sequence.at(rate) for sequence in sequences]
        rates = ", ".join(sorted({f"{sequence.rate:.3g}" for sequence in slower}, key=float))
        ways = {str(method): partial(linked, method) for method in METHODS}
        yield f"{data_set.title}, frames a second", f"{rate:g} (kept {rates})", slower, ways, FLOW
    if "delays" in parts and data_set.key in ("mot17", "pets"):
        delays = {name: partial(linked, "flow", delay=delay) for name, delay in DELAYS.items()}
        yield "Delay of the flow", data_set.title, sequences, delays, "flow, all"


def linked(
    method: PeopleMethod, sequence: DetectedSequence, delay: float | None = None, pictures: bool = True
) -> list[Track]:
    """The tracks of `tsuiseki track people --detections … --method METHOD`, as it writes them.

    Args:
        method: of the command.
        given: the sequence.
        delay: seconds after which it answers; None is the end.
        pictures: compare appearance where the sequence has pictures and all its frames are kept, as the command does.
    """
    detections = sequence_detections(sequence)
    if pictures and sequence.pictures is not None and sequence.stride == 1:
        first = sequence.kept.start
        padded = [Detections.empty()] * first + detections
        tracks = track_people(
            sequence.pictures, method, detections=padded, frames=sequence.frames, threads=1, delay=delay
        )
        return as_written([shifted(track, -first) for track in tracks])
    return as_written(tracks_over(detections, sequence.rate, sequence.size, method, delay=delay))


def peer_tracks(peer: Peer, sequence: DetectedSequence, logistic: bool) -> dict[str, list[Track]]:
    """The tracks of each tracker of the peer; boxes without an area are left out.

    Args:
        peer: its environment.
        given: the sequence.
        logistic: scores are logits and become probabilities first.
    """
    rows = rows_of(sequence_detections(sequence), 0, 0)
    scores = 1 / (1 + np.exp(-rows.scores)) if logistic else rows.scores
    boxes = np.column_stack([rows.frames, rows.boxes, scores]).tolist()
    tracks = {}
    for name, linked_rows in peer.answer({"boxes": boxes, "length": len(sequence.kept), "rate": sequence.rate}).items():
        table = np.array(linked_rows, dtype=np.float64).reshape(-1, 7)
        table = table[(table[:, 4] > table[:, 2]) & (table[:, 5] > table[:, 3])]
        parts = [table[table[:, 1] == number] for number in np.unique(table[:, 1])]
        tracks[name] = as_written([Track(int(p[0, 1]), p[:, 0].astype(int), p[:, 2:6], p[:, 6]) for p in parts])
    return tracks


def _tracks(
    store: Store, data_set: DataSet, sequences: Sequence[DetectedSequence], environment: Peer | None
) -> dict[str, list[list[Track]]]:
    """The tracks of every row by sequence."""
    ways = {str(method): partial(linked, method) for method in METHODS}
    if any(sequence.pictures for sequence in sequences):
        ways[BOXES_ALONE] = partial(linked, "flow", pictures=False)
    tracks = store.study(ways, sequences, data_set.title)
    tracks[UNFILLED] = [
        [Track(t.id, t.frames[k], t.boxes[k], t.scores[k]) for t in followed for k in [t.observed] if k.any()]
        for followed in tracks[FLOW]
    ]
    for logistic in (False, True)[: 1 + data_set.logits] if environment else ():
        jobs = [(environment, sequence, logistic) for sequence in sequences]
        answers = store.each(peer_tracks, jobs, f"{data_set.title}, peers")
        of = ", probabilities" if logistic else ""
        tracks |= {f"{name} (peer){of}": [answer[name] for answer in answers] for name in LINKERS}
    return tracks


def _scored(
    store: Store, sequences: Sequence[DetectedSequence], tracks: Mapping[Any, Sequence[Sequence[Track]]]
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of every row."""
    return {
        name: sums_of(store, track_sums, list(zip(sequences, followed, strict=True)))
        for name, followed in tracks.items()
    }
