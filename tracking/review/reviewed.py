"""What the page shows of a session: its tracks as rows, its questions, and what each change changed."""

from __future__ import annotations

import math
import secrets
import threading
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import refusal
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import LONGEST_NAME, Box, Correction, CorrectionLog, Kind
from tsuiseki.tracking.formats.tracked_video import runs_of
from tsuiseki.tracking.review.questions import Question
from tsuiseki.tracking.review.session import Session
from tsuiseki.tracking.review.track_rows import rows_of
from tsuiseki.tracking.types import Track

# Frames whose rows the page gets at once.
CHUNK = 500
# Questions that the page gets at once.
SHOWN = 50


# Detections up to which questions are ranked within a request.
AT_ONCE = 20_000
STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
# Pixels: no picture reaches farther.
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Number = Annotated[int, Field(ge=0, le=1_000_000_000)]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AnswerRequest:
    """An answer to the question of a key."""

    key: Annotated[str, Field(max_length=100)]
    yes: bool


@dataclass(frozen=True, kw_only=True, config=STRICT)
class CorrectionRequest:
    """A correction as the page sends it, and `Session.made` takes it.

    Attributes:
        kind: of the correction; ``target`` is a ``point`` at which the target ``of`` is, as large as where it was last.
        frame: from 0.
        of: track that an added box belongs to.
        ids: of tracks.
        last: the other frame.
        name: of a track.
        box: x, y, width, height.
        point: x, y.
    """

    kind: Kind | Literal["target"]
    frame: Number = 0
    of: Number | None = None
    ids: Annotated[list[Number], Field(max_length=2)] = field(default_factory=list)
    last: Number | None = None
    name: Annotated[str, Field(max_length=LONGEST_NAME)] = ""
    box: Annotated[list[Coordinate], Field(min_length=4, max_length=4)] | None = None
    point: Annotated[list[Coordinate], Field(min_length=2, max_length=2)] | None = None


R = TypeVar("R", AnswerRequest, CorrectionRequest)


def request_as(kind: type[R], request: Mapping[str, Any]) -> R:
    """A request whose fields are all of the right kind and length; raises RequestError where one is not."""
    try:
        return kind(**request)
    except ValidationError as error:
        raise RequestError(f"{refusal(error)[:300]}; load the page again") from error


class Reviewed:
    """A session for the page, one change after the other; a ``note`` says why there are no pictures.

    Questions about much are ranked in the background: the state says so in ``ranking``.

    Attributes:
        rows: of all boxes.
        state: all that the page shows, except for boxes and pictures; with a ``version`` that changes with each change
            and each start.
    """

    def __init__(self, session: Session, name: str, note: str = "") -> None:
        self._session, self._about = session, {"name": name, "note": note, "pictures": not note}
        self._lock, self._changed, self._unranked = threading.Lock(), threading.Event(), threading.Event()
        self.state: dict[str, Any] = {}
        self._rows_of: CorrectionLog | None = None
        self._take_over()
        for work in (self._keep_saved, self._keep_ranked):
            threading.Thread(target=work, daemon=True).start()

    def change(self, what: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a person says: ``answer``, ``correct``, ``undo`` or ``redo``.

        Returns:
            The state, with a message in ``said``, ``changed`` (see `changes`), and the ``chunks`` that differ.

        Raises:
            RequestError: it says nothing that can be done.
        """
        with self._lock:
            message, changed = self._done(what, request)
            self._take_over()
            self._changed.set()
            differ = {n for _, first, last in changed for n in range(first // CHUNK, last // CHUNK + 1)}
            return {**self.state, "said": message, "changed": changed, "chunks": sorted(differ)}

    def chunk(self, number: int) -> bytes:
        """The rows of `CHUNK` frames."""
        begin, end = np.searchsorted(self.rows["frame"], [number * CHUNK, (number + 1) * CHUNK])
        return self.rows[begin:end].tobytes()

    def _keep_saved(self) -> None:
        """Write the tracks after each change, while the person goes on."""
        while self._changed.wait():
            self._changed.clear()
            try:
                self._session.save()
            except (RequestError, OSError) as error:
                self.state = {**self.state, "note": f"The tracks are not written: {error}", "version": _version()}

    def _keep_ranked(self) -> None:
        """Rank questions after each change that left them unranked."""
        while self._unranked.wait():
            self._unranked.clear()
            with self._lock:
                rank, log = self._session.ranking(), self._session.log
            questions = rank()
            with self._lock:
                if self._session.log is log:
                    self._session.ask(questions)
                    self._take_over()

    def _done(self, what: str, request: Mapping[str, Any]) -> tuple[str, list[tuple[int, int, int]]]:
        """Do it; what was done, for the person, and what changed."""
        session = self._session
        if what == "answer":
            answer = request_as(AnswerRequest, request)
            done, message = session.answer(answer.key, answer.yes), "yes" if answer.yes else "no"
        elif what == "correct":
            asked = request_as(CorrectionRequest, request)
            try:
                correction = self._correction(asked)
            except RequestError:
                raise
            except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
                raise RequestError("expected a correction of boxes that are there; load the page again") from error
            done, message = session.correct(correction), str(correction)
        elif what in ("undo", "redo") and not request:
            done = session.undo() if what == "undo" else session.redo()
            notes = "; ".join(done.notes) or ("undone" if what == "undo" else "done again")
            return _sentence(notes), done.tracks
        else:
            raise RequestError("expected an answer, a correction, undo or redo")
        return _sentence(message, *done.notes), done.tracks

    def _correction(self, asked: CorrectionRequest) -> Correction:
        kind, frame, of, ids, box = asked.kind, asked.frame, asked.of, asked.ids, asked.box
        if max(frame, asked.last or 0) >= self._session.n_frames:
            raise ValueError
        if kind == "target":
            if asked.point is None:
                raise ValueError
            (x, y), near = asked.point, self._session.made("real", [of or 1], frame).there[0]
            kind, box = "box", [x - near.width / 2, y - near.height / 2, near.width, near.height]
            if near.frame == frame:
                ids, of = [of or 1], None
        correction = self._session.made(kind, ids, frame, asked.last, asked.name, box)
        if of is None:
            return correction
        pair = (*self._session.made("real", [of], frame).boxes, *correction.boxes)
        return Correction("several", parts=(correction, Correction("same", pair)))

    def _take_over(self) -> None:
        """Take over what the session has now."""
        session, tracks = self._session, self._session.tracks()
        if not session.ranked and session.n_detections <= AT_ONCE:
            session.questions()
        questions = session.asked
        if self._rows_of is not session.log:
            self.rows, self._rows_of, self._boxes_version = rows_of(tracks), session.log, _version()
        self.state = {
            **self._about,
            "version": _version(),
            "size": session.size or self.rows["box"][:, 2:].max(axis=0, initial=1).tolist(),
            "frames": session.n_frames,
            "rate": session.frame_rate,
            "rows": len(self.rows),
            "boxes": self._boxes_version,
            "chunk": CHUNK,
            "tracks": [{"id": t.id, "name": session.names.get(t.id, ""), "spans": _spans(t)} for t in tracks],
            "questions": [_shown(question) for question in questions[:SHOWN]],
            "ranking": not session.ranked,
            "answered": session.answered,
            "noun": session.noun,
            "single": (session.folder / "boxes.txt").is_file() and len(tracks) == 1,
            # As many of the questions would probably be answered with no.
            "left": math.ceil(sum(question.wrong for question in questions) - 0.5),
        }
        if not session.ranked:
            self._unranked.set()


def _spans(track: Track) -> list[list[int]]:
    """The segments of a track without a gap, first and last frame."""
    return [track.frames[run[[0, -1]]].tolist() for run in runs_of(track.frames)]


def _version() -> str:
    return secrets.token_hex(4)


def _sentence(*texts: str) -> str:
    return " ".join(f"{text[:1].upper()}{text[1:]}." for text in texts)


def _shown(question: Question) -> dict[str, Any]:
    """A question as the page has it; boxes as rows of frame, id and corners, id 0 for those that it is ``about``."""
    yes, no = (
        [_row(box, number) for number, boxes in side.items() for box in boxes]
        for side in (question.boxes_a, question.boxes_b)
    )
    about = dict.fromkeys(
        box for answer in (question.yes, question.no) for part in (answer, *answer.parts) for box in part.there
    )
    about_it = {name: getattr(question, name) for name in ("key", "sentence", "frame")}
    ids = [*dict.fromkeys([*question.boxes_a, *question.boxes_b])]
    return {**about_it, "ids": ids, "yes": yes, "no": no, "about": [_row(box, 0) for box in about]}


def _row(box: Box, number: int) -> tuple[float, ...]:
    return box.frame, number, box.x, box.y, box.x + box.width, box.y + box.height
