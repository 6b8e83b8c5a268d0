"""Points of animals in frames, whatever file they came from."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class PointTable:
    """Points of N animals in frames.

    Attributes:
        nodes: K names.
        frames: ``(N,)`` 0-based.
        tracks: N names of who it is; empty where that is not known.
        points: ``(N, K, 2)`` pixels; NaN where a point is not seen.
        scores: ``(N, K)``; NaN where a point has none.
    """

    nodes: tuple[str, ...]
    frames: IntArray
    tracks: tuple[str, ...]
    points: FloatArray
    scores: FloatArray

    def __len__(self) -> int:
        return len(self.frames)

    def node(self, name: str) -> int:
        """Number of a node.

        Raises:
            RequestError: there is none of that name.
        """
        if name not in self.nodes:
            raise RequestError(f"expected a point of {', '.join(self.nodes)}, got {name!r}")
        return self.nodes.index(name)
