"""Generated streets with exact labels and a simulated detector, both as different from each other as real ones are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.geometry import clip_boxes, iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

# Widths and heights of pictures, pixels.
SIZES = ((640, 480), (960, 540), (1280, 720), (1920, 1080))
RATES = (5.0, 7.0, 10.0, 14.0, 25.0, 30.0)
# Points across and down a box at which it is asked what hides it.
GRID = 8
# Share of a box's width that a person's body takes.
BODY = 0.7
# Probability that a street has things that look like people, and their largest share then.
LIKE_PEOPLE = 0.3
MOST_ALIKE = 0.2
# Least share of a person's box that lies in the picture.
INSIDE = 0.2


@dataclass(frozen=True)
class DetectedStreet:
    """A street with its labels and what a detector makes of it.

    Attributes:
        truth: labels; who is hidden is among them.
        detections: of each frame.
        rate: frames a second.
        size: width and height of a frame, pixels.
    """

    truth: GroundTruth
    detections: list[Detections]
    rate: float
    size: tuple[int, int]


@dataclass(frozen=True)
class SimulatedDetector:
    """How a simulated detector errs: the logit of missing a person is a sum of what follows.

    Attributes:
        missed: of somebody in full view.
        hidden: what each hidden share adds.
        small: what each halving of the height below that of `size` adds.
        size: pixels.
        person: standard deviation over people, who are harder or easier to detect.
        moment: standard deviation of what changes with time.
        steady: seconds over which it changes.
        jitter: of sides, in heights, that changes as that does.
        biased: standard deviation of what each person's sides are always off by, heights.
        cut: by how much of what is hidden of a person the box is lower.
        doubled: probability of a second box on a detected person.
        false: false boxes a frame, on average.
        lasting: median seconds that a false box comes again and again at its place.
        clear: by how much scores of people are above those of false boxes, in logits.
        noise: of scores, in logits.
        least: score below which boxes are left out; None where all boxes score 1.
    """

    missed: float
    hidden: float
    small: float
    size: float
    person: float
    moment: float
    steady: float
    jitter: float
    biased: float
    cut: float
    doubled: float
    false: float
    lasting: float
    clear: float
    noise: float
    least: float | None

    @classmethod
    def drawn(cls, rng: np.random.Generator, people: int, height: int) -> SimulatedDetector:
        """A detector at random, from excellent to poor."""
        poor = rng.random()
        return cls(
            missed=-4.0 + 4.0 * poor + rng.normal(0, 0.7),
            hidden=rng.uniform(3, 9),
            small=rng.uniform(0, 3) * poor,
            size=height * rng.uniform(0.06, 0.2),
            person=rng.uniform(0.3, 1.2) + 1.2 * poor,
            moment=rng.uniform(0.2, 2.0),
            steady=float(np.exp(rng.uniform(np.log(0.05), np.log(1.5)))),
            jitter=rng.uniform(0.01, 0.03) + 0.05 * poor * rng.random(),
            biased=rng.uniform(0.01, 0.03) + 0.08 * poor * rng.random(),
            cut=rng.uniform(0, 0.9),
            doubled=rng.uniform(0, 0.15) * rng.random(),
            false=people * poor * float(np.exp(rng.normal(np.log(0.3), 1.0))),
            lasting=float(np.exp(rng.uniform(np.log(0.15), np.log(1.2)))),
            clear=rng.uniform(1.5, 4.0) - 1.2 * poor,
            noise=rng.uniform(0.3, 1.2),
            least=None if rng.random() < 0.1 else float(rng.choice([0.05, 0.3, 0.5, 0.6])),
        )


def detected_street(seed: int) -> DetectedStreet:
    """The street of a seed: camera, crowd, signs, motion of the camera and detector are drawn."""
    rng = np.random.default_rng([seed, 66])
    size = SIZES[rng.integers(len(SIZES))]
    rate = float(RATES[rng.integers(len(RATES))])
    length = int(np.clip(rng.uniform(8, 40) * rate, 60, 600))
    people = int(np.exp(rng.uniform(np.log(3), np.log(32))))
    tall = np.exp(rng.uniform(np.log(0.15), np.log(0.9)))
    settings = StreetSettings(
        width=64 * size[0] // size[1], height=64, frames=length, frame_rate=rate, people=people, occluders=0, samples=1,
        person_height=(max(0.03, tall * rng.uniform(0.1, 0.4)) * 64, tall * 64),
    )  # fmt: skip
    clip = StreetClip(settings, seed)
    truth = _labels(clip, size, length, rng)
    detector = SimulatedDetector.drawn(rng, people, size[1])
    detections = _detected(truth, detector, rate, length, size, rng)
    if rng.random() < LIKE_PEOPLE:
        # Posters and mirror images: whoever looks like a person is detected as one.
        people_only = rng.random(int(truth.ids.max()) + 1) >= rng.uniform(0, MOST_ALIKE)
        truth = truth.select(people_only[truth.ids])
    return DetectedStreet(truth, detections, rate, size)


def _labels(clip: StreetClip, size: tuple[int, int], length: int, rng: np.random.Generator) -> GroundTruth:
    """The people of a clip in a picture of ``size``, by the feet from far to near; a camera may sway."""
    scale, columns = size[1] / clip.settings.height, []
    standing = rng.random() * rng.random()
    sway = _sway(rng, length, size)
    for number, walker in enumerate(clip.walkers, start=1):
        places, frames = walker.positions, walker.first + np.arange(len(walker.positions))
        if rng.random() < standing:
            places = np.repeat(places[[len(places) // 3]], length, axis=0)
            frames = np.arange(length)
        feet, depth = clip.camera.project(np.insert(places, 2, 0.0, axis=1))
        heads, _ = clip.camera.project(np.insert(places, 2, walker.person.build.height, axis=1))
        high = np.maximum(feet[:, 1] - heads[:, 1], 0.01)
        half = high * 0.2 * (1 + 0.15 * np.sin(2 * np.pi * 0.9 * frames / clip.settings.frame_rate + number))
        boxes = scale * np.column_stack([feet[:, 0] - half, feet[:, 1] - high, feet[:, 0] + half, feet[:, 1]])
        there = (frames >= 0) & (frames < length) & (depth > 0.5)
        moved = boxes[there] + np.tile(sway[frames[there]], 2)
        columns.append((frames[there], np.full(int(there.sum()), number), moved, depth[there]))
    frames, ids, boxes, depth = (np.concatenate(column) for column in zip(*columns, strict=True))
    cut = clip_boxes(boxes, *size)
    area, uncut = ((b[:, 2:] - b[:, :2]).clip(0).prod(axis=1) for b in (cut, boxes))
    inside = (area > INSIDE * uncut) & (cut[:, 3] - cut[:, 1] > 0.02 * size[1])
    order = np.flatnonzero(inside)[np.lexsort((ids[inside], frames[inside]))]
    frames, ids, boxes, cut, depth = frames[order], ids[order], boxes[order], cut[order], depth[order]
    visible = visible_shares(frames, boxes, depth, _signs(rng, size)) * (area / uncut)[order]
    counted = np.ones(len(frames), dtype=np.bool_)
    return GroundTruth(frames, ids.astype(np.int64), cut, counted, ~counted, visible)


def _sway(rng: np.random.Generator, length: int, size: tuple[int, int]) -> FloatArray:
    """``(T, 2)`` by how much a camera's picture moves, pixels; two in three stand still."""
    if rng.random() < 0.66:
        return np.zeros((length, 2))
    phase, period = rng.uniform(0, 6.3, 2), rng.uniform(40, 400, 2)
    slow = np.sin(2 * np.pi * np.arange(length)[:, None] / period + phase) * rng.uniform(0, 0.2, 2) * size
    return np.asarray(slow + np.cumsum(rng.normal(0, 0.001 * size[1], (length, 2)), axis=0))


def _signs(rng: np.random.Generator, size: tuple[int, int]) -> FloatArray:
    """``(S, 5)`` boxes that hide whoever is farther away than the last column, metres."""
    count = int(rng.integers(0, 6))
    middle = rng.uniform(0, 1, (count, 2)) * size
    half = 0.5 * np.column_stack([rng.uniform(0.01, 0.08, count), rng.uniform(0.1, 0.5, count)]) * size
    return np.column_stack([middle - half, middle + half, rng.uniform(3, 25, count)])


def visible_shares(frames: IntArray, boxes: FloatArray, depth: FloatArray, signs: FloatArray) -> FloatArray:
    """``(N,)`` share of each box that nobody nearer and no sign covers, by points of it; frames increase."""
    shares, grid = np.ones(len(boxes)), (np.arange(GRID) + 0.5) / GRID
    side = 0.5 * (1 - BODY) * (boxes[:, 2] - boxes[:, 0])
    bodies = boxes + side[:, None] * np.array([1, 0, -1, 0])
    for here in np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames)) + 1):
        x1, y1, x2, y2 = bodies[here].T
        x, y = (low[:, None] + grid * (high - low)[:, None] for low, high in ((x1, x2), (y1, y2)))
        hiding = np.concatenate([np.column_stack([bodies[here], depth[here]]), signs])
        across = (x[:, None] > hiding[None, :, :1]) & (x[:, None] < hiding[None, :, 2:3])
        down = (y[:, None] > hiding[None, :, 1:2]) & (y[:, None] < hiding[None, :, 3:4])
        nearer = hiding[:, 4] < depth[here][:, None] - 1e-9
        covered = ((across & nearer[..., None])[..., None, :] & down[..., None]).any(axis=1)
        shares[here] = 1 - covered.mean(axis=(1, 2))
    return shares


def _detected(
    truth: GroundTruth,
    detector: SimulatedDetector,
    rate: float,
    length: int,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> list[Detections]:
    high = truth.boxes[:, 3] - truth.boxes[:, 1]
    who, person = np.unique(truth.ids, return_inverse=True)
    keep = float(np.exp(-1 / (detector.steady * rate)))
    moments, errors = (_series(rng, (length, len(who), n), keep) for n in (1, 4))
    logit = detector.missed + detector.hidden * (1 - truth.visibility)
    logit += detector.small * np.log2(np.maximum(detector.size / high, 1))
    logit += detector.person * rng.normal(size=len(who))[person]
    logit += detector.moment * moments[truth.frames, person, 0]
    missed = 1 / (1 + np.exp(-logit))
    rows = np.flatnonzero(rng.random(len(logit)) >= missed)
    rows = np.concatenate([rows, (doubled := rows[rng.random(len(rows)) < detector.doubled])])
    far = np.append(np.full(len(rows) - len(doubled), detector.jitter), np.full(len(doubled), 0.12))
    noise = far[:, None] * (errors[truth.frames[rows], person[rows]] * [0.6, 1, 0.6, 1])
    noise[len(rows) - len(doubled) :] += 0.12 * rng.normal(size=(len(doubled), 4)) * [0.6, 1, 0.6, 1]
    noise += detector.biased * rng.normal(size=(len(who), 4))[person[rows]] * [0.6, 1, 0.6, 1]
    noise[:, 3] -= detector.cut * (1 - truth.visibility[rows])
    boxes = truth.boxes[rows] + noise * high[rows, None]
    certain = 2.5 + 0.5 * detector.clear - 0.6 * (logit[rows] + 2) * (logit[rows] > -2) / 2
    certain[len(rows) - len(doubled) :] -= detector.clear
    frames, wrong = _false(truth, detector, length, rate, size, rng)
    frames = np.concatenate([truth.frames[rows], frames])
    boxes = np.concatenate([boxes, wrong])
    certain = np.concatenate([certain, np.full(len(wrong), 2.5 - 0.5 * detector.clear)])
    scores = 1 / (1 + np.exp(-certain - detector.noise * rng.normal(size=len(certain))))
    boxes, scores = clip_boxes(boxes, *size), np.ones(len(scores)) if detector.least is None else scores
    good = (scores >= (detector.least or 0)) & ((boxes[:, 2:] - boxes[:, :2]) >= 3).all(axis=1)
    good[good] = ~_suppressed(frames[good], boxes[good], scores[good])
    return [Detections(boxes[here], scores[here]) for here in (good & (frames == f) for f in range(length))]


def _series(rng: np.random.Generator, shape: tuple[int, int, int], keep: float) -> FloatArray:
    """Normal numbers, each of which keeps so much of the one before, by the first axis."""
    series = rng.normal(size=shape)
    for step in range(1, len(series)):
        series[step] = keep * series[step - 1] + np.sqrt(1 - keep**2) * series[step]
    return series


def _false(
    truth: GroundTruth, detector: SimulatedDetector, length: int, rate: float, size: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[IntArray, FloatArray]:  # fmt: skip
    """Frames and boxes of false detections: most come for a moment, some for long, again and again at one place."""
    sizes = truth.boxes[:, 2:] - truth.boxes[:, :2]
    frames, boxes, wanted = list[IntArray](), list[FloatArray](), detector.false * length
    while wanted > 0:
        seconds = detector.lasting * np.exp(rng.normal(0, 1.4))
        at = int(rng.integers(-length // 4, length)) + np.arange(1 + int(seconds * rate))
        at = at[(at >= 0) & (at < length)]
        at = at[rng.random(len(at)) < rng.beta(2, 1.5)]
        drift = rng.normal(0, 0.3, 2) * (rng.random() < 0.3) * (np.arange(len(at)) / rate)[:, None]
        like = sizes[rng.integers(len(sizes))]
        frames.append(at)
        boxes.append(_around(rng.uniform(0, 1, 2) * size, like, len(at), rng) + np.tile(drift, 2) * like[1])
        wanted -= max(len(at), 1)
    none = np.empty(0, np.int64), np.empty((0, 4))
    return np.concatenate([none[0], *frames]), np.concatenate([none[1], *boxes])


def _around(middle: FloatArray, size: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """``(N, 4)`` boxes about one place."""
    box = np.concatenate([middle - size / 2, middle + size / 2])
    return np.asarray(box + 0.03 * size[1] * rng.normal(size=(count, 4)))


def _suppressed(frames: IntArray, boxes: FloatArray, scores: FloatArray, most: float = 0.65) -> BoolArray:
    """Which boxes a detector leaves out, for they lie on one of a higher score."""
    out = np.zeros(len(frames), dtype=np.bool_)
    order = np.lexsort((-scores, frames))
    for here in np.split(order, np.flatnonzero(np.diff(frames[order])) + 1):
        over = iou_matrix(boxes[here], boxes[here]) > most
        for k in range(len(here)):
            out[here[k]] = (over[k, :k] & ~out[here[:k]]).any()
    return out
