"""Labelled sequences with given detections: where they lie, their tracks as tables, and the scores of these.

The ignore rules are those of `read_ground_truth`, by the columns of each ``gt.txt``: MOT17's distractors are neither
right nor wrong, boxes that MOT15 marks with 0 in column 7 do not count, and KITTI's files hold the class itself alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.people.walkers import Motion
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.smoothing import fill_gaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import owners_of
from tsuiseki.tracking.evaluation.multi import SequencePair, restrict
from tsuiseki.tracking.evaluation.paired_bootstrap import COUNTS, SCORES, paired_bootstrap, score_sums, scores_of
from tsuiseki.tracking.evaluation.result_files import read_truths
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections
from tsuiseki.tracking.formats.mot_sequence import read_sequence, write_sequence_info
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.people.tracking import track_people
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.study import Bench, Table

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
    """

    key: str
    title: str
    folder: str
    names: tuple[str, ...] = ()
    frames: str | None = None
    logits: bool = False


DATA_SETS = (
    DataSet("mot17", "MOT17 val-half", "mot/mot17-val-half"),
    DataSet("mot15", "MOT15", "mot/mot15"),
    DataSet("kitti-pedestrians", "KITTI pedestrians", "mot/kitti/Pedestrian", logits=True),
    DataSet("kitti-cars", "KITTI cars", "mot/kitti/Car", logits=True),
    DataSet("pets", "PETS09-S2L1 301–400", "mot", ("PETS09-S2L1-first",), "301-400"),
    DataSet("tud", "TUD", "mot", ("TUD-Campus", "TUD-Stadtmitte")),
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
    home = data / one.folder
    names = one.names or tuple(sorted(path.name for path in home.iterdir() if path.is_dir()) if home.is_dir() else ())
    return [_given(home / name, one) for name in names if (home / name).is_dir()]


def find_sets(data: Path, keys: Iterable[str]) -> dict[DataSet, list[GivenSequence]]:
    """The sequences of the data sets that are there.

    Raises:
        RequestError: none is, or a sequence has no labels or no detections.
    """
    found = {one: find_given(data, one) for key in keys for one in DATA_SETS if one.key == key}
    if not any(found.values()):
        raise RequestError(f"`data`: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    return {one: sequences for one, sequences in found.items() if sequences}


def _given(folder: Path, one: DataSet) -> GivenSequence:
    sequence = read_sequence(folder)
    for path in (sequence.detections_path, sequence.ground_truth_path):
        if not path.is_file():
            raise RequestError(
                f"{folder}: expected {path.relative_to(folder)} of a sequence with detections, found none"
            )
    rows = _rows(sequence.detections_path)
    labelled = int(np.loadtxt(sequence.ground_truth_path, delimiter=",", usecols=0, ndmin=1).max())
    return GivenSequence(
        name=sequence.name,
        detections=sequence.detections_path,
        labels=sequence.ground_truth_path,
        length=sequence.length or max(int(rows[:, 0].max()), labelled),
        frame_rate=sequence.frame_rate,
        size=(sequence.width, sequence.height),
        frames=one.frames,
        pictures=folder if sequence.images else None,
    )


def given_detections(given: GivenSequence) -> list[Detections]:
    """The detections of the frames that are kept; boxes without an area are left out.

    One box of KITTI's cars is 0 pixels wide.
    """
    rows = _rows(given.detections)
    rows = rows[(rows[:, 4] > 0) & (rows[:, 5] > 0)]
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    corners = np.column_stack([rows[:, 2:4] - 1, rows[:, 2:4] - 1 + rows[:, 4:6]])
    starts = np.searchsorted(rows[:, 0] - 1, np.arange(given.length + 1))
    return [Detections(corners[a:b], rows[a:b, 6]) for a, b in ((starts[k], starts[k + 1]) for k in given.kept)]


def given_labels(given: GivenSequence) -> GroundTruth:
    """The labels of the frames that are kept, numbered from 0 as the tracks are."""
    (truth,) = read_truths(given.labels, parse_frames(given.frames).within(given.length))
    moved = truth.labels.frames - given.kept.start
    labels = replace(truth.labels, frames=moved // given.every)
    return labels.select((moved >= 0) & (moved % given.every == 0))


def as_written(tracks: Sequence[Track]) -> list[Track]:
    """The tracks as a file has them: by id, boxes to hundredths of a pixel."""
    ordered = sorted(tracks, key=lambda track: track.id)
    return [replace(one, boxes=np.round(one.boxes, 2), scores=np.round(one.scores, 4)) for one in ordered]


def filled(tracks: Sequence[Track], longest: int) -> list[Track]:
    """Tracks with their gaps of up to so many frames filled on straight lines."""
    return [fill_gaps(track, longest) for track in tracks]


def flow_over(given: GivenSequence, **more: Any) -> FlowTracker:
    """The flow, with ``more`` arguments, after all detections of a sequence."""
    tracker = FlowTracker(**more, **given.filmed)
    for found in given_detections(given):
        tracker.update(found)
    return tracker


def tracks_over(
    found: Sequence[Detections], rate: float, size: tuple[int, int], method: PeopleMethod = "flow", **more: Any
) -> list[Track]:
    """The tracks of `track_people` over the detections of each frame, without pictures."""
    with tempfile.TemporaryDirectory() as folder:
        write_sequence_info(Path(folder), "given", rate, len(found), *size)
        return list(track_people(folder, method, detections=found, **more))


def track_sums(given: GivenSequence, tracks: Sequence[Track]) -> FloatArray:
    """``(83,)`` sums of the scores of tracks, see `score_sums`."""
    count = len(given.kept)
    inside = restrict(list(tracks), FrameRange(0, count - 1))
    return score_sums(SequencePair(given.name, given_labels(given), inside, count))


def sums_of(bench: Bench, compute: Callable[..., FloatArray], jobs: Sequence[tuple[Any, ...]]) -> FloatArray:
    """``(S, 83)`` sums that ``compute`` gives for the arguments of S sequences."""
    return np.array([bench.store.recall(compute, *job) for job in jobs])


def right_sums(given: GivenSequence, seconds: float, bridged: bool) -> FloatArray:
    """Sums of the right links over the detections across gaps of up to so many seconds, filled where ``bridged``."""
    right = right_links(given_detections(given), given_labels(given), max(1.0, seconds * given.rate))
    return track_sums(given, filled(right, given.length) if bridged else right)


def right_links(detections: Sequence[Detections], truth: GroundTruth, longest: float = np.inf) -> list[Track]:
    """The tracks that the right links over the detections give.

    A box belongs to the label it overlaps by at least 0.5, one to one; boxes on ignored labels and false positives are
    left out. The right links join the boxes of one identity in the order of their frames.

    Args:
        detections: of each frame.
        truth: the labels, their frames counted as those of the detections.
        longest: most frames from one detection to the next of the same track; 1 allows no gap.
    """
    frames = np.repeat(np.arange(len(detections)), [len(found) for found in detections])
    boxes = np.concatenate([np.empty((0, 4)), *(d.boxes for d in detections)])
    scores = np.concatenate([np.empty(0), *(d.scores for d in detections)])
    owners = owners_of(frames, boxes, truth)
    tracks: list[Track] = []
    for identity in np.unique(owners[owners >= 0]):
        mine = np.flatnonzero(owners == identity)
        for part in np.split(mine, np.flatnonzero(np.diff(frames[mine]) > longest) + 1):
            tracks.append(Track(len(tracks) + 1, frames[part], boxes[part], scores[part]))
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
        cells += [""] * 4 if base == name else _gains(sums, rows[base])
        lines.append([name, *cells])
    above = [f"{what} − {base}" for what in ("HOTA", "MOTA", "IDF1", "IDSW")]
    columns = (title, "HOTA", "DetA", "AssA", "MOTA", "IDF1", "IDSW", "FP", "FN", *above)
    return Table("", columns, lines)


def _gains(ours: FloatArray, theirs: FloatArray) -> list[str]:
    """Differences of HOTA, MOTA and IDF1, and of the switches as a share of theirs."""
    found = paired_bootstrap(ours, theirs, SAMPLES, np.random.default_rng(0))
    gaps = [found[key] for key in ("hota", "mota", "idf1")]
    one, other = (np.asarray(scores_of(sums)["id_switches"]) for sums in (ours, theirs))
    drawn = np.random.default_rng(0).multinomial(len(one), np.full(len(one), 1 / len(one)), SAMPLES)
    low, high = np.quantile(drawn @ one / np.maximum(drawn @ other, 1) - 1, (0.025, 0.975))
    cells = [f"{gap.difference:+.3f} [{gap.low:+.3f}, {gap.high:+.3f}]" for gap in gaps]
    cells.append(f"{one.sum() / max(other.sum(), 1) - 1:+.0%} [{low:+.0%}, {high:+.0%}]")
    # Samples of one sequence say nothing.
    return cells if len(one) > 1 else [cell.partition(" ")[0] for cell in cells]


def _rows(path: Path) -> FloatArray:
    return np.loadtxt(path, delimiter=",", ndmin=2)


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
        settings = StreetSettings(
            width=320,
            height=240,
            frames=frames,
            frame_rate=float(rng.choice([7, 10, 14, 25, 30])),
            people=int(rng.integers(8, 22)),
            occluders=int(rng.integers(3, 11)),
            person_height=(16.0, 90.0),
            samples=1,
            motion=motion,
        )
        home = folder / f"street-{number:02d}"
        clip = plan_street(settings, number)
        clip.write_truth(home, home.name, [truth for _, truth in clip.frames()])
        truth = read_ground_truth(home / "gt" / "gt.txt")
        # Within what the detections of MOT17, MOT15, KITTI, PETS and TUD are off their labels.
        faults = DetectorFaults(
            jitter=float(rng.uniform(0.02, 0.045)),
            steady=float(rng.uniform(0.7, 0.9)),
            missed=float(rng.uniform(0.03, 0.35)),
            hidden=float(rng.uniform(0.5, 0.95)),
            false_alarms=float(rng.uniform(0.2, 4.0)),
            persistence=float(rng.uniform(0.5, 0.9)),
            doubled=float(rng.uniform(0.0, 0.1)),
        )
        found = simulate_detections(rng, truth, frames, settings.width, settings.height, faults)
        (home / "det").mkdir(parents=True)
        write_detections(home / "det" / "det.txt", found)
