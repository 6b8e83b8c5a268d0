"""A skeleton as a body: mean places of its points and how they vary, fitted to detected points, some of them wrong.

Points are complex numbers ``x + i y``. A state puts them at ``c + w (mean_k + sum_m b_m mode_mk)``, where ``c`` is the
place, ``w`` turn and size together, and ``b`` are bends of unit variance. Points that lie far from where the others put
them count little (Cauchy's weights), and missing ones not at all: the fit gives their places.

Poses and points go two ways round. Where points were found in every frame, by SLEAP or DeepLabCut, each animal's points
are observations of a `Skeleton`, and the fit is its pose. Where a person labelled a few frames, poses of these frames
teach where on the body the points lie, and every other pose carries them along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.animals.linking import Animal
from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.tracks import PointTable

Complex: TypeAlias = NDArray[np.complex128]

# Of a fit, whose scale narrows from one to the next; and of learning.
ROUNDS = 12
# Deviation of a point from the fit, of the skeleton's size, at the least.
LEAST_NOISE = 0.01
# Names of points at the front, the most telling first.
FRONTS = ("head", "nose", "snout")
# Names of points at the back, the most telling first.
BACKS = ("abdomen", "tailbase", "tail_base", "tail", "thorax")


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Points of a body that turns, grows and bends.

    Attributes:
        nodes: K names.
        mean: ``(K,)`` complex, centred, of root mean square distance 1, the heading on +x.
        modes: ``(M, K)`` complex, for one standard deviation.
        noise: deviation of a point from the fit, in sizes.
    """

    nodes: tuple[str, ...]
    mean: Complex
    modes: Complex
    noise: float

    @property
    def length(self) -> float:
        """From the rearmost point to the foremost, in sizes."""
        return float(np.ptp(self.mean.real))

    @property
    def width(self) -> float:
        """From side to side, in sizes."""
        return float(np.ptp(self.mean.imag))

    def placed(self, place: Complex, turn: Complex, bends: FloatArray) -> Complex:
        """``(N, K)`` points of places ``(N,)``, turns with sizes ``(N,)`` and bends ``(N, M)``."""
        return np.asarray(place[:, None] + turn[:, None] * (self.mean + bends @ self.modes))

    def fit(self, points: FloatArray) -> tuple[Complex, Complex, FloatArray, FloatArray]:
        """Places ``(N,)``, turns with sizes ``(N,)``, bends ``(N, M)`` and how well each point fits ``(N, K)``, 0 to 1.

        Args:
            points: ``(N, K, 2)`` pixels, NaN where missing; at least two of each animal.
        """
        measured = np.asarray(np.isfinite(points).all(axis=2), dtype=np.bool_)
        positions = np.where(measured, np.nan_to_num(points[..., 0]) + 1j * np.nan_to_num(points[..., 1]), 0)
        weights: FloatArray = np.asarray(measured, dtype=np.float64)
        bends: FloatArray = np.zeros((len(points), len(self.modes)))
        place, turn = _similarity(np.tile(self.mean, (len(points), 1)), positions, weights)
        # Cauchy's weights, with a scale of three deviations in the end. It begins wide, and stiff, so that a point that
        # is far off is found out before bends follow it.
        for number, scale in enumerate(np.geomspace(1.0, 3 * self.noise, ROUNDS)):
            shape = self.mean + bends @ self.modes
            place, turn = _similarity(shape, positions, weights)
            local = (positions - place[:, None]) / turn[:, None]
            if len(self.modes) and number >= ROUNDS // 2:
                bends = self._bends(local, weights)
            away = np.abs(local - self.mean - bends @ self.modes)
            weights = np.asarray(measured / (1 + (away / scale) ** 2), dtype=np.float64)
        return place, turn, bends, weights

    def _bends(self, local: Complex, weights: FloatArray) -> FloatArray:
        """Ridge regression on the modes, whose prior is standard normal."""
        precision = weights / self.noise**2
        normal = np.einsum("nk,mk,lk->nml", precision, self.modes, self.modes.conj()).real
        right = np.einsum("nk,nk,mk->nm", precision, local - self.mean, self.modes.conj()).real
        return np.asarray(np.linalg.solve(normal + np.eye(len(self.modes)), right[..., None])[..., 0])


def learn_skeleton(
    nodes: tuple[str, ...], points: FloatArray, line: tuple[str, str] | None = None, modes: int = 3
) -> Skeleton:
    """A skeleton from points of animals, by alternating similarities and means, then principal components.

    Args:
        nodes: K names.
        points: ``(N, K, 2)`` pixels, NaN where missing.
        line: names of a point at the back and one at the front; by default found by their names.
        modes: most bends; fewer where there are too few animals to learn them from.

    Raises:
        RequestError: no point is known to be front or back, or a point is never detected with others.
    """
    back, front = line_of(nodes, line)
    measured = np.asarray(np.isfinite(points).all(axis=2), dtype=np.bool_)
    if measured.sum(axis=0).min() == 0:
        never = nodes[int(measured.sum(axis=0).argmin())]
        raise RequestError(f"expected every point to be seen in some frame, but {never} never is")
    good = measured.sum(axis=1) >= 2
    if not good.any():
        raise RequestError("expected animals with at least two points, got none")
    points, measured = points[good], measured[good]
    positions = np.where(measured, np.nan_to_num(points[..., 0]) + 1j * np.nan_to_num(points[..., 1]), 0)
    mean = positions[int(measured.sum(axis=1).argmax())].copy()
    weights = np.asarray(measured, dtype=np.float64)
    for _ in range(ROUNDS):
        place, turn = _similarity(np.tile(mean, (len(positions), 1)), positions, weights)
        local = (positions - place[:, None]) / turn[:, None]
        mean = (weights * local).sum(axis=0) / weights.sum(axis=0)
        mean = mean - mean.mean()
        mean = mean / np.sqrt(np.mean(np.abs(mean) ** 2))
    ahead = mean[front] - mean[back]
    mean = mean * np.conj(ahead / abs(ahead))
    place, turn = _similarity(np.tile(mean, (len(positions), 1)), positions, weights)
    residual = np.where(measured, (positions - place[:, None]) / turn[:, None] - mean, 0)
    table = np.concatenate([residual.real, residual.imag], axis=1)
    _, lengths, vectors = np.linalg.svd(table, full_matrices=False)
    count = min(modes, max(0, len(positions) // 20), len(lengths))
    deviations = lengths[:count] / np.sqrt(len(positions))
    components = vectors[:count] * deviations[:, None]
    learnt_modes = components[:, : len(nodes)] + 1j * components[:, len(nodes) :]
    left = np.sum(lengths[count:] ** 2) / max(2 * measured.sum(), 1)
    return Skeleton(nodes, mean, np.asarray(learnt_modes), max(float(np.sqrt(left)), LEAST_NOISE))


def _similarity(shape: Complex, positions: Complex, weights: FloatArray) -> tuple[Complex, Complex]:
    """Place and turn with size that take ``shape`` ``(N, K)`` nearest to ``positions``, by weighted least squares."""
    total = np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    middle, target = ((weights * part).sum(axis=1, keepdims=True) / total for part in (shape, positions))
    centred_shape, centred_positions = shape - middle, positions - target
    square = np.maximum((weights * np.abs(centred_shape) ** 2).sum(axis=1), 1e-12)
    turn = (weights * centred_shape.conj() * centred_positions).sum(axis=1) / square
    turn = np.where(np.abs(turn) > 1e-9, turn, 1e-9)
    return target[:, 0] - turn * middle[:, 0], turn


def line_of(nodes: tuple[str, ...], line: tuple[str, str] | None) -> tuple[int, int]:
    """Numbers of the points at the back and at the front, by default found by their names.

    Raises:
        RequestError: they cannot be found, or there are no such points.
    """
    if line is None:
        lower = [name.lower() for name in nodes]
        front = next((name for name in FRONTS if name in lower), None)
        back = next((name for name in BACKS if name in lower), None)
        if front is None or back is None:
            raise RequestError(f"expected `line`, a point at the back and one at the front of {', '.join(nodes)}")
        return lower.index(back), lower.index(front)
    missing = [name for name in line if name not in nodes]
    if missing or line[0] == line[1]:
        raise RequestError(f"`line`: expected two different points of {', '.join(nodes)}, got {','.join(line)}")
    return nodes.index(line[0]), nodes.index(line[1])


# Animals nearer than so many lengths may be mistaken for each other.
TOUCHING = 0.5
# Least mean weight of an animal's points, below which they are of no one animal.
FITS = 0.3
# Points that tell the place and turn of an animal, at least.
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
    """Poses of each frame from its points.

    Args:
        table: the points; who they are of is found anew.
        skeleton: theirs.
        first: 0-based number of the first frame.
        count: of frames.
        centre: point whose place is reported; by default the middle of all.
    """
    usable = np.isfinite(table.points).all(axis=2).sum(axis=1) >= FEWEST
    rows = np.flatnonzero(usable & (table.frames >= first) & (table.frames < first + count))
    by_frame: list[list[AnimalPose]] = [[] for _ in range(count)]
    if not len(rows):
        return by_frame
    place, turn, bends, weights = skeleton.fit(table.points[rows])
    placed = skeleton.placed(place, turn, bends)
    node = None if centre is None else table.node(centre)
    for n, row in enumerate(rows):
        measured = np.isfinite(table.points[row]).all(axis=1)
        if weights[n][measured].mean() < FITS:
            continue
        points = np.stack([placed[n].real, placed[n].imag], axis=1)
        spot = points.mean(axis=0) if node is None else points[node]
        length, width = skeleton.length * abs(turn[n]), skeleton.width * abs(turn[n])
        pose = AnimalPose(
            spot, float(np.angle(turn[n])), length, max(width, 0.2 * length), spot, np.array([length, width]) / 4, 1.0,
            np.zeros(2), headed=True, points=points, point_scores=weights[n], score=float(weights[n][measured].mean()),
        )  # fmt: skip
        by_frame[int(table.frames[row]) - first].append(pose)
    return [_touching(poses) for poses in by_frame]


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
    """The poses, with heads where a person labelled them."""
    back, front = line_of(labels.nodes, line)
    headed = [list(of_frame) for of_frame in poses]
    for n, points in enumerate(labels.points):
        row = int(labels.frames[n]) - first
        ahead = points[front] - points[back]
        if not 0 <= row < len(headed) or not np.isfinite(ahead).all():
            continue
        present = headed[row]
        number = _nearest(np.array([p.place for p in present]), np.array([p.length for p in present]), points)
        if number is not None:
            pose = present[number]
            same = ahead[0] * np.cos(pose.axis) + ahead[1] * np.sin(pose.axis) >= 0
            present[number] = replace(pose, axis=pose.axis + (0.0 if same else np.pi), headed=True)
    return headed


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
        number = _nearest(states[:, :2], states[:, 3], points)
        if number is None:
            continue
        a, b, theta, length = states[number, :4]
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        local.append((points - [a, b]) @ turn / length)
    if not local:
        raise RequestError("expected labels on the animals of these frames, got none; are they of another video?")
    places = np.array(local)
    labelled = np.isfinite(places).all(axis=2).any(axis=0)
    if not labelled.all():
        raise RequestError(f"expected a label of every point, got none of {labels.nodes[int(np.argmin(labelled))]}")
    return BodyPoints(labels.nodes, np.nanmedian(places, axis=0))


def _nearest(places: FloatArray, lengths: FloatArray, points: FloatArray) -> int | None:
    """Number of the animal that labelled points lie on, of places ``(N, 2)`` and lengths ``(N,)``; None for none."""
    away = np.linalg.norm(places.reshape(-1, 2) - np.nanmean(points, axis=0), axis=1)
    number = int(away.argmin()) if len(away) else 0
    return number if len(away) and away[number] <= 0.5 * lengths[number] else None


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
                positions, sure = points.on(np.array([*state[:3], usual])), np.full(len(nodes), score)
            elif pose is not None and pose.points is not None and pose.point_scores is not None:
                positions, sure = pose.points, pose.point_scores
            else:
                continue
            frames.append(frame)
            tracks.append(f"track_{animal.track.id}")
            places.append(positions)
            scores.append(sure)
    count = len(frames)
    return PointTable(
        nodes,
        np.array(frames, dtype=np.int64),
        tuple(tracks),
        np.array(places).reshape(count, len(nodes), 2),
        np.array(scores).reshape(count, len(nodes)),
    )
