"""Pairs of a template and a search picture for the Siamese tracker, generated while it learns.

Each epoch has things and textures of its own, so the classes never end; nothing is kept on the disk. Freely usable
pictures may be among them: cut-outs in ``things/``, photographs in ``views/`` and ``surfaces/``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from tsuiseki.datamodules.network_data import NetworkData, check_positive
from tsuiseki.datamodules.scenes.pairs.looks import Silhouette, Wardrobe, read_things, read_views
from tsuiseki.datamodules.scenes.pairs.pair import TargetPair, draw_pair
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import ImageArray

# Side of the template, pixels.
TEMPLATE_SIDE = 127
# Pixels from one cell of the network's maps to the next.
_CELL = 16
# Second part of the seed of the pairs that are validated on: epochs count from 0.
_VALIDATION = 10**6


class TrackerBatch(NamedTuple):
    """``(B, 127, 127, 3)`` and ``(B, S, S, 3)`` uint8 RGB; ``(B, 4)`` boxes in the latter, pixels; ``(B,)`` bool."""

    template: Tensor
    search: Tensor
    boxes: Tensor
    present: Tensor


class GeneratedPairs(Dataset[TargetPair]):
    """Pairs out of one wardrobe an epoch; the same seed and index give the same pair.

    Args:
        count: how many.
        search_side: of the search pictures, pixels.
        seed: asked anew for every pair: it is that of the epoch.
        things: of every wardrobe, see `Wardrobe`.
        views: likewise.
    """

    def __init__(
        self,
        count: int,
        search_side: int,
        seed: Callable[[], tuple[int, ...]],
        things: Sequence[Silhouette] = (),
        views: Sequence[ImageArray] = (),
    ) -> None:
        self.count, self.search_side, self.seed, self.things, self.views = count, search_side, seed, things, views
        self._of: tuple[int, ...] = ()
        self._wardrobe: Wardrobe | None = None

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> TargetPair:
        if not 0 <= index < self.count:
            raise IndexError(index)
        seed = self.seed()
        if self._wardrobe is None or seed != self._of:
            self._wardrobe, self._of = Wardrobe(seed, self.things, self.views), seed
        return draw_pair(np.random.default_rng((*seed, index)), self._wardrobe, TEMPLATE_SIDE, self.search_side)


def collate(pairs: list[TargetPair]) -> TrackerBatch:
    """The pairs stacked."""
    template, search, boxes, present = zip(*pairs, strict=True)
    templates, searches, corners = (torch.from_numpy(np.stack(arrays)) for arrays in (template, search, boxes))
    return TrackerBatch(templates, searches, corners, torch.tensor(present))


class TrackerData(NetworkData):
    """Generated pairs, other ones in each epoch.

    Args:
        photographs: folder of freely usable pictures in ``things/``, ``views/`` and ``surfaces/``; by default all is
            made up.
        batch_size: pairs of a step.
        batches: steps of an epoch, over all devices.
        validation: pairs to validate on, always the same.
        search_side: of the search pictures, pixels, 16 k - 1; smaller ones are learnt from faster.
        workers: processes that prepare batches; 0 does it in the training process.
        seed: of everything drawn.

    Raises:
        RequestError: a count below 1, another side, or a folder without a picture.
    """

    kind = "tracker"

    def __init__(
        self,
        photographs: str | Path | None = None,
        batch_size: int = 32,
        batches: int = 100,
        validation: int = 256,
        search_side: int = 255,
        workers: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        check_positive(batch_size=batch_size, batches=batches, validation=validation)
        if search_side < TEMPLATE_SIDE or (search_side + 1) % _CELL:
            raise RequestError(
                f"`search_side`: expected 16 k - 1 pixels from {TEMPLATE_SIDE} on, such as 255, got {search_side}"
            )
        self.search_side = search_side
        self.photographs = None if photographs is None else Photographs(photographs)
        self.batch_size, self.batches, self.validation = batch_size, batches, validation
        self.workers, self.seed = workers, seed
        self.things: list[Silhouette] = []
        self.views: list[ImageArray] = []

    def setup(self, stage: str) -> None:
        """Read the pictures."""
        del stage
        if self.photographs is not None and not self.things + self.views:
            self.things, self.views = read_things(self.photographs), read_views(self.photographs)

    def train_dataloader(self) -> DataLoader[TargetPair]:
        """Batches of one epoch."""
        return self._loader(self.batches * self.batch_size, self.epoch_seed)

    def val_dataloader(self) -> DataLoader[TargetPair]:
        """The pairs that are validated on."""
        return self._loader(self.validation, lambda: (self.seed, _VALIDATION))

    def test_dataloader(self) -> DataLoader[TargetPair]:
        return self.val_dataloader()

    def predict_dataloader(self) -> DataLoader[TargetPair]:
        return self.val_dataloader()

    def _loader(self, count: int, seed: Callable[[], tuple[int, ...]]) -> DataLoader[TargetPair]:
        pairs = GeneratedPairs(count, self.search_side, seed, self.things, self.views)
        return DataLoader(pairs, batch_size=self.batch_size, num_workers=self.workers, collate_fn=collate)
