"""What a person says of tracks, and the file that keeps it: a JSON line each, appended and never changed.

A correction names boxes in frames, not ids, so that it can be applied to tracks of other settings or another detector.
In the file frames count from 1, and boxes are x, y, width, height in pixels from 0. Its first line says of which video
it speaks. Taking back and repeating are lines of their own.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.json_files import json_of

CORRECTIONS_FILE = "corrections.jsonl"
# How the file begins.
START = '{"video": '
Kind = Literal["same", "not_same", "next", "switch", "real", "not_person", "box", "name", "delete", "right", "several"]
# How many boxes each kind names, at least and at most, and what it says of them.
KINDS: Mapping[Kind, tuple[int, float, str]] = {
    "same": (2, 2, "{two} are the same"),
    "not_same": (2, 2, "{two} are not the same"),
    "next": (2, 2, "{two} are the same, not detected between"),
    "switch": (4, 4, "two tracks are exchanged from frame {last} on"),
    "real": (1, 1, "{one} is right"),
    "not_person": (1, 1, "{one} is a false positive"),
    "box": (1, 2, "{one} is {drawn}"),
    "name": (1, 1, "{one} is called {name}"),
    "delete": (1, math.inf, "the track of {one} is deleted"),
    "right": (2, math.inf, "the track from {one} to frame {last} is right"),
    "several": (0, 0, ""),
}


# Characters of a track's name.
LONGEST_NAME = 100
# Characters of the sentence of a correction.
LONGEST_SENTENCE = 1000
# What no text has: control characters, and halves of surrogate pairs, which UTF-8 cannot write.
NOT_TEXT = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")


class Box(NamedTuple):
    """A box in a frame, which counts from 0; pixels."""

    frame: int
    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Correction:
    """Something a person says.

    Attributes:
        kind: ``same``: the two boxes are one person; ``not_same``: they are two people; ``next``: one person, and no
            detection between; ``switch``: two people (last boxes before a frame) go on as each other (first boxes from
            it on); ``real``: a person, ``not_person``: none; ``box``: one box is added, or of two the first is moved to
            the second; ``name``: of the track; ``delete``: all boxes of a track; ``right``: the boxes of a segment;
            ``several``: the ``parts`` at once.
        boxes: that it speaks of, in the order above; of a switch None where there is none.
        name: of a track.
        parts: of several.
        sentence: for people; by default made of the rest.
    """

    kind: Kind
    boxes: tuple[Box | None, ...] = ()
    name: str = ""
    parts: tuple[Correction, ...] = ()
    sentence: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise RequestError(f"expected a correction {', '.join(KINDS)}, got {self.kind!r}")
        lowest, highest, _ = KINDS[self.kind]
        if not lowest <= len(self.boxes) <= highest or (self.kind == "several") != bool(self.parts):
            several = f"{lowest} boxes or more" if highest > 2 else "1 or 2 boxes"
            usual = f"{lowest} boxes" if highest == lowest else several
            raise RequestError(f"correction {self.kind}: expected {usual}, got {len(self.boxes)}")
        for text, longest in ((self.name, LONGEST_NAME), (self.sentence, LONGEST_SENTENCE)):
            if len(text) > longest or NOT_TEXT.search(text):
                got = f"{len(text)}" if len(text) > longest else f"{text[:40]!a}"
                raise RequestError(f"correction {self.kind}: expected a text of up to {longest} characters, got {got}")
        for box in self.boxes:
            if box is None and self.kind == "switch":
                continue
            if box is None or box.frame < 0 or not all(map(math.isfinite, box)) or min(box.width, box.height) <= 0:
                raise RequestError(f"correction {self.kind}: expected boxes in frames, with an area, got {box}")
        if self.kind in ("same", "not_same", "next") and self.there[0].frame == self.there[1].frame:
            raise RequestError(f"correction {self.kind}: expected boxes of two frames, got two of one")

    @property
    def there(self) -> list[Box]:
        """The boxes without gaps."""
        return [box for box in self.boxes if box is not None]

    def __str__(self) -> str:
        if self.sentence:
            return self.sentence
        if self.kind == "several":
            return "; ".join(map(str, self.parts))
        places = [
            f"the box at ({box.x + box.width / 2:.0f}, {box.y + box.height / 2:.0f}) in frame {box.frame + 1}"
            for box in self.there
        ]
        return KINDS[self.kind][2].format(
            one=places[0],
            two=f"{places[0]} and {places[-1]}",
            last=self.there[-1].frame + 1,
            drawn="added" if len(places) == 1 else "moved",
            name=self.name or "nothing",
        )

    def written(self) -> dict[str, Any]:
        """The correction as a row of the file: frames from 1, empty fields left out."""
        boxes = [None if box is None else [box.frame + 1, *(round(v, 2) for v in box[1:])] for box in self.boxes]
        row = {"kind": self.kind, "boxes": boxes, "name": self.name, "parts": [part.written() for part in self.parts]}
        return {key: value for key, value in (row | {"sentence": self.sentence}).items() if value}

    @classmethod
    def parse(cls, row: Any) -> Correction:
        """What `written` gave; raises RequestError where it is something else."""
        try:
            values = [None if b is None else [float(v) for v in b] for b in row.get("boxes", [])]
            boxes = tuple(None if b is None else Box(int(b[0]) - 1, *b[1:]) for b in values)
            parts = tuple(map(cls.parse, row.get("parts", [])))
            return cls(row["kind"], boxes, str(row.get("name", "")), parts, str(row.get("sentence", "")))
        except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
            raise RequestError(f"expected a correction with kind and boxes, got {json.dumps(row)[:80]}") from error


@dataclass(frozen=True)
class CorrectedVideo:
    """Of which video corrections speak.

    Attributes:
        video: its name.
        size: width and height; None where not known.
        frames: how many there are; 0 where not known.
    """

    video: str
    size: tuple[int, int] | None
    frames: int

    def check(self, about: CorrectedVideo, path: Path, slack: float = 0.0) -> None:
        """Refuse corrections ``about`` another video for this one, whose frames are known but for ``slack``.

        Raises:
            RequestError: it has another size or length; where neither is known, another name.
        """
        sizes, lengths = (self.size, about.size), (self.frames, about.frames)
        long = 0 not in lengths and abs(self.frames - about.frames) > slack
        if long or (None not in sizes and sizes[0] != sizes[1]):
            raise RequestError(f"{path}: expected corrections of {self}, got those of {about}")

    def __str__(self) -> str:
        size = "" if self.size is None else f" of {self.size[0]}x{self.size[1]} pixels"
        return f"{self.video or 'a video'}{size}" + (f" with {self.frames} frames" if self.frames else "")


@dataclass(frozen=True)
class CorrectionLog:
    """All corrections, in order; those taken back can be repeated until a new one comes."""

    corrections: tuple[Correction, ...] = ()
    undone: tuple[Correction, ...] = ()

    def and_then(self, row: Correction | Literal["undo", "redo"]) -> CorrectionLog:
        """The log after one more line; an undo or redo of nothing changes nothing."""
        if isinstance(row, Correction):
            return CorrectionLog((*self.corrections, row))
        if row == "undo":
            return CorrectionLog(self.corrections[:-1], (*self.undone, *self.corrections[-1:]))
        return CorrectionLog((*self.corrections, *self.undone[-1:]), self.undone[:-1])


def read_corrections(path: Path, of: CorrectedVideo | None = None, slack: float = 0.0) -> CorrectionLog:
    """The corrections in a file; a last line that a crash cut short is left out.

    They must speak ``of`` a video where it is given, whose length may be wrong by ``slack`` frames.

    Raises:
        RequestError: it cannot be read, holds something else, or speaks of another video.
    """
    try:
        lines = path.read_text(encoding="utf-8").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected corrections, JSON a line, got a file that cannot be read") from error
    log = CorrectionLog()
    # Of a line that a crash cut short the beginning is there.
    if not _is_json(lines[-1]) and (len(lines) > 1 or START.startswith(lines[0][: len(START)])):
        del lines[-1]
    for number, line in enumerate(lines, 1):
        row = json_of(line, f"{path}, line {number}", "a correction as JSON")
        try:
            if number == 1:
                size = row["size"]
                about = CorrectedVideo(
                    str(row["video"]), None if size is None else (size[0], size[1]), int(row["frames"])
                )
                if of is not None:
                    of.check(about, path, slack)
            else:
                log = log.and_then(row["kind"] if row.get("kind") in ("undo", "redo") else Correction.parse(row))
        except RequestError as error:
            raise RequestError(str(error) if number == 1 else f"{path}, line {number}: {error}") from error
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise RequestError(f"{path}, line {number}: expected a correction as JSON, got {line[:60]!r}") from error
    return log


def _is_json(line: str) -> bool:
    try:
        json_of(line, "", "a correction")
    except RequestError:
        return False
    return True


def append(path: Path, rows: Iterable[Correction | Literal["undo", "redo"]], of: CorrectedVideo) -> None:
    """Append lines to the file, which begins with its video, and wait until the disk has them: all or none.

    Raises:
        RequestError: the file cannot be written to.
    """
    texts = [{"kind": row} if isinstance(row, str) else row.written() for row in rows]
    head, *lines = (json.dumps(text).encode() + b"\n" for text in (asdict(of), *texts))
    try:
        # Without a buffer, nothing is written late.
        with path.open("ab+", buffering=0) as file:
            file.seek(0)
            content = file.read()
            last = content.rpartition(b"\n")[2]
            if is_whole := _is_json(last.decode(errors="replace")):
                lines.insert(0, b"\n")
            length = len(content) if is_whole else len(content) - len(last)
            file.truncate(length)  # a crash cut the last line short
            left = b"".join(lines if length else [head, *lines])
            try:
                while left:
                    left = left[file.write(left) :]
                os.fsync(file.fileno())
            except OSError:
                file.truncate(length)
                raise
    except OSError as error:
        raise RequestError(f"cannot write to {path}: {error.strerror}") from error


def boxes_of(frames: Sequence[int], boxes: Iterable[Sequence[float]]) -> tuple[Box, ...]:
    """``(T,)`` frames and ``(T, 4)`` corners as boxes."""
    corners = ([float(v) for v in box] for box in boxes)
    return tuple(Box(int(f), x1, y1, x2 - x1, y2 - y1) for f, (x1, y1, x2, y2) in zip(frames, corners, strict=True))
