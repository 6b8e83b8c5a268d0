"""A witness of the target's look: a linear classifier of the target against what surrounds it, learnt from the clip.

A correlation filter that slides onto the background learns it and stays sure of itself. The witness learns only where
it is sure itself, and from the others' looks, too: windows around the target, above all those that it takes for the
target. So it does not slide along. It is a ridge regression from gradients and mean colours of a window's cells to 1 on
the target and -1 around it; both classes weigh alike. It is heard once it has known the target in later frames, and
says that the target is lost after several unlike looks in a row.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.tracking.features.hog import CHANNELS, hog
from tsuiseki.tracking.filters.kernelised_correlation import Float32Array
from tsuiseki.tracking.single.regularised import CELL, Model, RegularisedTarget
from tsuiseki.tracking.types import ImageArray, IntArray

EVERY = 3
"""Frames between two looks."""
COLOUR_WEIGHT = 2.0
"""Of the mean colours beside the gradients."""
RIDGE = 0.002
"""Of the regression; windows have length one and the weights of all of them sum to one."""
TARGETS, AROUND, CHOSEN = 20, 10, 8
"""Looks of which the target, and the surroundings, are remembered beside the first; windows of the surroundings that a
look adds, of the likest and of others alike."""
OVERLAP = 0.25
"""IoU with the target up to which a window is of the surroundings."""
KNOWN, ALIKE, UNLIKE = 0.0, 0.1, -0.3
"""Answers, 1 on the target and -1 around it: above the first the look is learnt; above the second it is the target,
there or elsewhere; below the third it looks like something else."""
HEARD, LOOKS = 3, 3
"""Learnt looks from which on the witness is heard; unlike looks in a row from which on the target is lost."""


@dataclass(frozen=True)
class Regression:
    """``features @ weights + offset``."""

    weights: Float32Array
    offset: float

    @classmethod
    def learn(cls, on: Float32Array, around: Float32Array) -> Regression:
        """From rows ``(P, D)`` of the target and ``(N, D)`` of the surroundings; solved in their P + N dimensions."""
        rows = np.concatenate([on, around])
        wanted = np.repeat([1.0, -1.0], [len(on), len(around)])
        shares = np.where(wanted > 0, 0.5 / len(on), 0.5 / len(around))  # the weighted mean of `wanted` is zero
        mean = shares.astype(np.float32) @ rows
        centred = rows - mean
        gram = (centred @ centred.T).astype(np.float64)
        gram[np.diag_indices(len(rows))] += RIDGE / shares
        weights = np.linalg.solve(gram, wanted).astype(np.float32) @ centred
        return cls(weights, -float(mean @ weights))

    def __call__(self, rows: Float32Array) -> Float32Array:
        """``(N,)`` answers."""
        return np.asarray(rows @ self.weights + np.float32(self.offset))


class Witness:
    """What is known of the target's look and of its surroundings'.

    Args:
        model: of the target.
        image: the first frame ``(H, W, 3)``.
        target: the target in it.
        seed: of the choice of surroundings.

    Attributes:
        lost: whether the box no longer shows the target.
    """

    def __init__(self, model: Model, image: ImageArray, target: RegularisedTarget, seed: int = 0) -> None:
        self._model, self._rng = model, np.random.default_rng(seed)
        rows, columns = model.shape
        wide, high = (max(round(float(side) / (CELL * model.scale)), 2) for side in model.target)
        self._sides = min(high, rows), min(wide, columns)
        middle: IntArray = np.subtract(model.shape, self._sides)
        corners = np.stack(np.meshgrid(*(np.arange(n + 1) for n in middle), indexing="ij"), -1).reshape(-1, 2)
        off = np.abs(corners - middle // 2)
        shared = np.clip(np.array(self._sides) - off, 0, None).prod(axis=1)
        apart = shared <= OVERLAP / (1 + OVERLAP) * 2 * np.prod(self._sides)
        self._near = corners[(off <= 1).all(axis=1)]
        self._far = corners[apart & (off % 2 == 0).all(axis=1)]
        self._targets: deque[Float32Array] = deque(maxlen=TARGETS)
        self._around: deque[Float32Array] = deque(maxlen=AROUND)
        self.lost, self._unlike, self._learnt = False, 0, 0
        if len(self._far):
            grid = self._grid(image, target)
            self._first = self._rows(grid, middle[None] // 2), self._rows(grid, self._far)
            self._regression = Regression.learn(*self._first)

    @property
    def heard(self) -> bool:
        """Whether it has known the target in enough frames."""
        return self._learnt >= HEARD

    def answer(self, image: ImageArray, target: RegularisedTarget) -> float:
        """About 1 where the box shows the target, about -1 where it shows what was around it; 0 where it cannot say."""
        if not len(self._far):
            return 0.0
        return float(self._regression(self._rows(self._grid(image, target), self._near)).max())

    def look(self, image: ImageArray, target: RegularisedTarget, sure: bool) -> None:
        """Take what the box of a frame shows, and learn it where the tracker is ``sure`` and the witness is, too."""
        if not len(self._far):
            return
        grid = self._grid(image, target)
        near = self._rows(grid, self._near)
        answers = self._regression(near)
        answer = float(answers.max())
        self._unlike = self._unlike + 1 if answer < UNLIKE else 0
        self.lost = self.heard and answer <= ALIKE and (self.lost or self._unlike >= LOOKS)
        if answer <= KNOWN:
            return
        self._learnt += 1
        if not sure:
            return
        far = self._rows(grid, self._far)
        likest = np.argsort(-self._regression(far))[:CHOSEN]
        others = self._rng.choice(len(far), min(CHOSEN, len(far)), replace=False)
        self._targets.append(near[int(np.argmax(answers))][None])
        self._around.append(far[np.concatenate([likest, others])])
        on, around = self._first
        self._regression = Regression.learn(
            np.concatenate([on, *self._targets]), np.concatenate([around, *self._around])
        )

    def moved(self) -> None:
        """The box is elsewhere now: it counts as the target until it looks otherwise."""
        self.lost, self._unlike = False, 0

    def _grid(self, image: ImageArray, target: RegularisedTarget) -> Float32Array:
        """``(CHANNELS + 3, rows, columns)`` gradients and mean colours of the cells of the window about the target."""
        patch = self._model.patch(image, target.centre, target.size)
        lab = cv2.cvtColor(np.ascontiguousarray(patch[CELL:-CELL, CELL:-CELL]), cv2.COLOR_RGB2LAB)
        means = cv2.resize(lab, self._model.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32) / 255 - 0.5
        grid = np.empty((CHANNELS + 3, *self._model.shape), dtype=np.float32)
        grid[:CHANNELS] = hog(patch[None], CELL)[0]
        grid[CHANNELS:] = COLOUR_WEIGHT * means.transpose(2, 0, 1)
        return grid

    def _rows(self, grid: Float32Array, corners: IntArray) -> Float32Array:
        """``(N, D)`` features of length one of windows of the target's sides, from their first cells ``(N, 2)``."""
        windows = np.lib.stride_tricks.sliding_window_view(grid, self._sides, axis=(1, 2))
        rows = windows[:, corners[:, 0], corners[:, 1]].transpose(1, 0, 2, 3).reshape(len(corners), -1)
        return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-6))
