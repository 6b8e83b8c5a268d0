"""The paper's two sets of clips, section 5: 10 to learn from with 20 fish, 10 others to test on with 24."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.datamodules.scenes.goldfish import GoldfishSettings, write_goldfish
from tsuiseki.tracking.errors import RequestError

LEARNING_FISH = (1, 2, 3, 2, 1, 2, 3, 2, 2, 2)
TEST_FISH = (2, 3, 2, 3, 2, 2, 3, 2, 3, 2)
# Seeds of clips lie apart by set, so that no clip is in two.
LEARNING_SEEDS, TEST_SEEDS = 1_000, 2_000
CLIPS_PER_SEED = 100


@dataclass(frozen=True)
class GoldfishSets:
    """Folders of clips, as ``write_goldfish`` writes them."""

    learning: tuple[Path, ...]
    test: tuple[Path, ...]


def write_goldfish_sets(folder: Path, seed: int, settings: GoldfishSettings | None = None) -> GoldfishSets:
    """Writes ``learning-01`` ... and ``test-01`` ... into ``folder``; clips that are there already are kept.

    Args:
        folder: made where it is missing.
        seed: from 0; sets of different seeds share no clip.
        settings: of every clip, but for the number of fish.

    Raises:
        RequestError: the seed is negative or above 999.
    """
    if not 0 <= seed < 1000:
        raise RequestError(f"expected a seed of clips from 0 to 999, got {seed}")
    folder.mkdir(parents=True, exist_ok=True)
    base = settings or GoldfishSettings()
    sets = []
    for name, start, counts in (("learning", LEARNING_SEEDS, LEARNING_FISH), ("test", TEST_SEEDS, TEST_FISH)):
        clips = []
        for number, fish in enumerate(counts):
            clip = folder / f"{name}-{number + 1:02d}"
            if not (clip / "states.csv").is_file():
                write_goldfish(clip, replace(base, fish=fish), start * 1_000_000 + seed * CLIPS_PER_SEED + number, True)
            clips.append(clip)
        sets.append(tuple(clips))
    return GoldfishSets(*sets)
