"""How the camera moved between two frames, from what stands still.

Features are followed over the image, and RANSAC finds the similarity that most agree on. Whether it is right is checked
by moving the first frame with it and correlating the two. Where features fail, as in the smear of a jerk, the two
frames are searched for what they share (`camera_search`). Where that does not tell either, nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.features.camera_search import (
    CameraSearchSettings,
    FoundStep,
    Pattern,
    agreement,
    leads_to_the_same,
    pattern,
    refine,
    search,
)
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

Grey = NDArray[np.uint8]
STANDS_STILL = np.eye(3)[:2]


@dataclass(frozen=True)
class CameraMotionSettings:
    """Settings of the estimate.

    Attributes:
        longest_side: frames are shrunk to it, pixels.
        features: tracked at most.
        reach: largest error of a feature that moved with the camera, pixels of the shrunk frame.
        still: movement of the corners, pixels of the shrunk frame, under which the camera stood still.
        least: features that must agree; with fewer they do not tell how the camera moved.
        majority: share of the features that agree, from which what they say is taken as it is, for people who move may
            be all else that is seen; and share from which it is taken where the search tells nothing.
        sure: agreement of the frames, a correlation, from which what the features say is taken as it is.
        doubtful: agreement from which it is refined; below it frames are searched for what they share.
        accepted: agreement from which a step that was searched for is believed; half of it where features say the same.
        ahead: what a step that was searched for leaves unexplained, 1 less the agreement, is at most this share of what
            any other leaves.
        doubt: deviation of a step whose frames do not agree at all, in longest sides; less where they agree more, and
            none from ``sure`` on.
        patience: frames of a camera that stands still that are compared with one and the same, so that it cannot
            creep away unnoticed; and frames after an unknown one that are also compared with the one before it.
        search: for what two frames share.
    """

    longest_side: int = 640
    features: int = 400
    reach: float = 1.5
    still: float = 0.3
    least: int = 12
    majority: tuple[float, float] = (0.5, 0.2)
    sure: float = 0.95
    doubtful: float = 0.7
    accepted: float = 0.5
    ahead: float = 0.8
    doubt: float = 0.02
    patience: int = 15
    search: CameraSearchSettings = field(default_factory=CameraSearchSettings)

    def __post_init__(self) -> None:
        if min(self.longest_side, self.features, self.least) < 4 or self.patience < 1:
            raise ValueError(
                "expected longest_side, features and least from 4 and patience from 1, "
                f"got {self.longest_side}, {self.features}, {self.least} and {self.patience}"
            )
        if not (self.reach > 0 and self.still >= 0 and self.doubt >= 0):
            raise ValueError(f"expected reach > 0, still and doubt >= 0, got {self.reach}, {self.still}, {self.doubt}")
        if not -1 <= self.accepted <= self.doubtful <= self.sure <= 1:
            raise ValueError(
                "expected -1 <= accepted <= doubtful <= sure <= 1, "
                f"got {self.accepted}, {self.doubtful} and {self.sure}"
            )


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
    step = camera_step(before, after, settings, people)
    return None if step is None else step.similarity


def camera_step(
    before: ImageArray,
    after: ImageArray,
    settings: CameraMotionSettings | None = None,
    people: FloatArray | None = None,
) -> CameraStep | None:
    """The same with how far it may be off; see `camera_motion`."""
    if before.shape != after.shape:
        raise ValueError(f"expected two frames of one shape, got {before.shape} and {after.shape}")
    settings = settings or CameraMotionSettings()
    return frame_step(CameraFrame.of(before, settings, people), CameraFrame.of(after, settings, None))


@dataclass(frozen=True)
class CameraFrame:
    """A frame as it is compared with others.

    Attributes:
        image: ``(h, w, 3)`` shrunk.
        ratio: its width to that of the frame.
        people: boxes in the frame, or None.
        settings: of the estimate.
    """

    image: ImageArray
    ratio: float
    people: FloatArray | None
    settings: CameraMotionSettings

    @classmethod
    def of(cls, image: ImageArray, settings: CameraMotionSettings, people: FloatArray | None) -> CameraFrame:
        height, width = image.shape[:2]
        ratio = min(settings.longest_side / max(height, width), 1.0)
        small = cv2.resize(image, (round(width * ratio), round(height * ratio)), interpolation=cv2.INTER_AREA)
        colour = small if small.ndim == 3 else cv2.cvtColor(small, cv2.COLOR_GRAY2RGB)
        return cls(np.asarray(colour, dtype=np.uint8), small.shape[1] / width, people, settings)

    @cached_property
    def grey(self) -> Grey:
        """``(h, w)``."""
        return np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)

    @cached_property
    def pattern(self) -> Pattern:
        """What the search and the check compare."""
        return pattern(self.image, self.settings.search)

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """``(N, 2)`` corners that can be found again, outside the people."""
        mask = np.full(self.grey.shape, 255, dtype=np.uint8)
        for x1, y1, x2, y2 in np.empty((0, 4)) if self.people is None else self.people * self.ratio:
            mask[max(int(y1), 0) : max(int(np.ceil(y2)), 0), max(int(x1), 0) : max(int(np.ceil(x2)), 0)] = 0
        found = cv2.goodFeaturesToTrack(self.grey, self.settings.features, 0.01, 8, mask=mask)
        none = np.empty((0, 2), dtype=np.float32)
        return none if found is None else np.asarray(found, dtype=np.float32).reshape(-1, 2)


def frame_step(first: CameraFrame, second: CameraFrame) -> CameraStep | None:
    """The step from one view to another, in pixels of the frames; None where nothing tells."""
    settings = first.settings
    followed = _by_features(first, second)
    if followed is not None and (followed.agreement >= settings.sure or followed.share >= settings.majority[0]):
        return CameraStep(_in_frames(first, followed).similarity)
    if followed is not None and followed.agreement >= settings.doubtful:
        refined = refine(first.pattern, second.pattern, followed.similarity, settings.search)
        # Where features agree on the wrong, most of what they leave unexplained goes away.
        better = refined is not None and 1 - refined.agreement < 0.5 * (1 - followed.agreement)
        return _in_frames(first, refined if refined is not None and better else followed)
    best, *others = search(first.pattern, second.pattern, settings.search)
    ahead = 1 - best.agreement <= settings.ahead * (1 - max((step.agreement for step in others), default=-1.0))
    if followed is not None and leads_to_the_same(followed, best, first.pattern):
        # Two ways that come to the same need agree less.
        if ahead and best.agreement >= settings.accepted / 2:
            return _in_frames(first, best if best.agreement > followed.agreement + 0.02 else followed)
    elif ahead and best.agreement >= settings.accepted:
        return _in_frames(first, best)
    return _in_frames(first, followed) if followed is not None and followed.share >= settings.majority[1] else None


def _in_frames(first: CameraFrame, found: FoundStep) -> CameraStep:
    """A step between patterns in pixels of the frames, the more in doubt the less the patterns agree."""
    ratio = first.image.shape[1] / first.ratio / first.pattern.shape[1]
    similarity = np.column_stack([found.similarity[:, :2], found.similarity[:, 2] * ratio])
    if found.agreement >= first.settings.sure:
        return CameraStep(similarity)
    return CameraStep(similarity, first.settings.doubt * (1 - found.agreement) * max(first.image.shape) / first.ratio)


@dataclass(frozen=True)
class _ByFeatures(FoundStep):
    """What features say, and the share of them that agree."""

    share: float


def _by_features(first: CameraFrame, second: CameraFrame) -> _ByFeatures | None:
    """The similarity that most features agree on; None where too few do."""
    settings, start = first.settings, first.features
    if len(start) < settings.least:
        return None
    best: _ByFeatures | None = None
    # What moves by itself may lead the common shift astray, which a camera that stands still does not need.
    for shift in (_common_shift(first.grey, second.grey), np.zeros(2, dtype=np.float32)):
        end, found = _follow(first.grey, second.grey, start, shift)
        followed = _agreed(first, second, start[found], end[found]) if found.sum() >= settings.least else None
        if followed is not None and (best is None or followed.share > best.share):
            best = followed
        if best is not None and best.share >= settings.majority[0]:
            break
    return best


def _agreed(
    first: CameraFrame, second: CameraFrame, start: NDArray[np.float32], end: NDArray[np.float32]
) -> _ByFeatures | None:
    """The similarity that takes most of ``start`` ``(N, 2)`` to ``end``; None where too few agree."""
    settings = first.settings
    matrix, inliers = cv2.estimateAffinePartial2D(
        start, end, method=cv2.RANSAC, ransacReprojThreshold=settings.reach, maxIters=500, confidence=0.995
    )
    if matrix is None or int(inliers.sum()) < settings.least:
        return None
    result = np.asarray(matrix, dtype=np.float64)
    corners = np.array([[x, y, 1.0] for x in (0, first.grey.shape[1]) for y in (0, first.grey.shape[0])])
    if np.linalg.norm(corners @ result.T - corners[:, :2], axis=1).max() < settings.still:
        result = STANDS_STILL
    ratio = first.pattern.shape[1] / first.grey.shape[1]
    similarity = np.column_stack([result[:, :2], result[:, 2] * ratio])
    fit = agreement(first.pattern, second.pattern, similarity, settings.search.overlap)
    return _ByFeatures(similarity, fit, int(inliers.sum()) / len(first.features))


def _common_shift(first: Grey, second: Grey) -> NDArray[np.float32]:
    """``(2,)`` pixels that suit the whole frame best, by phase correlation."""
    quarter = [cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA) for image in (first, second)]
    small = [np.asarray(image, dtype=np.float32) for image in quarter]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    step, _ = cv2.phaseCorrelate(small[0], small[1], window)
    return 4 * np.array(step, dtype=np.float32)


def _follow(
    first: Grey, second: Grey, start: NDArray[np.float32], shift: NDArray[np.float32]
) -> tuple[NDArray[np.float32], BoolArray]:
    """Where ``start`` ``(N, 2)`` has gone, by Lucas and Kanade from a shift on, and which were found."""
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        start,
        (start + shift).astype(np.float32),
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


def undone(transform: FloatArray) -> FloatArray:
    """The ``(2, 3)`` similarity that takes back ``transform``."""
    return np.asarray(cv2.invertAffineTransform(transform), dtype=np.float64)


@dataclass(frozen=True)
class CameraStep:
    """How a camera moved from one frame to the next.

    Attributes:
        similarity: ``(2, 3)`` where pixels of the frame before lie in this one.
        deviation: standard deviation in pixels of that place; 0 where there is no doubt, infinite where nothing tells.
    """

    similarity: FloatArray
    deviation: float = 0.0
