"""People under a ceiling fisheye camera, by upright appearance and position on the floor (thesis chapter 4).

This is Algorithm 2. In each frame, every detected box is given a rotated box r and a place q on the floor
(`person_model`). Its appearance feature x is computed on the crop turned upright (`upright_crops`). Tracks and
detections are then matched in two stages (2.3.2). The first stage uses C^feat, the distance of their features. The
second uses C^pos, the distance of their places, for the tracks and detections that the first left unmatched.
Algorithm 2 prints r in c^pos; the text (4.2.2, 4.3.3) uses the place in the world, and so does this tracker.

The thesis leaves these points open; here:

* C^pos is the distance in metres between a detection and the position predicted for a track.
* The gate ε_pos is ``reach`` metres, and ``speed`` metres more for each second since the track's last detection. So
  one setting serves 1 frame a second and 15.
* The first stage has the same gate. Two people in similar clothes are distinguished by their places.
* The second stage leaves out pairs whose features differ by more than ``place_feature_gate``.
* The prediction is that of an alpha-beta filter. Its velocity decays with the time constant `MEMORY`.

`flow_on_floor` links the same detections by the minimum-cost flow, with distances on the floor.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.association.costs import ObservationCost
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.association.network_flow import build_graph, solve, track_labels
from tsuiseki.tracking.association.pairwise_flow import GateSettings, HandSetCost, pairs_with_costs
from tsuiseki.tracking.fisheye.settings import FisheyeSettings
from tsuiseki.tracking.people.lifecycle import Record
from tsuiseki.tracking.people.sort import running_mean
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack

# Time in which a track's velocity decays, seconds.
MEMORY = 1.0
# Time over which measured places are averaged, seconds.
NOISE = 0.15
# Weight of the newest feature in a track's appearance.
UPDATE = 0.3
# Frames after which what came of no track is dropped.
PRUNED = 200
# A person is a square of 1 m on the floor's plan, so that distances in heights are in metres.
SQUARE = 1.0
# Of the flow: time between two linked detections at most, seconds.
WINDOW = 3.0
# Of the flow: metres between two linked detections at most, at one time.
REACH = 0.8
# Of the flow: how much more for each second between them, m/s.
SPEED = 1.5
# Of the flow: cost of a track's start, and of its end.
ENTRY = 2.0
# Of the flow: seconds of detections that a track has at least; one detection at least.
SHORTEST = 0.2
# Of the flow: scale of measured places of one person who stands still, metres; see `HandSetCost`.
PLACE_NOISE = 0.25
# Of the flow: scale of a person's velocity, m/s.
PACE = 0.8
# Of the flow: weight of the cosine distance of two features.
APPEARANCE = 10.0
# Of the flow: cosine distance that speaks neither for nor against one person.
NEUTRAL = 0.3
# Of the flow: exponent q of two detections one frame apart that do not differ, of neutral appearance.
BIAS = -4.0
# At 1 frame a second a track has few detections, and they must outweigh the cost of its start and end.
OBSERVATION = ObservationCost(alpha=2.0, beta=-6.0)
FloorMethod: TypeAlias = Literal["hungarian", "flow"]


@dataclass(frozen=True)
class _Live:
    """The tracks that have not ended, one a row.

    Attributes:
        numbers: ``(T,)`` in the order of their starts, from 0.
        places: ``(T, 2)`` metres.
        velocities: ``(T, 2)`` m/s.
        appearance: ``(T, D)`` running means of features, of unit length or NaN.
        hits: ``(T,)`` number of detections.
        undetected: ``(T,)`` seconds since the last detection.
    """

    numbers: IntArray
    places: FloatArray
    velocities: FloatArray
    appearance: FloatArray
    hits: IntArray
    undetected: FloatArray

    def select(self, rows: IntArray) -> _Live:
        return _Live(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


class FisheyeTracker:
    """Matches detections to tracks by appearance first, then by place on the floor; see the module.

    It keeps the boxes and places of confirmed tracks, no detections and no features. Where video never ends, take
    `tracks` and `forget` them now and then; ids go on.
    """

    def __init__(self, frame_rate: float, settings: FisheyeSettings | None = None) -> None:
        self.settings = settings or FisheyeSettings()
        self._step = 1.0 / frame_rate
        self._needed = max(1, round(self.settings.confirm * frame_rate))
        self._live: _Live | None = None
        self._frame = -1
        self._record = Record()
        self._names: dict[int, str] = {}

    def update(self, located: FloorDetections) -> None:
        """Take the detections of the next frame."""
        self._frame += 1
        width = 0 if self._live is None else self._live.appearance.shape[1]
        features = located.detections.features
        if features is None:
            features = np.full((len(located), width), np.nan)
        live = self._expected(features.shape[1])
        matched, detected = self._match(live, located, features)
        self._live = self._advanced(live, located, features, matched, detected)

    def tracks(self) -> list[FloorTrack]:
        """The confirmed tracks of all frames so far, or since `forget`, by id."""
        matched, names = np.empty(0, np.bool_), self._names
        return [
            FloorTrack(
                Track(number, frames, rows[:, :4], scores, matched, rows[:, 11:].astype(np.int64), names),
                rows[:, 4:9],
                rows[:, 9:11],
            )
            for number, frames, rows, scores in self._record.parts()
        ]

    def forget(self) -> None:
        """Drop the boxes and places so far from `tracks`."""
        self._record.forget()

    def _expected(self, width: int) -> _Live:
        """The live tracks, predicted for this frame."""
        live = self._live
        if live is None or (len(live.numbers) == 0 and live.appearance.shape[1] != width):
            none = np.empty((0, 2))
            return _Live(np.empty(0, np.int64), none, none, np.empty((0, width)), np.empty(0, np.int64), np.empty(0))
        decay = float(np.exp(-self._step / MEMORY))
        moved = live.places + live.velocities * MEMORY * (1 - decay)
        return replace(live, places=moved, velocities=live.velocities * decay, undetected=live.undetected + self._step)

    def _match(self, live: _Live, located: FloorDetections, features: FloatArray) -> tuple[IntArray, IntArray]:
        """Rows of the matched tracks, and rows of their detections."""
        settings = self.settings
        away = np.linalg.norm(live.places[:, None] - located.places[None], axis=2)
        gate = settings.reach + settings.speed * live.undetected[:, None]
        # Each distance as a share of its own gate, so that one limit serves all tracks.
        shares = away / gate
        matched = detected = np.empty(0, dtype=np.int64)
        if settings.by_appearance and features.shape[1] and live.appearance.shape[1]:
            costs = 1 - live.appearance @ features.T
            shares = np.where(costs > settings.place_feature_gate, np.inf, shares)
            if settings.by_place:
                costs = np.where(away > gate, np.inf, costs)
            matched, detected = assign(costs, settings.feature_gate)
        if not settings.by_place:
            return matched, detected
        unmatched, free = np.setdiff1d(np.arange(len(away)), matched), np.setdiff1d(np.arange(len(located)), detected)
        rows, columns = assign(shares[np.ix_(unmatched, free)], 1.0)
        return np.concatenate([matched, unmatched[rows]]), np.concatenate([detected, free[columns]])

    def _advanced(
        self, live: _Live, located: FloorDetections, features: FloatArray, matched: IntArray, detected: IntArray
    ) -> _Live:
        settings = self.settings
        scores = located.detections.scores
        free = np.isnan(scores) | (scores >= settings.start_score)
        free[detected] = False
        born = np.flatnonzero(free)
        waiting = (live.hits >= self._needed) & (live.undetected < settings.max_age + 1e-9)
        waiting[matched] = False
        old, missed = live.select(matched), live.select(np.flatnonzero(waiting))
        new = self._record.start(len(born))
        away = located.places[detected] - old.places
        step = old.undetected[:, None]
        alpha = 1 - np.exp(-step / NOISE)
        beta = alpha**2 / (2 - alpha)
        appearance = running_mean(old.appearance, features[detected], 1 - UPDATE, UPDATE)
        zero = np.zeros(len(born))
        parts = (
            (old.numbers, missed.numbers, new),
            (old.places + alpha * away, missed.places, located.places[born]),
            (old.velocities + beta * away / step, missed.velocities, np.zeros((len(born), 2))),
            (appearance, missed.appearance, features[born]),
            (old.hits + 1, missed.hits, np.ones(len(born), np.int64)),
            (np.zeros(len(matched)), missed.undetected, zero),
        )
        result = _Live(*(np.concatenate(part) for part in parts))
        self._note(np.concatenate([old.numbers, new]), located, np.concatenate([detected, born]))
        self._record.confirm(result.numbers[(result.hits >= self._needed) & (result.undetected == 0)])
        if self._frame % PRUNED == 0:
            self._record.prune(result.numbers)
        return result

    def _note(self, numbers: IntArray, located: FloorDetections, which: IntArray) -> None:
        """Record the tracks with these numbers at the detections ``which``."""
        if len(numbers):
            detections = located.detections
            self._names |= detections.names
            rows = np.concatenate([detections.boxes, located.rotated, located.places, detections.origin], axis=1)[which]
            self._record.append(self._frame, numbers, rows, detections.scores[which])


def flow_on_floor(located: Sequence[FloorDetections], frame_rate: float) -> list[FloorTrack]:
    """The tracks of a whole video by minimum-cost flow, from the detections of each frame, in order."""
    step = 1.0 / frame_rate
    gate = GateSettings(max(1, round(WINDOW * frame_rate)), reach=REACH + SPEED * step, speed=SPEED * step)
    transition = HandSetCost(BIAS, PLACE_NOISE, speed=PACE * step, appearance=APPEARANCE, neutral=NEUTRAL)
    squares = [np.concatenate([frame.places - SQUARE / 2, frame.places + SQUARE / 2], axis=1) for frame in located]
    rows = rows_of(
        [Detections(s, f.detections.scores, f.detections.features) for s, f in zip(squares, located, strict=True)], 0, 0
    )
    miss = 0.1 * min(1.0, 10 * step)
    pairs = pairs_with_costs(rows, gate, transition, miss)
    labels = track_labels(solve(build_graph(OBSERVATION(rows.scores), pairs, ENTRY, ENTRY)))
    boxes, scores, origin = (
        np.concatenate([getattr(frame.detections, name) for frame in located]) for name in ("boxes", "scores", "origin")
    )
    rotated, places = (np.concatenate([getattr(frame, name) for frame in located]) for name in ("rotated", "places"))
    names = {kind: name for frame in located for kind, name in frame.detections.names.items()}
    matched, fewest = np.empty(0, np.bool_), max(1, round(SHORTEST * frame_rate))
    return [
        FloorTrack(
            Track(number, rows.frames[k], boxes[k], np.nan_to_num(scores[k]), matched, origin[k], names),
            rotated[k],
            places[k],
        )
        for number, k in enumerate(long_tracks(labels, fewest), start=1)
    ]


def link_on_floor(
    located: Iterable[FloorDetections], rate: float, method: FloorMethod, hungarian: FisheyeSettings, times: StageTimes
) -> list[FloorTrack]:
    """The tracks of one camera: ``hungarian`` decides frame by frame, ``flow`` links the whole video at the end."""
    online, frames = FisheyeTracker(rate, hungarian), []
    for frame in located:
        if method == "flow":
            frames.append(frame)
            continue
        with times.measure("associate"):
            online.update(frame)
    with times.measure("associate"):
        return flow_on_floor(frames, rate) if method == "flow" else online.tracks()
