"""The paper's two sets of clips, section 5: 10 to learn from with 20 fish, 10 others to test on with 24."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import BoolArray, FloatArray

LEARNING_FISH = (1, 2, 3, 2, 1, 2, 3, 2, 2, 2)
TEST_FISH = (2, 3, 2, 3, 2, 2, 3, 2, 3, 2)
# Seeds of clips lie apart by set, so that no clip is in two.
SEEDS_OF_A_SET = 1_000_000
CLIPS_PER_SEED = 100


@dataclass(frozen=True)
class PlannedClip:
    """A clip that is not drawn yet.

    Attributes:
        name: of its folder.
        settings: of its scene.
        seed: of its scene.
    """

    name: str
    settings: GoldfishSettings
    seed: int


@dataclass(frozen=True)
class GoldfishSets:
    """Folders of clips, as ``write_goldfish`` writes them."""

    learning: tuple[Path, ...]
    test: tuple[Path, ...]


def planned_clips(seed: int, settings: GoldfishSettings | None = None) -> tuple[PlannedClip, ...]:
    """``learning-01`` to ``learning-10`` and ``test-01`` to ``test-10``.

    Args:
        seed: from 0; sets of different seeds share no clip.
        settings: of every clip, but for the number of fish.

    Raises:
        RequestError: the seed is negative or above 9,999.
    """
    if not 0 <= seed < SEEDS_OF_A_SET // CLIPS_PER_SEED:
        raise RequestError(f"expected a seed of clips from 0 to {SEEDS_OF_A_SET // CLIPS_PER_SEED - 1}, got {seed}")
    base = settings or GoldfishSettings()
    return tuple(
        PlannedClip(
            f"{name}-{number + 1:02d}",
            replace(base, fish=fish),
            place * SEEDS_OF_A_SET + seed * CLIPS_PER_SEED + number,
        )
        for place, (name, counts) in enumerate((("learning", LEARNING_FISH), ("test", TEST_FISH)), start=1)
        for number, fish in enumerate(counts)
    )


SUDDEN_ANGLE = np.deg2rad(60.0)
WITHIN_FRAMES = 4


def sudden_turns(centres: FloatArray, least_step: float = 3.0) -> BoolArray:
    """Frames ``(T,)`` by which the direction of motion has turned by over 60 degrees within 4 frames.

    The direction in frame ``t`` is that of the step from ``t - 1``. A fish that hangs still or sways has no direction,
    so both steps must be long enough.

    Args:
        centres: ``(T, 2)`` of one body, pixels; further columns are ignored.
        least_step: pixels a frame.
    """
    steps = np.diff(centres[:, :2], axis=0)
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    moving = np.linalg.norm(steps, axis=1) >= least_step
    turned = np.zeros(len(centres), dtype=np.bool_)
    for lag in range(1, min(WITHIN_FRAMES, len(steps) - 1) + 1):
        change = np.abs(np.angle(np.exp(1j * (direction[lag:] - direction[:-lag]))))
        turned[1 + lag :] |= (change > SUDDEN_ANGLE) & moving[lag:] & moving[:-lag]
    return turned


def count_sudden_turns(centres: FloatArray, least_step: float = 3.0) -> int:
    """How many turns :func:`sudden_turns` finds; frames that follow each other are one turn.

    >>> way = np.cumsum([[5.0, 0]] * 9 + [[0, 5.0]] * 9, axis=0)
    >>> count_sudden_turns(way)
    1
    """
    turned = sudden_turns(centres, least_step)
    return int(turned[0]) + int(np.count_nonzero(turned[1:] & ~turned[:-1]))
