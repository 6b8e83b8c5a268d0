"""Costs of the flow that are learnt from labelled tracks, from ONNX: on pairs of detections, or on whole tracks.

An `Affinity` holds gradient-boosted trees over pairs (thesis eq. 2.14-2.15). They give the probability that two
detections show the same person, whether or not that person was detected in between.

A `CostNetwork` takes rows of features (`evidence`) and gives by how much each cost changes: of links, of detections
with the start and the end of a track at each, and of joins of tracklets. No change is larger than `LARGEST`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.association.costs import ObservationCost, PairFeatures
from tsuiseki.tracking.association.evidence import DETECTION_FEATURES, JOIN_FEATURES, LINK_FEATURES
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.network_trial import TRIED, most_at_once
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.types import FloatArray, IntArray

FeatureSet = Literal["thesis", "extended", "thesis_action", "extended_action"]
FEATURE_SETS: dict[FeatureSet, tuple[str, ...]] = {
    "thesis": ("iou", "appearance"),
    "extended": ("iou", "appearance", "gap", "width", "height", "x", "y"),
    "thesis_action": ("iou", "appearance", "action"),
    "extended_action": ("iou", "appearance", "gap", "width", "height", "x", "y", "action"),
}
# No evidence makes a link certain, and the cost of an impossible one has to stay finite.
LEAST_PROBABILITY = 1e-6
# Rows that the trees get at a time: their buffers grow with the rows of a call.
ROWS_A_CALL = 1 << 18


def feature_rows(pairs: PairFeatures, features: FeatureSet) -> NDArray[np.float32]:
    """``(P, F)`` what the trees see of P pairs; NaN where the appearance is not known.

    ``thesis`` is eq. 2.15: intersection over union and cosine distance. ``extended`` adds the gap in frames, the
    change of width and height (absolute log ratio) and the move in x and y (heights of the boxes a frame). Both also
    come with the distance of the action features (eq. 5.2), NaN where that is not known.

    Raises:
        RequestError: there is no such feature set.
    """
    if features not in FEATURE_SETS:
        raise RequestError(f"expected features of {', '.join(get_args(FeatureSet))}; got {features!r}")
    columns = {
        "iou": pairs.iou,
        "appearance": pairs.appearance,
        "gap": pairs.gap,
        "width": np.abs(pairs.dw),
        "height": np.abs(pairs.dh),
        "x": np.abs(pairs.dx) / pairs.gap,
        "y": np.abs(pairs.dy) / pairs.gap,
        "action": np.full(len(pairs), np.nan) if pairs.action is None else pairs.action,
    }
    return np.stack([columns[name] for name in FEATURE_SETS[features]], axis=1).astype(np.float32)


def transition_cost(probability: FloatArray) -> FloatArray:
    """c_tran, Eq. (2.14): with P = 1 / (1 + exp(q)) the cost is -log P, so ``(P,)`` above 0 and finite.

    >>> transition_cost(np.array([0.5])).round(4).tolist()
    [0.6931]
    """
    return -np.log(np.clip(probability, LEAST_PROBABILITY, 1 - LEAST_PROBABILITY))


class Affinity:
    """A learnt transition cost and the observation cost learnt with it; a `TransitionCost`.

    The trees are g of Eqs. (2.15) and (5.2).

    Attributes:
        card: what the file says of itself.
        window: largest gap in frames it was learnt on.
        observation: c_obsv of eq. 2.12-2.13.

    Args:
        path: the ONNX file.
        threads: CPU threads; 0 takes all cores.

    Raises:
        RequestError: the file is no affinity (see `OnnxModel`), or its features are not known here.
    """

    def __init__(self, path: str | Path, threads: int = 0) -> None:
        self.model = OnnxModel(path, "affinity", threads)
        self.card: ModelCard = self.model.card
        settings = self.card.settings
        self.features: FeatureSet = settings.get("features", "")
        if FEATURE_SETS.get(self.features) != self.card.class_names:
            raise RequestError(
                f"{path}: expected the features of {', '.join(FEATURE_SETS)}, got {', '.join(self.card.class_names)}; "
                "update tsuiseki or fit the affinity again"
            )
        try:
            self.window = int(settings["window"])
            self.observation = ObservationCost(*(float(settings[name]) for name in ("alpha", "beta", "b")))
        except (KeyError, TypeError, ValueError) as error:
            raise RequestError(
                f"{path}: expected numbers window, alpha, beta and b in the metadata, got {error!r}; "
                "fit the affinity again"
            ) from error
        rows = np.random.default_rng(0).random((TRIED, len(self.card.class_names)), np.float32)
        self._most = most_at_once(self.model.try_out, [rows], ROWS_A_CALL, self.model.path, "pairs")

    @property
    def acting(self) -> bool:
        """Whether it compares actions."""
        return "action" in FEATURE_SETS[self.features]

    def probability(self, pairs: PairFeatures) -> FloatArray:
        """``(P,)`` probability that the two detections of each pair show the same person."""
        rows = feature_rows(pairs, self.features)
        order = _alike_together(rows)
        rows, probability = rows[order], np.empty(len(rows))
        # In blocks: the trees' own buffers grow with the rows of a call.
        for start in range(0, len(rows), self._most):
            piece = slice(start, start + self._most)
            probability[order[piece]] = self.model.run(rows[piece])[0]
        return probability

    def __call__(self, pairs: PairFeatures) -> FloatArray:
        """``(P,)`` costs, above 0."""
        return transition_cost(self.probability(pairs))


def _alike_together(rows: NDArray[np.float32]) -> IntArray:
    """``(P,)`` an order in which alike rows follow each other, by the first two features and the last.

    Rows that take the same branches of the trees one after the other are decided up to twice as fast; sorting 16-bit
    keys costs next to nothing.
    """
    levels = np.nan_to_num(rows[:, [0, 1, -1]]).clip(0, 1) * np.array([15, 63, 63], dtype=np.float32)
    iou, appearance, last = levels.astype(np.uint16).T
    return np.argsort(iou << 12 | appearance << 6 | last, kind="stable")


# Largest change of a cost that a network makes, nats.
LARGEST = 8.0


@dataclass(frozen=True)
class FeatureNames:
    """What the columns of the three inputs are."""

    links: tuple[str, ...] = LINK_FEATURES
    detections: tuple[str, ...] = DETECTION_FEATURES
    joins: tuple[str, ...] = JOIN_FEATURES


class CostNetwork:
    """An exported association network, which changes the costs of the flow by features (`evidence`).

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
        self._columns = {part: self._places(part, computed) for part, computed in asdict(FeatureNames()).items()}
        rng = np.random.default_rng(0)
        rows = [rng.random((TRIED, len(columns)), np.float32) for columns in self._columns.values()]
        self._together = most_at_once(self.model.try_out, rows, TRIED, self.path, "rows") > 1

    def _places(self, part: str, computed: tuple[str, ...]) -> list[int]:
        """Which of the columns known here the file wants, in its order."""
        inputs = tuple(self.card.settings.get(part, ()))
        foreign = sorted(set(inputs) - set(computed))
        if foreign or not inputs:
            raise RequestError(
                f"{self.path}: expected some of the {len(computed)} features of {part} computed here, got "
                f"{', '.join(foreign) or 'none'}; train the network again"
            )
        return [computed.index(name) for name in inputs]

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links with ``(P, 25)`` features."""
        return self._run("links", rows)

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections with ``(N, 15)`` features: of use, of a start, of an end."""
        return self._run("detections", rows)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins with ``(P, 29)`` features."""
        return self._run("joins", rows)

    def _run(self, part: str, features: FloatArray) -> FloatArray:
        """The output of one part for its rows; the others get none."""
        if not self._together and len(features) > 1:
            return np.concatenate([self._run(part, row[None]) for row in features])
        rows = {
            name: features[:, columns] if name == part else np.zeros((0, len(columns)))
            for name, columns in self._columns.items()
        }
        outputs = self.model.run(*(np.ascontiguousarray(values, dtype=np.float32) for values in rows.values()))
        return np.asarray(outputs[[*rows].index(part)], dtype=np.float64)
