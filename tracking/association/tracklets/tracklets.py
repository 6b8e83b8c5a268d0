"""Tracklets: the chains of detections that the flow decides, as they grow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from tsuiseki.tracking.association.flow.network_flow import FlowSolution, track_labels
from tsuiseki.tracking.types import FloatArray, IntArray


@dataclass(frozen=True)
class Chained:
    """Detections of chains and what follows each.

    Attributes:
        numbers: ``(K,)`` increasing, counted over the whole video.
        follower: ``(K,)`` number of the next detection of the chain, -1 where there is none.
        features: ``(K, D)`` of unit length, NaN where not known; None where nothing was described.
    """

    numbers: IntArray
    follower: IntArray
    features: FloatArray | None

    def __len__(self) -> int:
        return len(self.numbers)


class Tracklets:
    """The tracklets as decisions of the flow come in, numbered from 0 on, and their mean appearance."""

    def __init__(self) -> None:
        self._labels = np.empty(0, dtype=np.int64)
        self._count = 0
        self._sums = np.empty((0, 0))

    def copy(self) -> Tracklets:
        """A copy that can grow by itself."""
        other = Tracklets()
        other._labels, other._count, other._sums = self._labels.copy(), self._count, self._sums.copy()
        return other

    def add(self, chained: Chained) -> None:
        """Take further detections: those that no earlier one has named as its follower start tracklets."""
        numbers, follower = chained.numbers, chained.follower
        if len(numbers) == 0:
            return
        self._grow(int(max(numbers[-1], follower.max())) + 1)
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
        if chained.features is not None:
            self._add_features(self._labels[numbers], chained.features)

    def labels(self, count: int) -> IntArray:
        """``(count,)`` tracklet of each detection, -1 for one that belongs to none."""
        self._grow(count)
        return self._labels

    def appearance(self) -> FloatArray | None:
        """``(M, D)`` unit-length mean features of the tracklets, NaN where not known; None if nothing was described."""
        if self._sums.shape[1] == 0:
            return None
        missing = self._count - len(self._sums)
        sums = np.concatenate([self._sums, np.zeros((missing, self._sums.shape[1]))])
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.asarray(np.divide(sums, length, out=np.full_like(sums, np.nan), where=length > 0))

    def _grow(self, count: int) -> None:
        more = count - len(self._labels)
        if more > 0:
            self._labels = np.append(self._labels, np.full(more, -1))

    def _add_features(self, labels: IntArray, features: FloatArray) -> None:
        known = ~np.isnan(features).any(axis=1)
        labels, features = labels[known], features[known]
        sums = np.zeros((self._count, features.shape[1]))
        sums[: len(self._sums), : self._sums.shape[1]] = self._sums
        member = scipy.sparse.csr_array(
            (np.ones(len(labels)), (labels, np.arange(len(labels)))), shape=(self._count, len(labels))
        )
        self._sums = sums + member @ features
