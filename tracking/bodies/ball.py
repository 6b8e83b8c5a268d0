"""A ball that squashes when it hits a wall: the paper's own outlook (section 6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np

from tsuiseki.tracking.bodies.body import Contours, Stroke, placed, turning_basis, unlimited
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray

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

    diameter: float = 60.0
    points: int = 24

    def __post_init__(self) -> None:
        if not 0 < self.diameter < np.inf or self.points < 8:
            raise RequestError(
                f"ball: expected a diameter above 0 and at least 8 points, got {self.diameter:g} and {self.points}"
            )

    @property
    def name(self) -> str:
        return "ball"

    @property
    def fields(self) -> tuple[str, ...]:
        return ("a", "b", "theta", "squash")

    @property
    def angles(self) -> tuple[int, ...]:
        return (2,)

    @cached_property
    def limits(self) -> FloatArray:
        limits = unlimited(4)
        limits[3] = 0.0, LARGEST_SQUASH
        return limits

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (Stroke(0, self.points, closed=True),)

    @property
    def radius(self) -> float:
        return self.diameter / 2 / (1 - LARGEST_SQUASH)

    @property
    def card(self) -> Mapping[str, object]:
        return {"body": self.name, **asdict(self)}

    def contour(self, states: FloatArray) -> Contours:
        """See :class:`~tsuiseki.tracking.bodies.body.Body`; squashes beyond the limits are drawn at the limit.

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
