"""The goldfish of section 3.1: an ellipse, and a line for the tail, Figs. 3 and 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from tsuiseki.tracking.bodies.body import Contours, Stroke, ellipse, placed, turning_basis, unlimited
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

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
    def name(self) -> str:
        return "goldfish"

    @property
    def fields(self) -> tuple[str, ...]:
        return ("a", "b", "theta", "phi")

    @property
    def angles(self) -> tuple[int, ...]:
        return (2, 3)

    @cached_property
    def limits(self) -> FloatArray:
        limits = unlimited(4)
        limits[3] = -LARGEST_BEND, LARGEST_BEND
        return limits

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (
            Stroke(0, self.ellipse_points, closed=True),
            Stroke(self.ellipse_points, self.ellipse_points + self.tail_points, closed=False),
        )

    @property
    def radius(self) -> float:
        return self.length / 2 + self.tail

    @property
    def card(self) -> Mapping[str, object]:
        return {"body": self.name, **asdict(self)}

    def contour(self, states: FloatArray) -> Contours:
        """See :class:`~tsuiseki.tracking.bodies.body.Body`; the ellipse first, then the tail from root to end.

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
