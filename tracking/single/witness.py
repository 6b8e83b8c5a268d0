"""A witness: a linear classifier of the target against its surroundings, learnt from the clip.

A correlation filter that slides onto the background learns it and stays confident. The witness learns only where its
own answer is high. It also learns from windows around the target, above all from those that it takes for the target.
So it does not slide along. It is a ridge regression to 1 on the target and -1 around it; both classes weigh alike. Its
features are gradients and mean colours of a window's cells. It counts once it has recognised the target in later
frames. After several low answers in a row the target is lost.
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
"""Frames between two updates."""
COLOUR_WEIGHT = 2.0
"""Weight of the mean colours beside the gradients."""
RIDGE = 0.002
"""Ridge penalty of the regression. Windows have length one and the weights of all of them sum to one."""
TARGETS, AROUND, CHOSEN = 20, 10, 8
"""Updates whose windows of the target, and of its surroundings, are kept beside the first. Windows of the surroundings
that an update adds: so many with the highest answers, and so many others."""
OVERLAP = 0.25
"""Largest IoU of a window of the surroundings with the target."""
KNOWN, ALIKE, UNLIKE = 0.0, 0.1, -0.3
"""Answers, 1 on the target and -1 around it. Above the first the window is learnt. Above the second it shows the
target, there or elsewhere. Below the third it shows something else."""
HEARD, LOW = 3, 3
"""Learnt windows from which on the witness counts; low answers in a row from which on the target is lost."""


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
    """The regression, and the windows of the target and of its surroundings that it learns from.

    Args:
        model: correlation filter of the target, which cuts out windows.
        image: the first frame ``(H, W, 3)``.
        target: the target in it.
        seed: seed of the random choice of surroundings.

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
        """Whether it has recognised the target in enough frames."""
        return self._learnt >= HEARD

    def answer(self, image: ImageArray, target: RegularisedTarget) -> float:
        """About 1 where the box shows the target, about -1 where it shows what was around it; 0 where unknown."""
        if not len(self._far):
            return 0.0
        return float(self._regression(self._rows(self._grid(image, target), self._near)).max())

    def update(self, image: ImageArray, target: RegularisedTarget, sure: bool) -> None:
        """Take the window of a box. Learn it where the tracker is ``sure`` and the answer is above `KNOWN`."""
        if not len(self._far):
            return
        grid = self._grid(image, target)
        near = self._rows(grid, self._near)
        answers = self._regression(near)
        answer = float(answers.max())
        self._unlike = self._unlike + 1 if answer < UNLIKE else 0
        self.lost = self.heard and answer <= ALIKE and (self.lost or self._unlike >= LOW)
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
        """The box is elsewhere now: it counts as the target until the answers are low again."""
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
