"""What a result shows of its own quality: numbers that labels are not needed for.

Tracks show how much of them was filled in, how unsteady their boxes are, how crowded it is, where they begin and end in
the midst of the picture, and whether another one begins there soon after. The network of a flow shows what it left out,
how much more the other way of each decision costs (`marginals`), and which tracks stay when it is solved again at other
costs and without some of the detections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from tsuiseki.tracking.association.marginals import Marginals
from tsuiseki.tracking.association.network_flow import FlowGraph, solve, track_labels
from tsuiseki.tracking.association.residual_flow import ResidualFlow
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Track

# Names of `network_signs`.
NETWORK_SIGNS = (
    "left_out", "left_out_apart", "left_out_sure", "sure", "sure_least", "weak", "weak_rate", "weak_most", "worth",
    "gaps", "kept", "together",
)  # fmt: skip
# Heights from the border of the picture within which a track may begin and end.
EDGE = 0.5
# Seconds from the ends of the video within which it may.
ENDS = 0.5
# Seconds within which a track may be that of another one that ended.
RETURN = 3.0
# Heights within which it begins then.
NEAR = 0.7
# Heights a second by which that grows.
SPEED = 0.7
# Seconds below which a track is short.
SHORT = 1.0
# Heights a second below which a track stands still.
STILL = 0.1
# Share of the height by which a box is not as high as the others of its place.
ODD = 0.3
# Times that the flow is solved again.
TRIALS = 2
# Share of the detections that are left out then.
DROPPED = 0.15
# Deviation of the costs then, nats.
NOISE = 1.0
# Margin below which exchanges are weighed, nats.
CLOSE = 2.5
# Logit of the probability that a link is wrong whose other way costs nothing; as of the questions of a review.
LINK = -1.6
# What each doubling of its gap adds.
GAP = 0.45
# By how much each unit of cost lowers it.
SLOPE = 0.45
# Detections of a network that are looked at.
MOST = 10_000
# Parts of a longer video that they come from.
PARTS = 5


def track_signs(
    tracks: Sequence[Track], rate: float, size: tuple[int, int] | None, frames: tuple[int, int] | None = None
) -> dict[str, float]:
    """Signs in the tracks alone.

    Args:
        tracks: at least one, none empty.
        rate: frames a second.
        size: width and height of a frame in pixels; None takes the extent of the boxes.
        frames: first and last frame that were processed; None takes those of the boxes.
    """
    numbers, boxes, scores, observed = (
        np.concatenate([getattr(track, name) for track in tracks]) for name in ("frames", "boxes", "scores", "observed")
    )
    lengths = np.array([len(track) for track in tracks])
    first, last = (int(numbers.min()), int(numbers.max())) if frames is None else frames
    frame, length = numbers - first, last - first + 1
    who, starts = np.repeat(np.arange(len(tracks)), lengths), np.append(0, np.cumsum(lengths)[:-1])
    ends = starts + lengths - 1
    height = boxes[:, 3] - boxes[:, 1]
    width, tall = size or (float(boxes[:, 2].max()), float(boxes[:, 3].max()))
    seconds = (frame[ends] - frame[starts] + 1) / rate
    detected = np.bincount(who, observed) / (frame[ends] - frame[starts] + 1)
    centre = centres(boxes)
    way = np.hypot(*(centre[ends] - centre[starts]).T) / np.maximum(height[starts], 1) / seconds
    broken, gone, begun = _broken(frame, boxes, starts, ends, rate, (width, tall), length)
    shaking, swelling = _unsteady(frame, centre, height, who, observed)
    hidden = _covered(frame, boxes)
    return {
        "filled": float(1 - observed.mean()),
        "detected": float(detected[who].mean()),
        "detected_least": float(np.quantile(detected[who], 0.1)),
        "seconds": float(np.log(np.average(seconds, weights=lengths))),
        "short": float((seconds < SHORT)[who].mean()),
        "tracks": float(np.log(len(tracks) / max(len(frame) / max(length, 1), 0.1))),
        "broken": broken / len(tracks),
        "broken_rate": float(np.log1p(broken / (len(frame) / rate))),
        "resumed": _resumed(centre, height, frame, gone, begun, rate) / len(tracks),
        "people": float(np.log(len(frame) / max(length, 1) + 0.1)),
        "covered": float(hidden.mean()),
        "covered_much": float((hidden > 0.5).mean()),
        "height": float(np.log(np.median(height) / tall)),
        "height_spread": float(np.std(np.log(np.maximum(height, 1)))),
        "off_ground": _off_ground(boxes, height),
        "shaking": float(np.log(shaking + 1e-3)),
        "swelling": float(np.log(swelling + 1e-3)),
        "still": float((way < STILL)[who].mean()),
        "rate": float(np.log(rate)),
        "length": float(np.log(max(length, 1) / rate)),
    } | _score_signs(scores[observed], who[observed])


def _score_signs(scores: FloatArray, who: IntArray) -> dict[str, float]:
    """Signs in the scores of ``(N,)`` detections of some tracks, on whatever scale they are."""
    if not len(scores) or np.ptp(scores) < 1e-6:
        return {}
    low, middle, high = np.quantile(scores, [0.05, 0.5, 0.95])
    means = np.bincount(who, scores) / np.maximum(np.bincount(who), 1)
    between = float(np.var(means[who]) / max(float(np.var(scores)), 1e-9))
    skew = float((high - middle) / max(high - low, 1e-9))
    return {"score": float(np.clip(middle, 0, 1)), "score_least": float(np.clip(low, 0, 1)),
            "score_skew": skew, "score_between": between}  # fmt: skip


def _broken(
    frames: IntArray, boxes: FloatArray, starts: IntArray, ends: IntArray, rate: float,
    size: tuple[float, float], length: int,
) -> tuple[int, IntArray, IntArray]:  # fmt: skip
    """How many tracks begin or end in the midst of picture and video; rows of these ends, and of these beginnings."""
    height = (boxes[:, 3] - boxes[:, 1])[:, None]
    low, high = EDGE * height * np.array([0.5, 0.0]), np.array(size) - EDGE * height * np.array([0.5, 0.2])
    inside: BoolArray = ((boxes[:, :2] > low) & (boxes[:, 2:] < high)).all(axis=1)
    gone = ends[inside[ends] & (frames[ends] < length - ENDS * rate)]
    begun = starts[inside[starts] & (frames[starts] > ENDS * rate)]
    return len(gone) + len(begun), gone, begun


def _resumed(
    centre: FloatArray, height: FloatArray, frames: IntArray, gone: IntArray, begun: IntArray, rate: float
) -> int:
    """How many beginnings lie where a track ended shortly before."""
    if not len(gone) or not len(begun):
        return 0
    found = np.zeros(len(begun), dtype=np.bool_)
    order = gone[np.argsort(frames[gone], kind="stable")]
    first = np.searchsorted(frames[order], frames[begun] - RETURN * rate)
    last = np.searchsorted(frames[order], frames[begun])
    for step in range(int((last - first).max(initial=0))):
        row = first + step
        there = row < last
        end = order[np.minimum(row, len(order) - 1)]
        apart = np.hypot(*(centre[begun] - centre[end]).T) / np.maximum(height[end], 1)
        reach = NEAR + SPEED * (frames[begun] - frames[end]) / rate
        found |= there & (apart < reach) & (np.abs(np.log(height[begun] / height[end])) < ODD)
    return int(found.sum())


def _unsteady(
    frames: IntArray, centre: FloatArray, height: FloatArray, who: IntArray, observed: BoolArray
) -> tuple[float, float]:
    """Median departures of centre and height of a box from the mean of its neighbours, heights."""
    if len(frames) < 3:
        return 0.0, 0.0
    here = (who[2:] == who[:-2]) & (frames[2:] - frames[:-2] == 2) & observed[1:-1]
    if not here.any():
        return 0.0, 0.0
    tall = np.maximum(height[1:-1][here], 1)
    bend = (centre[1:-1] - (centre[2:] + centre[:-2]) / 2)[here] / tall[:, None]
    swell = (height[1:-1] - (height[2:] + height[:-2]) / 2)[here] / tall
    return float(np.median(np.hypot(*bend.T))), float(np.median(np.abs(swell)))


def _covered(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(N,)`` largest share of each box that another one of its frame covers whose lower edge is lower."""
    covered = np.zeros(len(frames))
    order = np.lexsort((boxes[:, 3], frames))
    area = np.maximum((boxes[:, 2:] - boxes[:, :2]).prod(axis=1), 1e-9)
    most = int(np.bincount(frames - frames.min()).max())
    for step in range(1, min(most, 60)):
        i, j = order[:-step], order[step:]
        same = frames[i] == frames[j]
        i, j = i[same], j[same]
        low, high = np.maximum(boxes[i, :2], boxes[j, :2]), np.minimum(boxes[i, 2:], boxes[j, 2:])
        covered[i] = np.maximum(covered[i], (high - low).clip(0).prod(axis=1) / area[i])
    return covered


def _off_ground(boxes: FloatArray, height: FloatArray) -> float:
    """Share of the boxes that are not as high as those at their place: heights are a line over the lower edge."""
    feet, high = boxes[:, 3], np.maximum(height, 1)
    if len(feet) < 3 or np.ptp(feet) < 1e-6:
        return 0.0
    weight = np.ones(len(feet))
    for _ in range(5):
        slope, level = np.polyfit(feet, high, 1, w=weight / high)
        off = np.abs(np.log(np.maximum(slope * feet + level, 0.1 * high) / high))
        weight = 1 / np.maximum(off, 0.05)
    return float((off > ODD).mean())


def network_signs(network: SolvedNetwork, seed: int = 0) -> dict[str, float]:
    """Signs in the network of a flow, in which not everything is certain.

    Args:
        network: at least one of its detections is in a track; of a long one some parts are taken.
        seed: of the costs of the second solve.
    """
    network = _parts_of(network)
    graph, track = network.graph, network.track
    used = track > 0
    tail, head, wrong = link_doubts(network)
    gap = network.frames[head] - network.frames[tail]
    people, tracks = int(used.sum()), len(np.unique(track[used]))
    kept, together = _again(network, np.random.default_rng(seed))
    sure = scipy.special.expit(-graph.observation)
    apart = ~used & ~_on_track(network)
    return {
        "left_out": float(1 - used.mean()),
        "left_out_apart": float(apart.mean()),
        "left_out_sure": float(np.log1p(sure[apart].sum() / people)),
        "sure": float(sure[used].mean()),
        "sure_least": float(np.quantile(sure[used], 0.1)),
        "weak": float(np.log1p(wrong.sum() / tracks)),
        "weak_rate": float(np.log1p(100 * wrong.sum() / people)),
        "weak_most": float(np.log1p((wrong > 0.1).sum() / tracks)),
        "worth": float(np.quantile(_worth(network), 0.1)),
        "gaps": float((gap > 1).mean()) if len(gap) else 0.0,
        "kept": kept,
        "together": together,
    }


def link_doubts(network: SolvedNetwork) -> tuple[IntArray, IntArray, FloatArray]:
    """The links of tracks: detections before and after, and how likely each is wrong, all ``(L,)``.

    The other way is to end one track and start another, or, where it costs less than `CLOSE`, an exchange with others.
    """
    graph, first = network.graph, 3 * len(network)
    flow = ResidualFlow(graph, solve(graph))
    linked = flow.used[first:] & (network.track[graph.tail] > 0)
    margins = Marginals(flow, CLOSE, np.append(np.zeros(first, np.bool_), linked))
    tail, head = graph.tail[linked], graph.head[linked]
    doubling = np.log2(np.maximum(network.frames[head] - network.frames[tail], 1))
    ended, exchanged = (getattr(margins, name)[first:][linked] for name in ("through", "cost"))
    exchanged = np.where(exchanged < CLOSE, exchanged, np.inf)
    return tail, head, scipy.special.expit(LINK + GAP * doubling - SLOPE * np.minimum(ended, exchanged))


def _parts_of(network: SolvedNetwork) -> SolvedNetwork:
    """The network; of one of more than `MOST` detections as many in `PARTS` parts of the video."""
    if len(network) <= MOST:
        return network
    place = np.arange(len(network)) * PARTS / len(network)
    kept = place % 1 < MOST / len(network)
    # Whole frames.
    kept = np.isin(network.frames, network.frames[kept])
    columns = {name: getattr(network, name)[kept] for name in ("frames", "boxes", "scores", "origin", "track")}
    return replace(network, graph=network.graph.part(kept), **columns)


def _on_track(network: SolvedNetwork) -> BoolArray:
    """``(N,)`` detections of no track that lie on one of their frame."""
    boxes, frames, used = network.boxes, network.frames, network.track > 0
    on = np.zeros(len(frames), dtype=np.bool_)
    area = np.maximum((boxes[:, 2:] - boxes[:, :2]).prod(axis=1), 1e-9)
    for step in range(1, int(np.bincount(frames).max(initial=0))):
        i, j = np.arange(len(frames) - step), np.arange(step, len(frames))
        differ = (frames[i] == frames[j]) & (used[i] != used[j])
        i, j = i[differ], j[differ]
        low, high = np.maximum(boxes[i, :2], boxes[j, :2]), np.minimum(boxes[i, 2:], boxes[j, 2:])
        share = (high - low).clip(0).prod(axis=1) / np.minimum(area[i], area[j])
        on[i[share > 0.5]] = on[j[share > 0.5]] = True
    return on & ~used


def _worth(network: SolvedNetwork) -> FloatArray:
    """``(N,)`` mean worth of a detection of the track that each is in, in (0, 1)."""
    used = network.track > 0
    number = np.unique(network.track[used], return_inverse=True)[1]
    worth = np.bincount(number, -network.graph.observation[used]) / np.bincount(number)
    return np.asarray(scipy.special.expit(worth[number]))


def _again(network: SolvedNetwork, rng: np.random.Generator) -> tuple[float, float]:
    """Shares of the detections that stay in one track, and of those whose track is of one, when solved again."""
    kept, together = [], []
    for _ in range(TRIALS):
        graph = network.graph
        chosen = rng.random(len(graph)) >= DROPPED
        links = rng.normal(0, NOISE, len(graph.tail))
        costs = graph.observation + rng.normal(0, NOISE / 2, len(graph)), graph.entry, graph.exit
        part = FlowGraph(*costs, graph.tail, graph.head, graph.transition + links).part(chosen)
        labels, track = track_labels(solve(part)), network.track[chosen]
        both = (labels >= 0) & (track > 0)
        rows, columns = np.unique(track[both], return_inverse=True)[1], labels[both]
        if not both.any():
            return 0.0, 0.0
        table = scipy.sparse.coo_array((np.ones(len(rows)), (rows, columns))).tocsr()
        kept.append(table.max(axis=1).sum() / (track > 0).sum())
        together.append(table.max(axis=0).sum() / both.sum())
    return float(np.mean(kept)), float(np.mean(together))
