"""Boxes that a reviewer marked as a person or as background: certain labels of `tsuiseki adapt`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.review.correction_log import CORRECTIONS_FILE, CorrectedVideo, Correction, read_corrections
from tsuiseki.tracking.types import FloatArray, IntArray

BACKGROUND, PERSON, DRAWN = 0, 1, 2
SAME = 0.5
"""Intersection over union from which two boxes of a frame are one."""


@dataclass(frozen=True)
class CertainBoxes:
    """What corrections say of boxes.

    Attributes:
        frames: ``(N,)`` 0-based.
        boxes: ``(N, 4)`` pixels.
        kinds: ``(N,)`` `BACKGROUND`, `PERSON`, or `DRAWN` for a person whose box was drawn by hand.
    """

    frames: IntArray
    boxes: FloatArray
    kinds: IntArray

    def at(self, frame: int) -> CertainBoxes:
        """Those of one frame."""
        here = self.frames == frame
        return CertainBoxes(self.frames[here], self.boxes[here], self.kinds[here])

    def on(self, frames: IntArray, boxes: FloatArray) -> IntArray:
        """Kinds of those that lie on a track, whose ``(T,)`` ``frames`` increase."""
        place = np.searchsorted(frames, self.frames).clip(max=len(frames) - 1)
        alike = iou_pairs(boxes[place], self.boxes) >= SAME
        return np.asarray(self.kinds[alike & (frames[place] == self.frames)])


def corrections_in(path: Path, sources: Sequence[str]) -> Path:
    """The file of corrections of the only source: itself, or that of a reviewed result.

    Raises:
        RequestError: it is not there, or there are more sources.
    """
    if len(sources) > 1:
        raise RequestError(f"`corrections` speak of one video, got {len(sources)}; adapt to the corrected one")
    file = path / CORRECTIONS_FILE if path.is_dir() else path
    if not file.is_file():
        raise RequestError(f"`corrections`: expected a reviewed result or its {CORRECTIONS_FILE}, got {path}")
    return file


def certain_boxes(file: Path, size: tuple[int, int]) -> CertainBoxes:
    """The boxes of corrections of a video of a ``size``.

    Raises:
        RequestError: they cannot be read, or speak of a video of another size.
    """
    labelled = [row for one in read_corrections(file, CorrectedVideo("", size, 0)).given for row in _boxes(one)]
    rows = np.array(labelled, dtype=np.float64).reshape(-1, 6)
    boxes = np.column_stack([rows[:, 1:3], rows[:, 1:3] + rows[:, 3:5]])
    return CertainBoxes(rows[:, 0].astype(np.int64), boxes, rows[:, 5].astype(np.int64))


def _boxes(one: Correction) -> Iterator[tuple[float, ...]]:
    for part in one.parts:
        yield from _boxes(part)
    kind = {"not_person": BACKGROUND, "delete": BACKGROUND, "box": DRAWN}.get(one.kind, PERSON)
    yield from ((*box, kind) for box in one.there[-1 if one.kind == "box" else 0 :])
