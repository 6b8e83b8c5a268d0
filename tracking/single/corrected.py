"""One target again, from where a person says that it is: forward from each box, and back from it until both agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import Estimate, FloatArray, Frame
from tsuiseki.tracking.video.source import Source

BACK = 300
"""Frames that are followed back from a correction at most; so many pictures are held."""
AGREED = 0.5
"""Overlap (IoU) from which the way forward and the way back are at one place."""


def corrected_boxes(path: Path, source: Source) -> dict[int, FloatArray]:
    """Boxes ``(4,)`` of the target by 0-based frame, from corrections of a result.

    Raises:
        RequestError: the file cannot be read, speaks of a video of another size, or moves or adds no box.
    """
    from tsuiseki.tracking.review.correction_log import CorrectedVideo, read_corrections
    from tsuiseki.tracking.review.demands import corners

    file = read_corrections(path, CorrectedVideo(Path(source.name).name, source.size, 0)).given
    parts = [part for one in file for part in (one.parts or (one,)) if part.kind == "box"]
    if not parts:
        raise RequestError(f"{path}: expected boxes that show where the target is, got none")
    return {part.there[-1].frame: corners(part.there[-1]) for part in parts}


def from_both_sides(
    followed: Iterable[tuple[Frame, Estimate]], boxes: Mapping[int, FloatArray], tracker: SingleTracker
) -> Iterator[tuple[Frame, Estimate]]:
    """What was followed, and before each given box what is followed back from it, until that agrees with the former.

    Args:
        followed: frames with the target, begun anew at each of the boxes.
        boxes: ``(4,)`` each, by frame.
        tracker: for the way back.
    """
    held: list[tuple[Frame, Estimate]] = []
    for frame, estimate in followed:
        if frame.index in boxes:
            yield from _back(held, boxes, tracker, frame)
            held = []
        held.append((frame, estimate))
        if len(held) > BACK:
            yield held.pop(0)
    yield from held


def _back(
    held: list[tuple[Frame, Estimate]], boxes: Mapping[int, FloatArray], tracker: SingleTracker, last: Frame
) -> list[tuple[Frame, Estimate]]:
    """The frames before ``last``, with the target as it is followed back from there."""
    tracker.start(last.image, boxes[last.index])
    found = held.copy()
    for n, (frame, before) in reversed([*enumerate(held)]):
        now = tracker.follow(frame.image)
        agreed = before.status == "tracking" and iou_matrix(now.box[None], before.box[None])[0, 0] >= AGREED
        if now.status == "lost" or agreed or frame.index in boxes:
            break
        found[n] = frame, Estimate(before.frame, now.box, now.score, now.status)
    return found
