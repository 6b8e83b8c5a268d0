"""What the properties draw: seeds of random numbers, boxes, tracks, and all ways to match two small sets."""

from __future__ import annotations

import contextlib
import itertools
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from tsuiseki.tracking.types import FloatArray, Track

# Numbers without ties are drawn by a generator of such a seed.
seeds = st.integers(0, 2**32 - 1)


def boxes_of(rng: np.random.Generator, count: int, picture: float = 200.0) -> FloatArray:
    """``(count, 4)`` boxes of 5 to 60 pixels a side that begin in a picture."""
    corner, size = rng.uniform(0, picture, (count, 2)), rng.uniform(5, 60, (count, 2))
    return np.concatenate([corner, corner + size], axis=1)


def tracks_of(rng: np.random.Generator, count: int, length: int = 8, digits: int = 2) -> list[Track]:
    """Tracks with gaps, whose boxes lie in a picture of 320x240 pixels and have so many digits."""
    tracks = []
    for number in (rng.permutation(3 * count)[:count] + 1).tolist():
        frames = np.sort(rng.permutation(length)[: rng.integers(1, length + 1)])
        corner, size = rng.uniform(0, 180, (len(frames), 2)), rng.uniform(2, 55, (len(frames), 2))
        boxes = np.concatenate([corner, corner + size], axis=1).round(digits)
        scores = rng.uniform(0.1, 1, len(frames)).round(3)
        tracks.append(Track(number, frames, boxes, scores))
    return sorted(tracks, key=lambda track: track.id)


def matchings(rows: int, columns: int) -> Iterator[list[tuple[int, int]]]:
    """All ways to match rows to columns one to one, that of no pair first."""
    for count in range(min(rows, columns) + 1):
        for chosen in itertools.combinations(range(rows), count):
            for partners in itertools.permutations(range(columns), count):
                yield list(zip(chosen, partners, strict=True))


@contextlib.contextmanager
def new_folder() -> Iterator[Path]:
    """An empty folder of one example."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)
