"""Batches of P identities with K views each, for learning appearance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import lightning
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from tsuiseki.datamodules.crop_augmentation import CropAugmentation, augment_crop, draw_camera
from tsuiseki.datamodules.identity_crops import (
    IdentityCrops,
    crops_from_folder,
    join_crops,
    put_on_ground,
    read_crops,
    render_people,
    write_crops,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import ImageArray

Sample: TypeAlias = tuple[ImageArray, int, int, bool]


class Draw(NamedTuple):
    """One view of a batch and the seed of everything that happens to it."""

    view: int
    seed: tuple[int, ...]
    place: int


class AppearanceBatch(NamedTuple):
    """Crops ``(B, H, W, 3)`` uint8 RGB, with ``(B,)`` identities, frame numbers and whether each is a query."""

    images: Tensor
    ids: Tensor
    frames: Tensor
    query: Tensor


class IdentityBatches(Sampler[list[Draw]]):
    """Batches of P identities with K views each, different in every epoch and on every device.

    Args:
        crops: the views to draw from.
        identities: P; at most as many as there are.
        views: K; identities with fewer views repeat some.
        batches: of an epoch.
        rendered_share: share of the identities of a batch that are rendered, where both kinds are there; in [0, 1].
        seed: of epoch and device, asked anew at the start of every epoch.
    """

    def __init__(
        self,
        crops: IdentityCrops,
        identities: int,
        views: int,
        batches: int,
        rendered_share: float,
        seed: Callable[[], tuple[int, ...]],
    ) -> None:
        order = np.argsort(crops.ids, kind="stable")
        names, starts = np.unique(crops.ids[order], return_index=True)
        self.views_of = np.split(order, starts[1:])
        self.identities, self.views, self.batches, self.seed = min(identities, len(names)), views, batches, seed
        if self.identities < 2 or views < 2:
            raise RequestError(f"expected at least 2 identities with 2 views each, got {self.identities} and {views}")
        from_video = crops.from_video[order][starts]
        self.chances = _chances(from_video, rendered_share)

    def __len__(self) -> int:
        return self.batches

    def __iter__(self) -> Iterator[list[Draw]]:
        seed = self.seed()
        for batch in range(self.batches):
            rng = np.random.default_rng([*seed, batch])
            chosen = rng.choice(len(self.views_of), self.identities, replace=False, p=self.chances)
            views = np.concatenate([_choose(rng, self.views_of[i], self.views) for i in chosen])
            yield [Draw(int(view), (*seed, batch), place) for place, view in enumerate(views)]


def _chances(from_video: NDArray[np.bool_], rendered_share: float) -> NDArray[np.float64]:
    """Chance of every identity to be drawn; all equal where only one kind is there."""
    video, rendered = int(from_video.sum()), int((~from_video).sum())
    if video == 0 or rendered == 0:
        return np.full(len(from_video), 1 / len(from_video))
    # A share of exactly 1 would leave too few identities with a chance.
    share = float(np.clip(rendered_share, 0.01, 0.99))
    return np.where(from_video, (1 - share) / video, share / rendered)


def _choose(rng: np.random.Generator, views: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    return rng.choice(views, count, replace=len(views) < count)


class TrainingCrops(Dataset[Sample]):
    """Augmented views, each fully decided by its `Draw`."""

    def __init__(self, crops: IdentityCrops, augmentation: CropAugmentation, size: tuple[int, int]) -> None:
        self.crops, self.augmentation, self.size = crops, augmentation, size

    def __len__(self) -> int:
        return len(self.crops)

    def __getitem__(self, draw: Draw) -> Sample:
        camera = draw_camera(np.random.default_rng([*draw.seed, 0]), self.augmentation, self.size[0])
        rng = np.random.default_rng([*draw.seed, 1, draw.place])
        cover = self.crops.images[int(rng.integers(len(self.crops)))]
        image, box = self.crops.images[draw.view], self.crops.boxes[draw.view]
        crop = augment_crop(rng, self.augmentation, camera, image, box, cover, self.size)
        return crop, int(self.crops.ids[draw.view]), int(self.crops.frames[draw.view]), False


class ValidationCrops(Dataset[Sample]):
    """Views as the tracker will see them, every fourth of a person a query against the others."""

    def __init__(self, crops: IdentityCrops, size: tuple[int, int]) -> None:
        self.crops, self.size = crops, size
        self.query = np.zeros(len(crops), dtype=np.bool_)
        for identity in np.unique(crops.ids):
            self.query[np.flatnonzero(crops.ids == identity)[::4]] = True

    def __len__(self) -> int:
        return len(self.crops)

    def __getitem__(self, index: int) -> Sample:
        image, box = self.crops.images[index], self.crops.boxes[index]
        if image.shape[2] == 4:
            image, box = put_on_ground(np.random.default_rng(index), image, None)
        crop = crop_boxes(image, box[None], *self.size)[0]
        return crop, int(self.crops.ids[index]), int(self.crops.frames[index]), bool(self.query[index])


def collate(samples: list[Sample]) -> AppearanceBatch:
    """A batch of samples."""
    crops, ids, frames, query = zip(*samples, strict=True)
    images = torch.from_numpy(np.stack(crops))
    return AppearanceBatch(images, torch.tensor(ids), torch.tensor(frames), torch.tensor(query))


@dataclass(frozen=True)
class RenderedPeople:
    """People of the generator to learn from.

    Attributes:
        file: that keeps them; they are rendered where it is missing. Null renders none.
        identities: number of people.
        views: of each.
        validation: identities of them kept for validation.
        share: of rendered identities in a batch, where there are others too; in [0, 1].
    """

    file: Path | None = Path("out/cache/identities.npz")
    identities: int = 1500
    views: int = 12
    validation: int = 100
    share: float = 0.5


RENDERED, AUGMENTATION = RenderedPeople(), CropAugmentation()


class AppearanceData(lightning.LightningDataModule):
    """Identity crops from labelled video, from the generator, or from both.

    Args:
        train_folders: MOTChallenge sequences, or folders of them.
        train_frames: first and last frame of them, 1-based and both included; null for all.
        validation_folders: likewise for validation; none validates on rendered people that training never sees.
        validation_frames: likewise.
        least_visible: smallest visible share of a labelled box, in [0, 1].
        rendered: people of the generator among them.
        height: of the network's input, pixels.
        width: of the network's input, pixels.
        identities: P, people of a batch.
        views: K, views of each.
        batches: of an epoch.
        augmentation: changes of the training crops.
        workers: processes that prepare batches; 0 does it in the training process.
        seed: of everything drawn.
    """

    def __init__(
        self,
        train_folders: list[Path] | None = None,
        train_frames: tuple[int, int] | None = None,
        validation_folders: list[Path] | None = None,
        validation_frames: tuple[int, int] | None = None,
        least_visible: float = 0.3,
        rendered: RenderedPeople = RENDERED,
        height: int = 128,
        width: int = 64,
        identities: int = 16,
        views: int = 4,
        batches: int = 100,
        augmentation: CropAugmentation = AUGMENTATION,
        workers: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.train_folders, self.train_frames = train_folders or [], train_frames
        self.validation_folders, self.validation_frames = validation_folders or [], validation_frames
        self.least_visible = least_visible
        self.rendered = rendered
        self.size = (height, width)
        self.identities, self.views, self.batches = identities, views, batches
        self.augmentation = augmentation
        self.workers, self.seed = workers, seed
        if rendered.file is None and not self.train_folders:
            raise RequestError("nothing to learn from: give train_folders, a file for rendered people, or both")
        if rendered.file is None and not self.validation_folders:
            raise RequestError("nothing to validate on: give validation_folders and validation_frames")

    def prepare_data(self) -> None:
        """Render the people once, where the file is missing."""
        file = self.rendered.file
        if file is not None and not file.exists():
            write_crops(file, render_people(self.seed, self.rendered.identities, self.rendered.views))

    def setup(self, stage: str) -> None:
        """Load the crops that ``stage`` needs."""
        rendered = None if self.rendered.file is None else read_crops(self.rendered.file)
        held_out = None if rendered is None else rendered.ids < self.rendered.validation
        if stage == "fit":
            parts = [self._cut(folder, self.train_frames) for folder in self.train_folders]
            if rendered is not None and held_out is not None:
                parts.append(rendered.select(~held_out))
            self.train_crops = join_crops(parts)
        parts = [self._cut(folder, self.validation_frames) for folder in self.validation_folders]
        if not parts and rendered is not None and held_out is not None:
            parts = [rendered.select(held_out)]
        self.validation_crops = join_crops(parts)

    def _cut(self, folder: Path, frames: tuple[int, int] | None) -> IdentityCrops:
        return crops_from_folder(folder, frames, self.least_visible)

    def _epoch_seed(self) -> tuple[int, ...]:
        trainer = self.trainer
        return (self.seed, trainer.current_epoch, trainer.global_rank) if trainer else (self.seed,)

    def train_dataloader(self) -> DataLoader[Sample]:
        """P x K batches."""
        sampler = IdentityBatches(
            self.train_crops, self.identities, self.views, self.batches, self.rendered.share, self._epoch_seed
        )
        return DataLoader(
            TrainingCrops(self.train_crops, self.augmentation, self.size),
            batch_sampler=sampler,
            num_workers=self.workers,
            collate_fn=collate,
            persistent_workers=self.workers > 0,
        )

    def val_dataloader(self) -> DataLoader[Sample]:
        """Every validation crop once."""
        return DataLoader(ValidationCrops(self.validation_crops, self.size), batch_size=64, collate_fn=collate)

    def test_dataloader(self) -> DataLoader[Sample]:
        """The same."""
        return self.val_dataloader()
