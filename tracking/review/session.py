"""A result that a person corrects: questions, answers, corrections, and all of it on disk after each one."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal, NamedTuple, cast

import numpy as np

from tsuiseki.tracking.association.corrected_flow import EVERY, CorrectedFlow, refitted
from tsuiseki.tracking.association.corrected_tracks import Reporter, acting, corrected_bodies
from tsuiseki.tracking.association.correction_demands import Finder
from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks, write_acting_tracks
from tsuiseki.tracking.formats.body_states import read_states, write_states
from tsuiseki.tracking.formats.correction_log import (
    CORRECTIONS_FILE,
    Box,
    CorrectedVideo,
    Correction,
    CorrectionLog,
    Kind,
    append,
    boxes_of,
    read_corrections,
)
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.formats.result_folder import (
    ACTIONS_FILE,
    SOLVED_ACTIONS,
    SOLVED_FILE,
    SOLVED_STATES,
    STATES_FILE,
    filled_frames,
)
from tsuiseki.tracking.formats.single import write_boxes
from tsuiseki.tracking.formats.track_tables import table_of, write_table
from tsuiseki.tracking.output import RUN_FILE, hold, output_file, record_text, whole_file
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.review.questions import Question, Questioner
from tsuiseki.tracking.review.track_rows import changes
from tsuiseki.tracking.types import IntArray, Track
from tsuiseki.tracking.types.tracks import BodyTrack, boxes_about
from tsuiseki.tracking.video.source import open_source

# Questions that are ranked at a time.
MOST_ASKED = 100
# What commands track; others, and classes of choice, are targets.
NOUNS = {"people": "person", "drone": "person", "fisheye": "person", "animals": "animal"}


class Changes(NamedTuple):
    """What a correction changed: id, first and last frame of each track, see `changes`, and lines for the person."""

    tracks: list[tuple[int, int, int]]
    notes: list[str]


class Session:
    """A result folder that one person corrects at a time.

    Args:
        result: folder that ``tsuiseki track people`` or ``drone`` wrote.
        source: the video; by default that of the result, where it is still there.

    Attributes:
        folder: the result.
        corrections_file: to which every correction is appended.
        names: of tracks, by id.
        noun: what is tracked, by the command of the result: person, animal or target.
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
        self._saving = Lock()
        with ExitStack() as stack:
            busy = f"somebody reviews {result} at this moment, or a run writes it; wait or end that"
            hold(self.folder, busy, stack)
            self._result: Result[Any] = Result.load(self.folder)
            solved = self._solved_tracks()
            self.frame_rate = self._result.frame_rate or 25.0
            last = max((int(track.frames[-1]) for track in solved), default=-1)
            self.n_frames = max([last, *self._result.frames.get("frame", ())]) + 1
            self.size = self._result.size
            record = self._record()
            chosen = self._result.settings.get("classes")
            self.noun = "target" if chosen else NOUNS.get(record.get("command", ["people"])[-1], "target")
            self._find_video(source)
            self._video = CorrectedVideo(self._result.name if self._result.source else "", self.size, self.n_frames)
            path = self.folder / NETWORK_FILE
            self._network = SolvedNetwork.read(path) if path.is_file() else network_of_tracks(solved, self.frame_rate)
            self.corrections_file = self.folder / CORRECTIONS_FILE
            there = self.corrections_file.is_file()
            self._log = read_corrections(self.corrections_file, self._video) if there else CorrectionLog()
            self._reporter, self._flow, self._fitted = Reporter(solved), CorrectedFlow(self._network), 0
            self._costs, self._tracks = self._network, list[Track]()
            self._asked: list[Question] | None = None
            self._solve(self._log)
            self._refresh()
            # Of a review that was killed, the last corrections may not be in the tracks yet.
            self.saved = self._result.facts.get("corrections", 0) == len(self._log.corrections)
            self._open = stack.pop_all()

    def _solved_tracks(self) -> list[Track]:
        solved, bodies = self.folder / SOLVED_FILE, self.folder / SOLVED_STATES
        if solved.is_file() and not bodies.is_file():
            return list(read_tracks(solved))
        self._bodies = read_states(bodies) if bodies.is_file() else self._result
        return boxes_about(self._bodies, self._result.names)

    def _find_video(self, source: str | Path | None) -> None:
        video = source if source is not None else self._result.source
        self.source: str | None = None
        if not video or (source is None and not Path(str(video)).exists()):
            return
        opened = open_source(str(video))
        size, length = opened.size, opened.length
        if size is not None and self.size is not None and size != self.size:
            raise RequestError(
                f"{video}: expected frames of {self.size[0]}x{self.size[1]} pixels as in the result, got "
                f"{size[0]}x{size[1]}"
            )
        if length is not None and length < self.n_frames:
            raise RequestError(f"{video}: expected {self.n_frames} frames as in the result, got {length}")
        self.size = self.size or size
        self.source = str(video) if opened.has_images else None

    def tracks(self) -> Result[Track]:
        """The tracks as they are now."""
        attributes = {name: getattr(self._result, name) for name in ("settings", "facts", "seconds", "frames")}
        attributes["facts"] = {**attributes["facts"], "corrections": self.answered, "track_names": self.names}
        return Result(self._tracks, self._result.source, self.frame_rate, self.size, **attributes)

    @property
    def answered(self) -> int:
        """What was decided and not taken back."""
        return len(self._log.corrections)

    def questions(self) -> list[Question]:
        """What to ask next, the least certain first; nothing of tracks that no flow solved."""
        if self._asked is None:
            flow = self._flow
            asker = Questioner(flow.network, flow.settled(), self._ids, flow.parted(), self.noun)
            self._asked = [] if self._network.given else asker.ranked(MOST_ASKED)
        return self._asked

    def answer(self, key: str, yes: bool) -> Changes:
        """Answer a question: yes for as it was solved, no for the other way.

        Raises:
            RequestError: there is no such question now; or see `correct`.
        """
        matches = [question for question in self._asked or [] if question.key == key]
        if not matches:
            raise RequestError(f"expected the key of a question that was asked, got {key}; ask for the questions again")
        answer_given = matches[0].yes if yes else matches[0].no
        return self.correct(replace(answer_given, sentence=f"{matches[0].sentence} {'Yes' if yes else 'No'}"))

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
            ids: one track, or two: the same or not the same, one in ``frame`` and the other in ``last``; to switch. One
                that is not the same is another from ``frame`` on.
            frame: from 0; where a track has no detection there, the nearest is meant.
            last: the other frame, or the end of a segment that is right; by default the same.
            name: of a track.
            box: x, y, width and height: the box that is added, or moved where there is an id.

        Raises:
            RequestError: there is no such track.
        """
        last = frame if last is None else last
        if kind == "switch" or (kind == "not_same" and len(ids) == 1):
            last_boxes = [self._boxes(n, lambda frames: np.flatnonzero(frames < frame)[-1:]) for n in ids]
            first_boxes = [self._boxes(n, lambda frames: np.flatnonzero(frames >= frame)[:1]) for n in ids]
            if kind == "not_same" and not (last_boxes[0] and first_boxes[0]):
                raise RequestError(f"expected a frame within track {ids[0]} to part it, got {frame + 1}")
            return Correction(kind, tuple(boxes[0] if boxes else None for boxes in (*last_boxes, *first_boxes)))
        if kind in ("delete", "right"):
            first, end = (0, self.n_frames) if kind == "delete" else (frame, last)
            boxes = self._boxes(ids[0], lambda frames: (frames >= first) & (frames <= end))
            if kind == "right" and len(boxes) < 2:
                raise RequestError(
                    f"expected two detections or more of track {ids[0]} in frames {first + 1} to {end + 1}, got "
                    f"{len(boxes)}; choose a longer segment"
                )
            return Correction(kind, boxes)
        drawn = (Box(frame, *(float(v) for v in box)),) if kind == "box" and box is not None else ()
        near = [
            self._boxes(n, lambda frames, at=at: [np.abs(frames - at).argmin()])[0]  # type: ignore[misc]
            for n, at in zip(ids, (frame, frame if drawn else last), strict=False)
        ]
        return Correction(kind, (*near, *drawn), name)

    def _boxes(self, number: int, which: Callable[[IntArray], Any]) -> tuple[Box, ...]:
        """Those rows of a track that ``which`` chooses by their frames."""
        rows, network = np.flatnonzero(self._ids == number), self._flow.network
        if number < 1 or len(rows) == 0:
            raise RequestError(f"expected the id of a track, got {number}")
        rows = rows[np.argsort(network.frames[rows], kind="stable")]
        rows = rows[which(network.frames[rows])]
        return boxes_of(network.frames[rows].tolist(), network.boxes[rows].tolist())

    def correct(self, correction: Correction) -> Changes:
        """Do what a person says; it is among the corrections on disk when this returns.

        Raises:
            RequestError: it contradicts what was decided before, or speaks of boxes that are not there.
        """
        find = Finder(self._flow.network.frames, self._flow.network.boxes)
        parts = correction.parts or (correction,)
        drawn = {p.there[-1] for p in parts if p.kind == "box"}
        width, height = self.size or (math.inf, math.inf)
        for box in drawn:
            outside = min(box.x + box.width, box.y + box.height, width - box.x, height - box.y) <= 0
            if outside or box.frame >= self.n_frames:
                raise RequestError(f"{correction}: expected a box in the picture of frame 1 to {self.n_frames}")
        referenced = [b for p in parts if p.kind not in ("box", "real", "delete", "right") for b in p.there]
        if any(b not in drawn and find(b) < 0 for b in referenced):
            raise RequestError(f"{correction}: no detection is there; add the box first")
        return self._recorded(correction)

    def undo(self) -> Changes:
        """Take back what was decided last."""
        return self._recorded("undo") if self._log.corrections else Changes([], ["there is nothing to take back"])

    def redo(self) -> Changes:
        """Say again what was taken back last."""
        return self._recorded("redo") if self._log.undone else Changes([], ["there is nothing to repeat"])

    def _recorded(self, row: Correction | Literal["undo", "redo"]) -> Changes:
        log = self._log.and_then(row)
        self._solve(log)
        append(self.corrections_file, [row], self._video)
        self._log, self.saved = log, False
        return self._refresh()

    def _solve(self, log: CorrectionLog) -> None:
        """Solve under corrections, at costs that are fitted to them after every so many."""
        flow, fitted = self._flow, len(log.corrections) // EVERY
        if fitted != self._fitted:
            network = refitted(self._network, log.corrections[: EVERY * fitted])
            if network is not self._costs:
                flow = CorrectedFlow(network)
            self._costs = network
        flow.correct(log.corrections)
        self._flow, self._fitted = flow, fitted

    def _refresh(self) -> Changes:
        """Report anew, and what is other than before."""
        previous, self._asked = self._tracks, None
        self._ids, self._tracks, self.names = self._reporter.reported(self._flow)
        return Changes(changes(previous, self._tracks), self._flow.notes)

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
            boxes = np.full((self.n_frames, 4), np.nan)
            for track in tracks[:1]:
                boxes[track.frames] = track.boxes
            for name, write in (
                ("tracks.csv", lambda file: write_table(file, table_of(tracks), {})),
                (ACTIONS_FILE, lambda file: self._write_acting(file, tracks)),
                (STATES_FILE, lambda file: self._write_states(file, tracks)),
                ("boxes.txt", lambda file: write_boxes(file, boxes)),
            ):
                if (self.folder / name).is_file():
                    self._replaced(name, write)
            self._replaced("tracks.txt", lambda file: write_tracks(file, tracks))

    def _write_acting(self, file: Path, tracks: Sequence[Track]) -> None:
        """Tracks with actions; what the tracker left is kept beside."""
        original = self.folder / SOLVED_ACTIONS
        if not original.is_file():
            self._replaced(SOLVED_ACTIONS, lambda copy: copy.write_bytes((self.folder / ACTIONS_FILE).read_bytes()))
        solved, names = read_acting_tracks(original, needed=False)
        write_acting_tracks(file, acting(tracks, solved), names)

    def _write_states(self, file: Path, tracks: Sequence[Track]) -> None:
        """Animals under corrections; what the tracker left is kept beside."""
        solved, names = cast("Sequence[BodyTrack]", self._bodies), self._result.names
        if not (self.folder / SOLVED_STATES).is_file():
            self._replaced(SOLVED_STATES, lambda work: write_states(work, solved, names))
        write_states(file, corrected_bodies(tracks, solved, names), names)

    def _replaced(self, name: str, write: Callable[[Path], object]) -> None:
        """Write a file of the result, which is there whole or as it was."""
        with output_file(self.folder / name, overwrite=True) as work:
            write(work)

    def _record(self) -> dict[str, Any]:
        path = self.folder / RUN_FILE
        return cast(dict[str, Any], json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}

    def _note_in_record(self, tracks: Sequence[Track]) -> None:
        path, record = self.folder / RUN_FILE, self._record()
        record.setdefault("facts", {}).update(corrections=self.answered, track_names=self.names)
        originals = {SOLVED_ACTIONS: ACTIONS_FILE, SOLVED_STATES: STATES_FILE}
        ours = [SOLVED_FILE, "tracks.txt", *(name for name, of in originals.items() if (self.folder / of).is_file())]
        record["files"] = sorted({*record.get("files", []), *ours})
        record.setdefault("results", {}).setdefault(".", {})["filled"] = filled_frames(tracks)
        with whole_file(path) as file:
            file.write(record_text(record | {"frames": record.pop("frames", {})}).encode())

    def close(self) -> None:
        """Write the tracks, and let go of the result."""
        self.save()
        self._open.close()
