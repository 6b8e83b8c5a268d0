"""What the deformable tracker, motion learning and plots need to know of a body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import FloatArray

Contours: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class Stroke:
    """A run of contour points that belong to one line, for drawing.

    Attributes:
        first: index of its first point.
        last: one beyond its last point.
        closed: the last point joins the first.
    """

    first: int
    last: int
    closed: bool


class Body(Protocol):
    """A shape that moves and deforms.

    A state is ``a, b, theta, ...``: the centre in pixels, the heading in radians (0 along +x, growing towards +y, which
    points down), then whatever bends or squashes the body. All bodies share the first three components.

    Attributes:
        name: short, in lower case; a learnt motion file says which body it is for.
        fields: names of the ``D`` components, as in ``states.csv``.
        angles: indices of the components that are angles in radians.
        limits: ``(D, 2)`` least and greatest value of each component; infinite where there is none.
        strokes: which contour points form lines.
        radius: no contour point is ever farther from the centre, pixels.
        card: sizes that rebuild the body (:func:`tsuiseki.tracking.bodies.choice.body_of_card`), for files.
    """

    @property
    def name(self) -> str: ...
    @property
    def fields(self) -> tuple[str, ...]: ...
    @property
    def angles(self) -> tuple[int, ...]: ...
    @property
    def limits(self) -> FloatArray: ...
    @property
    def strokes(self) -> tuple[Stroke, ...]: ...
    @property
    def radius(self) -> float: ...
    @property
    def card(self) -> Mapping[str, object]: ...

    def contour(self, states: FloatArray) -> Contours:
        """Points ``(N, K, 2)`` float32, x and y in pixels, of states ``(N, D)``; K is the same for every state."""
        ...


def unlimited(components: int) -> FloatArray:
    """Limits ``(components, 2)`` that exclude nothing."""
    return np.tile([-np.inf, np.inf], (components, 1))


def turning_basis(basis: Contours) -> Contours:
    """What :func:`placed` multiplies: basis shapes ``(R, K, 2)`` with the nose on +x, as rows ``(2 R + 2, 2 K)``.

    The first rows are the shapes themselves, then follow the shapes turned by a right angle, then the two shifts.
    """
    turned = np.stack([-basis[..., 1], basis[..., 0]], axis=-1)
    shifts = np.broadcast_to(np.eye(2)[:, None], (2, basis.shape[1], 2))
    return np.concatenate([basis, turned, shifts]).reshape(2 * len(basis) + 2, -1).astype(np.float32)


def placed(terms: Contours, states: FloatArray, turning: Contours) -> Contours:
    """Contours ``(N, K, 2)`` that are sums of basis shapes, turned by the heading and moved to the centre.

    All of it is linear in ``cos theta`` and ``sin theta`` times the terms, so that one product does it.

    Args:
        terms: ``(N, R)`` how much of each basis shape.
        states: ``(N, D >= 3)``.
        turning: of the basis shapes, by :func:`turning_basis`.
    """
    theta = np.asarray(states[:, 2:3], dtype=np.float32)
    place = np.asarray(states[:, :2], dtype=np.float32)
    factors = np.concatenate([np.cos(theta) * terms, np.sin(theta) * terms, place], axis=1)
    return (factors @ turning).reshape(len(states), turning.shape[1] // 2, 2)


def ellipse(length: float, width: float, points: int) -> Contours:
    """``(points, 2)`` evenly spaced along an ellipse about the origin, from its end on +x towards +y."""
    fine = np.linspace(0.0, 2 * np.pi, 1025)
    outline = np.stack([length / 2 * np.cos(fine), width / 2 * np.sin(fine)], axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(outline, axis=0), axis=1))])
    at = np.interp(np.arange(points) * way[-1] / points, way, fine)
    return np.stack([length / 2 * np.cos(at), width / 2 * np.sin(at)], axis=1).astype(np.float32)
