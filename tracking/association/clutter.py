"""What is clutter among detections of unknown scores, learnt from what moves.

Scores of different detectors mean different things. People walk and clutter stands: a static false positive is
detected in every frame, but it goes nowhere. So the share of detections on chains that move calibrates a score.
Of the N(t) detections from a score t upwards, let A(t) lie on chains that move. `score_floor` takes the t* with the
largest A(t)² / N(t); above it a score is trusted. Below, the marginal share dA / dN, made monotone and divided by
A(t*) / N(t*), is the probability that a detection of that score is right.

`standing_clutter` names the tracks that stay in their place and score less than tracks that move.

`ScoreChoice` chooses the threshold of other projects' networks. Such a network first runs on the beginning of the video
with a low threshold. The moving detections there give the threshold for the rest of the video. Before a moving camera
all clutter moves, so there the usual threshold stays. Given detections are cut likewise where that leaves out most of
them; then no detector's own threshold has cut them before. What stands for a second, such as a parked car, is left to
`standing_clutter`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from tsuiseki.tracking.association.detection_tables import boxes_of_frames
from tsuiseki.tracking.association.nearby import near_pairs, sizes
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.ground_plane import GroundPlane
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.features.view_choice import inner_detector
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames
from tsuiseki.tracking.video.source import Source

# Number of thresholds that are tried.
LEVELS = 24
# Share of the detections above the highest of them.
HIGHEST = 0.03
# Longest time from one box of a chain to the next, seconds.
LONGEST_GAP = 0.4
# Most frames from one box of a chain to the next, so that the search stays short at high frame rates.
MOST_GAP = 10
# Least intersection over union of neighbours on a chain.
OVERLAP = 0.3
# A chain moves that covers more than this, heights.
MOVED = 1.0
# A chain moves that lasts at least this long, seconds.
LASTED = 0.5
# Least share of the detections on chains that move; below it what moves is no evidence.
ENOUGH = 0.2
# Probability from which a detection is kept.
KEPT = 0.1
# A track stands that stays within this, heights.
STANDING = 0.5
# Quantile of the scores of moving tracks below which a standing one is clutter.
QUANTILE = 0.05
# Tracks that must move before any is taken for clutter.
FEWEST = 4
# A track moves that lasts at least this long, seconds.
MOVING_SECONDS = 1.0


def score_floor(frames: IntArray, boxes: FloatArray, scores: FloatArray, frame_rate: float) -> float | None:
    """The score from which detections are worth keeping; None where too little moves.

    Args:
        frames: ``(N,)`` not decreasing.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` on any scale, not NaN.
        frame_rate: frames a second.
    """
    if len(frames) == 0:
        return None
    quantiles = 1 - np.geomspace(1, HIGHEST, LEVELS)
    levels = np.unique(np.quantile(scores, quantiles, method="lower"))[::-1]
    links = _links(frames, boxes, frame_rate)
    moving = np.array([_moving(links, level, frames, boxes, scores, frame_rate) for level in levels], dtype=np.float64)
    above = np.array([np.count_nonzero(scores >= level) for level in levels], dtype=np.float64)
    best = int((moving**2 / above).argmax())
    trusted = moving[best] / above[best]
    if trusted < ENOUGH:
        return None
    marginal = np.diff(moving[best:]) / np.diff(above[best:])
    weights = np.append(above[best], np.diff(above[best:]))
    falling = scipy.optimize.isotonic_regression(np.append(trusted, marginal), weights=weights, increasing=False)
    right = falling.x / trusted
    return float(np.interp(KEPT, right[::-1], levels[best:][::-1]))


def standing_clutter(tracks: Sequence[Track], images: Sequence[FloatArray], frame_rate: float) -> IntArray:
    """Which tracks stand still and score less than those that move.

    Args:
        tracks: with finite scores.
        images: ``(T, 4)`` boxes of each where the image shows them, pixels.
        frame_rate: frames a second.

    Returns:
        Indices of ``tracks``; none where fewer than four tracks move.
    """
    if not tracks:
        return np.empty(0, dtype=np.int64)
    # How far the centres lie apart, heights.
    covered = np.array([np.linalg.norm(np.ptp(centres(b), axis=0)) / np.median(sizes(b)[:, 1]) for b in images])
    seconds = np.array([track.frames[-1] - track.frames[0] + 1 for track in tracks]) / frame_rate
    score = np.array([track.scores.mean() for track in tracks])
    moving = (covered > MOVED) & (seconds >= MOVING_SECONDS)
    if np.count_nonzero(moving) < FEWEST:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero((covered < STANDING) & (score < np.quantile(score[moving], QUANTILE)))


def _links(frames: IntArray, boxes: FloatArray, frame_rate: float) -> tuple[IntArray, IntArray]:
    """Earlier and later boxes that overlap, the best last: that of the shortest gap, then of the largest overlap."""
    centre, size = centres(boxes), sizes(boxes)
    near = []
    for gap in range(1, max(2, min(MOST_GAP, round(LONGEST_GAP * frame_rate))) + 1):
        i, j = near_pairs(frames, centre, size, gap)
        overlap = iou_pairs(boxes[i], boxes[j])
        good = overlap > OVERLAP
        near.append((i[good], j[good], overlap[good] - gap))
    i, j, fit = (np.concatenate(column) for column in zip(*near, strict=True))
    order = np.argsort(fit, kind="stable")
    return i[order], j[order]


def _moving(
    links: tuple[IntArray, IntArray],
    level: float,
    frames: IntArray,
    boxes: FloatArray,
    scores: FloatArray,
    frame_rate: float,
) -> int:
    """How many detections from a score upwards lie on chains that cover a height and last half a second."""
    i, j = links
    good = (scores[i] >= level) & (scores[j] >= level)
    above = np.flatnonzero(scores >= level)
    _, label = np.unique(_chains(i[good], j[good], len(frames))[above], return_inverse=True)
    order = np.argsort(label, kind="stable")
    start = np.flatnonzero(np.diff(label[order], prepend=-1))
    rows = above[order]
    centre, when = centres(boxes[rows]), frames[rows]
    span = np.maximum.reduceat(centre, start) - np.minimum.reduceat(centre, start)
    height = np.add.reduceat(sizes(boxes[rows])[:, 1], start) / np.bincount(label)
    seconds = (np.maximum.reduceat(when, start) - np.minimum.reduceat(when, start) + 1) / frame_rate
    moves = (np.linalg.norm(span, axis=1) > MOVED * height) & (seconds >= LASTED)
    return int(moves[label].sum())


def _chains(i: IntArray, j: IntArray, count: int) -> IntArray:
    """``(N,)`` chain of each of ``count`` boxes, by the links of `_links` that are the best of both their boxes."""
    best_after, best_before = np.full(count, -1), np.full(count, -1)
    # The best link of each box is written last.
    best_after[i], best_before[j] = np.arange(len(i)), np.arange(len(j))
    mutual = (best_after[i] == np.arange(len(i))) & (best_before[j] == np.arange(len(j)))
    chains = scipy.sparse.coo_array((np.ones(mutual.sum()), (i[mutual], j[mutual])), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.connected_components(chains, directed=False)[1])


# Threshold at which a network first runs: least score of the boxes that count.
LOWEST = 0.05
# Length of the beginning of the video that gives the threshold, seconds.
SECONDS = 20.0
# Most detections that the threshold is taken from.
MOST = 60_000
# Given detections are cut where no more than this share of them is worth keeping.
MOSTLY = 0.25


def floor_of(detections: Sequence[Detections], frame_rate: float) -> float | None:
    """`score_floor` of ``(F,)`` frames' detections; None where they have no scores, or too little moves."""
    frames, boxes, scores = _beginning(detections)
    return None if np.isnan(scores).any() else score_floor(frames, boxes, scores, frame_rate)


def _beginning(detections: Sequence[Detections]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Frames, boxes and scores of the first detections, at most `MOST`."""
    counts = np.array([len(frame) for frame in detections], dtype=np.int64)
    return boxes_of_frames(detections[: int(np.searchsorted(np.cumsum(counts), MOST, side="right"))])


def _flickers(detections: Sequence[Detections], floor: float, frame_rate: float) -> bool:
    """Whether most detections of a score below ``floor`` are on chains shorter than a second."""
    frames, boxes, scores = _beginning(detections)
    label = _chains(*_links(frames, boxes, frame_rate), len(frames))
    begin, end = np.full(len(frames), len(detections)), np.zeros(len(frames), dtype=np.int64)
    np.minimum.at(begin, label, frames)
    np.maximum.at(end, label, frames)
    short = (end - begin)[label[scores < floor]] < frame_rate
    return bool(2 * np.count_nonzero(short) > len(short))


def above_floor(detections: Sequence[Detections], frame_rate: float) -> tuple[list[Detections], float | None]:
    """The given detections that are worth keeping, an entry a frame, and their least score; None where all are kept."""
    floor, unchanged = floor_of(detections, frame_rate), [*detections]
    if floor is not None:
        above = [frame.select(frame.scores >= floor) for frame in detections]
        if sum(map(len, above)) <= MOSTLY * sum(map(len, detections)) and _flickers(detections, floor, frame_rate):
            return above, floor
    return unchanged, None


class ScoreChoice:
    """A network of another project whose threshold the beginning of a video gives.

    Args:
        detect: the network, in tiles or not.
        network: the same, which holds the threshold.
        ground: also drops what scores less.

    Attributes:
        floor: the threshold by now; None where the usual one is taken: too little moves, or the camera does.
        moving: pictures do not show that the camera stands still in most of the beginning.
    """

    def __init__(self, detect: Detect, network: ForeignDetector, ground: GroundPlane | None) -> None:
        self._detect, self._network, self._ground = detect, network, ground
        self.floor: float | None = None
        self.moving = False

    def choose(
        self,
        source: Source,
        batch_size: int,
        workers: int,
        times: StageTimes,
        inferred: InferenceFrames = ALL_INFERRED,
    ) -> dict[int, Detections]:
        """Detections by frame number at the beginning of the video, at the threshold that is taken from then on."""
        usual, self._network.score_threshold = self._network.score_threshold, LOWEST
        last = source.frames_wanted.first + round(SECONDS * source.frame_rate)
        beginning: dict[int, Detections] = {}
        frames, camera = source.frames(), StandingCamera()
        for frame, detections in stream(frames, self._detect, None, batch_size, times, workers, inferred):
            if frame.index >= last:
                break
            beginning[frame.index] = detections
            camera.add(frame.image)
        self.moving = 2 * len(camera.moved) > len(camera)
        self.floor = None if self.moving else floor_of([*beginning.values()], source.frame_rate)
        threshold = usual if self.floor is None else self.floor
        self._network.score_threshold = threshold
        if self._ground is not None:
            self._ground.score_threshold = threshold
        return {number: detections.select(detections.scores >= threshold) for number, detections in beginning.items()}

    @property
    def threshold(self) -> float:
        """Score from which boxes are kept by now."""
        return self._network.score_threshold

    def __str__(self) -> str:
        if self.floor is None:
            reason = "the camera moves too much" if self.moving else "too little moves"
            return f"scores: {reason} to tell what they are worth; kept from {self.threshold:g}"
        return f"scores: boxes are kept from {self.floor:.2f} on, by what moves; --score-threshold says another"


def score_choice(detect: object, ground: GroundPlane | None) -> ScoreChoice | None:
    """For a network of another project; None for others, whose scores are known or whose threshold is theirs."""
    network = inner_detector(detect)
    return ScoreChoice(detect, network, ground) if isinstance(network, ForeignDetector) else None  # type: ignore[arg-type]
