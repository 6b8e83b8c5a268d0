"""One target through a video, from its box in the first frame."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.single import find_single_sequences, has_labels
from tsuiseki.tracking.geometry import corners_from_xywh
from tsuiseki.tracking.single.interface import SingleTracker, follow_target
from tsuiseki.tracking.single.methods import METHODS, SingleMethod, SinglePreset, make_tracker
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.types import Estimate, FloatArray, Frame, ImageArray, Status
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.video.source import Source, open_source


def follow(
    source: str | Path | int,
    box: Sequence[float] | ArrayLike | None = None,
    method: SingleMethod | SingleTracker = "combined",
    *,
    preset: SinglePreset = "robust",
    frames: str | None = None,
    seed: int = 0,
) -> Iterator[tuple[Frame, Estimate]]:
    """One target of any kind: each frame with the target's box, a score, and whether to believe it.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, VOT, UAV123), the number of a
            webcam or the address of a stream.
        box: ``(4,)`` the target in the first frame, x1, y1, x2, y2 in 0-based pixels; a labelled sequence folder has
            its own.
        method: ``combined`` is a correlation filter with colours and sizes that particles help when the target is
            hidden; ``kcf`` is a plain filter, and faster; ``kcf-particle`` is the thesis's way of joining filter and
            particles; or a tracker of one target.
        preset: constants of the last two: ``robust`` is ours; ``thesis``, ``printed`` (``kcf-particle`` only: to the
            letter) and ``paper`` (``kcf`` only) are the published ones.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        seed: of all random numbers.

    Returns:
        An iterator over all frames in order; the first answer is ``box`` itself.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off, or changes its size.
    """
    opened, labelled = open_single(source, frames)
    wanted = labelled if box is None else np.asarray(box, dtype=np.float64)
    if wanted is None:
        raise RequestError(f"{opened.name} has no labels; expected the `box` of the target in the first frame")
    if wanted.shape != (4,):
        raise RequestError(f"expected a `box` of four numbers x1, y1, x2, y2, got shape {wanted.shape}")
    return follow_frames(opened.frames(), wanted, single_tracker(method, preset, seed))


def single_tracker(
    method: SingleMethod | SingleTracker, preset: SinglePreset = "robust", seed: int = 0
) -> SingleTracker:
    """A fresh tracker by its name; a tracker as it is.

    Raises:
        RequestError: there is no such method or preset, or the two do not go together.
    """
    if not isinstance(method, str):
        return method
    if method not in METHODS:
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    if preset not in get_args(SinglePreset):
        raise RequestError(f"expected the preset {', '.join(get_args(SinglePreset))}, got {preset!r}")
    check_preset(method, preset)
    return make_tracker(method, preset, seed=seed)


def check_preset(method: SingleMethod, preset: SinglePreset) -> None:
    """Refuse constants that a method does not have.

    Raises:
        RequestError: the two do not go together.
    """
    takers = {"paper": ("kcf",), "printed": ("kcf-particle",), "thesis": ("kcf", "kcf-particle")}.get(preset)
    if takers is not None and method not in takers:
        raise RequestError(f"`preset` {preset}: expected with the method {' or '.join(takers)}, got {method}")


def follow_frames(frames: Iterator[Frame], box: FloatArray, tracker: SingleTracker) -> Iterator[tuple[Frame, Estimate]]:
    """`follow_target` with the frames themselves."""
    current: list[Frame] = []

    def noted() -> Iterator[Frame]:
        for frame in frames:
            current[:] = [frame]
            yield frame

    for estimate in follow_target(noted(), box, tracker):
        yield current[0], estimate


def open_single(source: str | Path | int, frames: str | None = None) -> tuple[Source, FloatArray | None]:
    """The video, and the labelled box of its first frame where it is a sequence folder with labels.

    Raises:
        RequestError: see `open_source` and `find_single_sequences`.
    """
    stretch, folder = parse_frames(frames), Path(str(source))
    if not folder.is_dir() or not has_labels(folder):
        return open_source(str(source), stretch), None
    sequence = find_single_sequences(folder)[0]
    if not sequence.images:
        raise RequestError(f"{folder}: expected images beside its labels, found none")
    stretch = stretch.within(len(sequence.images))
    skipped = list_images(sequence.images[0].parent).index(sequence.images[0])
    assert stretch.last is not None
    used = FrameRange(skipped + stretch.first, skipped + stretch.last)
    return open_source(sequence.images[0].parent, used), sequence.boxes[stretch.first]


def parse_box(text: str) -> FloatArray:
    """``(4,)`` corners of ``X,Y,W,H``.

    Raises:
        RequestError: it is something else.
    """
    words = re.split(r"[,\s]+", text.strip())
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise RequestError(f"`box`: expected X,Y,W,H in pixels, such as 120,80,40,90, got {text!r}")
    return corners_from_xywh(numbers)


def follow_measured(
    frames: Iterator[Frame],
    box: FloatArray | Callable[[ImageArray], FloatArray],
    tracker: SingleTracker,
    times: StageTimes,
) -> Iterator[Estimate]:
    """The target in every frame.

    Args:
        frames: of the video.
        box: the target in the first of them, or what finds it in its image.
        tracker: a fresh one.
        times: gets the stage ``read and track``.
    """
    first = next(frames, None)
    if first is None:
        return
    start = box(first.image) if callable(box) else box
    estimates = follow_target(chain((first,), frames), start, tracker)
    while True:
        with times.measure("read and track"):
            estimate = next(estimates, None)
        if estimate is None:
            return
        yield estimate


def columns_of(estimates: Sequence[Estimate]) -> dict[str, list[Any]]:
    """What happened in each frame, for ``run.json``: its number from 1, score and status."""
    return {
        "frame": [e.frame + 1 for e in estimates],
        "score": [round(e.score, 5) for e in estimates],
        "status": [e.status for e in estimates],
    }


def summary_of(estimates: Sequence[Estimate]) -> str:
    """How many frames there are, and how many of each status."""
    counts = {status: sum(e.status == status for e in estimates) for status in get_args(Status)}
    parts = [f"{count} {status}" for status, count in counts.items() if count]
    return f"{len(estimates)} frames ({', '.join(parts)})"
