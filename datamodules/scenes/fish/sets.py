"""The paper's two sets of clips, section 5: 10 to learn from with 20 fish, 10 others to test on with 24."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.datamodules.scenes.fish.goldfish import GoldfishSettings
from tsuiseki.tracking.errors import RequestError

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
