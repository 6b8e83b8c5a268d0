"""The trial of a network before the first frame: it ends, and gives for several at once what it gives for each."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

# Rows that are run at once and one at a time.
TRIED = 2
# Largest difference of the two, as a share of the largest value: half precision stays far below it.
TOLERANCE = 0.02
# Largest distance of the sides of two boxes that are the same, as a share of the side of the picture.
BOX_TOLERANCE = 0.05
# Largest difference of their scores, as a share of the best one.
SCORE_TOLERANCE = 0.1
# Best boxes of a picture that are compared.
COMPARED = 10
# Difference that is always rounding.
LEAST = 1e-6


def most_at_once(
    run: Callable[..., Sequence[NDArray[Any]]], inputs: Sequence[NDArray[Any]], most: int, path: Path, noun: str
) -> int:
    """How many rows a call of a network may have: ``most``, or 1, which is said, where two at once come out otherwise.

    Args:
        run: gives outputs with a row for each row of the inputs.
        inputs: of the network, `TRIED` rows each, which differ.
        most: rows of a call that the file admits; with 1 the network is only run.
        path: of the file, for messages.
        noun: what a row is, in the plural, for messages.

    Raises:
        RequestError: it does not run for one row.
    """
    if most == 1:
        run(*(values[:1] for values in inputs))
        return 1
    apart = [run(*(values[n : n + 1] for values in inputs)) for n in range(TRIED)]
    try:
        together = run(*inputs)
    except RequestError:  # a batch of one is baked into the file
        together = []
    singles = [np.concatenate(rows) for rows in zip(*apart, strict=True)]
    if together and all(map(_near, together, singles)):
        return most
    say_one_at_a_time(path, noun)
    return 1


def _near(values: NDArray[Any], expected: NDArray[Any]) -> bool:
    """Whether two arrays are the same row by row, but for rounding."""
    if values.shape != expected.shape:
        return False
    rows, expected_rows = (np.nan_to_num(x.astype(np.float64)).reshape(len(x), -1) for x in (values, expected))
    largest = np.abs(expected_rows).max(axis=1, initial=0.0)
    return bool((np.abs(rows - expected_rows).max(axis=1, initial=0.0) <= TOLERANCE * largest + LEAST).all())


def same_detections(
    boxes: FloatArray, scores: FloatArray, others: FloatArray, other_scores: FloatArray, side: float
) -> bool | None:
    """Whether two sets of boxes are the same people: those that score best have the like of them in the other set.

    None where nothing scores in either.

    Networks that choose their best queries may give them in another order, and others of the poor ones.

    Args:
        boxes: ``(N, 4)`` or more columns, pixels.
        scores: ``(N,)``.
        others: ``(M, 4)`` likewise.
        other_scores: ``(M,)``.
        side: of the picture, pixels.
    """
    best = max(scores.max(initial=0.0), other_scores.max(initial=0.0))
    if best <= LEAST:
        return None
    pairs = ((boxes, scores, others, other_scores), (others, other_scores, boxes, scores))
    for mine, my_scores, theirs, their_scores in pairs:
        for row in np.argsort(-my_scores, kind="stable")[:COMPARED]:
            if my_scores[row] < best / 2:
                break
            close = np.abs(theirs - mine[row]).max(axis=1, initial=0.0) <= BOX_TOLERANCE * side
            if not (close & (np.abs(their_scores - my_scores[row]) <= SCORE_TOLERANCE * best)).any():
                return False
    return True


def say_one_at_a_time(path: Path, noun: str) -> None:
    """Warn that a file cannot be trusted with several at once."""
    warnings.warn(
        f"{path}: gives for two {noun} at once something else than for one at a time, so it gets one at a time; "
        "export it with a batch of any size",
        InputWarning,
        stacklevel=2,
    )


def noise(height: int, width: int, channels: int = 3) -> ImageArray:
    """``(TRIED, height, width, channels)`` uint8 pictures of noise, the second darker, and by channel."""
    levels = np.random.default_rng(0).integers(0, 256, (TRIED, height, width, channels), dtype=np.uint8)
    levels[1] >>= np.arange(1, channels + 1, dtype=np.uint8)
    return levels
