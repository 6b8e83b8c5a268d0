"""Actions of false boxes where true ones have the labelled actions: those of a person at another time.

So false boxes are told from people neither by what they do nor by how often they begin something else.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.evaluation.action_files import LabelledActions
from tsuiseki.tracking.types import FloatArray, IntArray

PLACES = 64
_SIDE = 160  # pixels of a place


def borrowed(done: FloatArray, rng: np.random.Generator) -> FloatArray:
    """``(T, PLACES, A)`` what false boxes of a place do: as a person of ``done`` ``(T, P, A)`` at another time."""
    length, people = done.shape[:2]
    whom, later = rng.integers(people, size=PLACES), rng.integers(1, length, size=PLACES)
    return np.asarray(done[(np.arange(length)[:, None] + later) % length, whom])


def place_of(boxes: FloatArray) -> IntArray:
    """``(N,)`` the place of boxes ``(N, 4)``, below `PLACES`."""
    corner = (boxes[:, :2] // _SIDE).astype(np.int64)
    return np.asarray((corner[:, 0] + 8 * corner[:, 1]) % PLACES)


def done_by_person(labels: LabelledActions, length: int) -> FloatArray:
    """``(length, P, A)`` what each labelled person does; where they are out of view, what they did last, or will first.

    Args:
        labels: of a clip whose first frame is 0.
        length: of the clip, frames.
    """
    people = []
    for identity in np.unique(labels.truth.ids):
        rows = np.flatnonzero(labels.truth.ids == identity)
        rows = rows[np.argsort(labels.truth.frames[rows], kind="stable")]
        last = np.searchsorted(labels.truth.frames[rows], np.arange(length), side="right") - 1
        people.append(labels.actions[rows[np.maximum(last, 0)]])
    return np.stack(people, axis=1).astype(np.float64)
