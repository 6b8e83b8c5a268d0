"""How the camera moved between two frames, from what stands still.

Features are followed over the image, and RANSAC finds the similarity that most agree on. Whether it is right is checked
by moving the first frame with it and correlating the two. Where features fail, as in the smear of a jerk, the two
frames are searched for what they share (`search`). Where that does not tell either, nothing is reported.

The search is over all shifts and many turns. Where a jerk smears a frame, or moves it by a third of its width, no
feature can be followed. What is left are blurred patches of ground and people. They are compared at a quarter of the
size or less, in colour, without brightness that changes slowly and without detail that the smear takes away
(`pattern`).

For every turn the correlation of the overlapping parts is computed for all shifts at once, in the Fourier domain (D.
Padfield, Masked Object Registration in the Fourier Domain, 2012). The best are refined (G. Evangelidis and E. Psarakis,
Parametric Image Alignment Using Enhanced Correlation Coefficient Maximization, 2008). How well a step explains the
second frame is again a correlation, that of the frame with the first one, moved (`agreement`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from tsuiseki.tracking.errors import lacks_memory
from tsuiseki.tracking.types import FloatArray, ImageArray

Grey = NDArray[np.uint8]
Pattern = NDArray[np.float32]
# The similarity ``(2, 3)`` of a camera that did not move.
STANDS_STILL = np.eye(3)[:2]
# Frames are shrunk to this longest side, pixels.
LONGEST_SIDE = 640
# Features that are tracked at most.
FEATURES = 400
# Largest error of a feature that moved with the camera, pixels of the shrunk frame.
REACH = 1.5
# Movement of the corners under which the camera stood still, pixels of the shrunk frame.
STILL = 0.3
# Features that must agree; with fewer they do not tell how the camera moved.
LEAST = 12
# Share of the features that agree, from which what they say is taken as it is, for people who move may be all else that
# shows.
MAJORITY = 0.5
# Share from which it is taken where the search tells nothing.
MINORITY = 0.2
# Agreement of the frames, a correlation, from which what the features say is taken as it is.
SURE = 0.95
# Agreement from which it is refined, and below which frames are searched for what they share.
DOUBTFUL = 0.7
# Agreement from which a step that was searched for is taken; half of it where features say the same.
ACCEPTED = 0.5
# What a step that was searched for leaves unexplained, 1 less the agreement, is at most this share of what any other
# leaves.
AHEAD = 0.8
# Deviation of a step whose frames do not agree at all, in longest sides; less where they agree more.
DEVIATION = 0.02
# Frames of a camera that stands still that are compared with one and the same, so that it cannot creep away unnoticed.
# So many frames after an unknown one are also compared with the one before it.
PATIENCE = 15
# Patterns are shrunk to this longest side, pixels.
PATTERN_SIDE = 160
# Standard deviation of the blur that takes detail away, pixels of the pattern.
DETAIL = 1.0
# Standard deviation of the blur whose result counts as slow brightness, pixels of the pattern.
BRIGHTNESS = 12.0
# Largest turn that is searched, degrees.
LARGEST_TURN = 30.0
# Step between turns, degrees.
TURN_STEP = 5.0
# Best turns that are refined.
REFINED = 5
# Least share of the image that two frames must have in common.
OVERLAP = 0.25


@dataclass(frozen=True)
class ProposedStep:
    """A step that features or the search propose.

    Attributes:
        similarity: ``(2, 3)`` from pixels of the first pattern to those of the second.
        agreement: of the two patterns after it, in [-1, 1].
        share: of the features that agree on it, in [0, 1].
    """

    similarity: FloatArray
    agreement: float
    share: float = 0.0


def pattern(image: ImageArray) -> Pattern:
    """``(h, w, 3)`` float32: what is compared of an image ``(H, W, 3)`` uint8."""
    ratio = min(PATTERN_SIDE / max(image.shape[:2]), 1.0)
    size = max(round(image.shape[1] * ratio), 8), max(round(image.shape[0] * ratio), 8)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    slow = cv2.GaussianBlur(small, (0, 0), BRIGHTNESS)
    result = cv2.GaussianBlur(small, (0, 0), DETAIL) - slow
    # What rounding leaves of a blank image.
    result[np.abs(result) < 0.01] = 0
    return np.asarray(result, dtype=np.float32)


def agreement(first: Pattern, second: Pattern, similarity: FloatArray) -> float:
    """Correlation of ``second`` with ``first`` moved by ``similarity``, in [-1, 1]; -1 where they share too little."""
    moved, inside = _moved(first, similarity)
    shared = inside > 0
    if shared.mean() < OVERLAP:
        return -1.0
    moved_pixels, second_pixels = moved[shared], second[shared]
    moved_pixels, second_pixels = moved_pixels - moved_pixels.mean(axis=0), second_pixels - second_pixels.mean(axis=0)
    energy = float((moved_pixels * moved_pixels).sum()) * float((second_pixels * second_pixels).sum())
    # Two blank images say nothing.
    return float((moved_pixels * second_pixels).sum()) / energy**0.5 if energy > 0 else -1.0


def search(first: Pattern, second: Pattern) -> list[ProposedStep]:
    """The steps that explain ``second`` by ``first``, the best first; those that lead to the same place come once."""
    turns = np.arange(-(LARGEST_TURN // TURN_STEP) * TURN_STEP, LARGEST_TURN + TURN_STEP / 2, TURN_STEP)
    coarse = sorted((_best_shift(first, second, turn) for turn in turns.tolist()), key=lambda step: -step.agreement)
    steps = []
    for step in coarse[:REFINED]:
        refined = refine(first, second, step.similarity)
        steps += [step] if refined is None else [step, refined]
    distinct: list[ProposedStep] = []
    for step in sorted(steps, key=lambda step: -step.agreement):
        if not any(leads_to_the_same(step, better, first) for better in distinct):
            distinct.append(step)
    return distinct


def _moved(image: Pattern, similarity: FloatArray) -> tuple[Pattern, Pattern]:
    """``image`` after a similarity, and ``(h, w)`` where it shows something, 0 or 1."""
    size = image.shape[1], image.shape[0]
    inside = cv2.warpAffine(np.ones(image.shape[:2], dtype=np.float32), similarity, size) > 0.99
    return np.asarray(cv2.warpAffine(image, similarity, size), dtype=np.float32), inside.astype(np.float32)


def _best_shift(first: Pattern, second: Pattern, turn: float) -> ProposedStep:
    """The step of the highest correlation over all shifts of ``first`` turned by ``turn`` degrees."""
    height, width = first.shape[:2]
    similarity = np.asarray(cv2.getRotationMatrix2D((width / 2, height / 2), turn, 1.0), dtype=np.float64)
    turned, inside = _moved(first, similarity)
    correlation = _masked_correlation(turned * inside[..., None], inside, second)
    row, column = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
    # Shifts up and to the left are at the end.
    down = int(row) - correlation.shape[0] * (row >= height)
    right = int(column) - correlation.shape[1] * (column >= width)
    similarity[:, 2] += right, down
    return ProposedStep(similarity, float(correlation[row, column]))


def _masked_correlation(first: Pattern, inside: Pattern, second: Pattern) -> FloatArray:
    """``(2h, 2w)`` correlation coefficient of the parts that overlap, for all shifts; -1 where they are too small."""
    height, width = second.shape[:2]
    shape = scipy.fft.next_fast_len(2 * height, real=True), scipy.fft.next_fast_len(2 * width, real=True)

    def spectra(images: Pattern) -> NDArray[np.complex64]:
        return np.asarray(scipy.fft.rfft2(images, shape, axes=(0, 1)))

    def correlated(a: NDArray[np.complex64], b: NDArray[np.complex64]) -> FloatArray:
        return np.asarray(scipy.fft.irfft2(np.conj(a) * b, shape, axes=(0, 1)))

    mask, ones = spectra(inside[..., None]), spectra(np.ones((height, width, 1), dtype=np.float32))
    spectra_first, spectra_second = spectra(first), spectra(second)
    count = np.maximum(correlated(mask, ones), 1)
    sum_first, sum_second = correlated(spectra_first, ones), correlated(mask, spectra_second)
    product = (correlated(spectra_first, spectra_second) - sum_first * sum_second / count).sum(axis=2)
    energy_first = (correlated(spectra(first * first), ones) - sum_first**2 / count).sum(axis=2)
    energy_second = (correlated(mask, spectra(second * second)) - sum_second**2 / count).sum(axis=2)
    energy = energy_first * energy_second
    # What rounding leaves of an empty overlap is no energy.
    floor = 1e-3 * max(energy_first.max(), 0) * max(energy_second.max(), 0) + np.finfo(np.float32).tiny
    result = product / np.sqrt(np.maximum(energy, floor))
    return np.where(count[..., 0] < OVERLAP * height * width, -1.0, result)


def refine(first: Pattern, second: Pattern, guess: FloatArray) -> ProposedStep | None:
    """The step near ``guess``, turned and shifted, of the highest correlation; None where there is none."""
    back = np.asarray(cv2.invertAffineTransform(guess), dtype=np.float32)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    grey_second, grey_first = (np.ascontiguousarray(image.mean(axis=2)) for image in (second, first))
    try:
        _, back = cv2.findTransformECC(grey_second, grey_first, back, cv2.MOTION_EUCLIDEAN, until, None, 5)  # type: ignore[call-overload]
    except cv2.error as error:  # It has left the image.
        if lacks_memory(error):
            raise
        return None
    similarity = np.asarray(cv2.invertAffineTransform(back.astype(np.float64)), dtype=np.float64)
    return ProposedStep(similarity, agreement(first, second, similarity))


def leads_to_the_same(step: ProposedStep, alternative: ProposedStep, image: Pattern) -> bool:
    """Whether two steps take the corners of ``image`` to the same places, to an eighth of the width."""
    height, width = image.shape[:2]
    corners = np.array([[x, y, 1.0] for x in (0, width) for y in (0, height)])
    away = corners @ (step.similarity - alternative.similarity).T
    return bool(np.linalg.norm(away, axis=1).max() <= width / 8)


def camera_motion(first: ImageArray, second: ImageArray, people: FloatArray | None = None) -> FloatArray | None:
    """``(2, 3)`` similarity that takes pixels of the frame ``first`` to those of ``second``; None where nothing tells.

    A camera that stood still gives exactly the identity.

    Args:
        first: ``(H, W, 3)`` uint8 RGB or ``(H, W)`` uint8 grey.
        second: of the same shape.
        people: ``(N, 4)`` boxes in ``first`` of what may move by itself.

    Raises:
        ValueError: the frames differ in shape.
    """
    if first.shape != second.shape:
        raise ValueError(f"expected two frames of one shape, got {first.shape} and {second.shape}")
    step = frame_step(CameraFrame.of(first, people), CameraFrame.of(second, None))
    return None if step is None else step.similarity


@dataclass(frozen=True)
class CameraFrame:
    """A frame as it is compared with others.

    Attributes:
        image: ``(h, w, 3)`` shrunk.
        ratio: its width to that of the frame.
        people: boxes in the frame, or None.
    """

    image: ImageArray
    ratio: float
    people: FloatArray | None

    @classmethod
    def of(cls, image: ImageArray, people: FloatArray | None) -> CameraFrame:
        height, width = image.shape[:2]
        ratio = min(LONGEST_SIDE / max(height, width), 1.0)
        small = cv2.resize(image, (round(width * ratio), round(height * ratio)), interpolation=cv2.INTER_AREA)
        colour = small if small.ndim == 3 else cv2.cvtColor(small, cv2.COLOR_GRAY2RGB)
        return cls(np.asarray(colour, dtype=np.uint8), small.shape[1] / width, people)

    @cached_property
    def grey(self) -> Grey:
        """``(h, w)``."""
        return np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)

    @cached_property
    def pattern(self) -> Pattern:
        """What the search and the check compare."""
        return pattern(self.image)

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """``(N, 2)`` corners that can be found again, outside the people."""
        mask = np.full(self.grey.shape, 255, dtype=np.uint8)
        for x1, y1, x2, y2 in np.empty((0, 4)) if self.people is None else self.people * self.ratio:
            mask[max(int(y1), 0) : max(int(np.ceil(y2)), 0), max(int(x1), 0) : max(int(np.ceil(x2)), 0)] = 0
        corners = cv2.goodFeaturesToTrack(self.grey, FEATURES, 0.01, 8, mask=mask)
        return np.asarray(() if corners is None else corners, dtype=np.float32).reshape(-1, 2)


def frame_step(first: CameraFrame, second: CameraFrame) -> CameraStep | None:
    """The step from one view to another, in pixels of the frames; None where nothing tells."""
    followed = _by_features(first, second)
    if followed is not None and (followed.agreement >= SURE or followed.share >= MAJORITY):
        return CameraStep(_in_frames(first, followed).similarity)
    if followed is not None and followed.agreement >= DOUBTFUL:
        refined = refine(first.pattern, second.pattern, followed.similarity)
        # Where features agree on the wrong, most of what they leave unexplained goes away.
        better = refined is not None and 1 - refined.agreement < 0.5 * (1 - followed.agreement)
        return _in_frames(first, refined if refined is not None and better else followed)
    best, *others = search(first.pattern, second.pattern)
    ahead = 1 - best.agreement <= AHEAD * (1 - max((step.agreement for step in others), default=-1.0))
    if followed is not None and leads_to_the_same(followed, best, first.pattern):
        # Two ways that come to the same need agree less.
        if ahead and best.agreement >= ACCEPTED / 2:
            return _in_frames(first, best if best.agreement > followed.agreement + 0.02 else followed)
    elif ahead and best.agreement >= ACCEPTED:
        return _in_frames(first, best)
    return _in_frames(first, followed) if followed is not None and followed.share >= MINORITY else None


def _in_frames(first: CameraFrame, step: ProposedStep) -> CameraStep:
    """A step between patterns in pixels of the frames, the more in doubt the less the patterns agree."""
    ratio = first.image.shape[1] / first.ratio / first.pattern.shape[1]
    similarity = np.column_stack([step.similarity[:, :2], step.similarity[:, 2] * ratio])
    if step.agreement >= SURE:
        return CameraStep(similarity)
    return CameraStep(similarity, DEVIATION * (1 - step.agreement) * max(first.image.shape) / first.ratio)


def _by_features(first: CameraFrame, second: CameraFrame) -> ProposedStep | None:
    """The similarity that most features agree on; None where too few do."""
    start = first.features
    if len(start) < LEAST:
        return None
    best: ProposedStep | None = None
    # What moves by itself may lead the common shift astray, which a camera that stands still does not need.
    for shift in (_common_shift(first.grey, second.grey), np.zeros(2, dtype=np.float32)):
        # By Lucas and Kanade, from the shift on.
        end, status, _ = cv2.calcOpticalFlowPyrLK(
            first.grey,
            second.grey,
            start,
            (start + shift).astype(np.float32),
            winSize=(15, 15),
            maxLevel=3,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.03),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        rows = np.asarray(status).ravel() == 1
        end = np.asarray(end, dtype=np.float32)
        followed = _agreed(first, second, start[rows], end[rows]) if rows.sum() >= LEAST else None
        if followed is not None and (best is None or followed.share > best.share):
            best = followed
        if best is not None and best.share >= MAJORITY:
            break
    return best


def _agreed(
    first: CameraFrame, second: CameraFrame, start: NDArray[np.float32], end: NDArray[np.float32]
) -> ProposedStep | None:
    """The similarity that takes most of ``start`` ``(N, 2)`` to ``end``; None where too few agree."""
    matrix, inliers = cv2.estimateAffinePartial2D(
        start, end, method=cv2.RANSAC, ransacReprojThreshold=REACH, maxIters=500, confidence=0.995
    )
    if matrix is None or int(inliers.sum()) < LEAST:
        return None
    result = np.asarray(matrix, dtype=np.float64)
    corners = np.array([[x, y, 1.0] for x in (0, first.grey.shape[1]) for y in (0, first.grey.shape[0])])
    if np.linalg.norm(corners @ result.T - corners[:, :2], axis=1).max() < STILL:
        result = STANDS_STILL
    ratio = first.pattern.shape[1] / first.grey.shape[1]
    similarity = np.column_stack([result[:, :2], result[:, 2] * ratio])
    fit = agreement(first.pattern, second.pattern, similarity)
    return ProposedStep(similarity, fit, int(inliers.sum()) / len(first.features))


def _common_shift(first: Grey, second: Grey) -> NDArray[np.float32]:
    """``(2,)`` pixels that suit the whole frame best, by phase correlation."""
    quarter = [cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA) for image in (first, second)]
    small = [np.asarray(image, dtype=np.float32) for image in quarter]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    step, _ = cv2.phaseCorrelate(small[0], small[1], window)
    return 4 * np.array(step, dtype=np.float32)


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

    def and_then(self, later: CameraStep) -> CameraStep:
        """This step and another after it, as one."""
        first, second = (np.vstack([step.similarity, [0, 0, 1]]) for step in (self, later))
        return CameraStep((second @ first)[:2], math.hypot(self.deviation, later.deviation))
