"""The people on one floor, as tracks with one id in all cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.filters.kalman import Gaussians, update
from tsuiseki.tracking.floor.floor_flow import FloorFlow, FloorTracks, solve_on_floor
from tsuiseki.tracking.floor.foot_points import expected_boxes
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor
from tsuiseki.tracking.floor.walking import PLACE
from tsuiseki.tracking.types import BoolArray, IntArray, Track
from tsuiseki.tracking.types.measurements import PersonOnFloor

# As `SensedTrack` orders a state: x, vx, y, vy.
AXES = np.array([0, 2, 1, 3])
UNSEEN = 0.5
IN_VIEW = 0.3


def flow_on_one_floor(measured: MeasuredFloor, settings: FloorFlow) -> list[PersonOnFloor]:
    """Everybody on the floor, by the flow over the whole video."""
    if not len(measured.points):
        return []
    found = solve_on_floor(measured.points, measured.views, measured.times, measured.rates, settings)
    return people_of(measured, found, settings.short)


def people_of(measured: MeasuredFloor, found: FloorTracks, short: int) -> list[PersonOnFloor]:
    """Tracks of at least ``short`` nodes, or of a certain name, on the plan; ids in the order of their beginning."""
    points, nodes = measured.points, found.nodes
    sensed = np.zeros((len(nodes.moment), len(measured.views)), dtype=np.bool_)
    sensed[nodes.node, points.sensor] = True
    names = nodes.highest(points.names)
    parts = []
    for track in np.unique(found.label[found.label >= 0]):
        own = np.flatnonzero(found.label == track)
        name = int(names[own].max())
        if len(own) >= short or name >= 0:
            parts.append((int(nodes.moment[own].min()), name, own, np.flatnonzero(found.expected.track == track)))
    parts.sort(key=lambda part: part[0])
    taken = {name for _, name, *_ in parts if name >= 0}
    free = iter(number for number in range(1, len(parts) + len(taken) + 1) if number not in taken)
    people = [
        _person(measured, found, name if name >= 0 else next(free), own, rows, sensed) for _, name, own, rows in parts
    ]
    return [one for one in people if len(one)]


def _person(
    measured: MeasuredFloor, found: FloorTracks, number: int, own: IntArray, rows: IntArray, sensed: BoolArray
) -> PersonOnFloor:
    nodes, expected = found.nodes, found.expected
    at = nodes.moment[own]
    rows = rows[(expected.moment[rows] >= at.min()) & (expected.moment[rows] <= at.max())]
    if len(rows):
        moments = expected.moment[rows]
        states = Gaussians(expected.states.mean[rows].copy(), expected.states.covariance[rows].copy())
        row = np.searchsorted(moments, at)
        met, _ = update(
            Gaussians(states.mean[row], states.covariance[row]), nodes.places[own], PLACE, nodes.covariances[own]
        )
        states.mean[row], states.covariance[row] = met.mean, met.covariance
    else:
        moments, states = at, FloorFlow().walking.start(nodes.places[own], nodes.covariances[own])
    there = np.zeros((len(moments), sensed.shape[1]), dtype=np.bool_)
    there[np.searchsorted(moments, at)] = sensed[own]
    inside = measured.inside(states.mean[:, :2])
    mean, covariance, there = states.mean[inside], states.covariance[inside][:, AXES][:, :, AXES], there[inside]
    return PersonOnFloor(
        number, moments[inside], measured.times[moments[inside]], mean[:, :2], mean[:, 2:], covariance,
        np.where(there.any(axis=1), 1.0, UNSEEN), np.empty((len(mean), 0)), there,
    )  # fmt: skip


def tracks_in(measured: MeasuredFloor, people: Sequence[PersonOnFloor], camera: int) -> list[Track]:
    """The same people in the image of one camera: their detections, and where they are expected in full view.

    Args:
        measured: of the run.
        people: with ids of the floor.
        camera: its number.
    """
    frames = np.array([-1 if m.frames[camera] is None else m.frames[camera] for m in measured.moments], dtype=np.int64)
    points, feed, view = measured.points, measured.feeds[camera], measured.views[camera]
    own = np.flatnonzero(points.sensor == camera)
    tracks = []
    for one in people:
        boxes = expected_boxes(feed.placed.camera, one.positions)
        visible = view.share(one.scans, one.positions) > IN_VIEW
        observed = one.detected[:, camera]
        for row in np.flatnonzero(observed):
            found = feed.people[frames[one.scans[row]]].detections.boxes
            near = own[points.moment[own] == one.scans[row]]
            nearest = near[np.linalg.norm(points.places[near] - one.positions[row], axis=1).argmin()]
            boxes[row] = found[points.row[nearest]]
        keep = (observed | visible) & (frames[one.scans] >= 0) & np.isfinite(boxes).all(axis=1)
        if keep.any():
            tracks.append(
                Track(one.id, frames[one.scans[keep]], boxes[keep], observed[keep].astype(np.float64), observed[keep])
            )
    return tracks
