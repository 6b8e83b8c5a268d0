"""Levels of more than 8 bits a colour as 8: cameras of 10, 12 or 14 bits write files of 16."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.types import ImageArray

# uint8 or uint16.
Levels: TypeAlias = NDArray[np.unsignedinteger[Any]]
# Bits of a colour in this project.
BYTE = 8
# Bits of a colour that cameras use of 16.
DEPTHS = (BYTE, 10, 12, 14, 16)
# How many pictures of a video tell how many bits it uses.
SAMPLES = 16


def depth_of(pictures: Iterable[Levels], name: str) -> int:
    """How many bits a colour ``pictures`` of the video ``name`` use, which is noted where they are fewer than 16.

    >>> depth_of([np.array([[0, 65535]], np.uint16)], "clip")
    16
    """
    highest = max((int(levels.max(initial=0)) for levels in pictures), default=0)
    depth = next(depth for depth in DEPTHS if highest < 2**depth)
    if depth < DEPTHS[-1]:
        warnings.warn(
            f"{name}: of 16 bits a colour {depth} are in use: its levels are divided by {2 ** (depth - BYTE)}",
            InputWarning,
            stacklevel=2,
        )
    return depth


def eight_bits(levels: Levels, depth: int) -> ImageArray:
    """Levels of 16 bits, of which ``depth`` are in use, as uint8; those of 8 bits stay as they are."""
    if levels.dtype == np.uint8:
        return np.asarray(levels, dtype=np.uint8)
    return np.asarray(np.minimum(levels >> (depth - BYTE), 255), dtype=np.uint8)
