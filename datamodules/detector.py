"""Training and validation images for detectors, from MOTChallenge folders of real or generated video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, DistributedSampler

from tsuiseki.datamodules.augmentation import Augmentation, Example, augment, texture
from tsuiseki.datamodules.composition import Canvas, Cutout, change_clothes, generate_people, place_people
from tsuiseki.datamodules.labelled_images import held_out, labelled_parts
from tsuiseki.datamodules.network_data import NetworkData, check_positive
from tsuiseki.datamodules.training_images import FixedView, TrainingImages, TrainingSource, check_source, write_pictures
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import PEOPLE
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import ImageArray

# Label of a person, the first class that is an object.
PERSON = 1
# Label of a box that neither counts as an object nor as background.
IGNORED = -1
# Label of rows that fill up a batch.
PADDING = 0
# Random textures to choose from, made once.
_TEXTURES = 48


@dataclass(frozen=True)
class Composition:
    """How people are composed onto the frames of fixed cameras; chances are in [0, 1].

    Attributes:
        generated_people: how many are rendered at the start; 0 leaves all frames of fixed cameras as they are.
        add: chance that people are added to a frame.
        reclothe: chance that each person of a frame gets other colours.
        empty: chance that a frame is replaced by its camera's view without people, before people are added.
        foreign: chance that a frame is replaced by a random texture, before people are added.
        most_people: added to one image.
        tilt: how far the cameras of generated people look down, radians.
    """

    generated_people: int = 0
    add: float = 0.5
    reclothe: float = 0.4
    empty: float = 0.3
    foreign: float = 0.1
    most_people: int = 10
    tilt: tuple[float, float] = (0.05, 0.6)


STRONG = Augmentation()
NO_COMPOSITION = Composition()


class DetectionBatch(NamedTuple):
    """Images and their labels.

    Attributes:
        images: ``(B, H, W, 3)`` uint8 RGB.
        boxes: ``(B, M, 4)`` float32 x1, y1, x2, y2 in input pixels, padded.
        labels: ``(B, M)`` int64 class from 1 on (`PERSON`), `IGNORED` or `PADDING`.
    """

    images: Tensor
    boxes: Tensor
    labels: Tensor


class TrainingExamples(Dataset[Example]):
    """Augmented and composed examples; each number stands for one, always the same with one seed."""

    def __init__(
        self,
        videos: list[TrainingImages],
        length: int,
        size: tuple[int, int],
        augmentation: Augmentation,
        composition: Composition,
        seed: int,
    ) -> None:
        self.every_video = videos
        self.length = length
        self.size = size
        self.augmentation = augmentation
        self.composition = composition
        self.seed = seed
        rng = np.random.default_rng([seed, 0])
        shares = np.array([f.source.share for f in videos])
        self.shares = shares / shares.sum()
        self.textures = [texture(rng, size) for _ in range(_TEXTURES)]
        generated = generate_people(rng, composition.generated_people, tilt=composition.tilt)
        cut_out = [person for f in videos for people in f.cutouts for person in people if person is not None]
        self.pools = [pool for pool in (cut_out, generated) if pool]

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, number: int) -> Example:
        rng = np.random.default_rng([self.seed, 1, number])
        videos = self.every_video[rng.choice(len(self.every_video), p=self.shares)]
        index = int(rng.integers(len(videos)))
        example = videos.example(index)
        if videos.views and self.composition.generated_people > 0:
            example = self._compose(rng, example, videos.views[index], videos.cutouts[index])
        return augment(rng, example, self.size, self.augmentation, self._fill(rng))

    def _fill(self, rng: np.random.Generator) -> ImageArray:
        return self.textures[rng.integers(len(self.textures))]

    def _compose(
        self, rng: np.random.Generator, example: Example, view: FixedView, cutouts: list[Cutout | None]
    ) -> Example:
        settings = self.composition
        kind = rng.random()
        if kind < settings.empty:
            canvas = Canvas(view.background)
        elif kind < settings.empty + settings.foreign:
            height, width = view.background.image.shape[:2]
            image = np.asarray(cv2.resize(self._fill(rng), (width, height)), dtype=np.uint8)
            canvas = Canvas(Example(image, np.empty((0, 4)), np.empty(0, dtype=np.bool_)))
        else:
            canvas = Canvas(example)
            for box, person in zip(example.boxes, cutouts, strict=True):
                if person is not None and rng.random() < settings.reclothe:
                    canvas.repaint(change_clothes(rng, person), box)
        if kind < settings.empty + settings.foreign or rng.random() < settings.add:
            count = int(rng.integers(1, settings.most_people + 1))
            place_people(rng, canvas, self.pools, count, view.sizes)
        return canvas.finish()


class ValidationExamples(Dataset[Example]):
    """Images fitted into the input as the exported model's user will, unchanged otherwise."""

    def __init__(self, videos: list[TrainingImages], card: ModelCard) -> None:
        self.card = card
        self.items = [(f, i) for f in videos for i in range(len(f))]

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, number: int) -> Example:
        videos, index = self.items[number]
        example = videos.example(index)
        image, scale = fit_image(example.image, self.card)
        return replace(example, image=image, boxes=example.boxes * np.tile(scale, 2))


class EpochSampler(DistributedSampler[int]):
    """Numbers that go on from epoch to epoch, so that no example comes twice, split over the devices."""

    def __iter__(self) -> Iterator[int]:
        return (self.epoch * self.total_size + number for number in super().__iter__())


class PredictedImages(Dataset[ImageArray]):
    """Decoded images in their own size, without labels."""

    def __init__(self, videos: list[TrainingImages]) -> None:
        self.items = [(video, index) for video in videos for index in range(len(video))]

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, number: int) -> ImageArray:
        video, index = self.items[number]
        return video.example(index).image


class DetectionData(NetworkData):
    """Labelled people, or objects of other classes, in images of one size.

    What the network's input is, and which classes are learnt, is asked of the module that the Trainer fits.

    Args:
        train: labelled video to learn from: a folder of any layout that is read, or several, or sources that say more.
        val: likewise, to validate on; by default the last part of every video.
        val_share: that part, a share of the frames.
        batch_size: images a step and device.
        batches: steps of an epoch, over all devices.
        workers: processes that prepare images.
        augmentation: how training images are changed.
        composition: how people are composed onto frames of fixed cameras.
        height: of the network's input, pixels; by default the module's.
        width: of the network's input, pixels; by default the module's.
        resize: how validation images are fitted into the input; by default as the module's.
        classes: names of those to learn, as the labels call them; by default the module's. ``person`` is people as a
            layout counts them.
        seed: of everything random here.

    Raises:
        RequestError: a folder is missing, or arguments contradict each other.
    """

    kind = "detector"

    def __init__(
        self,
        train: Sequence[TrainingSource | Path | str] | TrainingSource | Path | str,
        val: Sequence[TrainingSource | Path | str] | TrainingSource | Path | str | None = None,
        val_share: float = 0.1,
        batch_size: int = 8,
        batches: int = 60,
        workers: int = 1,
        augmentation: Augmentation = STRONG,
        composition: Composition = NO_COMPOSITION,
        height: int | None = None,
        width: int | None = None,
        resize: Literal["letterbox", "stretch"] | None = None,
        classes: list[str] | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(
            input_height=height,
            input_width=width,
            resize=resize,
            class_names=None if classes is None else tuple(classes),
        )
        learnt = labelled_parts(train, "train", TrainingSource)
        if val is None:
            learnt, held = held_out(learnt, val_share)
        else:
            held = labelled_parts(val, "val", TrainingSource)
        for source in [*learnt, *held]:
            check_source(source)
        check_positive(batch_size=batch_size, batches=batches)
        self.sources = {"train": learnt, "val": held}
        self.batch_size, self.batches, self.workers = batch_size, batches, workers
        self.augmentation, self.composition = augmentation, composition
        self.seed = seed

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of what is learnt.

        Raises:
            RequestError: people are to be composed, and others are learnt.
        """
        names = self.card.class_names or (PEOPLE,)
        if names != (PEOPLE,) and self.composition.generated_people:
            raise RequestError("`composition`: expected no people to compose with where other classes are learnt")
        return names

    def prepare_data(self) -> None:
        """Generate the pictures of sources that ask for it, where their folder is missing."""
        super().prepare_data()
        for source in [*self.sources["train"], *self.sources["val"]]:
            folder = Path(source.folder)
            if not source.generate or folder.exists():
                continue
            size = source.size or (self.card.input_width, self.card.input_height)
            print(f"generating {source.generate} pictures into {folder}", flush=True)
            write_pictures(source, size)

    def setup(self, stage: str) -> None:
        """Read the labels, decode what fits into memory, cut people out and render others."""
        card, classes = self.card, self.classes
        if stage == "fit":
            self.training = TrainingExamples(
                [TrainingImages(source, classes) for source in self.sources["train"]],
                self.batches * self.batch_size,
                (card.input_height, card.input_width),
                self.augmentation,
                self.composition,
                self.seed,
            )
        self.validated = [TrainingImages(source, classes) for source in self.sources["val"]]
        self.validation = ValidationExamples(self.validated, card)

    def train_dataloader(self) -> DataLoader[Example]:
        """Batches of an epoch."""
        world, rank = (self.trainer.world_size, self.trainer.global_rank) if self.trainer else (1, 0)
        return DataLoader(
            self.training,
            batch_size=self.batch_size,
            sampler=EpochSampler(self.training, world, rank, shuffle=False, drop_last=True),
            num_workers=self.workers,
            collate_fn=collate,
            drop_last=True,
            persistent_workers=self.workers > 0,
            worker_init_fn=_one_thread,
        )

    def val_dataloader(self) -> DataLoader[Example]:
        """All validation images in order."""
        return DataLoader(self.validation, batch_size=self.batch_size, collate_fn=collate)

    def test_dataloader(self) -> DataLoader[Example]:
        return self.val_dataloader()

    def predict_dataloader(self) -> DataLoader[ImageArray]:
        """The images that are validated on, one by one, as they are."""
        return DataLoader(PredictedImages(self.validated), batch_size=1, collate_fn=list)


def collate(examples: list[Example]) -> DetectionBatch:
    """Stack images and pad their boxes to one number."""
    padded = max(len(e.boxes) for e in examples)
    boxes = np.zeros((len(examples), padded, 4), dtype=np.float32)
    labels = np.full((len(examples), padded), PADDING, dtype=np.int64)
    for n, example in enumerate(examples):
        boxes[n, : len(example.boxes)] = example.boxes
        kinds = PERSON if example.classes is None else example.classes
        labels[n, : len(example.boxes)] = np.where(example.ignored, IGNORED, kinds)
    images = torch.from_numpy(np.stack([e.image for e in examples]))
    return DetectionBatch(images, torch.from_numpy(boxes), torch.from_numpy(labels))


def _one_thread(worker: int) -> None:
    del worker
    cv2.setNumThreads(0)
