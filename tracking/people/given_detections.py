"""Detections that are there already: in a file, or of a call."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.association.inference_times import inferred_frames, named_frames
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.interchange import BadBoxes, DetectionsLike, as_detections
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames
from tsuiseki.tracking.video.source import Source

GivenDetections: TypeAlias = str | Path | Iterable[DetectionsLike]


class GivenRows(list[Detections]):
    """Detections that a call has given, an entry a frame.

    Attributes:
        bad: boxes that are none, and left out.
    """

    def __init__(self, rows: Iterable[Detections], bad: BadBoxes) -> None:
        super().__init__(rows)
        self.bad = bad


def given_detections(
    detections: GivenDetections,
    source: Source,
    score_range: tuple[float, float] | None = None,
    choice: ClassChoice | None = None,
    names: Sequence[str] | None = None,
) -> GivenRows:
    """Detections that are there already, up to the end of the video as far as it is known.

    Args:
        detections: a file (MOTChallenge ``det.txt``), or one entry a frame.
        source: the video.
        score_range: smallest and largest score that the rows of a file may have; by default any.
        choice: the classes that are wanted; by default all.
        names: of the classes in order, from 0, where the detections do not tell them.

    Raises:
        RequestError: see `read_detections`, `as_detections` and `ClassChoice`; or the video is shorter.
    """
    if isinstance(detections, str | Path):
        # The header of a video file only estimates its length: what is too much shows when the video has ended.
        rows, what = GivenRows(read_detections(detections, source.length, score_range), BadBoxes()), detections
    else:
        rows, what = _checked_entries(detections, source.length), "`detections`"
    compare_with_picture(what, np.concatenate([np.empty((0, 4)), *(row.boxes for row in rows)]), source.size)
    numbers = {int(number) for row in rows for number in np.unique(row.origin[:, 1])} - {-1}
    if choice is None:
        if isinstance(detections, str | Path) and len(numbers) > 1:
            warnings.warn(
                f"{what}: detections of the classes {','.join(map(str, sorted(numbers)))} are tracked as one; give "
                "`classes` to track each apart",
                InputWarning,
                stacklevel=2,
            )
        return rows
    if any(row.classes is None and len(row) for row in rows):
        raise RequestError(f"`classes`: expected classes with the boxes of {what}, got boxes without; leave it out")
    named = {number: name for row in rows for number, name in row.names.items()}
    numbers, named = numbers | named.keys(), named or dict(enumerate(names or ()))
    chosen = choice.numbers(named, numbers, what)
    return GivenRows((replace(row.select(np.isin(row.origin[:, 1], chosen)), names=named) for row in rows), rows.bad)


def _checked_entries(entries: Iterable[DetectionsLike], length: int | None) -> GivenRows:
    if not isinstance(entries, Iterable) or isinstance(entries, Mapping):
        raise RequestError(f"`detections`: expected a file, or boxes of each frame, got {type(entries).__name__}")
    entries, bad = list(entries), BadBoxes()
    if length is not None and len(entries) > length:
        raise RequestError(
            f"expected detections for {length} frames, one entry a frame, got {len(entries)}; are these the detections "
            "of another video?"
        )
    rows = GivenRows((as_detections(entry, counted=bad) for entry in entries), bad)
    if 2 * bad.bad > bad.total:
        raise RequestError(
            f"`detections`: {bad.bad} of {bad.total} boxes have no area or are not finite; expected x1, y1, x2, y2, "
            "not x, y, width, height"
        )
    return rows


def frames_with_inference(detections: Sequence[Detections], source: Source) -> InferenceFrames:
    """The frames with inference of given detections, see `inferred_frames`. A pattern is reported.

    Args:
        detections: of each frame.
        source: the video.
    """
    length = max(source.length or 0, len(detections))
    inferred = inferred_frames(np.array([*map(len, detections), *[0] * (length - len(detections))], dtype=np.int64))
    if inferred is None:
        return ALL_INFERRED
    frames = named_frames(np.flatnonzero(inferred))
    stride = frames.stride
    ordinal = f"{stride:g}th" if stride == round(stride) else f"{stride:.3g}th, on average,"
    warnings.warn(
        f"there are detections in {inferred.sum()} of {len(inferred)} frames, every {ordinal} one; the others "
        "count as frames without inference, and no person counts as missed in them",
        InputWarning,
        stacklevel=2,
    )
    return frames
