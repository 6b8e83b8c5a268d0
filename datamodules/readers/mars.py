"""MARS as crops to learn appearance from."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mars import MarsCrop, read_mars

# Crops taken of a tracklet: neighbouring frames look almost the same, and all half a million fit into no memory.
PER_TRACKLET = 8


def training_crops(folder: str | Path, per_tracklet: int = PER_TRACKLET) -> list[MarsCrop]:
    """Up to ``per_tracklet`` crops of every tracklet, spread over it, without distractors and junk.

    Raises:
        RequestError: fewer than two people are left, or see `read_mars`.
    """
    chosen: list[MarsCrop] = []
    people = [crop for crop in read_mars(folder) if crop.person > 0]
    for _, group in itertools.groupby(people, key=lambda crop: (crop.person, crop.camera, crop.tracklet)):
        tracklet = list(group)
        count = min(per_tracklet, len(tracklet))
        chosen += [tracklet[i] for i in np.unique(np.linspace(0, len(tracklet) - 1, count).round().astype(int))]
    if len({crop.person for crop in chosen}) < 2:
        raise RequestError(f"{folder}: expected crops of at least two people, to tell them apart")
    return chosen
