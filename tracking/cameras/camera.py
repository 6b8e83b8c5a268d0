"""What is asked of any camera, whatever its lens: a pinhole or an omnidirectional one."""

from __future__ import annotations

from typing import Protocol

from tsuiseki.tracking.types import FloatArray


class Camera(Protocol):
    """A camera with one optical centre.

    Attributes:
        width: of the image, pixels.
        height: likewise.
        position: ``(3,)`` of the optical centre in the world, metres.
    """

    @property
    def width(self) -> int: ...

    @property
    def height(self) -> int: ...

    @property
    def position(self) -> FloatArray: ...

    def project(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels ``(N, 2)`` and depths ``(N,)`` of world points ``(N, 3)``; a depth of 0 or less is not seen."""
        ...
