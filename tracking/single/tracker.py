"""The contract of every tracker of one target."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Estimate, FloatArray, Frame, ImageArray, Status

# Score of a box that somebody gave.
CERTAIN = 1.0


@dataclass(frozen=True)
class TargetState:
    """The target in one frame.

    Attributes:
        box: ``(4,)`` corners x1, y1, x2, y2, pixels.
        score: confidence of the tracker, on its own scale.
        status: ``tracking``, ``searching`` or ``lost``.
    """

    box: FloatArray
    score: float
    status: Status


class SingleTracker(Protocol):
    """Follows one target.

    Two trackers with the same seed, images and box give the same answers, whatever else runs in the process.
    """

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """Take ``box`` ``(4,)`` of the first image ``(H, W, 3)`` as the target."""
        ...

    def follow(self, image: ImageArray) -> TargetState:
        """Where the target stands in the next image ``(H, W, 3)``, and how sure that is."""
        ...


def box_centre(box: FloatArray) -> FloatArray:
    return np.asarray((box[:2] + box[2:]) / 2)


def box_about(centre: FloatArray, size: FloatArray) -> FloatArray:
    """``(4,)`` corners of a box of ``size`` ``(2,)``."""
    return np.concatenate([centre - size / 2, centre + size / 2])


def as_box(corners: object) -> FloatArray:
    """``(4,)`` corners, whatever they are given in.

    Raises:
        RequestError: they are not four numbers.
    """
    try:
        box = np.asarray(corners, dtype=np.float64)
    except (TypeError, ValueError):
        raise RequestError(f"expected a `box` of four numbers x1, y1, x2, y2, got {corners!r:.60}") from None
    if box.shape != (4,):
        raise RequestError(f"expected a `box` of four numbers x1, y1, x2, y2, got shape {box.shape}")
    return box


def check_start(box: FloatArray, image: ImageArray) -> FloatArray:
    """``box`` as ``(4,)`` float64, where a tracker can start with it.

    Raises:
        RequestError: it has no area, is larger than the image, or lies outside it.
    """
    box = as_box(box)
    height, width = image.shape[:2]
    x, y, w, h = map(float, (*box[:2], *(box[2:] - box[:2])))
    description = f"x {x:g}, y {y:g}, width {w:g}, height {h:g}"
    if not np.isfinite(box).all() or w <= 0 or h <= 0:
        raise RequestError(f"`box`: expected a positive width and height, got {description}")
    if w < 2 or h < 2:
        raise RequestError(f"`box`: expected at least 2 x 2 pixels, got {description}")
    if w > width or h > height:
        raise RequestError(f"`box`: expected a box that fits into the {width}x{height} image, got {description}")
    if x + w <= 0 or y + h <= 0 or x >= width or y >= height:
        raise RequestError(f"`box`: expected a box inside the {width}x{height} image, got {description}")
    return box


def follow_target(
    frames: Iterator[Frame],
    box: FloatArray | Callable[[ImageArray], FloatArray],
    tracker: SingleTracker,
    times: StageTimes,
    boxes: Mapping[int, FloatArray] | None = None,
) -> Iterator[tuple[Frame, Estimate]]:
    """Each frame with the target in it; the first estimate is the box itself, and so are those at ``boxes``.

    Args:
        frames: of the video.
        box: ``(4,)`` the target in the first of them, or what finds it in its image.
        tracker: a fresh one.
        times: gets the stage ``read and track``.
        boxes: ``(4,)`` the target in other frames, at which the tracker begins anew.

    Raises:
        RequestError: see `check_start`; or the first image has one colour only.
        RunError: the video changes its size.
    """
    frame = next(frames, None)
    if frame is None:
        return
    first = frame.image
    box = check_start(box(first) if callable(box) else box, first)
    if (first == first[0, 0]).all():
        raise RequestError(
            f"frame {frame.index + 1}: expected a picture of the target, got one colour everywhere; "
            "start at a later frame with `frames`"
        )
    with times.measure("read and track"):
        tracker.start(first, box)
    yield frame, Estimate(frame.index, box, CERTAIN, "tracking")
    while True:
        with times.measure("read and track"):
            frame = next(frames, None)
            if frame is None:
                return
            if frame.image.shape != first.shape:
                raise RunError(
                    f"frame {frame.index + 1}: expected {first.shape[1]}x{first.shape[0]} pixels as before, "
                    f"got {frame.image.shape[1]}x{frame.image.shape[0]}; track the parts one by one"
                )
            restart_box = None if boxes is None else boxes.get(frame.index)
            if restart_box is None:
                state = tracker.follow(frame.image)
            else:
                state = TargetState(check_start(restart_box, frame.image), CERTAIN, "tracking")
                tracker.start(frame.image, state.box)
        yield frame, Estimate(frame.index, state.box, state.score, state.status)
