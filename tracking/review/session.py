"""A result that a person corrects: questions, answers, corrections, and all of it on disk after each one."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any, Literal, NamedTuple, cast

import numpy as np

from tsuiseki.tracking.association.corrected_flow import EVERY, CorrectedFlow, refitted
from tsuiseki.tracking.association.corrected_tracks import Reporter, acting, corrected_bodies
from tsuiseki.tracking.association.correction_demands import Finder
from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.errors import RequestError, RunError
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
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import RUN_FILE, check_writable, hold, record_text, replaced_files
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.review.questions import Question, Questioner
from tsuiseki.tracking.review.track_rows import changes
from tsuiseki.tracking.types import IntArray, Track
from tsuiseki.tracking.types.tracks import BodyTrack, boxes_about
from tsuiseki.tracking.video.source import file_of, open_source

# Questions that are ranked at a time.
MOST_ASKED = 100
# Under which ``run.json`` has the `sum_of` the corrections that the tracks are under.
LOG_SUM = "corrections"
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
        log: of all corrections.
        ranked: the questions are those of the tracks as they are now.
        saved: the files of the result are as the tracks are now.

    Raises:
        RequestError: it is no result, it cannot be written to, or somebody else reviews it; the video has another size
            or length; the corrections beside it speak of another video.
    """

    def __init__(self, result: Path, source: str | Path | None = None) -> None:
        self.folder = Path(result)
        if not self.folder.is_dir():
            raise RequestError(f"expected the folder of a result to review, got {result}")
        self._saving = Lock()
        check_writable(self.folder)
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
            self.log = read_corrections(self.corrections_file, self._video) if there else CorrectionLog()
            self._reporter, self._flow, self._fitted = Reporter(solved), CorrectedFlow(self._network), 0
            self._costs, self._tracks = self._network, list[Track]()
            self._asked, self.ranked = list[Question](), False
            self._solve(self.log)
            self._refresh()
            # Of a review that was killed, the last corrections may not be in the tracks yet.
            written = record.get("results", {}).get(".", {}).get(LOG_SUM)
            if written is None and not self._result.facts.get("corrections"):
                written = sum_of(CorrectionLog())
            self._saved_log = self.log if written == sum_of(self.log) else None
            self._open = stack.pop_all()

    def _solved_tracks(self) -> list[Track]:
        solved, bodies = self.folder / SOLVED_FILE, self.folder / SOLVED_STATES
        if solved.is_file() and not bodies.is_file():
            return list(read_tracks(solved))
        self._bodies = read_states(bodies) if bodies.is_file() else self._result
        return boxes_about(self._bodies, self._result.names)

    def _find_video(self, source: str | Path | None) -> None:
        video = str(self._result.source if source is None else source)
        self.source: str | None = None
        if not video or (source is None and file_of(video) is None):
            return
        opened = open_source(video)
        self._result.check_source(opened, self.n_frames - 1)
        self.size = self.size or opened.size
        self.source = video if opened.has_images else None

    def tracks(self) -> Result[Track]:
        """The tracks as they are now."""
        names = ("settings", "seconds", "frames", "recording")
        attributes = {name: getattr(self._result, name) for name in names}
        attributes["facts"] = {**self._result.facts, "corrections": self.answered, "track_names": self.names}
        return Result(self._tracks, self._result.source, self.frame_rate, self.size, **attributes)

    @property
    def saved(self) -> bool:
        """Whether the files of the result have the tracks as they are now."""
        return self._saved_log is self.log

    @property
    def n_detections(self) -> int:
        """How many detections corrections are weighed among."""
        return len(self._network)

    @property
    def answered(self) -> int:
        """What was decided and not taken back."""
        return len(self.log.corrections)

    def questions(self) -> list[Question]:
        """What to ask next, the least certain first; nothing of tracks that no flow solved."""
        if not self.ranked:
            self.ask(self.ranking()())
        return self._asked

    def ranking(self) -> Callable[[], list[Question]]:
        """What ranks the questions as tracks are now: it takes long, and any thread may call it."""
        if self._network.given:
            return list
        flow, network, ids, noun = self._flow, self._flow.network, self._ids, self.noun
        settled, parted = flow.settled(), flow.parted()
        return lambda: Questioner(network, settled, ids, parted, noun).ranked(MOST_ASKED)

    def ask(self, questions: list[Question]) -> None:
        """Ask what was ranked for the tracks as they are now."""
        self._asked, self.ranked = questions, True

    @property
    def asked(self) -> list[Question]:
        """The questions as they were ranked last, without those about tracks that changed since."""
        return self._asked

    def answer(self, key: str, yes: bool) -> Changes:
        """Answer a question: yes for as it was solved, no for the other way.

        Raises:
            RequestError: there is no such question now; or see `correct`.
        """
        matches = [question for question in self._asked if question.key == key]
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
        return self._recorded("undo") if self.log.corrections else Changes([], ["there is nothing to take back"])

    def redo(self) -> Changes:
        """Say again what was taken back last."""
        return self._recorded("redo") if self.log.undone else Changes([], ["there is nothing to repeat"])

    def _recorded(self, row: Correction | Literal["undo", "redo"]) -> Changes:
        log = self.log.and_then(row)
        self._solve(log)
        try:
            append(self.corrections_file, [row], self._video)
        except RequestError:
            self._solve(self.log)
            raise
        self.log = log
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
        previous = self._tracks
        self._ids, self._tracks, self.names = self._reporter.reported(self._flow)
        changed = changes(previous, self._tracks)
        ids = {number for number, _, _ in changed}
        self._asked = [q for q in self._asked if not ids & {*q.boxes_a, *q.boxes_b}]
        self.ranked = False
        return Changes(changed, self._flow.notes)

    def save(self) -> None:
        """Write the tracks, and then into ``run.json`` what they are; any thread may do it.

        All files are written before one takes its place. Those that are there stay where the disk refuses that.

        Raises:
            RequestError, OSError: it does.
        """
        with self._saving:
            log, tracks, names = self.log, self._tracks, self.names
            if self._saved_log is log:
                return
            with replaced_files(self.folder) as work:
                for name, write in self._files(tracks).items():
                    write(work / name)
                self._write_record(work, log, tracks, names)
            self._saved_log = log

    def _files(self, tracks: Sequence[Track]) -> dict[str, Callable[[Path], object]]:
        """What writes each file that corrections change; what the tracker left is kept beside."""
        there = {path.name for path in self.folder.iterdir()}
        files: dict[str, Callable[[Path], object]] = {}
        if SOLVED_FILE not in there:
            if NETWORK_FILE not in there:
                # The text does not say which boxes were filled in.
                files[NETWORK_FILE] = self._network.write
            files[SOLVED_FILE] = lambda file: write_tracks(file, self._solved_tracks())
        originals = {ACTIONS_FILE: SOLVED_ACTIONS, STATES_FILE: SOLVED_STATES}
        for name, original in originals.items():
            if name in there and original not in there:
                content = (self.folder / name).read_bytes()
                files[original] = partial(Path.write_bytes, data=content)
        boxes = np.full((self.n_frames, 4), np.nan)
        for track in tracks[:1]:
            boxes[track.frames] = track.boxes
        writers: dict[str, Callable[[Path], object]] = {
            "tracks.csv": lambda file: write_table(file, table_of(tracks), {}),
            ACTIONS_FILE: lambda file: self._write_acting(file, tracks),
            STATES_FILE: lambda file: self._write_states(file, tracks),
            "boxes.txt": lambda file: write_boxes(file, boxes),
        }
        files |= {name: write for name, write in writers.items() if name in there}
        return files | {"tracks.txt": lambda file: write_tracks(file, tracks)}

    def _write_acting(self, file: Path, tracks: Sequence[Track]) -> None:
        original = self.folder / SOLVED_ACTIONS
        solved, names = read_acting_tracks(original if original.is_file() else self.folder / ACTIONS_FILE, needed=False)
        write_acting_tracks(file, acting(tracks, solved), names)

    def _write_states(self, file: Path, tracks: Sequence[Track]) -> None:
        names = self._result.names
        write_states(file, corrected_bodies(tracks, cast("Sequence[BodyTrack]", self._bodies), names), names)

    def _record(self) -> dict[str, Any]:
        path = self.folder / RUN_FILE
        return cast(dict[str, Any], read_json(path, "the record of a run")) if path.is_file() else {}

    def _write_record(self, work: Path, log: CorrectionLog, tracks: Sequence[Track], names: Mapping[int, str]) -> None:
        record = self._record()
        record.setdefault("facts", {}).update(corrections=len(log.corrections), track_names=names)
        record["files"] = sorted({*record.get("files", []), *(path.name for path in work.iterdir())})
        about = record.setdefault("results", {}).setdefault(".", {})
        about |= {"filled": filled_frames(tracks), LOG_SUM: sum_of(log)}
        text = record_text(record | {"frames": record.pop("frames", {})})
        (work / RUN_FILE).write_text(text, encoding="utf-8")

    def close(self) -> None:
        """Write the tracks, and let go of the result.

        Raises:
            RunError: they cannot be written.
        """
        try:
            self.save()
        except (RequestError, OSError) as error:
            raise RunError(
                f"{error}; {self.corrections_file} has all corrections, the tracks lack the last ones: make room, and "
                "start tsuiseki review again"
            ) from error
        finally:
            self._open.close()


def sum_of(log: CorrectionLog) -> str:
    """What tells logs from each other: 32 hexadecimal digits of their corrections."""
    rows = json.dumps([correction.written() for correction in log.corrections])
    return hashlib.sha256(rows.encode()).hexdigest()[:32]
