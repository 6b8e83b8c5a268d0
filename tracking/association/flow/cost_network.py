"""Costs that a network adds to those of the flow: learnt on whole tracks, from ONNX (`tsuiseki train association`).

The network takes rows of features (`evidence`) and gives what each cost is to be changed by: of links, of detections
with the start and the end of a track at each, and of joins of tracklets. No change is larger than `LARGEST`. It may
also project appearance features, whose distances are then compared in place of the given ones'.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from tsuiseki.tracking.association.flow.evidence import DETECTION_FEATURES, JOIN_FEATURES, LINK_FEATURES
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.types import Detections, FloatArray

LARGEST = 8.0


class CostChanges(Protocol):
    """Anything that changes the costs of the flow by features."""

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links with ``(P, 25)`` features."""
        ...

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections with ``(N, 15)`` features: of use, of a start, of an end."""
        ...

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins with ``(P, 29)`` features."""
        ...


@runtime_checkable
class ProjectsAppearance(Protocol):
    """Cost changes that were learnt with appearance features compared after a projection."""

    def projected(self, found: Detections) -> Detections:
        """The detections of a frame with their appearance features as they are to be compared."""
        ...


@dataclass(frozen=True)
class FeatureNames:
    """What the columns of the three inputs are."""

    links: tuple[str, ...] = LINK_FEATURES
    detections: tuple[str, ...] = DETECTION_FEATURES
    joins: tuple[str, ...] = JOIN_FEATURES


class CostNetwork:
    """An exported association network; a `CostChanges`.

    Attributes:
        path: of the file.
        card: what it says of itself.

    Args:
        path: the ONNX file.
        threads: CPU threads; 0 takes all cores.

    Raises:
        RequestError: the file is no association network (see `OnnxModel`), or asks for features not known here.
    """

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        self.model = OnnxModel(path, "association", threads)
        self.path, self.card = Path(path), self.model.card
        # A network that was trained before a feature was added does without it.
        self._columns = {part: self._places(part, known) for part, known in asdict(FeatureNames()).items()}

    def _places(self, part: str, known: tuple[str, ...]) -> list[int]:
        """Which of the columns known here the file wants, in its order."""
        asked = tuple(self.card.settings.get(part, ()))
        foreign = sorted(set(asked) - set(known))
        if foreign or not asked:
            raise RequestError(
                f"{self.path}: expected some of the {len(known)} features of {part} computed here, got "
                f"{', '.join(foreign) or 'none'}; train the network again"
            )
        return [known.index(name) for name in asked]

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return self._run(links=rows)[0]

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        return self._run(detections=rows)[1]

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return self._run(joins=rows)[2]

    def projected(self, found: Detections) -> Detections:
        """The detections of a frame with features ``(N, d)`` of unit length; as they are where nothing is projected.

        Raises:
            RequestError: they have no features, or of another length than it was trained with.
        """
        length = self.card.feature_length
        if not length or not len(found):
            return found
        if found.features is None or found.features.shape[1] != length:
            got = "none" if found.features is None else f"{found.features.shape[1]} numbers"
            raise RequestError(
                f"{self.path}: expected appearance features of {length} numbers, which it projects, got {got}; give "
                "`appearance`, the network that it was trained with"
            )
        return found.with_features(self.project(found.features))

    def project(self, features: FloatArray) -> FloatArray:
        """``(N, D)`` features to ``(N, d)``, NaN where not known; only of a file that projects."""
        return self._run(appearance=features)[3]

    def _run(
        self,
        links: FloatArray | None = None,
        detections: FloatArray | None = None,
        joins: FloatArray | None = None,
        appearance: FloatArray | None = None,
    ) -> list[FloatArray]:
        rows = []
        for part, given in (("links", links), ("detections", detections), ("joins", joins)):
            columns = self._columns[part]
            chosen = np.zeros((0, len(columns))) if given is None else given[:, columns]
            rows.append(np.ascontiguousarray(chosen, dtype=np.float32))
        if self.card.feature_length:
            looks = np.zeros((0, self.card.feature_length)) if appearance is None else appearance
            rows.append(np.ascontiguousarray(looks, dtype=np.float32))
        return [np.asarray(out, dtype=np.float64) for out in self.model.run(*rows)]
