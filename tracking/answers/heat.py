"""Where those who are followed spend their time, in cells of the picture, and their paths as rows."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.answers.counting import Answers, Table
from tsuiseki.tracking.types import FloatArray

COLUMNS = 48
"""Cells across the picture; they are square."""
SAMPLES = 10
"""Rows of a path in a second."""


def seconds_in_cells(answers: Answers, pixels: FloatArray) -> FloatArray:
    """``(R, C)`` seconds that all together spent in each cell of the picture, row 0 at the top.

    Args:
        answers: with the paths.
        pixels: ``(N, 2)`` of their rows.
    """
    wide, high = answers.size.tolist()
    rows = max(1, round(COLUMNS * high / wide))
    edges = np.linspace(0, high, rows + 1), np.linspace(0, wide, COLUMNS + 1)
    return np.histogram2d(pixels[:, 1], pixels[:, 0], bins=edges)[0] / answers.frame_rate


def square_metres(answers: Answers, shape: tuple[int, int]) -> FloatArray | None:
    """``(R, C)`` floor in each cell, NaN where it shows none; None where metres are not known."""
    if not answers.scene.has_metres:
        return None
    x, y = (np.linspace(0, most, count + 1) for most, count in zip(answers.size, shape[::-1], strict=True))
    corners = answers.scene.metres(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x), 2)
    down, across = corners[1:, 1:] - corners[:-1, :-1], corners[:-1, 1:] - corners[1:, :-1]
    found = 0.5 * np.abs(down[..., 0] * across[..., 1] - down[..., 1] * across[..., 0])
    return np.where(found > 0, found, np.nan)


def heat_values(answers: Answers, pixels: FloatArray) -> tuple[FloatArray, str]:
    """``(R, C)`` seconds, a square metre where metres are known; and what they are."""
    seconds = seconds_in_cells(answers, pixels)
    metres = square_metres(answers, seconds.shape)
    return (seconds, "s in a cell") if metres is None else (seconds / metres, "s a square metre")


def heat_table(answers: Answers, pixels: FloatArray) -> Table:
    """The cells in which somebody was: the middle of each in pixels, and seconds."""
    seconds = seconds_in_cells(answers, pixels)
    metres = square_metres(answers, seconds.shape)
    rows, columns = np.nonzero(seconds)
    side = answers.size / seconds.shape[::-1]
    table = {
        "x": ((columns + 0.5) * side[0]).round(1).tolist(),
        "y": ((rows + 0.5) * side[1]).round(1).tolist(),
        "seconds": seconds[rows, columns].round(3).tolist(),
    }
    if metres is not None:
        table["seconds_per_square_metre"] = (seconds / metres)[rows, columns].round(4).tolist()
    return table


def path_table(answers: Answers, pixels: FloatArray) -> Table:
    """Where each was, up to `SAMPLES` times a second: pixels, and metres where they are known."""
    paths, rate = answers.paths, answers.frame_rate
    kept = paths.frames % max(1, round(rate / SAMPLES)) == 0
    columns = {"time": paths.frames / rate, "id": paths.ids, "x": pixels[:, 0], "y": pixels[:, 1]}
    if paths.metres is not None:
        columns |= {"x_metres": paths.metres[:, 0], "y_metres": paths.metres[:, 1]}
    return {name: column[kept].round(3).tolist() for name, column in columns.items()}
