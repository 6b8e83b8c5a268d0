"""Tracks as they are reported after corrections, with the ids that they had."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.corrected_flow import CorrectedFlow
from tsuiseki.tracking.association.smoothing import fill_gaps
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.correction_log import CorrectedVideo, Correction, read_corrections
from tsuiseki.tracking.types import FloatArray, IntArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack, BodyTrack, PointTable, rows_of_each

MOVED = 0.01
"""Pixels from which an animal was moved by hand."""


class Reporter:
    """Makes tracks of labelled detections; what did not change is reported as it was.

    Args:
        solved: the tracks of the result, before any correction.

    Attributes:
        highest: the highest id of these.
    """

    def __init__(self, solved: Sequence[Track]) -> None:
        self.highest = max((track.id for track in solved), default=0)
        self._solved = {track.id: track for track in solved}
        self._names = next((track.names for track in solved if track.names), {})
        self._made: dict[tuple[int, bytes], Track] = {}

    def reported(self, flow: CorrectedFlow) -> tuple[IntArray, list[Track], dict[int, str]]:
        """``(N,)`` ids of the detections of a flow, 0 for none, its tracks, and names of tracks by id."""
        ids = track_ids(flow.network.track, flow.labels(), self.highest)
        names = {int(ids[n]): name for n, name in flow.demands.names.items() if ids[n] and name}
        return ids, self.tracks(flow.network, ids, flow.demands.drawn_boxes), names

    def tracks(self, network: SolvedNetwork, ids: IntArray, drawn: Mapping[int, FloatArray]) -> list[Track]:
        """The tracks by id, from ``(N,)`` ids of detections, 0 for none; ``drawn`` boxes replace detected ones."""
        used = np.flatnonzero(ids)
        # Detections that were drawn come last, whatever their frames.
        used = used[np.lexsort((network.frames[used], ids[used]))]
        previous, self._made = self._made, {}
        for rows in (used[part] for part in rows_of_each(ids[used])):
            number = int(ids[rows[0]])
            here = {n: box for n, box in drawn.items() if ids[n] == number}
            key = number, rows.tobytes() + b"".join(str(n).encode() + box.tobytes() for n, box in here.items())
            self._made[key] = previous.get(key) or self._track(network, rows, number, here)
        return list(self._made.values())

    def _track(self, network: SolvedNetwork, rows: IntArray, number: int, drawn: Mapping[int, FloatArray]) -> Track:
        solved_rows = np.flatnonzero(network.track == network.track[rows[0]])
        solved = self._solved.get(int(network.track[rows[0]]))
        if solved is not None and not drawn and np.array_equal(solved_rows, rows):
            return solved if solved.id == number else replace(solved, id=number)
        boxes, frames = network.boxes[rows].copy(), network.frames[rows]
        for solved_id in {*np.unique(network.track[rows]).tolist()} & self._solved.keys():
            track, mine = self._solved[solved_id], np.flatnonzero(network.track[rows] == solved_id)
            place = np.searchsorted(track.frames, frames[mine]).clip(max=len(track) - 1)
            there = track.frames[place] == frames[mine]
            boxes[mine[there]] = track.boxes[place[there]]
        for n, box in drawn.items():
            boxes[rows == n] = box
        scores, origin = np.nan_to_num(network.scores[rows]), network.origin[rows]
        track = Track(number, frames, boxes, scores, origin=origin, names=self._names)
        return fill_gaps(track, network.fill)


def acting(tracks: Sequence[Track], solved: Sequence[ActingTrack]) -> list[ActingTrack]:
    """Corrected tracks with what people do: as the ``solved`` track that had the box, in between on straight lines."""
    actions_of_boxes = {
        place: (person.single[n], person.multi[n])
        for person in solved
        if person.single is not None and person.multi is not None
        for n, place in enumerate(_places(person.track))
    }
    acting_tracks = []
    for track in tracks:
        there = [(place[0], *actions_of_boxes[place]) for place in _places(track) if place in actions_of_boxes]
        if not there:
            acting_tracks.append(ActingTrack(track))
            continue
        frames, *both = (np.array(column) for column in zip(*there, strict=True))
        rows = (np.stack([np.interp(track.frames, frames, values) for values in kind.T], axis=1) for kind in both)
        acting_tracks.append(ActingTrack(track, *rows))
    return acting_tracks


def corrected_bodies(tracks: Sequence[Track], solved: Sequence[BodyTrack], names: Sequence[str]) -> list[BodyTrack]:
    """Animals whose squares (`boxes_about`) were corrected; what no state is known of is between states on both sides.

    Args:
        tracks: corrected squares.
        solved: the animals that the squares are about, as the tracker left them.
        names: of the numbers of a state.
    """
    states = np.concatenate([body.states for body in solved])
    scores = np.concatenate([body.scores for body in solved])
    statuses = np.concatenate([body.statuses for body in solved])
    angle, bodies = [name == "theta" for name in names].index(True), []
    for track in tracks:
        detected = track.detection >= 0
        row, filled = track.detection[detected], np.tile(states.mean(axis=0), (len(track), 1))
        status = np.where(track.observed, "tracking", "searching").astype(object)
        if detected.any():
            unwrapped, frames = states[row], track.frames
            unwrapped[:, angle] = np.unwrap(unwrapped[:, angle])
            filled = np.stack([np.interp(frames, frames[detected], column) for column in unwrapped.T], axis=1)
            filled[detected], status[detected] = states[row], statuses[row]
        centre = 0.5 * (track.boxes[:, :2] + track.boxes[:, 2:])
        moved = np.abs(centre - filled[:, :2]).max(axis=1) > MOVED
        for n, name in enumerate(("a", "b")):
            if f"{name}_mm" in names:
                scale = states[:, names.index("length_mm")].sum() / states[:, names.index("length")].sum()
                filled[moved, names.index(f"{name}_mm")] = scale * centre[moved, n]
        filled[moved, :2] = centre[moved]
        score = np.where(detected, scores[np.where(detected, track.detection, 0)], track.scores)
        bodies.append(BodyTrack(track.id, track.frames, filled, score, tuple(status.tolist())))
    return bodies


def renamed_points(points: PointTable, solved: Sequence[BodyTrack], tracks: Sequence[Track]) -> PointTable:
    """The points of animals by the ids of their squares, which `corrected_bodies` takes, too."""
    old_ids = np.concatenate([np.full(len(track), track.id) for track in solved])
    now = {
        (frame, f"track_{old_ids[row]}"): f"track_{track.id}"
        for track in tracks
        for frame, row in zip(track.frames.tolist(), track.detection.tolist(), strict=True)
        if row >= 0
    }
    names = [now.get(place, "") for place in zip(points.frames.tolist(), points.tracks, strict=True)]
    named = np.array([name != "" for name in names], dtype=np.bool_)
    return PointTable(
        points.nodes, points.frames[named], tuple(filter(None, names)), points.points[named], points.scores[named]
    )


def _places(track: Track) -> list[tuple[float, ...]]:
    return [(f, *box) for f, box in zip(track.frames.tolist(), track.boxes.round(2).tolist(), strict=True)]


def track_ids(old_ids: IntArray, labels: IntArray, highest: int) -> IntArray:
    """``(N,)`` ids of detections of ``(N,)`` tracks, 0 for none.

    A track has the id that most of its detections had, where no other has more of them; the others are numbered anew
    by their first detections.

    Args:
        old_ids: ``(N,)`` ids in the result, 0 for none.
        labels: ``(N,)`` numbers of the tracks now, -1 for none.
        highest: the highest id of the result.
    """
    carried = (old_ids > 0) & (labels >= 0)
    base = int(old_ids.max(initial=0)) + 1
    keys, counts = np.unique(labels[carried] * base + old_ids[carried], return_counts=True)
    pairs, new_ids = np.column_stack(np.divmod(keys, base)), dict[int, int]()
    for label, number in pairs[np.lexsort((pairs[:, 1], -counts))].tolist():
        if label not in new_ids and number not in new_ids.values():
            new_ids[label] = number
    for label in dict.fromkeys(labels[labels >= 0].tolist()):
        if label not in new_ids:
            highest += 1
            new_ids[label] = highest
    table = np.zeros(int(labels.max(initial=-1)) + 2, dtype=np.int64)
    table[list(new_ids)] = list(new_ids.values())
    return table[labels]


@dataclass(frozen=True)
class Replayed:
    """What came of corrections of an earlier result on tracks of other settings or of another detector.

    Attributes:
        tracks: corrected.
        names: of tracks, by id.
        count: how many corrections there are.
        done: those that can hold together.
        left_out: a line for each that does not.
    """

    tracks: Sequence[Track]
    names: dict[int, str]
    count: int
    done: Sequence[Correction]
    left_out: Sequence[str]

    def warn(self) -> None:
        """Report which corrections do not apply."""
        if self.left_out:
            left = len(self.left_out)
            text = f"corrections: {self.count - left} of {self.count} done again; left out: {'; '.join(self.left_out)}"
            warnings.warn(text, InputWarning, stacklevel=3)


def replayed(tracks: Sequence[Track], network: SolvedNetwork, path: Path, video: CorrectedVideo) -> Replayed:
    """Do corrections of a result again, as far as they apply; they find their detections by their boxes.

    Raises:
        RequestError: they cannot be read, or speak of another video.
    """
    corrections = read_corrections(path, video).corrections
    flow, done, left_out = CorrectedFlow(network), [*corrections], list[str]()
    try:
        flow.correct(corrections)
    except RequestError:
        # With other detections some cannot hold any more: each is tried by itself.
        done = []
        for correction in corrections:
            try:
                flow.correct([*done, correction])
                done.append(correction)
            except RequestError as error:
                left_out.append(str(error))
    _, corrected, names = Reporter(tracks).reported(flow)
    return Replayed(corrected, names, len(corrections), done, [*left_out, *flow.demands.left_out])
