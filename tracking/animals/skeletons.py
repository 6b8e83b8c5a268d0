"""Points of a skeleton and poses: what was seen of a skeleton becomes poses, and poses say where its points are.

Two ways round. Where points were found in every frame, by SLEAP or DeepLabCut, each animal's points are observations of
a `Skeleton`, and the fit is its pose. Where a person labelled a few frames, poses of these frames teach where on the
body the points lie, and every other pose carries them along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.animals.linking import Animal
from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.animals.skeleton import Skeleton, line_of
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.tracks import PointTable

TOUCHING = 0.5
"""Animals nearer than so many lengths may be mistaken for each other."""
FITS = 0.3
"""Least mean weight of an animal's points, below which they are of no one animal."""
FEWEST = 2


@dataclass(frozen=True)
class BodyPoints:
    """Where on the body the points of a skeleton lie.

    Attributes:
        nodes: K names.
        places: ``(K, 2)`` from the middle, along the heading and to its right, in lengths of the animal.
    """

    nodes: tuple[str, ...]
    places: FloatArray

    def on(self, state: FloatArray) -> FloatArray:
        """``(K, 2)`` pixels on an animal whose state is a, b, theta, length, …"""
        cosine, sine = np.cos(state[2]), np.sin(state[2])
        turn = np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(state[:2] + state[3] * self.places @ turn)


def poses_of_points(
    table: PointTable, skeleton: Skeleton, first: int, count: int, centre: str | None = None
) -> list[list[AnimalPose]]:
    """Poses of each frame from points seen in it.

    Args:
        table: the points; who they are of is found anew.
        skeleton: theirs.
        first: 0-based number of the first frame.
        count: of frames.
        centre: point whose place is reported; by default the middle of all.
    """
    usable = np.isfinite(table.points).all(axis=2).sum(axis=1) >= FEWEST
    rows = np.flatnonzero(usable & (table.frames >= first) & (table.frames < first + count))
    found: list[list[AnimalPose]] = [[] for _ in range(count)]
    if not len(rows):
        return found
    place, turn, bends, weights = skeleton.fit(table.points[rows])
    placed = skeleton.placed(place, turn, bends)
    node = None if centre is None else table.node(centre)
    for n, row in enumerate(rows):
        seen = np.isfinite(table.points[row]).all(axis=1)
        if weights[n][seen].mean() < FITS:
            continue
        points = np.stack([placed[n].real, placed[n].imag], axis=1)
        own = points.mean(axis=0) if node is None else points[node]
        length, width = skeleton.length * abs(turn[n]), skeleton.width * abs(turn[n])
        pose = AnimalPose(
            own, float(np.angle(turn[n])), length, max(width, 0.2 * length), own, np.array([length, width]) / 4, 1.0,
            np.zeros(2), headed=True, points=points, point_scores=weights[n],
        )  # fmt: skip
        found[int(table.frames[row]) - first].append(pose)
    return [_touching(poses) for poses in found]


def _touching(poses: list[AnimalPose]) -> list[AnimalPose]:
    """The poses with those marked that are near another."""
    places = np.array([pose.place for pose in poses]).reshape(-1, 2)
    away = np.linalg.norm(places[:, None] - places[None], axis=2) + np.diag(np.full(len(poses), np.inf))
    return [
        replace(pose, contact=bool(len(poses) > 1 and away[n].min() < TOUCHING * pose.length))
        for n, pose in enumerate(poses)
    ]


def headed_by_labels(
    poses: Sequence[list[AnimalPose]], labels: PointTable, first: int, line: tuple[str, str] | None
) -> list[list[AnimalPose]]:
    """The poses, with their heads known where a person labelled them."""
    back, front = line_of(labels.nodes, line)
    after = [list(found) for found in poses]
    for n, points in enumerate(labels.points):
        row = int(labels.frames[n]) - first
        ahead = points[front] - points[back]
        if not 0 <= row < len(after) or not np.isfinite(ahead).all():
            continue
        number = _nearest(after[row], points)
        if number is not None:
            pose = after[row][number]
            same = ahead[0] * np.cos(pose.axis) + ahead[1] * np.sin(pose.axis) >= 0
            after[row][number] = replace(pose, axis=pose.axis + (0.0 if same else np.pi), headed=True)
    return after


def learn_body_points(animals: Sequence[Animal], labels: PointTable) -> BodyPoints:
    """Where on the body labelled points lie: medians over all labels.

    Raises:
        RequestError: no label lies on an animal, or a point has none.
    """
    local = []
    for frame, points in zip(labels.frames.tolist(), labels.points, strict=True):
        states = np.array(
            [
                animal.track.states[row]
                for animal in animals
                if (row := int(np.searchsorted(animal.track.frames, frame))) < len(animal.track)
                and animal.track.frames[row] == frame
            ]
        ).reshape(-1, 5)
        middle = np.nanmean(points, axis=0)
        away = np.linalg.norm(states[:, :2] - middle, axis=1)
        if not len(states) or away.min() > 0.5 * states[away.argmin(), 3]:
            continue
        a, b, theta, length = states[away.argmin(), :4]
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        local.append((points - [a, b]) @ turn / length)
    if not local:
        raise RequestError("expected labels on the animals of these frames, got none; are they of another video?")
    every = np.array(local)
    known = np.isfinite(every).all(axis=2).any(axis=0)
    if not known.all():
        raise RequestError(f"expected a label of every point, got none of {labels.nodes[int(np.argmin(known))]}")
    return BodyPoints(labels.nodes, np.nanmedian(every, axis=0))


def _nearest(poses: list[AnimalPose], points: FloatArray) -> int | None:
    """Number of the pose that labelled points lie on."""
    if not poses:
        return None
    middle = np.nanmean(points, axis=0)
    away = np.array([np.linalg.norm(pose.place - middle) for pose in poses])
    number = int(away.argmin())
    return number if away[number] <= 0.5 * poses[number].length else None


def with_centre(animal: Animal, points: BodyPoints, centre: str) -> Animal:
    """The animal, its place that of the point ``centre``; its usual length counts, so that a leg moves nothing."""
    node, states = points.nodes.index(centre), animal.track.states.copy()
    usual = states.copy()
    usual[:, 3] = float(np.median(states[:, 3]))
    states[:, :2] = [points.on(state)[node] for state in usual]
    return replace(animal, track=replace(animal.track, states=states))


def point_table(animals: Sequence[Animal], points: BodyPoints | None, nodes: tuple[str, ...]) -> PointTable:
    """All points of all animals: those fitted, or those that ``points`` puts on the body.

    Args:
        animals: their places are the middles of their bodies where ``points`` are given.
        points: where on the body they lie; None takes those of the poses.
        nodes: K names.
    """
    frames, tracks, places, scores = [], [], [], []
    for animal in animals:
        usual = float(np.median(animal.track.states[:, 3]))
        for frame, state, score, pose in zip(
            animal.track.frames.tolist(), animal.track.states, animal.track.scores, animal.poses, strict=True
        ):
            if points is not None:
                own, sure = points.on(np.array([*state[:3], usual])), np.full(len(nodes), score)
            elif pose is not None and pose.points is not None and pose.point_scores is not None:
                own, sure = pose.points, pose.point_scores
            else:
                continue
            frames.append(frame)
            tracks.append(f"track_{animal.track.id}")
            places.append(own)
            scores.append(sure)
    count = len(frames)
    return PointTable(
        nodes,
        np.array(frames, dtype=np.int64),
        tuple(tracks),
        np.array(places).reshape(count, len(nodes), 2),
        np.array(scores).reshape(count, len(nodes)),
    )
