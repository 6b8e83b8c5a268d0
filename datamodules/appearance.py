"""Batches of P identities with K views each, for learning appearance, and how their crops are changed at random.

A batch is seen through one camera: its colours, contrast, sharpness and resolution are drawn once for all, so that
people are distinguished by what differs between them and not by the light. What changes from frame to frame (box,
direction, small changes of light, things in front) is drawn for every crop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from tsuiseki.datamodules.augmentation import compressed
from tsuiseki.datamodules.identity_crops import (
    IdentityCrops,
    crops_from_folder,
    join_crops,
    put_before,
    put_on_ground,
    read_crops,
    render_people,
    write_crops,
)
from tsuiseki.datamodules.labelled_images import LabelledPart, labelled_parts
from tsuiseki.datamodules.network_data import NetworkData, check_positive
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray

Float32Array = NDArray[np.float32]


# Chance that a crop is mirrored.
FLIP = 0.5
# Standard deviation of the box's centre, in box sizes, as a detector's boxes are a little off.
SHIFT = 0.05
# Standard deviation of the logarithm of the box's width and height.
STRETCH = 0.07
# Strength of the tint, saturation, gamma and contrast that the whole batch shares, as one camera's.
CAMERA_COLOUR = 1.0
# Strength of the same from crop to crop, as light differs from place to place.
VIEW_COLOUR = 0.25
# Crops are brought down to between this and the full input height, in pixels.
LOWEST_HEIGHT = 28
# Chance that a crop is blurred.
BLUR = 0.4
# Chance that a crop is compressed.
JPEG = 0.5
# Chance that a piece of another crop or a plain patch covers a part.
OCCLUDE = 0.4
# Largest deviation of the sensor noise, grey levels.
NOISE = 6.0


@dataclass(frozen=True)
class CropCamera:
    """What all crops of a batch share.

    Attributes:
        colour: ``(3, 3)`` mixes the channels.
        gamma: exponent of the levels.
        contrast: slope around ``pivot``; above 1 the darks drown and the lights burn out.
        pivot: level in [0, 1] that the contrast keeps.
        height: typical height of a person, pixels.
        sharpness: amount of the sharpening that consumer cameras do.
    """

    colour: Float32Array
    gamma: float
    contrast: float
    pivot: float
    height: float
    sharpness: float


def draw_camera(rng: np.random.Generator, full_height: int) -> CropCamera:
    """Colours, tones, sharpness and size that the crops of one batch share, drawn at random."""
    lowest = min(LOWEST_HEIGHT, full_height)
    return CropCamera(
        _draw_colour(rng, CAMERA_COLOUR),
        float(np.exp(rng.normal(0, 0.2 * CAMERA_COLOUR))),
        float(np.exp(rng.normal(0.0, 0.15) * CAMERA_COLOUR)),
        float(rng.uniform(0.3, 0.6)),
        float(np.exp(rng.uniform(np.log(lowest), np.log(full_height)))),
        float(rng.uniform(0, 1)) * min(CAMERA_COLOUR, 1),
    )


def augment_crop(
    rng: np.random.Generator,
    camera: CropCamera,
    image: ImageArray,
    box: FloatArray,
    cover: ImageArray,
    size: tuple[int, int],
) -> ImageArray:
    """``(H, W, 3)`` training crop of ``size`` H, W.

    Args:
        rng: the source of all chance.
        camera: of the batch.
        image: ``(h, w, 3)`` view with a margin, or an RGBA cut-out ``(h, w, 4)``, which gets a random ground.
        box: ``(4,)`` the person's box in it.
        cover: another view, to cover parts with or to stand behind.
        size: of the network's input.
    """
    if image.shape[2] == 4:
        behind = cover if cover.shape[2] == 4 and rng.random() < OCCLUDE else None
        image, box = put_on_ground(rng, image, behind)
    sides = box[2:] - box[:2]
    middle = (box[:2] + box[2:]) / 2 + rng.normal(0, SHIFT, 2) * sides
    half = sides / 2 * np.exp(rng.normal(0, STRETCH, 2))
    box = np.concatenate([middle - half, middle + half])
    height = int(np.clip(camera.height * np.exp(rng.normal(0, 0.15)), min(LOWEST_HEIGHT, size[0]), size[0]))
    width = max(4, round(height * size[1] / size[0]))
    small = crop_boxes(image, box[None], height, width)[0]
    if rng.random() < FLIP:
        small = np.ascontiguousarray(small[:, ::-1])
    if rng.random() < OCCLUDE:
        small = _occlude(rng, small, cover)
    levels = _recolour(rng, VIEW_COLOUR, camera, small)
    if rng.random() < BLUR:
        levels = _blurred(levels, float(rng.uniform(0.3, 0.015 * height + 0.3)))
    if camera.sharpness > 0:
        levels = levels + camera.sharpness * (levels - _blurred(levels, 1.0))
    noise = rng.standard_normal(levels.shape, dtype=np.float32) * np.float32(rng.uniform(0, NOISE))
    small = np.clip(levels * 255 + noise, 0, 255).astype(np.uint8)
    if rng.random() < JPEG:
        small = compressed(small, int(rng.integers(30, 90)))
    return np.asarray(cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _draw_colour(rng: np.random.Generator, strength: float) -> Float32Array:
    """``(3, 3)`` of a tint and a saturation; the identity at strength 0."""
    tint = np.diag(np.exp(rng.normal(0, 0.12 * strength, 3) + rng.normal(0, 0.1 * strength)))
    grey = np.full((3, 3), 1 / 3)
    saturation = np.exp(rng.normal(0, 0.3 * strength))
    return np.asarray(tint @ (grey + saturation * (np.eye(3) - grey)), dtype=np.float32)


def _recolour(rng: np.random.Generator, strength: float, camera: CropCamera, image: ImageArray) -> Float32Array:
    """Levels around [0, 1]."""
    levels = image.astype(np.float32) / 255 @ (_draw_colour(rng, strength) @ camera.colour).T
    levels = np.clip(levels, 0, 1) ** (camera.gamma * np.exp(rng.normal(0, 0.25 * strength)))
    levels = (levels - camera.pivot) * camera.contrast + camera.pivot + rng.normal(0, 0.06 * strength)
    return np.asarray(np.clip(levels, 0, 1), dtype=np.float32)


def _occlude(rng: np.random.Generator, image: ImageArray, cover: ImageArray) -> ImageArray:
    """``image`` with a part of it behind a cut-out person, behind a piece of ``cover`` or behind one colour."""
    if cover.shape[2] == 4 and rng.random() < 0.6:
        return put_before(rng, image, cover)
    image = image.copy()
    height, width = image.shape[:2]
    h, w = max(1, int(height * rng.uniform(0.1, 0.6))), max(1, int(width * rng.uniform(0.15, 0.7)))
    # Half of the time from a side, as another walker comes in; else anywhere, as a sign or a bag.
    x = int(rng.choice([0, width - w])) if rng.random() < 0.5 else int(rng.integers(0, width - w + 1))
    y = int(rng.integers(0, height - h + 1))
    if rng.random() < 0.5:
        y0, x0 = rng.uniform(0, 0.5, 2) * cover.shape[:2]
        piece = cover[int(y0) : int(y0) + cover.shape[0] // 2 + 1, int(x0) : int(x0) + cover.shape[1] // 2 + 1]
        image[y : y + h, x : x + w] = cv2.resize(piece[..., :3], (w, h), interpolation=cv2.INTER_AREA)
    else:
        image[y : y + h, x : x + w] = rng.integers(0, 256, 3)
    return image


def _blurred(levels: Float32Array, sigma: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(levels, (0, 0), sigma), dtype=np.float32)


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


class IdentityBatches(Dataset[list[Draw]]):
    """Batches of P ``identities``, or all, with K ``views`` each, different in every epoch and on every device.

    Identities with fewer views repeat some. The ``seed`` of epoch and device is asked anew for every batch.
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

    def __getitem__(self, index: int) -> list[Draw]:
        if not 0 <= index < self.batches:
            raise IndexError(index)
        seed = (*self.seed(), index)
        rng = np.random.default_rng(seed)
        chosen = rng.choice(len(self.views_of), self.identities, replace=False, p=self.chances)
        several = [self.views_of[i] for i in chosen]
        views = np.concatenate([rng.choice(v, self.views, replace=len(v) < self.views) for v in several])
        return [Draw(int(view), seed, place) for place, view in enumerate(views)]


def _chances(from_video: NDArray[np.bool_], rendered_share: float) -> NDArray[np.float64]:
    """Chance of every identity to be drawn; all equal where only one kind is there."""
    video, rendered = int(from_video.sum()), int((~from_video).sum())
    if video == 0 or rendered == 0:
        return np.full(len(from_video), 1 / len(from_video))
    # A share of exactly 1 would leave too few identities with a chance.
    share = float(np.clip(rendered_share, 0.01, 0.99))
    return np.where(from_video, (1 - share) / video, share / rendered)


class TrainingCrops(Dataset[list[Sample]]):
    """Batches of augmented views of ``crops``, each view fully decided by its `Draw`; of a ``size`` H, W."""

    def __init__(self, crops: IdentityCrops, draws: IdentityBatches, size: tuple[int, int]) -> None:
        self.crops, self.draws, self.size = crops, draws, size

    def __len__(self) -> int:
        return len(self.draws)

    def __getitem__(self, index: int) -> list[Sample]:
        return [self.sample(draw) for draw in self.draws[index]]

    def sample(self, draw: Draw) -> Sample:
        """The view of a draw."""
        camera = draw_camera(np.random.default_rng([*draw.seed, 0]), self.size[0])
        rng = np.random.default_rng([*draw.seed, 1, draw.place])
        cover = self.crops.images[int(rng.integers(len(self.crops)))]
        image, box = self.crops.images[draw.view], self.crops.boxes[draw.view]
        crop = augment_crop(rng, camera, image, box, cover, self.size)
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
    """The samples stacked: crops ``(B, H, W, 3)`` uint8, and ``(B,)`` of the rest."""
    crops, ids, frames, query = zip(*samples, strict=True)
    images = torch.from_numpy(np.stack(crops))
    return AppearanceBatch(images, torch.tensor(ids), torch.tensor(frames), torch.tensor(query))


@dataclass(frozen=True)
class RenderedPeople:
    """People of the generator to learn from.

    Attributes:
        file: that keeps them; they are rendered where it is missing.
        identities: number of people.
        views: of each.
        validation: identities of them kept for validation.
        share: of rendered identities in a batch, where there are others too; in [0, 1].
    """

    file: Path
    identities: int = 1500
    views: int = 12
    validation: int = 100
    share: float = 0.5


# Views of a person count as seen again from this many frames apart on: a moment apart they look the same to anything.
APART = 25


class AppearanceData(NetworkData):
    """Identity crops from labelled video, from the generator, or from both.

    Nothing is rendered or written but what ``rendered`` asks for. The size of crops is that of the module's network.

    Args:
        train: labelled video to learn from, with ids, MARS or Market-1501: a folder, several, or parts of them.
        val: likewise, to validate on. By default people of the generator whom training never uses; without
            ``rendered`` the last people of ``train``.
        val_share: those, a share of the people.
        batch_size: crops of a step, over all people in it.
        views: of each person of a batch.
        batches: steps of an epoch, over all devices.
        workers: processes that prepare batches; 0 does it in the training process.
        least_visible: smallest visible share of a labelled box, in [0, 1].
        rendered: people of the generator among them.
        height: of the network's input, pixels; by default the module's.
        width: of the network's input, pixels; by default the module's.
        seed: of everything drawn.

    Raises:
        RequestError: there is nothing to learn from, or a folder is missing.
    """

    kind = "appearance"

    def __init__(
        self,
        train: Sequence[LabelledPart | Path | str] | LabelledPart | Path | str | None = None,
        val: Sequence[LabelledPart | Path | str] | LabelledPart | Path | str | None = None,
        val_share: float = 0.1,
        batch_size: int = 64,
        views: int = 4,
        batches: int = 100,
        workers: int = 0,
        least_visible: float = 0.3,
        rendered: RenderedPeople | None = None,
        height: int | None = None,
        width: int | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__(input_height=height, input_width=width)
        if train is None and rendered is None:
            raise RequestError("nothing to learn from: give `train`, `rendered` people, or both")
        if not 0 < val_share < 1:
            raise RequestError(f"`val_share`: expected a share of the people between 0 and 1, got {val_share}")
        check_positive(batches=batches)
        if views < 2 or batch_size < 2 * views:
            raise RequestError(
                f"expected `batch_size` for at least two people with at least two `views` each, got {batch_size} and "
                f"{views}"
            )
        self.train = [] if train is None else labelled_parts(train, "train", LabelledPart)
        self.val = [] if val is None else labelled_parts(val, "val", LabelledPart)
        self.val_share, self.least_visible, self.rendered = val_share, least_visible, rendered
        self.batch_size, self.views, self.batches = batch_size, views, batches
        self.workers, self.seed = workers, seed

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of crops, pixels."""
        return self.card.input_height, self.card.input_width

    def prepare_data(self) -> None:
        """Render the people once, where they are asked for and their file is missing."""
        super().prepare_data()
        rendered = self.rendered
        if rendered is not None and not rendered.file.exists():
            write_crops(rendered.file, render_people(self.seed, rendered.identities, rendered.views))

    def setup(self, stage: str) -> None:
        """Load the crops that ``stage`` needs.

        Raises:
            RequestError: too few people have several pictures to learn from, or to validate on.
        """
        rendered, held = list[IdentityCrops](), list[IdentityCrops]()
        if self.rendered is not None:
            people = read_crops(self.rendered.file)
            apart = people.ids < self.rendered.validation
            rendered, held = [people.select(~apart)], [people.select(apart)]
        cut = self._cut(self.train) if stage == "fit" or not (self.val or held) else []
        if self.val:
            held = self._cut(self.val)
        elif not held:
            cut, held = _without_last(cut, self.val_share)
        if stage == "fit":
            self.train_crops = join_crops([*cut, *rendered])
            check_views(self.train_crops, "train")
        self.validation_crops = join_crops(held)
        check_views(self.validation_crops, "val", APART)

    def _cut(self, parts: Sequence[LabelledPart]) -> list[IdentityCrops]:
        return [crops_from_folder(Path(p.folder), p.frames, self.least_visible, p.part) for p in parts]

    def train_dataloader(self) -> DataLoader[list[Sample]]:
        """P x K batches."""
        identities, share = self.batch_size // self.views, 0.5 if self.rendered is None else self.rendered.share
        draws = IdentityBatches(self.train_crops, identities, self.views, self.batches, share, self.epoch_seed)
        batches = TrainingCrops(self.train_crops, draws, self.size)
        return DataLoader(batches, batch_size=None, num_workers=self.workers, collate_fn=collate)

    def val_dataloader(self) -> DataLoader[Sample]:
        """Every validation crop once."""
        return DataLoader(ValidationCrops(self.validation_crops, self.size), batch_size=64, collate_fn=collate)

    def test_dataloader(self) -> DataLoader[Sample]:
        return self.val_dataloader()

    def predict_dataloader(self) -> DataLoader[Sample]:
        return self.val_dataloader()


def _without_last(crops: list[IdentityCrops], share: float) -> tuple[list[IdentityCrops], list[IdentityCrops]]:
    """All crops but those of the last people, at least two, and these."""
    people = join_crops(crops)
    count = int(people.ids.max(initial=-1)) + 1
    later = max(2, round(share * count))
    if count < later + 2:
        raise RequestError(
            f"`train`: expected at least {later + 2} people, two to learn from and {later} to validate on, got "
            f"{count}; give more, or others as `val`"
        )
    last = people.ids >= count - later
    return [people.select(~last)], [people.select(last)]


def check_views(crops: IdentityCrops, name: str, apart: int = 0) -> None:
    """Refuse crops of which fewer than two people are seen twice.

    Args:
        crops: to learn from or to validate on.
        name: of the argument, for the error.
        apart: frames between the first and the last view of somebody seen twice, at least.

    Raises:
        RequestError: they are such crops.
    """
    people, person, counts = np.unique(crops.ids, return_inverse=True, return_counts=True)
    first, last = np.full(len(people), np.inf), np.full(len(people), -np.inf)
    np.minimum.at(first, person, crops.frames)
    np.maximum.at(last, person, crops.frames)
    twice = int(((counts > 1) & (last - first >= apart)).sum())
    if twice < 2:
        when = f", {apart} frames apart" if apart else ""
        raise RequestError(
            f"`{name}`: expected at least two people with two pictures each{when}, got {twice} of {len(people)} people"
        )
