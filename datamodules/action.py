"""Labelled clips as crops of people with the actions that they perform."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import lightning
from torch.utils.data import DataLoader

from tsuiseki.datamodules.action_batches import ActionAugmentation, ActionBatch, ActionBatches, ValidationBatches
from tsuiseki.datamodules.action_crops import CropSettings, clips_to_cut, cut_clip, has_crops, load_crops
from tsuiseki.datamodules.readers.acting import ActionSequence, action_sequences
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import STREAMS, StreamName
from tsuiseki.tracking.features.optical_flow import FlowName


class ActionData(lightning.LightningDataModule):
    """Crops of people from clips labelled with actions, cut once and kept on disk.

    Args:
        train_folders: folders of Okutama-Action, Drone-Action or generated clips; docs/drone-data.md has the layouts.
        validation_folders: likewise; other clips than those trained on.
        cache: folder that keeps the crops; a clip is cut anew where they are missing, or clip or cutting have changed.
        multiple_actions: of Okutama-Action, take the labels with all actions of a person instead of the one of the
            tracking labels.
        streams: which streams are trained.
        size: side of the network's input, pixels.
        enlargement: of the global crop, μ.
        flow_limit: flow is clipped to this many pixels a frame.
        stack: pairs of frames whose flow is stacked.
        flow: how flow is estimated.
        compensate: whether the camera's motion is taken out of the flow; it is not in the thesis.
        cutting: how crops are cut; what is said of the network's input, from ``size`` on, wins over what is in it.
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
        train_folders: list[Path],
        validation_folders: list[Path],
        cache: Path = Path("out/cache/actions"),
        multiple_actions: bool = False,
        streams: tuple[StreamName, ...] = STREAMS,
        size: int = 64,
        enlargement: float = 3.0,
        flow_limit: float = 20.0,
        stack: int = 1,
        flow: FlowName = "dis",
        compensate: bool = False,
        cutting: CropSettings | None = None,
        batch_size: int = 16,
        batches: int = 100,
        segments: int = 1,
        span: int = 30,
        rarity: float = 0.5,
        augmentation: ActionAugmentation | None = None,
        workers: int = 0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if segments < 1 or span < segments:
            raise RequestError(f"expected at least 1 segment and a span of at least as many, got {segments} and {span}")
        if not train_folders or not validation_folders:
            raise RequestError("nothing to learn from or to validate on: give train_folders and validation_folders")
        self.folders = {"train": train_folders, "validation": validation_folders}
        self.cache, self.streams, self.size = cache, tuple(streams), size
        self.multiple_actions = multiple_actions
        self.cutting = dataclasses.replace(
            cutting or CropSettings(),
            size=size,
            enlargement=enlargement,
            flow_limit=flow_limit,
            stack=stack,
            flow=flow,
            compensate=compensate,
        )
        self.batch_size, self.batches, self.workers, self.seed = batch_size, batches, workers, seed
        self.segments, self.span, self.rarity = segments, span, rarity
        self.augmentation = augmentation or ActionAugmentation()
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
            self.size,
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
        return DataLoader(ValidationBatches(self.validation_crops, self.streams, self.size), batch_size=None)


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
