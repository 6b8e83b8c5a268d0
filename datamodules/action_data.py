"""Labelled clips as crops of people with the actions that they perform."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import lightning
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from tsuiseki.datamodules.action_crops import (
    ActionCrops,
    ActionSequence,
    CropSettings,
    action_sequences,
    clips_to_cut,
    cut_clip,
    has_crops,
    load_crops,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import NO_MOTION, STREAMS, StreamName
from tsuiseki.tracking.types import ImageArray, IntArray

Changes: TypeAlias = dict[str, NDArray[Any]]


class ActionBatch(NamedTuple):
    """Crops ``(B, K, S, S, C)`` uint8 by stream, K a sample, and ``(B, A)`` float32 which actions are performed."""

    crops: dict[StreamName, Tensor]
    actions: Tensor


@dataclass(frozen=True)
class ActionAugmentation:
    """How training crops are changed (thesis 5.4.2); zeros change nothing but the place of the crop.

    Attributes:
        flip_horizontal: chance of a mirror image, left and right.
        flip_vertical: likewise, top and bottom; a camera that looks straight down sees both.
        colour: scale of the changes of brightness and contrast, drawn for every sample.
    """

    flip_horizontal: float = 0.5
    flip_vertical: float = 0.5
    colour: float = 0.2


CUTTING, AUGMENTATION = CropSettings(), ActionAugmentation()


class ActionBatches(Dataset[ActionBatch]):
    """Batches drawn at random, each fully decided by the epoch and its number.

    Args:
        crops: to draw from.
        streams: that are trained.
        size: side of the network's input, pixels; smaller than the stored crops.
        batch_size: samples of a batch.
        batches: of an epoch.
        augmentation: changes of the crops.
        segments: K, pictures of a sample. With more than one the surroundings of a picture in time are cut into as many
            segments and one picture is drawn from each (Wang et al. 2016, not in the thesis).
        span: frames that the segments of a sample cover together.
        rarity: exponent of the chance of samples by how rare their rarest action is; 0 draws all alike.
        seed: of epoch and device, asked anew for every batch.
    """

    def __init__(
        self,
        crops: ActionCrops,
        streams: tuple[StreamName, ...],
        size: int,
        batch_size: int,
        batches: int,
        augmentation: ActionAugmentation,
        segments: int,
        span: int,
        rarity: float,
        seed: Callable[[], tuple[int, ...]],
    ) -> None:
        self.crops, self.streams, self.size = crops, streams, size
        self.batch_size, self.batches, self.augmentation = batch_size, batches, augmentation
        self.segments, self.span, self.seed = segments, span, seed
        share = crops.actions.mean(axis=0)
        rarest = np.where(crops.actions, np.maximum(share, 1 / len(crops)), 1.0).min(axis=1)
        self.chances = rarest**-rarity / (rarest**-rarity).sum()
        # Rows of one person in the order of time, so that neighbours in time are neighbours here.
        self.order = np.lexsort((crops.frames, crops.people))
        self.place = np.argsort(self.order)

    def __len__(self) -> int:
        return self.batches

    def __getitem__(self, index: int) -> ActionBatch:
        if not 0 <= index < self.batches:
            raise IndexError(index)
        rng = np.random.default_rng([*self.seed(), index])
        rows = rng.choice(len(self.crops), self.batch_size, p=self.chances)
        pictures = self._segments(rng, rows).ravel()
        actions = torch.from_numpy(self.crops.actions[rows].astype(np.float32))
        change = draw_changes(rng, self.augmentation, self.batch_size)
        every = {name: np.repeat(values, self.segments, axis=0) for name, values in change.items()}
        crops = {}
        for name in self.streams:
            images = changed(self.crops.crops(name, pictures), every, self.size, is_flow=name.startswith("flow"))
            crops[name] = torch.from_numpy(images.reshape(self.batch_size, self.segments, *images.shape[1:]))
        return ActionBatch(crops, actions)

    def _segments(self, rng: np.random.Generator, rows: IntArray) -> IntArray:
        """``(B, K)`` rows of the same person doing the same, one a segment around each of ``rows`` ``(B,)``."""
        chosen = np.repeat(rows[:, None], self.segments, axis=1)
        if self.segments == 1:
            return chosen
        length = self.span / self.segments
        for sample, row in enumerate(rows.tolist()):
            near = self._same_nearby(row)
            offset = self.crops.frames[near] - self.crops.frames[row] + self.span / 2
            segment = (offset // length).astype(int)
            for k in range(self.segments):
                candidates = near[segment == k]
                if len(candidates):
                    chosen[sample, k] = rng.choice(candidates)
        return chosen

    def _same_nearby(self, row: int) -> IntArray:
        """Rows of the same person with the same actions within the span."""
        crops, place = self.crops, int(self.place[row])
        reach = self.span // 2 + 1
        near = self.order[max(place - reach, 0) : place + reach]
        near = near[crops.people[near] == crops.people[row]]
        same = (crops.actions[near] == crops.actions[row]).all(axis=1)
        return np.asarray(near[same & (np.abs(crops.frames[near] - crops.frames[row]) <= self.span / 2)])


def draw_changes(rng: np.random.Generator, settings: ActionAugmentation, count: int) -> Changes:
    """What happens to ``count`` samples; the same to all streams and pictures of a sample."""
    return {
        "shift": rng.random((count, 2)),
        "left_right": rng.random(count) < settings.flip_horizontal,
        "top_bottom": rng.random(count) < settings.flip_vertical,
        "gain": np.exp(rng.normal(0, settings.colour, (count, 1)) + rng.normal(0, settings.colour / 4, (count, 3))),
        "offset": rng.normal(0, 60 * settings.colour, (count, 1)),
    }


def changed(images: ImageArray, change: Changes, size: int, *, is_flow: bool) -> ImageArray:
    """``(B, size, size, C)`` crops of the stored ``(B, S, S, C)``, shifted, mirrored and recoloured.

    A mirrored flow also changes its sign along that axis.
    """
    margin = images.shape[1] - size
    result = np.empty((len(images), size, size, images.shape[3]), dtype=np.uint8)
    for n, image in enumerate(images):
        y, x = np.floor(change["shift"][n] * (margin + 1)).astype(int).tolist()
        result[n] = image[y : y + size, x : x + size]
    for axis, name in ((2, "left_right"), (1, "top_bottom")):
        which = change[name]
        result[which] = np.flip(result[which], axis=axis)
        if is_flow:
            channel = slice(0 if axis == 2 else 1, None, 2)
            result[which, :, :, channel] = 2 * NO_MOTION - result[which, :, :, channel].astype(np.int16)
    if is_flow:
        return result
    levels = result * change["gain"][:, None, None, :].astype(np.float32)
    levels += change["offset"][:, None, None, :].astype(np.float32)
    return np.asarray(np.clip(levels, 0, 255), dtype=np.uint8)


VALIDATED = 64
"""Crops of a batch in validation."""


class ValidationBatches(Dataset[ActionBatch]):
    """Every sample once, in its middle, one picture each."""

    def __init__(self, crops: ActionCrops, streams: tuple[StreamName, ...], size: int) -> None:
        self.crops, self.streams, self.size = crops, streams, size

    def __len__(self) -> int:
        return -(-len(self.crops) // VALIDATED)

    def __getitem__(self, index: int) -> ActionBatch:
        rows = np.arange(index * VALIDATED, min((index + 1) * VALIDATED, len(self.crops)))
        if not len(rows):
            raise IndexError(index)
        images = {name: centre_crops(self.crops.crops(name, rows), self.size)[:, None] for name in self.streams}
        actions = torch.from_numpy(self.crops.actions[rows].astype(np.float32))
        return ActionBatch({name: torch.from_numpy(crops) for name, crops in images.items()}, actions)


def centre_crops(images: ImageArray, size: int) -> ImageArray:
    """``(B, size, size, C)`` middles of ``(B, S, S, C)``: what the network sees of a box when it runs."""
    first = (images.shape[1] - size) // 2
    return np.ascontiguousarray(images[:, first : first + size, first : first + size])


class ActionData(lightning.LightningDataModule):
    """Crops of people from clips labelled with actions, cut once and kept on disk.

    Args:
        train_folders: folders of Okutama-Action, Drone-Action or generated clips; docs/how-to/files.md has the layouts.
        validation_folders: likewise; other clips than those trained on.
        cache: folder that keeps the crops; a clip is cut anew where they are missing, or clip or cutting have changed.
        multiple_actions: of Okutama-Action, take the labels with all actions of a person instead of the one of the
            tracking labels.
        streams: which streams are trained.
        cutting: how crops are cut.
        batch_size: samples of a batch; the thesis has 16.
        batches: number of batches of an epoch.
        segments: pictures of a sample, spread over ``span`` frames; 1 is the thesis's training.
        span: frames that the segments cover.
        rarity: exponent of the chance of samples by the rarest of their actions, 0 to 1.
        augmentation: changes of the training crops.
        workers: processes that prepare batches; 0 does it in the training process.
        seed: of the random numbers.
    """

    def __init__(
        self,
        train_folders: list[Path] | list[str],
        validation_folders: list[Path] | list[str],
        cache: Path = Path("out/cache/actions"),
        multiple_actions: bool = False,
        streams: tuple[StreamName, ...] = STREAMS,
        cutting: CropSettings = CUTTING,
        batch_size: int = 16,
        batches: int = 100,
        segments: int = 1,
        span: int = 30,
        rarity: float = 0.5,
        augmentation: ActionAugmentation = AUGMENTATION,
        workers: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if segments < 1 or span < segments:
            raise RequestError(f"expected at least 1 segment and a span of at least as many, got {segments} and {span}")
        if not train_folders or not validation_folders:
            raise RequestError("nothing to learn from or to validate on: give train_folders and validation_folders")
        parts = {"train": train_folders, "validation": validation_folders}
        self.folders = {part: [Path(folder) for folder in folders] for part, folders in parts.items()}
        self.cache, self.streams, self.cutting = Path(cache), tuple(streams), cutting
        self.multiple_actions = multiple_actions
        self.batch_size, self.batches, self.workers, self.seed = batch_size, batches, workers, seed
        self.segments, self.span, self.rarity = segments, span, rarity
        self.augmentation = augmentation
        self.clips: dict[str, list[ActionSequence]] = {}

    def prepare_data(self) -> None:
        """Cut the clips whose crops are missing, and with a warning those whose crops are damaged."""
        for clips in self._find().values():
            for clip in clips:
                if not self._has_crops(clip):
                    cut_clip(clip, self.cutting, self._folder(clip))

    def _has_crops(self, clip: ActionSequence) -> bool:
        if not has_crops(self._folder(clip), clip, self.cutting):
            return False
        try:
            load_crops([self._folder(clip)], STREAMS)
        except RequestError as error:
            print(f"tsuiseki: warning: {error}; cut anew", file=sys.stderr)
            return False
        return True

    def setup(self, stage: str) -> None:
        """Open the crops."""
        del stage
        found = self._find()
        self.train_crops, self.validation_crops = (
            load_crops([self._folder(clip) for clip in found[part]], self.streams) for part in self.folders
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The actions, in the order of the labels."""
        return self._find()["train"][0].labels.class_names

    def _find(self) -> dict[str, list[ActionSequence]]:
        if not self.clips:
            found = {
                part: [clip for folder in folders for clip in action_sequences(folder, self.multiple_actions)]
                for part, folders in self.folders.items()
            }
            _check_apart(found)
            self.clips = {part: clips_to_cut(clips, self.cutting, part) for part, clips in found.items()}
        return self.clips

    def _folder(self, clip: ActionSequence) -> Path:
        return self.cache / clip.name

    def _epoch_seed(self) -> tuple[int, ...]:
        trainer = self.trainer
        return (self.seed, trainer.current_epoch, trainer.global_rank) if trainer else (self.seed,)

    def train_dataloader(self) -> DataLoader[ActionBatch]:
        """Batches drawn at random."""
        batches = ActionBatches(
            self.train_crops,
            self.streams,
            self.cutting.size,
            self.batch_size,
            self.batches,
            self.augmentation,
            self.segments,
            self.span,
            self.rarity,
            self._epoch_seed,
        )
        return DataLoader(batches, batch_size=None, num_workers=self.workers)

    def val_dataloader(self) -> DataLoader[ActionBatch]:
        """Every validation crop once."""
        return DataLoader(ValidationBatches(self.validation_crops, self.streams, self.cutting.size), batch_size=None)

    def test_dataloader(self) -> DataLoader[ActionBatch]:
        """The same."""
        return self.val_dataloader()


def _check_apart(found: dict[str, list[ActionSequence]]) -> None:
    """Refuse clips of one name, which would share their crops, and clips with different actions."""
    clips = [clip for part in found.values() for clip in part]
    names = [clip.name for clip in clips]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RequestError(f"expected clips of different names for training and validation, got {twice[0]} twice")
    for clip in clips:
        if clip.labels.class_names != clips[0].labels.class_names:
            raise RequestError(
                f"expected the same actions in all clips, got {', '.join(clip.labels.class_names)} in {clip.name} and "
                f"{', '.join(clips[0].labels.class_names)} in {clips[0].name}"
            )
