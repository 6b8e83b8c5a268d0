"""A result that a person corrects: questions, answers, corrections, and all of it on disk after each one."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np

from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks, write_acting_tracks
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.formats.result_folder import filled_frames
from tsuiseki.tracking.formats.single import write_boxes
from tsuiseki.tracking.formats.track_tables import table_of, write_table
from tsuiseki.tracking.output import RUN_FILE, hold, output_file, record_text, whole_file
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.review.corrections import (
    CORRECTIONS_FILE,
    Box,
    Correction,
    CorrectionLog,
    Kind,
    Video,
    append,
    boxes_of,
    read_corrections,
)
from tsuiseki.tracking.review.demands import Finder
from tsuiseki.tracking.review.questions import Question, Questioner
from tsuiseki.tracking.review.refit import EVERY, refitted
from tsuiseki.tracking.review.solving import CorrectedFlow
from tsuiseki.tracking.review.tracks import Reporter, acting, track_ids
from tsuiseki.tracking.types import IntArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video.source import image_size, open_source

# The tracks as the tracker left them, kept as soon as they are corrected.
SOLVED_FILE = "tracks.solved.txt"
ACTIONS_FILE, SOLVED_ACTIONS = "tracks.json", "tracks.solved.json"
# Seconds of a gap that is filled where the result does not say it.
FILL = 2.0
# Questions that are found at a time.
MOST_ASKED = 100


@dataclass(frozen=True)
class Changes:
    """What a correction changed.

    Attributes:
        frames: first and last frame, from 0, in which a box is another; None for none.
        ids: of the tracks that are not as they were, those that are gone included.
        notes: lines for the person.
    """

    frames: tuple[int, int] | None = None
    ids: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Progress:
    """How far a review is.

    Attributes:
        answered: what was said and not taken back.
        likely_errors_left: how many of the questions that are left would probably be answered with no.
    """

    answered: int
    likely_errors_left: float


class Session:
    """A result folder that one person corrects at a time.

    Args:
        result: folder that ``tsuiseki track people`` or ``drone`` wrote.
        source: the video; by default that of the result, where it is still there.

    Attributes:
        folder: the result.
        source: the video; None where there is none, or no pictures.
        frame_rate: frames a second; 25 where not known.
        size: width and height in pixels; None where not known.
        n_frames: how many there are.
        saved: the files of the result are as the tracks are now.

    Raises:
        RequestError: it is no result, or somebody else reviews it; the video has another size or length; the
            corrections beside it speak of another video.
    """

    def __init__(self, result: Path, source: str | Path | None = None) -> None:
        self.folder = Path(result)
        if not self.folder.is_dir():
            raise RequestError(f"expected the folder of a result to review, got {result}")
        self._open, self._saving = ExitStack(), Lock()
        try:
            hold(
                self.folder,
                f"somebody reviews {result} at this moment, or a run writes it; wait or end that",
                self._open,
            )
            self._load(source)
        except BaseException:
            self._open.close()
            raise

    def _load(self, source: str | Path | None) -> None:
        self._result: Result[Any] = Result.load(self.folder)
        solved = self._solved_tracks()
        self.frame_rate = self._result.frame_rate or 25.0
        numbers = self._result.frames.get("frame", ())
        last = max((int(track.frames[-1]) for track in solved), default=-1)
        self.n_frames = max([last, *numbers]) + 1
        self.size = self._result.size
        self._find_video(source)
        self._video = Video(self._result.name if self._result.source else "", self.size, self.n_frames)
        path = self.folder / NETWORK_FILE
        fill = round(FILL * self.frame_rate)
        network = SolvedNetwork.read(path) if path.is_file() else network_of_tracks(solved, fill, self.frame_rate)
        self._network = network
        self._log = CorrectionLog()
        if self.corrections_file.is_file():
            self._log = read_corrections(self.corrections_file, self._video)
        self._reporter, self._flow, self._fitted = Reporter(solved), CorrectedFlow(network), 0
        self._solve(self._log)
        self._asked: list[Question] | None = None
        self._refresh()
        # Of a review that was killed, the last corrections may not be in the tracks yet.
        self.saved = self._result.facts.get("corrections", 0) == len(self._log.said)

    @property
    def corrections_file(self) -> Path:
        """Where everything that is said is appended."""
        return self.folder / CORRECTIONS_FILE

    def _solved_tracks(self) -> list[Track]:
        kept = self.folder / SOLVED_FILE
        if kept.is_file():
            return list(read_tracks(kept))
        every = [getattr(track, "track", track) for track in self._result]
        if not all(isinstance(track, Track) for track in every):
            raise RequestError(f"{self.folder}: expected tracks of boxes to correct, got others")
        return every

    def _find_video(self, source: str | Path | None) -> None:
        given = source if source is not None else self._result.source
        self.source: str | None = None
        if not given or (source is None and not Path(str(given)).exists()):
            return
        opened = open_source(str(given))
        size, length = image_size(opened), opened.length
        if size is not None and self.size is not None and size != self.size:
            raise RequestError(
                f"{given}: expected frames of {self.size[0]}x{self.size[1]} pixels as in the result, got "
                f"{size[0]}x{size[1]}"
            )
        if length is not None and length < self.n_frames:
            raise RequestError(f"{given}: expected {self.n_frames} frames as in the result, got {length}")
        self.size = self.size or size
        self.source = str(given) if opened.has_images else None

    def tracks(self) -> Result[Track]:
        """The tracks as they are now."""
        known = {name: getattr(self._result, name) for name in ("settings", "facts", "seconds", "frames")}
        known["facts"] = {**known["facts"], "corrections": len(self._log.said), "track_names": self.names()}
        return Result(self._tracks, self._result.source, self.frame_rate, self.size, **known)

    def names(self) -> dict[int, str]:
        """Names that were given to tracks, by id."""
        return self._names

    def questions(self, limit: int = 50) -> list[Question]:
        """What to ask next, the least certain first."""
        if self._asked is None or len(self._asked) < min(limit, MOST_ASKED):
            flow = self._flow
            asking = Questioner(flow.network, flow.settled(), self._ids, flow.parted())
            self._asked = asking.ranked(max(limit, MOST_ASKED))
        return self._asked[:limit]

    def answer(self, key: str, yes: bool) -> Changes:
        """Answer a question: yes for as it was solved, no for the other way.

        Raises:
            RequestError: there is no such question now; or see `correct`.
        """
        found = [question for question in self._asked or [] if question.key == key]
        if not found:
            raise RequestError(f"expected the key of a question that was asked, got {key}; ask for the questions again")
        said = found[0].yes if yes else found[0].no
        return self.correct(replace(said, sentence=f"{found[0].sentence} {'Yes' if yes else 'No'}"))

    def made(
        self,
        kind: Kind,
        ids: Sequence[int] = (),
        frame: int = 0,
        last: int | None = None,
        name: str = "",
        box: Sequence[float] | None = None,
    ) -> Correction:
        """A correction of tracks by their ids, as a person points at them.

        Args:
            kind: see `Correction`.
            ids: one track, or two: the same or not the same, one in ``frame`` and the other in ``last``; to switch.
            frame: from 0; where a track has no detection there, the nearest is meant.
            last: the other frame, or the end of a stretch that is right; by default the same.
            name: of a track.
            box: x, y, width and height: the box that is added, or moved where there is an id.

        Raises:
            RequestError: there is no such track.
        """
        last = frame if last is None else last
        if kind == "box" and box is not None:
            new = Box(frame, *(float(v) for v in box))
            return Correction(kind, (*(self._near(number, frame) for number in ids), new))
        if kind == "switch":
            one, other = ids
            before, after = ([self._beside(n, frame, later) for n in (one, other)] for later in (False, True))
            return Correction(kind, (*before, *after))
        if kind in ("delete", "right"):
            return Correction(kind, self._stretch(ids[0], *((0, self.n_frames) if kind == "delete" else (frame, last))))
        where = [frame, last][: len(ids)]
        return Correction(kind, tuple(map(self._near, ids, where)), name)

    def _rows(self, number: int) -> IntArray:
        rows = np.flatnonzero(self._ids == number)
        if number < 1 or len(rows) == 0:
            raise RequestError(f"expected the id of a track, got {number}")
        return rows[np.argsort(self._flow.network.frames[rows], kind="stable")]

    def _boxes(self, rows: IntArray) -> tuple[Box, ...]:
        network = self._flow.network
        return boxes_of(network.frames[rows].tolist(), network.boxes[rows].tolist())

    def _near(self, number: int, frame: int) -> Box:
        rows = self._rows(number)
        return self._boxes(rows[[np.abs(self._flow.network.frames[rows] - frame).argmin()]])[0]

    def _beside(self, number: int, frame: int, later: bool) -> Box | None:
        """The last box of a track before a frame, or the first from it on; None for none."""
        rows = self._rows(number)
        cut = int(np.searchsorted(self._flow.network.frames[rows], frame))
        row = rows[cut : cut + 1] if later else rows[:cut][-1:]
        return self._boxes(row)[0] if len(row) else None

    def _stretch(self, number: int, first: int, last: int) -> tuple[Box, ...]:
        rows = self._rows(number)
        frames = self._flow.network.frames[rows]
        return self._boxes(rows[(frames >= first) & (frames <= last)])

    def correct(self, correction: Correction) -> Changes:
        """Do what a person says; it is among the corrections on disk when this returns.

        Raises:
            RequestError: it contradicts what was said before, or speaks of boxes that are not there.
        """
        find = Finder(self._flow.network.frames, self._flow.network.boxes)
        parts = correction.parts or (correction,)
        drawn = {p.boxes[-1] for p in parts if p.kind == "box"}
        found = [b for p in parts if p.kind not in ("box", "real", "delete", "right") for b in p.there]
        lost = [b for b in found if b not in drawn and find(b) < 0]
        if lost:
            raise RequestError(f"{correction}: no detection is there; add the box first")
        return self._said(correction)

    def undo(self) -> Changes:
        """Take back what was said last."""
        return self._said("undo") if self._log.said else Changes(notes=("there is nothing to take back",))

    def redo(self) -> Changes:
        """Say again what was taken back last."""
        return self._said("redo") if self._log.undone else Changes(notes=("there is nothing to repeat",))

    def _said(self, row: Correction | Literal["undo", "redo"]) -> Changes:
        log = self._log.and_then(row)
        self._solve(log)
        append(self.corrections_file, [row], self._video)
        self._log = log
        self.saved = False
        return self._refresh()

    def _solve(self, log: CorrectionLog) -> None:
        """Solve under corrections; after every twenty, at costs that are fitted to them."""
        fitted = len(log.said) // EVERY
        if fitted == self._fitted:
            self._flow.correct(log.said)
            return
        flow = CorrectedFlow(refitted(self._network, log.said[: EVERY * fitted]))
        flow.correct(log.said)
        self._flow, self._fitted = flow, fitted

    def _refresh(self) -> Changes:
        """Report anew, and what is other than before."""
        network, labels = self._flow.network, self._flow.labels()
        before = {track.id: track for track in getattr(self, "_tracks", [])}
        self._ids = track_ids(network.track, labels, self._reporter.most)
        self._tracks = self._reporter.tracks(network, self._ids, self._flow.demands.shown)
        named = self._flow.demands.names.items()
        self._names = {int(self._ids[n]): name for n, name in named if self._ids[n] and name}
        self._asked = None
        now = {track.id: track for track in self._tracks}
        changed = sorted(n for n in before.keys() | now.keys() if before.get(n) is not now.get(n))
        spans = [_span(before.get(n), now.get(n)) for n in changed]
        frames = (min(s[0] for s in spans), max(s[1] for s in spans)) if spans else None
        return Changes(frames, tuple(changed), tuple(self._flow.notes))

    def progress(self) -> Progress:
        """How far the review is."""
        return Progress(len(self._log.said), sum(question.wrong for question in self.questions(MOST_ASKED)))

    def save(self) -> None:
        """Write the tracks, and into ``run.json`` how many corrections and names they have; any thread may do it."""
        with self._saving:
            if self.saved:
                return
            self.saved = True
            tracks = self._tracks
            if not (self.folder / SOLVED_FILE).is_file():
                if not (self.folder / NETWORK_FILE).is_file():
                    # The text does not say which boxes were filled in.
                    self._replaced(NETWORK_FILE, self._network.write)
                self._replaced(SOLVED_FILE, lambda file: write_tracks(file, self._solved_tracks()))
            self._note_in_record(tracks)
            if (self.folder / "tracks.csv").is_file():
                self._replaced("tracks.csv", lambda file: write_table(file, table_of(tracks), {}))
            if (self.folder / ACTIONS_FILE).is_file():
                self._replaced(ACTIONS_FILE, lambda file: write_acting_tracks(file, *self._acting(tracks)))
            if (self.folder / "boxes.txt").is_file():
                boxes = np.full((self.n_frames, 4), np.nan)
                for track in tracks[:1]:
                    boxes[track.frames] = track.boxes
                self._replaced("boxes.txt", lambda file: write_boxes(file, boxes))
            self._replaced("tracks.txt", lambda file: write_tracks(file, tracks))

    def _acting(self, tracks: Sequence[Track]) -> tuple[list[ActingTrack], tuple[str, ...]]:
        """Tracks with actions, and the names of these; what the tracker left is kept beside."""
        kept = self.folder / SOLVED_ACTIONS
        if not kept.is_file():
            self._replaced(SOLVED_ACTIONS, lambda file: file.write_bytes((self.folder / ACTIONS_FILE).read_bytes()))
        solved, names = read_acting_tracks(kept, needed=False)
        return acting(tracks, solved), names

    def _replaced(self, name: str, write: Callable[[Path], object]) -> None:
        """Write a file of the result, which is there whole or as it was."""
        with output_file(self.folder / name, overwrite=True) as work:
            write(work)

    def _note_in_record(self, tracks: Sequence[Track]) -> None:
        path = self.folder / RUN_FILE
        record = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        record.setdefault("facts", {}).update(corrections=len(self._log.said), track_names=self.names())
        ours = (SOLVED_FILE, "tracks.txt", *([SOLVED_ACTIONS] if (self.folder / ACTIONS_FILE).is_file() else []))
        record["files"] = sorted({*record.get("files", []), *ours})
        record.setdefault("results", {}).setdefault(".", {})["filled"] = filled_frames(tracks)
        with whole_file(path) as file:
            file.write(record_text(record | {"frames": record.pop("frames", {})}).encode())

    def close(self) -> None:
        """Write the tracks, and let go of the result."""
        self.save()
        self._open.close()


def _span(one: Track | None, other: Track | None) -> tuple[int, int]:
    """First and last frame in which two states of a track differ."""
    tables = [
        {} if t is None else dict(zip(t.frames.tolist(), map(tuple, t.boxes.tolist()), strict=True))
        for t in (one, other)
    ]
    differ = [f for f in tables[0].keys() | tables[1].keys() if tables[0].get(f) != tables[1].get(f)]
    return (min(differ), max(differ)) if differ else (int(one.frames[0]), int(one.frames[-1])) if one else (0, 0)
