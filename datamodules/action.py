"""Labelled clips as crops of people with the actions that they perform."""

from __future__ import annotations

import itertools
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

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
from tsuiseki.datamodules.labelled_images import LabelledPart, labelled_parts
from tsuiseki.datamodules.network_data import NetworkData, check_positive
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import NO_MOTION, STREAMS, ActionInput, StreamName
from tsuiseki.tracking.types import BoolArray, ImageArray

Changes: TypeAlias = dict[str, NDArray[Any]]


class ActionBatch(NamedTuple):
    """Crops ``(B, S, S, C)`` uint8 by stream, and ``(B, A)`` float32 which actions are performed."""

    crops: dict[StreamName, Tensor]
    actions: Tensor


CUTTING = CropSettings()
# Chance that a training crop is mirrored left and right (thesis 5.4.2).
FLIP_HORIZONTAL = 0.5
# Chance that it is mirrored top and bottom: a camera that looks straight down sees people from all sides.
FLIP_VERTICAL = 0.5
# Scale of the changes of brightness and contrast, as the standard deviation of the logarithm of the gain.
COLOUR = 0.2


class ActionBatches(Dataset[ActionBatch]):
    """Batches of ``crops`` drawn at random as `ActionData` says, each fully decided by the epoch and its number.

    The ``seed`` of epoch and device is asked anew for every batch; ``size`` is less than that of the stored crops.
    """

    def __init__(
        self,
        crops: ActionCrops,
        streams: tuple[StreamName, ...],
        size: int,
        batch_size: int,
        batches: int,
        rarity: float,
        seed: Callable[[], tuple[int, ...]],
    ) -> None:
        self.crops, self.streams, self.size = crops, streams, size
        self.batch_size, self.batches, self.seed = batch_size, batches, seed
        share = crops.actions.mean(axis=0)
        rarest = np.where(crops.actions, np.maximum(share, 1 / len(crops)), 1.0).min(axis=1)
        self.chances = rarest**-rarity / (rarest**-rarity).sum()

    def __len__(self) -> int:
        return self.batches

    def __getitem__(self, index: int) -> ActionBatch:
        if not 0 <= index < self.batches:
            raise IndexError(index)
        rng = np.random.default_rng([*self.seed(), index])
        rows = rng.choice(len(self.crops), self.batch_size, p=self.chances)
        change = draw_changes(rng, self.batch_size)
        images = {
            name: changed(self.crops.crops(name, rows), change, self.size, is_flow=name.startswith("flow"))
            for name in self.streams
        }
        return batch_of(images, self.crops.actions[rows])


def batch_of(images: Mapping[StreamName, ImageArray], actions: BoolArray) -> ActionBatch:
    """Crops ``(B, S, S, C)`` by stream, and ``(B, A)`` which actions are performed, as tensors."""
    crops = {name: torch.from_numpy(crop) for name, crop in images.items()}
    return ActionBatch(crops, torch.from_numpy(actions.astype(np.float32)))


def draw_changes(rng: np.random.Generator, count: int) -> Changes:
    """What happens to ``count`` samples; the same to all streams of a sample."""
    return {
        "shift": rng.random((count, 2)),
        "left_right": rng.random(count) < FLIP_HORIZONTAL,
        "top_bottom": rng.random(count) < FLIP_VERTICAL,
        "gain": np.exp(rng.normal(0, COLOUR, (count, 1)) + rng.normal(0, COLOUR / 4, (count, 3))),
        "offset": rng.normal(0, 60 * COLOUR, (count, 1)),
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
    """Every sample once, in its middle."""

    def __init__(self, crops: ActionCrops, streams: tuple[StreamName, ...], size: int) -> None:
        self.crops, self.streams, self.size = crops, streams, size

    def __len__(self) -> int:
        return -(-len(self.crops) // VALIDATED)

    def __getitem__(self, index: int) -> ActionBatch:
        rows = np.arange(index * VALIDATED, min((index + 1) * VALIDATED, len(self.crops)))
        if not len(rows):
            raise IndexError(index)
        images = {name: centre_crops(self.crops.crops(name, rows), self.size) for name in self.streams}
        return batch_of(images, self.crops.actions[rows])


def centre_crops(images: ImageArray, size: int) -> ImageArray:
    """``(B, size, size, C)`` middles of ``(B, S, S, C)``: what the network sees of a box when it runs."""
    first = (images.shape[1] - size) // 2
    return np.ascontiguousarray(images[:, first : first + size, first : first + size])


class ActionData(NetworkData):
    """Crops of people from clips labelled with actions, cut once and kept on disk.

    Which streams, of which size and flow, is asked of the module that the Trainer fits.

    Args:
        train: folders of Okutama-Action, Drone-Action or generated clips; docs/how-to/files.md has the layouts.
        val: likewise, other clips than those trained on; by default the last clips of ``train``.
        val_share: those, a share of the clips.
        batch_size: samples of a batch; the thesis has 16.
        batches: number of batches of an epoch.
        workers: processes that prepare batches; 0 does it in the training process.
        cache: folder that keeps the crops; a clip is cut anew where they are missing, or clip or cutting have changed.
            By default a temporary folder, which goes with the process.
        streams: which streams are trained; by default the module's.
        cutting: how crops are cut; size and flow are the module's.
        rarity: exponent of the chance of samples by the rarest of their actions, 0 to 1.
        seed: of the random numbers.

    Raises:
        RequestError: a folder is missing.
    """

    kind = "action"

    def __init__(
        self,
        train: Sequence[Path | str] | Path | str,
        val: Sequence[Path | str] | Path | str | None = None,
        val_share: float = 0.1,
        batch_size: int = 16,
        batches: int = 100,
        workers: int = 0,
        cache: Path | str | None = None,
        streams: tuple[StreamName, ...] | None = None,
        cutting: CropSettings = CUTTING,
        rarity: float = 0.5,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if not 0 < val_share < 1:
            raise RequestError(f"`val_share`: expected a share of the clips between 0 and 1, got {val_share}")
        check_positive(batch_size=batch_size, batches=batches)
        self.folders = {"train": [Path(part.folder) for part in labelled_parts(train, "train", LabelledPart)]}
        if val is not None:
            self.folders["val"] = [Path(part.folder) for part in labelled_parts(val, "val", LabelledPart)]
        self.val_share, self._streams, self._cutting = val_share, streams, cutting
        self.batch_size, self.batches, self.workers, self.seed = batch_size, batches, workers, seed
        self.rarity = rarity
        self.clips: dict[str, list[ActionSequence]] = {}
        self.cache = None if cache is None else Path(cache)
        self._temporary: Path | None = None

    @property
    def _inputs(self) -> Mapping[StreamName, ActionInput]:
        return getattr(self.module, "inputs", None) or {}

    @property
    def streams(self) -> tuple[StreamName, ...]:
        """Which streams are trained.

        Raises:
            RequestError: the module has others than were asked for.
        """
        own = tuple(self._inputs)
        if self._streams and own and set(self._streams) != set(own):
            raise RequestError(f"`streams`: expected those of the module, {', '.join(own)}, got {self._streams}")
        return self._streams or own or STREAMS

    @property
    def cutting(self) -> CropSettings:
        """How crops are cut."""
        first = next(iter(self._inputs.values()), None)
        return self._cutting if first is None else replace(self._cutting, size=first.size, flow=first.flow)

    def prepare_data(self) -> None:
        """Cut the clips whose crops are missing, and with a warning those whose crops are damaged."""
        super().prepare_data()
        for clip in itertools.chain(*self._find().values()):
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
        if self.cache is None:
            # A temporary folder is that of a process; a Trainer prepares in one of them alone.
            self.prepare_data()
        sequences = self._find()
        self.train_crops, self.validation_crops = (
            load_crops([self._folder(clip) for clip in sequences[part]], self.streams) for part in ("train", "val")
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The actions, in the order of the labels."""
        return self._find()["train"][0].labels.class_names

    def _find(self) -> dict[str, list[ActionSequence]]:
        if not self.clips:
            sequences = {
                part: [clip for folder in folders for clip in action_sequences(folder)]
                for part, folders in self.folders.items()
            }
            if "val" not in sequences:
                sequences = _without_last(sequences["train"], self.val_share)
            _check_apart(sequences)
            self.clips = {part: clips_to_cut(clips, self.cutting, part) for part, clips in sequences.items()}
        return self.clips

    def _folder(self, clip: ActionSequence) -> Path:
        if self.cache is not None:
            return self.cache / clip.name
        if self._temporary is None:
            self._temporary = Path(tempfile.mkdtemp(prefix="tsuiseki-actions-"))
            weakref.finalize(self, shutil.rmtree, self._temporary, ignore_errors=True)
        return self._temporary / clip.name

    def train_dataloader(self) -> DataLoader[ActionBatch]:
        """Batches drawn at random."""
        sizes = self.cutting.size, self.batch_size, self.batches
        batches = ActionBatches(self.train_crops, self.streams, *sizes, self.rarity, self.epoch_seed)
        return DataLoader(batches, batch_size=None, num_workers=self.workers)

    def val_dataloader(self) -> DataLoader[ActionBatch]:
        """Every validation crop once."""
        return DataLoader(ValidationBatches(self.validation_crops, self.streams, self.cutting.size), batch_size=None)

    def test_dataloader(self) -> DataLoader[ActionBatch]:
        return self.val_dataloader()

    def predict_dataloader(self) -> DataLoader[ActionBatch]:
        return self.val_dataloader()


def _without_last(clips: list[ActionSequence], share: float) -> dict[str, list[ActionSequence]]:
    """All clips but the last, at least one of each."""
    later = max(1, round(share * len(clips)))
    if later >= len(clips):
        raise RequestError(
            f"`train`: expected at least two clips, one of them to validate on, got {len(clips)}; give others as `val`"
        )
    return {"train": clips[:-later], "val": clips[-later:]}


def _check_apart(sequences: dict[str, list[ActionSequence]]) -> None:
    """Refuse clips of one name, which would share their crops, and clips with different actions."""
    clips = [clip for part in sequences.values() for clip in part]
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
