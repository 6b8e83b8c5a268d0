"""The data sets of the association's table: where their sequences lie and what must be known to score them.

The ignore rules are those of `read_ground_truth`, told by the columns of each ``gt.txt``: MOT17's distractors are
neither right nor wrong, boxes that MOT15 marks with 0 in column 7 do not count, and KITTI's files hold the class itself
and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames


@dataclass(frozen=True)
class DataSet:
    """Sequences that are scored together.

    Attributes:
        key: its name as an option.
        title: its name in tables.
        folder: of its sequences, below the folder of all data.
        names: of its sequences; by default every folder there.
        frames: the stretch that is tracked and scored, counted from 1; by default all.
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
class Clip:
    """A sequence with its detections, some frames of each second left out if wanted.

    Attributes:
        name: of the sequence.
        detections: det.txt.
        labels: gt.txt.
        length: number of frames before any is left out.
        frame_rate: of the sequence, frames a second.
        size: width and height of the image, pixels; 0 where unknown.
        frames: the stretch that is tracked and scored, counted from 1; None is all.
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
    def stretch(self) -> FrameRange:
        """The frames that count, of the sequence."""
        return parse_frames(self.frames).within(self.length)

    @property
    def kept(self) -> range:
        """0-based frames of the sequence that are tracked."""
        wanted = self.stretch
        assert wanted.last is not None
        return range(wanted.first, wanted.last + 1, self.every)

    def at(self, rate: float) -> Clip:
        """The clip at about ``rate`` frames a second: the nearest that leaving out frames evenly gives."""
        return replace(self, every=max(1, round(self.frame_rate / rate)))


def find_clips(data: Path, one: DataSet) -> list[Clip]:
    """The sequences of a data set, by name; none where its folder is not there.

    Raises:
        RequestError: a sequence has no labels or no detections.
    """
    home = data / one.folder
    names = one.names or tuple(sorted(path.name for path in home.iterdir() if path.is_dir()) if home.is_dir() else ())
    return [_clip(home / name, one) for name in names if (home / name).is_dir()]


def _clip(folder: Path, one: DataSet) -> Clip:
    sequence = read_sequence(folder)
    for path in (sequence.detections_path, sequence.ground_truth_path):
        if not path.is_file():
            raise RequestError(
                f"{folder}: expected {path.relative_to(folder)} of a sequence with detections, found none"
            )
    rows = _rows(sequence.detections_path)
    labelled = int(np.loadtxt(sequence.ground_truth_path, delimiter=",", usecols=0, ndmin=1).max())
    return Clip(
        name=sequence.name,
        detections=sequence.detections_path,
        labels=sequence.ground_truth_path,
        length=sequence.length or max(int(rows[:, 0].max()), labelled),
        frame_rate=sequence.frame_rate,
        size=(sequence.width, sequence.height),
        frames=one.frames,
        pictures=folder if sequence.images else None,
    )


def read_clip(clip: Clip) -> list[Detections]:
    """The detections of the frames that are kept; boxes without an area are left out.

    One box of KITTI's cars is 0 pixels wide.
    """
    rows = _rows(clip.detections)
    rows = rows[(rows[:, 4] > 0) & (rows[:, 5] > 0)]
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    corners = np.column_stack([rows[:, 2:4] - 1, rows[:, 2:4] - 1 + rows[:, 4:6]])
    starts = np.searchsorted(rows[:, 0] - 1, np.arange(clip.length + 1))
    return [Detections(corners[a:b], rows[a:b, 6]) for a, b in ((starts[k], starts[k + 1]) for k in clip.kept)]


def table_of(tracks: Sequence[Track]) -> FloatArray:
    """``(N, 8)`` rows of frame, id, x1, y1, x2, y2, score and whether it was detected, by id and frame."""
    rows = [
        np.column_stack([t.frames, np.full(len(t), t.id), np.round(t.boxes, 2), np.round(t.scores, 4), t.observed])
        for t in tracks
    ]
    return np.concatenate(rows) if rows else np.empty((0, 8))


def tracks_of(table: FloatArray) -> list[Track]:
    """The tracks in `table_of`'s rows."""
    rows = table.reshape(-1, 8)  # a table without a row comes back from JSON without its columns
    rows = rows[np.lexsort([rows[:, 0], rows[:, 1]])]
    parts = np.split(rows, np.flatnonzero(np.diff(rows[:, 1])) + 1) if len(rows) else []
    return [Track(int(p[0, 1]), p[:, 0].astype(np.int64), p[:, 2:6], p[:, 6], p[:, 7] > 0) for p in parts]


def _rows(path: Path) -> FloatArray:
    return np.loadtxt(path, delimiter=",", ndmin=2)
