"""A skeleton as a body: mean places of its points and how they vary, fitted to points that were seen, some wrongly.

Points are complex numbers ``x + i y``. A state puts them at ``c + w (mean_k + sum_m b_m mode_mk)``, where ``c`` is the
place, ``w`` turn and size together, and ``b`` are bends of unit variance. Points that lie far from where the others put
them count little (Cauchy's weights), and those not seen not at all: the fit says where they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

Complex: TypeAlias = NDArray[np.complex128]

ROUNDS = 12
LEAST_NOISE = 0.01
"""Deviation of a point from the fit, of the skeleton's size, at the least."""
FRONTS = ("head", "nose", "snout")
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
            points: ``(N, K, 2)`` pixels, NaN where not seen; at least two of each animal.
        """
        seen = np.asarray(np.isfinite(points).all(axis=2), dtype=np.bool_)
        given = np.where(seen, np.nan_to_num(points[..., 0]) + 1j * np.nan_to_num(points[..., 1]), 0)
        weights: FloatArray = np.asarray(seen, dtype=np.float64)
        bends: FloatArray = np.zeros((len(points), len(self.modes)))
        place, turn = _similarity(np.tile(self.mean, (len(points), 1)), given, weights)
        # Cauchy's weights, with a scale of three deviations in the end. It begins wide, and stiff, so that a point that
        # is far off is found out before bends follow it.
        for number, scale in enumerate(np.geomspace(1.0, 3 * self.noise, ROUNDS)):
            shape = self.mean + bends @ self.modes
            place, turn = _similarity(shape, given, weights)
            local = (given - place[:, None]) / turn[:, None]
            if len(self.modes) and number >= ROUNDS // 2:
                bends = self._bends(local, weights)
            away = np.abs(local - self.mean - bends @ self.modes)
            weights = np.asarray(seen / (1 + (away / scale) ** 2), dtype=np.float64)
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
        points: ``(N, K, 2)`` pixels, NaN where not seen.
        line: names of a point at the back and one at the front; by default found by their names.
        modes: most bends; fewer where there are too few animals to learn them from.

    Raises:
        RequestError: no point is known to be front or back, or a point is never seen with others.
    """
    back, front = line_of(nodes, line)
    seen = np.asarray(np.isfinite(points).all(axis=2), dtype=np.bool_)
    if seen.sum(axis=0).min() == 0:
        never = nodes[int(seen.sum(axis=0).argmin())]
        raise RequestError(f"expected every point to be seen in some frame, but {never} never is")
    good = seen.sum(axis=1) >= 2
    if not good.any():
        raise RequestError("expected animals with at least two points, got none")
    points, seen = points[good], seen[good]
    given = np.where(seen, np.nan_to_num(points[..., 0]) + 1j * np.nan_to_num(points[..., 1]), 0)
    mean = given[int(seen.sum(axis=1).argmax())].copy()
    weights = np.asarray(seen, dtype=np.float64)
    for _ in range(ROUNDS):
        place, turn = _similarity(np.tile(mean, (len(given), 1)), given, weights)
        local = (given - place[:, None]) / turn[:, None]
        mean = (weights * local).sum(axis=0) / weights.sum(axis=0)
        mean = mean - mean.mean()
        mean = mean / np.sqrt(np.mean(np.abs(mean) ** 2))
    ahead = mean[front] - mean[back]
    mean = mean * np.conj(ahead / abs(ahead))
    place, turn = _similarity(np.tile(mean, (len(given), 1)), given, weights)
    rest = np.where(seen, (given - place[:, None]) / turn[:, None] - mean, 0)
    table = np.concatenate([rest.real, rest.imag], axis=1)
    _, lengths, vectors = np.linalg.svd(table, full_matrices=False)
    count = min(modes, max(0, len(given) // 20), len(lengths))
    deviations = lengths[:count] / np.sqrt(len(given))
    own = vectors[:count] * deviations[:, None]
    kept = own[:, : len(nodes)] + 1j * own[:, len(nodes) :]
    left = np.sum(lengths[count:] ** 2) / max(2 * seen.sum(), 1)
    return Skeleton(nodes, mean, np.asarray(kept), max(float(np.sqrt(left)), LEAST_NOISE))


def _similarity(shape: Complex, given: Complex, weights: FloatArray) -> tuple[Complex, Complex]:
    """Place and turn with size that take ``shape`` ``(N, K)`` nearest to ``given``, by weighted least squares."""
    total = np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    middle, target = ((weights * part).sum(axis=1, keepdims=True) / total for part in (shape, given))
    own, other = shape - middle, given - target
    square = np.maximum((weights * np.abs(own) ** 2).sum(axis=1), 1e-12)
    turn = (weights * own.conj() * other).sum(axis=1) / square
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
