"""The pieces of tracks that the flow decides, as they grow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from tsuiseki.tracking.association.network_flow import FlowSolution, track_labels
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Links:
    """Detections of tracks and what follows each.

    Attributes:
        numbers: ``(K,)`` increasing, counted over the whole video.
        follower: ``(K,)`` number of the next detection of the track, -1 where there is none.
        cost: ``(K,)`` of each detection and of the link to its follower.
        features: ``(K, D)`` of unit length, NaN where not known; None where nothing was described.
    """

    numbers: IntArray
    follower: IntArray
    cost: FloatArray
    features: FloatArray | None

    def __len__(self) -> int:
        return len(self.numbers)


class Pieces:
    """The pieces of tracks as decisions of the flow come in, and what is needed of them later.

    Pieces are numbered from 0 on in the order of their first detections. A detection has a cost (its own and that of
    the link to the next) and features, of which only the sum over the piece is kept.
    """

    def __init__(self) -> None:
        self._labels = np.empty(0, dtype=np.int64)
        self._costs = np.empty(0)
        self._count = 0
        self._looks = np.empty((0, 0))

    def copy(self) -> Pieces:
        """A copy that can grow by itself."""
        other = Pieces()
        other._labels, other._costs = self._labels.copy(), self._costs.copy()
        other._count, other._looks = self._count, self._looks.copy()
        return other

    def add(self, links: Links) -> None:
        """Take further detections: those that no earlier one has named as its follower start new pieces."""
        numbers, follower = links.numbers, links.follower
        if len(numbers) == 0:
            return
        self._grow(int(max(numbers[-1], follower.max())) + 1)
        self._costs[numbers] = links.cost
        place = np.searchsorted(numbers, follower).clip(max=len(numbers) - 1)
        within = (follower >= 0) & (numbers[place] == follower)
        chain = track_labels(
            FlowSolution(np.ones(len(numbers), np.bool_), np.where(within, place, -1), np.zeros(len(numbers)), 0.0)
        )
        label = self._labels[numbers[np.unique(chain, return_index=True)[1]]]
        fresh = label < 0
        label[fresh] = self._count + np.arange(fresh.sum())
        self._count += int(fresh.sum())
        self._labels[numbers] = label[chain]
        leaving = (follower >= 0) & ~within
        self._labels[follower[leaving]] = label[chain[leaving]]
        if links.features is not None:
            self._add_looks(self._labels[numbers], links.features)

    def labels(self, count: int) -> IntArray:
        """``(count,)`` piece of each detection, -1 for one that belongs to none."""
        self._grow(count)
        return self._labels

    @property
    def costs(self) -> FloatArray:
        """``(N,)`` costs of the detections."""
        return self._costs

    def looks(self) -> FloatArray | None:
        """``(M, D)`` unit-length mean features of the pieces, NaN where not known; None if nothing was described."""
        if self._looks.shape[1] == 0:
            return None
        missing = self._count - len(self._looks)
        sums = np.concatenate([self._looks, np.zeros((missing, self._looks.shape[1]))])
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.asarray(np.divide(sums, length, out=np.full_like(sums, np.nan), where=length > 0))

    def _grow(self, count: int) -> None:
        more = count - len(self._labels)
        if more > 0:
            self._labels = np.append(self._labels, np.full(more, -1))
            self._costs = np.append(self._costs, np.zeros(more))

    def _add_looks(self, labels: IntArray, features: FloatArray) -> None:
        known = ~np.isnan(features).any(axis=1)
        labels, features = labels[known], features[known]
        sums = np.zeros((self._count, features.shape[1]))
        sums[: len(self._looks), : self._looks.shape[1]] = self._looks
        member = csr_array((np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(self._count, len(labels)))
        self._looks = sums + member @ features
