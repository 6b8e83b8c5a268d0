"""Detections that are there already: in a file, or of a call."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.association.inference_times import inferred_frames, named_frames, stride_of
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.interchange import BadBoxes, DetectionsLike, as_detections
from tsuiseki.tracking.types import BoolArray, Detections
from tsuiseki.tracking.types.class_choice import ClassChoice
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
    given: GivenDetections,
    source: Source,
    score_range: tuple[float, float] | None = None,
    choice: ClassChoice | None = None,
    names: Sequence[str] | None = None,
) -> GivenRows:
    """Detections that are there already, up to the end of the video as far as it is known.

    Args:
        given: a file (MOTChallenge ``det.txt``), or one entry a frame.
        source: the video.
        score_range: smallest and largest score that the rows of a file may have; by default any.
        choice: the classes that are wanted; by default all.
        names: of the classes in order, from 0, where the detections do not tell them.

    Raises:
        RequestError: see `read_detections`, `as_detections` and `ClassChoice`; or the video is shorter.
    """
    what, bad = given if isinstance(given, str | Path) else "`detections`", BadBoxes()
    if isinstance(given, str | Path):
        # The header of a video file only estimates its length: what is too much shows when the video has ended.
        detections = read_detections(given, source.length, score_range)
    else:
        if not isinstance(given, Iterable) or isinstance(given, Mapping):
            raise RequestError(f"`detections`: expected a file, or boxes of each frame, got {type(given).__name__}")
        given = list(given)
        if source.length is not None and len(given) > source.length:
            raise RequestError(
                f"expected detections for {source.length} frames, one entry a frame, got {len(given)}; are these the "
                "detections of another video?"
            )
        detections = [as_detections(entry, counted=bad) for entry in given]
        if 2 * bad.bad > bad.total:
            raise RequestError(
                f"{what}: {bad.bad} of {bad.total} boxes have no area or are not finite; expected x1, y1, x2, y2, not "
                "x, y, width, height"
            )
    boxes = np.concatenate([np.empty((0, 4)), *(each.boxes for each in detections)])
    compare_with_picture(what, boxes, source.picture_size)
    there = {int(number) for each in detections for number in np.unique(each.origin[:, 1])} - {-1}
    if choice is None:
        if isinstance(given, str | Path) and len(there) > 1:
            warnings.warn(
                f"{given}: detections of the classes {','.join(map(str, sorted(there)))} are tracked as one; give "
                "`classes` to track each apart",
                InputWarning,
                stacklevel=2,
            )
        return GivenRows(detections, bad)
    if any(each.classes is None and len(each) for each in detections):
        raise RequestError(f"`classes`: expected classes with the boxes of {what}, got boxes without; leave it out")
    named = {number: name for each in detections for number, name in each.names.items()}
    known, named = there | named.keys(), named or dict(enumerate(names or ()))
    numbers = choice.numbers(named, known, what)
    chosen = (replace(each.select(np.isin(each.origin[:, 1], numbers)), names=named) for each in detections)
    return GivenRows(chosen, bad)


def frames_with_inference(
    detect: Detect | Sequence[Detections], source: Source, given: Iterable[int] | None = None
) -> BoolArray | None:
    """``(F,)`` the frames with inference of given detections; None for all. A pattern is reported.

    Args:
        detect: a detector runs on all frames.
        source: the video.
        given: 0-based numbers of the frames, where the user gives them; by default see `inferred_frames`.

    Raises:
        RequestError: see `named_frames`; or there is a detector.
    """
    if not isinstance(detect, Sequence):
        if given is not None:
            raise RequestError("expected `inference_frames` with `detections`, got it with a detector")
        return None
    length = max(source.length or 0, len(detect))
    if given is not None:
        return named_frames(given, length)
    inferred = inferred_frames(np.array([*map(len, detect), *[0] * (length - len(detect))], dtype=np.int64))
    if inferred is not None:
        stride = stride_of(inferred)
        every = f"{stride:g}th" if stride == round(stride) else f"{stride:.3g}th, on average,"
        warnings.warn(
            f"there are detections in {inferred.sum()} of {len(inferred)} frames, every {every} one; the others count "
            "as frames without inference, and no person counts as missed in them",
            InputWarning,
            stacklevel=2,
        )
    return inferred
