"""How the camera moved between two frames, from what stands still: features tracked over the image, and RANSAC.

A `CameraPath` takes a video's frames one by one and says where each lies in the coordinates of the first, so that boxes
of a moving camera can be compared as if it stood still.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class CameraMotionSettings:
    """Settings of the estimate.

    Attributes:
        longest_side: frames are shrunk to it, pixels.
        features: tracked at most.
        reach: largest error of a feature that moved with the camera, pixels of the shrunk frame.
        still: movement of the corners, pixels of the shrunk frame, under which the camera stood still.
        least: features that must agree; with fewer nothing tells how the camera moved.
        patience: frames of a camera that stands still that are compared with one and the same, so that it cannot
            creep away unnoticed.
    """

    longest_side: int = 640
    features: int = 400
    reach: float = 1.5
    still: float = 0.3
    least: int = 12
    patience: int = 15

    def __post_init__(self) -> None:
        if min(self.longest_side, self.features, self.least) < 4 or self.patience < 1:
            raise ValueError(
                "expected longest_side, features and least from 4 and patience from 1, "
                f"got {self.longest_side}, {self.features}, {self.least} and {self.patience}"
            )
        if not (self.reach > 0 and self.still >= 0):
            raise ValueError(f"expected reach > 0 and still >= 0, got {self.reach} and {self.still}")


def camera_motion(
    before: ImageArray,
    after: ImageArray,
    settings: CameraMotionSettings | None = None,
    people: FloatArray | None = None,
) -> FloatArray | None:
    """``(2, 3)`` similarity that takes pixels of the frame ``before`` to those of ``after``; None where nothing tells.

    A camera that stood still gives exactly the identity.

    Args:
        before: ``(H, W, 3)`` uint8 RGB or ``(H, W)`` uint8 grey.
        after: of the same shape.
        settings: by default those of ``CameraMotionSettings()``.
        people: ``(N, 4)`` boxes in ``before`` of what may move by itself.

    Raises:
        ValueError: the frames differ in shape.
    """
    if before.shape != after.shape:
        raise ValueError(f"expected two frames of one shape, got {before.shape} and {after.shape}")
    settings = settings or CameraMotionSettings()
    first, second = _shrunk(before, settings), _shrunk(after, settings)
    ratio = first.shape[1] / before.shape[1]
    start = _features(first, settings, None if people is None else people * ratio)
    if len(start) < settings.least:
        return None
    end, found = _follow(first, second, start)
    start, end = start[found], end[found]
    if len(start) < settings.least:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(
        start, end, method=cv2.RANSAC, ransacReprojThreshold=settings.reach, maxIters=500, confidence=0.995
    )
    if matrix is None or int(inliers.sum()) < settings.least:
        return None
    result = np.asarray(matrix, dtype=np.float64)
    corners = np.array([[x, y, 1.0] for x in (0, first.shape[1]) for y in (0, first.shape[0])])
    if np.linalg.norm(corners @ result.T - corners[:, :2], axis=1).max() < settings.still:
        return np.eye(3)[:2]
    result[:, 2] /= ratio
    return result


def _shrunk(image: ImageArray, settings: CameraMotionSettings) -> Grey:
    height, width = image.shape[:2]
    ratio = min(settings.longest_side / max(height, width), 1.0)
    small = cv2.resize(image, (round(width * ratio), round(height * ratio)), interpolation=cv2.INTER_AREA)
    return np.asarray(small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _features(image: Grey, settings: CameraMotionSettings, people: FloatArray | None) -> NDArray[np.float32]:
    """``(N, 2)`` corners that can be found again, outside ``people``."""
    mask = np.full(image.shape, 255, dtype=np.uint8)
    for x1, y1, x2, y2 in np.empty((0, 4)) if people is None else people:
        mask[max(int(y1), 0) : max(int(np.ceil(y2)), 0), max(int(x1), 0) : max(int(np.ceil(x2)), 0)] = 0
    found = cv2.goodFeaturesToTrack(image, settings.features, 0.01, 8, mask=mask)
    return np.empty((0, 2), dtype=np.float32) if found is None else np.asarray(found, dtype=np.float32).reshape(-1, 2)


def _follow(first: Grey, second: Grey, start: NDArray[np.float32]) -> tuple[NDArray[np.float32], BoolArray]:
    """Where ``start`` ``(N, 2)`` has gone, by Lucas and Kanade from the step that suits the whole frame best."""
    quarter = [cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA) for image in (first, second)]
    small = [np.asarray(image, dtype=np.float32) for image in quarter]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    step, _ = cv2.phaseCorrelate(small[0], small[1], window)
    guess = start + 4 * np.array(step, dtype=np.float32)
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        start,
        guess.astype(np.float32),
        winSize=(15, 15),
        maxLevel=3,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.03),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return np.asarray(end, dtype=np.float32), np.asarray(status).ravel() == 1


def camera_flow(motion: FloatArray, size: tuple[int, int]) -> NDArray[np.float32]:
    """``(H, W, 2)`` pixels by which the camera alone moved what shows at each pixel of the later frame.

    Args:
        motion: ``(2, 3)``, see `camera_motion`.
        size: width and height of the frame.

    >>> camera_flow(np.array([[1.0, 0, 5], [0, 1, -2]]), (2, 1)).tolist()
    [[[5.0, -2.0], [5.0, -2.0]]]
    """
    x, y = np.meshgrid(np.arange(size[0], dtype=np.float32), np.arange(size[1], dtype=np.float32))
    back = undone(motion).astype(np.float32)
    moved = [values - (row[0] * x + row[1] * y + row[2]) for values, row in zip((x, y), back, strict=True)]
    return np.stack(moved, axis=2)


@dataclass
class CameraPath:
    """Where the frames of a video lie, in pixels of the first.

    Attributes:
        settings: of the estimate.
        transforms: one ``(2, 3)`` similarity a frame, from its pixels to those of the first.
        unknown: frames whose movement nothing told; they lie where the frame before does.
    """

    settings: CameraMotionSettings = field(default_factory=CameraMotionSettings)
    transforms: list[FloatArray] = field(default_factory=list)
    unknown: list[int] = field(default_factory=list)
    _before: Grey | None = None
    _people: FloatArray | None = None
    _waited: int = 0

    def add(self, image: ImageArray, people: FloatArray | None = None) -> FloatArray:
        """Take the next frame, in which ``people`` ``(N, 4)`` may move by themselves; returns its transform."""
        small = _shrunk(image, self.settings)
        ratio = small.shape[1] / image.shape[1]
        boxes = None if people is None else np.asarray(people, dtype=np.float64) * ratio
        if self._before is None:
            step: FloatArray | None = np.eye(3)[:2]
        else:
            step = camera_motion(self._before, small, self.settings, self._people)
            if step is None:
                self.unknown.append(len(self.transforms))
        still = step is not None and bool((step == np.eye(3)[:2]).all())
        self._waited += 1
        before = self.transforms[-1] if self.transforms else np.eye(3)[:2]
        self.transforms.append(before if step is None or still else _chained(before, step, ratio))
        if not still or self._before is None or self._waited >= self.settings.patience:
            self._before, self._people, self._waited = small, boxes, 0
        return self.transforms[-1]

    def step(self, frame: int) -> FloatArray | None:
        """``(2, 3)`` where pixels of the frame before lie in a frame; None for the first, and where nothing told."""
        if frame == 0 or frame in self.unknown:
            return None
        earlier, now = (np.vstack([self.transforms[k], [0, 0, 1]]) for k in (frame - 1, frame))
        # A camera that stood still is told from one that moved by less than rounding.
        return np.eye(3)[:2] if np.array_equal(earlier, now) else np.asarray(np.linalg.solve(now, earlier)[:2])


def _chained(before: FloatArray, step: FloatArray, ratio: float) -> FloatArray:
    """The transform of the frame that lies ``step``, in pixels of shrunk frames, after that of ``before``."""
    whole = np.vstack([step, [0, 0, 1]])
    whole[:2, 2] /= ratio
    return np.asarray((np.vstack([before, [0, 0, 1]]) @ np.linalg.inv(whole))[:2])


def moved_boxes(boxes: FloatArray, transform: FloatArray) -> FloatArray:
    """``boxes`` ``(N, 4)`` after a similarity ``(2, 3)``: the middle goes along, the sides are scaled, not turned."""
    if (transform == np.eye(3)[:2]).all():
        return boxes
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 @ transform[:, :2].T + transform[:, 2]
    half = (boxes[:, 2:] - boxes[:, :2]) / 2 * np.hypot(*transform[:, 0])
    return np.concatenate([middle - half, middle + half], axis=1)


def undone(transform: FloatArray) -> FloatArray:
    """The ``(2, 3)`` similarity that takes back ``transform``."""
    return np.asarray(cv2.invertAffineTransform(transform), dtype=np.float64)
