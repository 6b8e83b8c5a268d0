"""How good a result is, estimated without labels, each score with an interval that holds the true one in 9 of 10 cases.

Trees at random (Geurts et al., "Extremely randomized trees", 2006) know from generated streets which scores go with
which signs (`quality_signs`). The ends of an interval are quantiles of the errors on streets that were left out of the
fit (conformal prediction: Lei et al., "Distribution-free predictive inference for regression", 2018), on a logistic
scale, so that it is narrow near 0 and 1.

Nothing here sees a person whom the detector never detects, nor knows which things shall count as people: the scores are
those against labels of everyone, hidden people included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.quality_signs import link_doubts, network_signs, track_signs
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.weights import shipped

# Probability from which a link is a doubtful place.
DOUBTFUL = 0.2
# Seconds within which doubtful links of the same people are one place.
ONE_PLACE = 1.0
# Doubtful places that are named.
NAMED = 5
# Fewest boxes of a result that says anything.
FEWEST = 50
# Shares are kept this far from 0 and 1 where they become logits.
MARGIN = 0.01
SHARES = ("hota", "idf1", "recall", "precision")
# What is estimated: shares, accuracy, and switches for each 1,000 boxes.
SCORES = (*SHARES, "mota", "id_switches")
BLIND = "people whom the detector never detects, and boxes on what should not count"
NO_NETWORK = "margins of decisions, as flow has: people who were confused show in the tracks alone"
NO_SCORES = "scores of detections: false positives show in the tracks alone"


class DoubtfulPlace(NamedTuple):
    """A place where one person may have become another: 0-based frame, ids, and the probability that it is so."""

    frame: int
    ids: tuple[int, ...]
    probability: float


class Interval(NamedTuple):
    """An estimated score, and the ends between which the true one lies in 9 of 10 cases."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Quality:
    """How good a result is, as far as it shows; see `PeopleScores` for the scores.

    Attributes:
        hota: in [0, 1].
        mota: at most 1.
        idf1: in [0, 1].
        recall: in [0, 1].
        precision: in [0, 1].
        id_switches: a number.
        doubtful: places where one person may have become another, most doubtful first.
        unseen: what the estimates do not see, a sentence each.
    """

    hota: Interval
    mota: Interval
    idf1: Interval
    recall: Interval
    precision: Interval
    id_switches: Interval
    doubtful: tuple[DoubtfulPlace, ...] = ()
    unseen: tuple[str, ...] = ()

    def on_numbers(self) -> str:
        """How many boxes carry the right number, in a line."""
        value, low, high = (f"{100 * share:.0f}" for share in self.idf1)
        return f"about {value} % of the boxes carry the right number: {low} to {high} %"

    def on_doubt(self) -> str:
        """Where people may have been confused, in a line."""
        places = [f"frame {place.frame + 1} ({', '.join(map(str, place.ids))})" for place in self.doubtful[:NAMED]]
        more = [f"{len(self.doubtful) - NAMED} more"] if len(self.doubtful) > NAMED else []
        count = f"{len(self.doubtful)} {'place' if len(self.doubtful) == 1 else 'places'}"
        return f"doubtful: {count}" + (f": {', '.join([*places, *more])}" if places else "")


def scaled_score(name: str, value: FloatArray | float) -> FloatArray:
    """A score as it is estimated: shares as logits, accuracy and switches for 1,000 boxes as logarithms.

    >>> float(scaled_score("idf1", 0.5)), round(float(score_of("idf1", scaled_score("idf1", 0.75))), 6)
    (0.0, 0.75)
    """
    if name in SHARES:
        share = MARGIN + (1 - 2 * MARGIN) * np.clip(value, 0, 1)
        return np.asarray(np.log(share / (1 - share)))
    if name == "mota":
        return np.asarray(-np.log(1 + MARGIN - np.clip(value, -5, 1)))
    return np.asarray(np.log(1 + np.asarray(value)))


def score_of(name: str, scaled: FloatArray | float) -> FloatArray:
    """``(N,)`` scores in their own units, back from the scale on which they are fitted, and within their bounds."""
    if name in SHARES:
        return np.asarray(np.clip((scipy.special.expit(scaled) - MARGIN) / (1 - 2 * MARGIN), 0, 1))
    if name == "mota":
        return np.asarray(np.minimum(1 + MARGIN - np.exp(-np.asarray(scaled)), 1))
    return np.asarray(np.maximum(np.exp(scaled) - 1, 0))


def estimated(signs: Mapping[str, float], boxes: int, model: OnnxModel | None = None) -> dict[str, Interval]:
    """The scores that such signs go with, by name.

    Args:
        signs: those of `track_signs`, with or without those of scores and of a network.
        boxes: of the result.
        model: of kind quality; None takes the shipped one.
    """
    model = model or _shipped_model()
    settings, names = model.card.settings, model.card.class_names
    outputs = model.run(sign_row(signs, names, settings["usual"])[None].astype(np.float32))[0][0].astype(np.float64)
    middles = outputs * np.array(settings["spread"]) + np.array(settings["mean"])
    ends, intervals = settings["quantiles"][variant_of(signs)], {}
    for name, middle in zip(SCORES, middles, strict=True):
        values = score_of(name, middle + np.array([0.0, *ends[name]]))
        value, low, high = (values * (boxes / 1000 if name == "id_switches" else 1.0)).tolist()
        intervals[name] = Interval(value, min(low, value), max(high, value))
    return intervals


def sign_row(signs: Mapping[str, float], names: Sequence[str], usual: Mapping[str, float]) -> FloatArray:
    """``(S,)`` signs in the order of their names; one that is not known is as usual, which the last ones tell."""
    known = {"no_network": float("kept" not in signs), "no_scores": float("score" not in signs), **signs}
    return np.array([known.get(name, usual[name]) for name in names])


def variant_of(signs: Mapping[str, float]) -> str:
    """Which signs are known: those of tracks, and of a network and of scores or not."""
    parts = [name for name, sign in (("network", "kept"), ("scores", "score")) if sign in signs]
    return " ".join(["tracks", *parts])


@lru_cache(maxsize=1)
def _shipped_model() -> OnnxModel:
    return OnnxModel(shipped("quality_people"), "quality", threads=1)


def people_quality(
    tracks: Sequence[Track],
    network: SolvedNetwork | None = None,
    rate: float = 25.0,
    size: tuple[int, int] | None = None,
    frames: tuple[int, int] | None = None,
) -> Quality:
    """How good tracks of people probably are.

    Args:
        tracks: the result.
        network: that it was chosen from; None where nothing else was weighed.
        rate: frames a second.
        size: width and height of a frame in pixels; None takes the extent of the boxes.
        frames: first and last frame that were processed; None takes those of the boxes.

    Raises:
        RequestError: there are fewer than `FEWEST` boxes, which say nothing.
    """
    tracks = [track for track in tracks if len(track)]
    boxes = sum(map(len, tracks))
    if boxes < FEWEST:
        raise RequestError(f"expected a result of at least {FEWEST} boxes to estimate its quality from, got {boxes}")
    network = None if network is None or network.given or not (network.track > 0).any() else network
    signs = track_signs(tracks, rate, size, frames)
    signs |= {} if network is None else network_signs(network)
    unseen = [BLIND, *([NO_NETWORK] if network is None else []), *([] if "score" in signs else [NO_SCORES])]
    places = () if network is None else doubtful_places(network)
    return Quality(**estimated(signs, boxes), doubtful=places, unseen=tuple(unseen))


def doubtful_places(network: SolvedNetwork) -> tuple[DoubtfulPlace, ...]:
    """Where one person may have become another, the likeliest first.

    Args:
        network: of the result.
    """
    tail, head, wrong = link_doubts(network)
    doubtful = np.flatnonzero(wrong > DOUBTFUL)
    # The likeliest first, then by frame, so that links of an exchange, which cost the same, follow each other.
    order = doubtful[np.lexsort((network.frames[tail[doubtful]], -wrong[doubtful].round(6)))]
    places = list[DoubtfulPlace]()
    for link in order.tolist():
        frame = int(network.frames[tail[link]])
        ids = dict.fromkeys(network.track[[tail[link], head[link]]].tolist())
        near = [n for n, place in enumerate(places) if abs(place.frame - frame) <= ONE_PLACE * network.rate]
        same = [n for n in near if abs(places[n].probability - wrong[link]) < 1e-6 or {*places[n].ids} & {*ids}]
        if same:
            place = places[same[0]]
            places[same[0]] = place._replace(ids=tuple(dict.fromkeys([*place.ids, *ids])))
        else:
            places.append(DoubtfulPlace(frame, tuple(ids), float(wrong[link])))
    return tuple(places)
