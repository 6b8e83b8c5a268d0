"""What the page shows of a session: its tracks as rows, its questions, and what each change changed."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Mapping
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.review.box_rows import CHUNK, changes, rows_of, spans_of
from tsuiseki.tracking.review.corrections import Correction
from tsuiseki.tracking.review.session import Question, Session
from tsuiseki.tracking.review.spoken import correction_of
from tsuiseki.tracking.types import Track

SAVED_AFTER = 1.0
"""Seconds after a change until the tracks are written; what was said is in its file before it is answered."""


class Reviewed:
    """A session for the page; one request after the other.

    Attributes:
        rows: of all boxes.
        state: all that the page shows, except for boxes and pictures; with a ``version`` that changes with each change
            and each start.
    """

    def __init__(self, session: Session, name: str, note: str, pictures: bool) -> None:
        self._session, self._about = session, {"name": name, "note": note, "pictures": pictures}
        self._lock, self._start, self._count = threading.Lock(), secrets.token_hex(4), 0
        self._timer = threading.Timer(0, self.save)
        self._look()

    def change(self, what: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a person says: ``answer``, ``correct``, ``undo`` or ``redo``.

        Returns:
            The state, with what is ``said`` of it, ``changed`` (see `changes`), and the ``chunks`` that differ.

        Raises:
            RequestError: it says nothing that can be done.
        """
        with self._lock:
            before = self.rows
            said = self._do(what, given)
            self._count += 1
            self._look()
            self._timer.cancel()
            self._timer = threading.Timer(SAVED_AFTER, self.save)
            self._timer.start()
            changed = changes(before, self.rows)
            differ = {n for _, first, last in changed for n in range(first // CHUNK, last // CHUNK + 1)}
            return {**self.state, "said": said, "changed": changed, "chunks": sorted(differ)}

    def save(self) -> None:
        """Write the tracks."""
        self._timer.cancel()
        with self._lock:
            self._session.save()

    def _do(self, what: str, given: Mapping[str, Any]) -> str:
        if what == "answer" and isinstance(given.get("key"), str) and isinstance(given.get("yes"), bool):
            self._session.answer(given["key"], given["yes"])
            return "Yes." if given["yes"] else "No."
        if what == "correct":
            correction = correction_of(given, self._tracks)
            self._session.correct(correction)
            return f"{str(correction)[:1].upper()}{str(correction)[1:]}."
        if what not in ("undo", "redo"):
            raise RequestError("expected an answer, a correction, undo or redo")
        self._session.undo() if what == "undo" else self._session.redo()
        return "Undone." if what == "undo" else "Redone."

    def _look(self) -> None:
        """Take over what the session has now."""
        session = self._session
        result, progress = session.tracks(), session.progress()
        tracks = [getattr(track, "track", track) for track in result]
        self._tracks: dict[int, Track] = {track.id: track for track in tracks}
        self.rows = rows_of(tracks)
        names: Mapping[int, str] = {}
        self.state = {
            **self._about,
            "version": f"{self._start}-{self._count}",
            "size": session.size,
            "frames": session.n_frames,
            "rate": session.frame_rate,
            "rows": len(self.rows),
            "chunk": CHUNK,
            "tracks": [
                {"id": number, "name": names.get(number, ""), "spans": spans}
                for number, spans in spans_of(self.rows).items()
            ],
            "questions": [_shown(question) for question in session.questions()],
            "answered": progress.answered,
            "left": progress.likely_errors_left,
        }


def _shown(question: Question) -> dict[str, Any]:
    """A question as the page has it; boxes as rows of frame, id and corners."""
    sides = [[[f, i, x, y, x + w, y + h] for f, x, y, w, h, i in side] for side in (question.boxes_a, question.boxes_b)]
    ids = dict.fromkeys(row[1] for side in sides for row in side)
    return {
        "key": question.key,
        "sentence": question.sentence,
        "frame": question.frame,
        "ids": [*ids],
        "yes": sides[0],
        "no": sides[1],
    }
