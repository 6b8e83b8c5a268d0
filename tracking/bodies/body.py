"""What the deformable tracker, motion learning and plots need to know of a body, two drawn by hand and those learnt.

`Goldfish` is that of section 3.1 of the goldfish paper, Figs. 3 and 4; `Ball` is the paper's own outlook (section 6).
`LearntBody` is the mean outline of silhouettes and how it bends, the paper's closing wish. `tsuiseki train body` saves
one JSON file, which :func:`read_body` loads; :func:`parse_body` finds any body by its name or file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_learnt
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

    def contour(self, states: FloatArray) -> Contours:
        """Points ``(N, K, 2)`` float32, x and y in pixels, of states ``(N, D)``; K is the same for every state."""
        ...


def shape_limits(*limits: tuple[float, float]) -> FloatArray:
    """Limits ``(D, 2)`` of a state whose shape has these, a pair each; place and heading have none."""
    return np.array([*[(-np.inf, np.inf)] * 3, *limits])


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


# Most that a goldfish bends its tail, radians.
LARGEST_BEND = np.pi / 2


@dataclass(frozen=True)
class Goldfish:
    """An ellipse about ``(a, b)`` whose long axis points along ``theta``, and a tail line bent by ``phi``.

    The line starts at the rear end of the ellipse and points to ``theta + pi - phi``: straight back for ``phi = 0``,
    and to the side of growing ``theta`` for ``phi > 0``, so that a fish curled to one side turns there with both
    positive. The sizes are those of one fish before one camera and stay as they are: the state has none.

    Attributes:
        length: of the ellipse's long axis, pixels.
        width: of its short axis, pixels.
        tail: length of the tail line, pixels.
        ellipse_points: contour points on the ellipse, at least 8.
        tail_points: contour points on the line, the last at its end, at least 1.
    """

    name = "goldfish"
    fields = ("a", "b", "theta", "phi")
    angles = (2, 3)
    limits = shape_limits((-LARGEST_BEND, LARGEST_BEND))
    length: float = 56.0
    width: float = 24.0
    tail: float = 32.0
    ellipse_points: int = 24
    tail_points: int = 6

    def __post_init__(self) -> None:
        if not (0 < self.width <= self.length < np.inf and 0 < self.tail < np.inf):
            raise RequestError(
                "goldfish: expected sizes above 0 and a width up to the length, "
                f"got length {self.length:g}, width {self.width:g}, tail {self.tail:g}"
            )
        if self.ellipse_points < 8 or self.tail_points < 1:
            raise RequestError("goldfish: expected at least 8 points on the ellipse and 1 on the tail")

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (
            Stroke(0, self.ellipse_points, closed=True),
            Stroke(self.ellipse_points, self.ellipse_points + self.tail_points, closed=False),
        )

    @property
    def radius(self) -> float:
        return self.length / 2 + self.tail

    def contour(self, states: FloatArray) -> Contours:
        """The points of the ellipse first, then those of the tail from root to end.

        >>> Goldfish(length=40, width=20, tail=30).contour(np.array([[0, 0, 0, 0.0]]))[0, [0, -1]].tolist()
        [[20.0, 0.0], [-50.0, 0.0]]
        """
        phi = np.asarray(states[:, 3:4], dtype=np.float32)
        terms = np.concatenate([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
        return placed(terms, states, self._turning)

    @cached_property
    def _turning(self) -> Contours:
        """Of the unbent body without its tail, and of the tail along and across it."""
        basis = np.zeros((3, self.ellipse_points + self.tail_points, 2), dtype=np.float32)
        basis[0, : self.ellipse_points] = ellipse(self.length, self.width, self.ellipse_points)
        basis[0, self.ellipse_points :, 0] = -self.length / 2
        # The root of the tail lies on the ellipse already.
        along = np.linspace(0.0, self.tail, self.tail_points + 1)[1:]
        basis[1, self.ellipse_points :, 0] = -along
        basis[2, self.ellipse_points :, 1] = along
        return turning_basis(basis)


# Most that a ball is flattened, as a share of its diameter.
LARGEST_SQUASH = 0.6


@dataclass(frozen=True)
class Ball:
    """A disc about ``(a, b)`` squashed along ``theta`` by the share ``squash``, its area kept.

    The axis along ``theta`` is ``1 - squash`` diameters long, the other ``1 / (1 - squash)``. ``theta`` and
    ``theta + pi`` look the same, and any ``theta`` does at ``squash = 0``.

    Attributes:
        diameter: of the ball at rest, pixels.
        points: contour points, at least 8.
    """

    name = "ball"
    fields = ("a", "b", "theta", "squash")
    angles = (2,)
    limits = shape_limits((0.0, LARGEST_SQUASH))
    diameter: float = 60.0
    points: int = 24

    def __post_init__(self) -> None:
        if not 0 < self.diameter < np.inf or self.points < 8:
            raise RequestError(
                f"ball: expected a diameter above 0 and at least 8 points, got {self.diameter:g} and {self.points}"
            )

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (Stroke(0, self.points, closed=True),)

    @property
    def radius(self) -> float:
        return self.diameter / 2 / (1 - LARGEST_SQUASH)

    def contour(self, states: FloatArray) -> Contours:
        """Squashes beyond the limits are drawn at the limit.

        >>> Ball(diameter=20).contour(np.array([[0, 0, 0, 0.5]]))[0, [0, 6]].round(3).tolist()
        [[5.0, 0.0], [0.0, 20.0]]
        """
        length = np.float32(1) - np.clip(states[:, 3:4], *self.limits[3]).astype(np.float32)
        return placed(np.concatenate([length, 1 / length], axis=1), states, self._turning)

    @cached_property
    def _turning(self) -> Contours:
        """Of the circle along and across the squash."""
        angle = np.arange(self.points) * 2 * np.pi / self.points
        basis = np.zeros((2, self.points, 2), dtype=np.float32)
        basis[0, :, 0], basis[1, :, 1] = np.cos(angle), np.sin(angle)
        return turning_basis(basis * np.float32(self.diameter / 2))


FORMAT = "tsuiseki-body-1"


@dataclass(frozen=True, eq=False)
class LearntBody:
    """``mean + sum_m bend_m mode_m + (bend_m^2 - 1) curve_m`` about ``(a, b)``, turned by ``theta``.

    Points of a bent body move along arcs and not along lines, so each mode comes with its second-order term; bends have
    unit variance and mean zero over the silhouettes, and ``bend^2 - 1`` has mean zero too.

    Attributes:
        name: of the body.
        mean: ``(K, 2)`` pixels about the centroid, the heading on +x.
        modes: ``(M, K, 2)`` pixels for one standard deviation, the greatest first.
        curves: ``(M, K, 2)`` pixels.
        bends: ``(M, 2)`` least and greatest bend in the data.
    """

    name: str
    mean: FloatArray
    modes: FloatArray
    curves: FloatArray
    bends: FloatArray

    def __post_init__(self) -> None:
        count, points = self.modes.shape[0], self.mean.shape[0]
        shapes = {"mean": (points, 2), "modes": (count, points, 2), "curves": (count, points, 2), "bends": (count, 2)}
        for part, shape in shapes.items():
            values = getattr(self, part)
            if values.shape != shape or not np.isfinite(values).all():
                raise ValueError(f"expected finite {part} of shape {shape}, got shape {values.shape}")
        if count < 1 or points < 8 or np.any(self.bends[:, 0] >= self.bends[:, 1]):
            raise ValueError("expected at least one mode, eight points and a range of bends")

    @property
    def fields(self) -> tuple[str, ...]:
        return ("a", "b", "theta", *(f"bend{mode + 1}" for mode in range(len(self.modes))))

    @property
    def angles(self) -> tuple[int, ...]:
        return (2,)

    @cached_property
    def limits(self) -> FloatArray:
        return shape_limits(*self.bends.tolist())

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (Stroke(0, len(self.mean), closed=True),)

    @cached_property
    def radius(self) -> float:
        largest = np.abs(self.bends).max(axis=1)[:, None]
        mode, curve = (np.linalg.norm(part, axis=2) for part in (self.modes, self.curves))
        bent = (largest * mode + np.maximum(largest**2 - 1, 1) * curve).sum(axis=0)
        return float((np.linalg.norm(self.mean, axis=1) + bent).max())

    def contour(self, states: FloatArray) -> Contours:
        """Bends beyond the limits are drawn at the limit."""
        bends = np.clip(states[:, 3 : 3 + len(self.modes)], *self.bends.T).astype(np.float32)
        terms = np.concatenate([bends, bends**2 - 1, np.ones((len(bends), 1), np.float32)], axis=1)
        return placed(terms, states, self._turning)

    @cached_property
    def _turning(self) -> Contours:
        return turning_basis(np.concatenate([self.modes, self.curves, self.mean[None]]).astype(np.float32))


def write_body(path: Path, body: LearntBody) -> None:
    """Writes the file that :func:`read_body` reads."""
    arrays = {part: getattr(body, part).round(4).tolist() for part in ("mean", "modes", "curves", "bends")}
    values = {"format": FORMAT, "body": "learnt", "name": body.name, **arrays}
    path.write_text(json.dumps(values) + "\n", encoding="utf-8")


def read_body(path: Path) -> LearntBody:
    """The body in a file of `tsuiseki train body`.

    Raises:
        RequestError: it is no such file, or is broken.
    """
    values = read_learnt(path, "train body", FORMAT)
    try:
        parts = [np.array(values[part], dtype=np.float64) for part in ("mean", "modes", "curves", "bends")]
        return LearntBody(str(values["name"]), *parts)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RequestError(f"{path}: broken body file ({error}); make it again with tsuiseki train body") from error


BODIES: Mapping[str, Callable[..., Body]] = {"goldfish": Goldfish, "ball": Ball}


def parse_body(text: str) -> Body:
    """A body by name, with its sizes where they differ from the usual ones, or a file of `tsuiseki train body`.

    >>> parse_body("goldfish,length=40,width=14").length
    40.0

    Raises:
        RequestError: there is no such body, size or file, or a size is no number.
    """
    if text.endswith(".json"):
        return read_body(Path(text))
    name, *words = (part.strip() for part in text.split(","))
    make = BODIES.get(name)
    if make is None:
        raise RequestError(
            f"expected a body of {', '.join(BODIES)} or a file .json of tsuiseki train body, got {name!r}"
        )
    number_types = {field.name: int if field.type == "int" else float for field in fields(make)}  # type: ignore[arg-type]
    sizes: dict[str, float] = {}
    for size in words:
        key, equals, value = (part.strip() for part in size.partition("="))
        if not equals:
            raise RequestError(f"expected sizes of a body as name=number, got {size!r} in {text!r}")
        if key not in number_types:
            raise RequestError(f"expected sizes of the {name} among {', '.join(number_types)}, got {key!r}")
        try:
            sizes[key] = number_types[key](value)
        except ValueError as error:
            raise RequestError(f"expected a number for {key} of the {name}, got {value!r}") from error
    return make(**sizes)
