"""How many different people a video shows, and how sure that is: from tracks that may be parts of people, or nobody.

Each track is the first one of a further person with a probability that falls where it is short, scores less than the
others, or begins in the midst of the picture where an earlier one ended. Beside the tracks there are people who have
none of their own, because a track went over to them (`handovers`). The number of different people is the sum of both.
The first part is Poisson-binomial, the second negative binomial (gamma-Poisson). That all probabilities of a video err
alike is a normal error of their logits. Its quantiles are those of draws.

A person counts who was detected for a second or more. Whom the detector never reports, nobody counts here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tsuiseki.tracking.association.doubtful_tracks import DOUBTFUL, nobody, track_features
from tsuiseki.tracking.counts.handovers import Handovers, handovers_of
from tsuiseki.tracking.counts.line_tables import Columns, add, empty
from tsuiseki.tracking.counts.paths import Paths
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.track_bars import PERSON
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.tracks import boxes_about, frames_up_to

# Weights of `doubtful_tracks.FEATURES` and a constant, of the logit that a track is the first of a further person. They
# and the two below are fitted on generated streets of seeds below 120.
FURTHER = np.array([3.58, -1.06, -4.46, -1.22, 0.0, 0.0, 1.26])
# People without a track, on average: in any video, and for each handover.
WITHOUT = (0.95, 0.23)
# Shape of the gamma of their mean.
SHAPE = 1.0
# Standard deviation of the common error of all logits of a video.
COMMON = 0.5
# Probability of the interval.
LEVEL = 0.9
# Draws for its ends.
DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Visitors:
    """How many different people there were, N of whose tracks are known.

    Attributes:
        estimate: the likeliest number, half of the distribution on each side.
        low: end of the interval of 90 %.
        high: its other end.
        tracks: of people, N of them.
        further: ``(N,)`` probability that each is the first one of a further person.
        nobody: ``(N,)`` probability that each is a false positive, or a second track on somebody.
        handovers: places at which a track may have gone over to another person.
    """

    estimate: int
    low: int
    high: int
    tracks: Sequence[Track]
    further: FloatArray
    nobody: FloatArray
    handovers: Handovers

    def __repr__(self) -> str:
        return f"<Visitors: {self}, {len(self.tracks)} tracks>"

    @property
    def doubtful(self) -> IntArray:
        """Ids of the tracks that rather show nobody, or somebody once more."""
        return np.array([self.tracks[n].id for n in np.flatnonzero(self.nobody >= DOUBTFUL).tolist()], dtype=np.int64)

    def changed(self, ids: Sequence[int], first: FloatArray, last: FloatArray) -> list[float]:
        """Chance that each of ``(K,)`` ids is another person's by the end of frames ``first`` to ``last`` ``(K,)``."""
        numbers = {track.id: number for number, track in enumerate(self.tracks)}
        tracks = np.array([numbers.get(number, -1) for number in ids], dtype=np.int64)
        return [round(float(p), 3) for p in self.handovers.chance(tracks, first, last)]

    def __str__(self) -> str:
        return f"{self.estimate}" if self.low == self.high else f"{self.estimate} ({self.low}-{self.high})"


def count_visitors(result: Result[Any] | Sequence[Track], frame_rate: float | None = None) -> Visitors:
    """How many different people a result shows, with an interval of 90 %.

    Tracks that have a class count where it is a person's.

    Args:
        result: of a run, or tracks of people.
        frame_rate: frames a second, where the result does not say.

    Raises:
        RequestError: nothing says the frame rate, or the result has no boxes.
    """
    rate: float = getattr(result, "frame_rate", 0.0) if frame_rate is None else frame_rate
    if not 0 < rate < 1e4:
        raise RequestError(f"expected a frame rate above 0, got {rate:g}; give `frame_rate`")
    tracks = boxes_about(result, getattr(result, "names", ()))
    length = frames_up_to(getattr(result, "frames", {}).get("frame", ()), tracks)
    found = visitors_among(result, tracks, rate, getattr(result, "size", None), length)
    if found is None:
        raise RequestError("expected a result of people, got one of other targets")
    return found


def visitors_among(
    result: Result[Any] | Sequence[Track],
    tracks: Sequence[Track],
    rate: float,
    size: tuple[int, int] | None,
    length: int,
) -> Visitors | None:
    """How many different people there are among the ``tracks`` of a result; None where it is of no people."""
    page, network = getattr(result, "page", None), getattr(result, "network", None)
    people = people_among(tracks)
    if (page is not None and page.nouns != PERSON) or (tracks and not people):
        return None
    places = handovers_of(people, rate, None if network is None else network())
    return visitors_of(people, rate, size, length, places)


def people_among(tracks: Sequence[Track]) -> list[Track]:
    """The tracks of people, and those whose class is not known."""
    return [track for track in tracks if not track.class_name or track.class_name.lower() in PERSON_NAMES]


def visitors_of(
    tracks: Sequence[Track], rate: float, size: tuple[int, int] | None, length: int, places: Handovers
) -> Visitors:
    """How many different people N tracks show.

    Args:
        tracks: of people.
        rate: frames a second.
        size: width and height of the picture; None where not known.
        length: frames of the video.
        places: at which tracks may have gone over to others.
    """
    if not tracks:
        return Visitors(0, 0, 0, tracks, np.empty(0), np.empty(0), places)
    features = track_features(tracks, rate, size, length)
    logits = features @ FURTHER[:-1] + FURTHER[-1]
    low, estimate, high = _quantiles(logits, WITHOUT[0] + WITHOUT[1] * float(places.probability.sum()))
    return Visitors(estimate, low, high, tracks, scipy.special.expit(logits), nobody(features), places)


def _quantiles(logits: FloatArray, without: float) -> tuple[int, int, int]:
    """Low end, median and high end of the number of people, see the head of this file."""
    rng = np.random.default_rng(0)
    # Logits to a quarter are alike, so that draws are few for any number of tracks.
    levels, count = np.unique(np.rint(4 * logits) / 4, return_counts=True)
    chance = scipy.special.expit(levels + rng.normal(0, COMMON, (DRAWS, 1)))
    people = rng.binomial(count, chance).sum(axis=1) + rng.poisson(rng.gamma(SHAPE, without / SHAPE, DRAWS))
    ends = (1 - LEVEL) / 2, 0.5, (1 + LEVEL) / 2
    low, middle, high = np.quantile(np.maximum(people, 1), ends, method="nearest").astype(int).tolist()
    return low, middle, high


def with_doubt(
    tables: Mapping[str, Columns], visitors: Visitors | None, paths: Paths, rate: float
) -> dict[str, Columns]:
    """The tables ``visitors`` and ``handovers`` of `Answers`, and ``stays`` and ``people`` with what is in doubt.

    Args:
        tables: the others.
        visitors: None of animals, of whom none of this is known.
        paths: of all tracks.
        rate: frames a second.
    """
    stays, people = dict(tables["stays"]), dict(tables["people"])
    filled = np.bincount(paths.ids, ~paths.observed, max([0, *people["id"]]) + 1) / rate
    people["filled"] = np.round(filled[people["id"]], 3).tolist() if people["id"] else []
    counted = empty("people", "low", "high", "tracks")
    if visitors is not None:
        add(counted, visitors.estimate, visitors.low, visitors.high, len(visitors.tracks))
        nobody = {track.id: round(float(p), 3) for track, p in zip(visitors.tracks, visitors.nobody, strict=True)}
        for table, names in ((stays, ("start", "end")), (people, ("first", "last"))):
            first, last = (np.rint(np.array(table[name], dtype=np.float64) * rate) for name in names)
            table["changed"] = visitors.changed(table["id"], first, last)
        people["nobody"] = [nobody.get(number) for number in people["id"]]
    return {"visitors": counted, "handovers": _handover_table(visitors, rate), "stays": stays, "people": people}


def _handover_table(visitors: Visitors | None, rate: float) -> Columns:
    """The table ``handovers`` of `Answers`: places that are marked, by time."""
    table = empty("time", "frame", "id", "other", "x", "y", "probability")
    if visitors is None:
        return table
    places = visitors.handovers.select(visitors.handovers.marked)
    for row in np.lexsort((places.track, places.first)).tolist():
        track, other = visitors.tracks[places.track[row]], int(places.other[row])
        at = min(int(np.searchsorted(track.frames, places.first[row])), len(track) - 1)
        box, frame = track.boxes[at], int(places.first[row])
        add(
            table, round(frame / rate, 3), frame + 1, track.id, visitors.tracks[other].id if other >= 0 else None,
            round(float(box[0] + box[2]) / 2, 2), round(float(box[3]), 2), round(float(places.probability[row]), 3),
        )  # fmt: skip
    return table
