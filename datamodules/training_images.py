"""Labelled images held for training, also generated ones, and what composing people onto fixed views needs. No torch.

Generated pictures lie in folders of the MOTChallenge layout.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.composition import Cutout, SizeByRow, cut_out_people, empty_view, fit_size_by_row
from tsuiseki.datamodules.labelled_images import LabelledPart, labelled_images
from tsuiseki.datamodules.scenes.clip import IMAGES, FrameTruth, ground_truth, write_image
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.datamodules.scenes.room_pictures import panorama_picture
from tsuiseki.datamodules.scenes.training_pictures import random_training_scene
from tsuiseki.datamodules.scenes.training_settings import THINGS, TOWN, BoxConvention, settings_of_scene
from tsuiseki.datamodules.video_pictures import VideoPicture, read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import PEOPLE
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.types import FloatArray, ImageArray

# Most bytes of decoded images kept of one source; beyond it they are decoded anew each time.
_MEMORY = 1 << 30
# People of whom a smaller share is visible are ignored.
LEAST_VISIBLE = 0.25

Scene: TypeAlias = Literal[
    "street", "varied", "sparse", "aerial", "near", "crowded", "posed", "lifeless", "everyday", "overhead", "drone",
    "ceiling",
]  # fmt: skip


@dataclass(frozen=True)
class TrainingSource(LabelledPart):
    """Labelled video to learn from or to validate on.

    Attributes:
        share: how often examples come from here, relative to the other sources.
        fixed_camera: the camera stands still in each sequence, so that people can be cut out and pasted.
        generate: fill a folder that does not exist with this many random generated pictures.
        scene: what those show: a street; streets, crowds, views from afar and empty places by day and night (varied);
            few people among many things (sparse); people among many things from above (aerial); a few people near the
            camera (near); people who hide each other (crowded), who sit, lie, fall, crouch, kneel or bend (posed),
            leaves, statues, dolls and posters without people (lifeless), or all of these (everyday); people all around
            below a fisheye camera (overhead); people who act under a drone; or people in rooms, as ceiling cameras see
            them in unrolled pictures.
        sprites: folder of rendered people (`tsuiseki simulate sprites`), shown in all but street and drone pictures;
            posed and everyday ones need some of ``--poses``.
        photographs: folder of photographs without people: ``surfaces/`` and ``views/`` for the grounds of these, cut
            out ``things/`` to stand on them.
        town: these pictures show things of towns, too: traffic lights, signs, bicycles, shop fronts and the like.
        things: and photographed things, which the folder of photographs must hold.
        sun: share of the pictures in a hard sun, in [0, 1]; of all scenes but streets and rooms.
        boxes: how people are boxed in these: round their silhouettes; or steady, as wide as in a whole walk on average,
            as people label videos.
        seed: of those.
        size: their width and height, pixels; by default those of the input.
    """

    share: float = 1.0
    fixed_camera: bool = False
    generate: int = 0
    scene: Scene = "street"
    sprites: str = ""
    photographs: str = ""
    town: bool = False
    things: bool = False
    sun: float = 0.0
    boxes: BoxConvention = "silhouettes"
    seed: int = 0
    size: tuple[int, int] | None = None

    @property
    def made(self) -> bool:
        """Whether the folder is filled where it is missing."""
        return self.generate > 0


@dataclass(frozen=True)
class FixedView:
    """What a fixed camera's sequence gives for composing.

    Attributes:
        background: the scene without people; ignored boxes where there always are some.
        sizes: how tall people are by row.
    """

    background: Example
    sizes: SizeByRow


class TrainingImages:
    """The labelled images of one source.

    Args:
        source: where they are.
        classes: names of those to learn.

    Attributes:
        views: of each image the fixed view that it belongs to; none where the source does not say that cameras stand
            still.
        cutouts: of each image the people cut out, one entry a box, None for those that could not be; likewise.

    Raises:
        RequestError: the source has no usable labelled image, or an image cannot be read.
    """

    def __init__(self, source: TrainingSource, classes: Sequence[str] = (PEOPLE,)) -> None:
        self.source = source
        self.labels = labelled_images(source.folder, source.frames, source.part, classes=classes)
        first = read_image(self.labels[0].picture)
        self._decoded: list[ImageArray] | None = None
        if first.nbytes * len(self.labels) <= _MEMORY:
            self._decoded = [read_image(label.picture) for label in self.labels]
        elif isinstance(entered := self.labels[0].picture, VideoPicture) and not entered.video.seekable:
            raise RequestError(
                f"{entered.video.file}: expected a video that can be entered anywhere, as all its frames take over "
                f"{_MEMORY >> 20} MiB; write it anew as MP4, say, or its frames into img1/"
            )
        self.views: list[FixedView] = []
        self.cutouts: list[list[Cutout | None]] = []
        if source.fixed_camera:
            for _, members in itertools.groupby(range(len(self)), key=lambda index: self.labels[index].sequence):
                examples = [self.example(index) for index in members]
                background = empty_view(examples)
                boxes = np.concatenate([e.boxes[~e.ignored] for e in examples])
                self.views += [FixedView(background, fit_size_by_row(boxes))] * len(examples)
                self.cutouts += [cut_out_people(e, background.image) for e in examples]

    def __len__(self) -> int:
        return len(self.labels)

    def example(self, index: int) -> Example:
        """A picture with its boxes; ignored are those that are hardly visible, too."""
        label = self.labels[index]
        image = read_image(label.picture) if self._decoded is None else self._decoded[index]
        ignored = label.ignored | (label.visibility < LEAST_VISIBLE)
        return Example(image, label.boxes, ignored, label.classes)


_SEQUENCE = "random-scenes"
# Pictures of one clip of a drone.
_PER_CLIP = 6
# Frames between two of them: long enough for other poses and views.
_APART = 45
# People of a clip of a drone.
_DRONE_PEOPLE = 7
# (shortest, longest) focal length of it in widths of the image: as a window of a frame half as wide again, which shows
# people large enough to learn.
_DRONE_FOCAL = (1.5, 3.0)


def check_source(source: TrainingSource) -> None:
    """Refuse a source that asks for what the pictures of its scene do not show.

    Raises:
        RequestError: it does.
    """
    where = source.folder
    options = [name for name in ("photographs", "town", "things") if getattr(source, name)]
    options += ["boxes"] if source.boxes != "silhouettes" else []
    options += ["sprites"] if source.sprites and source.scene != "ceiling" else []
    if options and source.scene in ("street", "drone", "ceiling"):
        raise RequestError(
            f"{where}: expected `{options[0]}` with a scene of people before a camera, such as varied or everyday, "
            f"got {source.scene}"
        )
    if source.sun and source.scene in ("street", "ceiling"):
        raise RequestError(
            f"{where}: expected `sun` with a varied, sparse, aerial, near, overhead or drone scene, got {source.scene}"
        )
    if source.boxes == "steady" and not source.sprites:
        raise RequestError(f"{where}: expected `sprites` with steady `boxes`, which are theirs, got none")
    if source.scene == "lifeless":
        raise RequestError(f"{where}: expected a scene with people, such as everyday, which has lifeless pictures, too")
    if not 0 <= source.sun <= 1:
        raise RequestError(f"{where}: expected `sun` as a share in [0, 1], got {source.sun}")


def write_pictures(source: TrainingSource, size: tuple[int, int]) -> None:
    """Render the pictures of ``source`` into its folder, on all cores; picture n depends on the seed and n only.

    The frames of the sequence have nothing to do with each other; every box has its own id.

    Args:
        source: how many pictures, of which scene, and the folder they go to.
        size: width and height of the pictures, pixels.

    Raises:
        RequestError: fewer than one picture, the folder holds files, there is nothing in the folders that ``source``
            names, or things are asked for and there are no photographs of any.
    """
    folder, count = Path(source.folder), source.generate
    if count < 1:
        raise RequestError(f"expected at least one picture to generate for {folder}, got {count}")
    photographs = _stock(source.sprites, source.photographs)[1]
    if source.things and not (photographs and photographs.paths["things"]):
        where = f"in {source.photographs}/things" if source.photographs else "with `things`"
        raise RequestError(f"expected photographs of things {where}, got none")
    folder.parent.mkdir(parents=True, exist_ok=True)
    together = _PER_CLIP if source.scene == "drone" else 1
    with output_folder(folder, overwrite=False) as work:
        numbers = [range(start, min(start + together, count)) for start in range(0, count, together)]
        drawn = on_all_cores(partial(_drawn, source, size, work), numbers, 8 // together or 1)
        truth = ground_truth([of_picture for of_process in drawn for of_picture in of_process])
        truth = replace(truth, ids=np.arange(1, len(truth) + 1))
        write_ground_truth(work / "gt" / "gt.txt", truth)
        write_sequence_info(work, _SEQUENCE, 1.0, count, *size)


def _drawn(source: TrainingSource, size: tuple[int, int], folder: Path, numbers: range) -> list[FrameTruth]:
    """Draw the pictures of these numbers into ``folder``, and return their labels, without ids."""
    truths = []
    for number in numbers:
        image, boxes, visibility = _picture(source, size, number)
        write_image(folder / IMAGES.format(number=number + 1), image)
        large = ((boxes[:, 2:] - boxes[:, :2]) > 1).all(axis=1)
        truths.append(FrameTruth(np.zeros(int(large.sum()), np.int64), boxes[large], visibility[large]))
    return truths


def _picture(source: TrainingSource, size: tuple[int, int], number: int) -> tuple[ImageArray, FloatArray, FloatArray]:
    if source.scene == "drone":
        in_clip = number % _PER_CLIP
        (image,), truth = _drone_clip(size, source.sun, source.seed + number - in_clip).draw_frame(_APART * in_clip)
        return image, truth.boxes, truth.visibility
    rng = np.random.default_rng([source.seed, number])
    if source.scene == "ceiling":
        return panorama_picture(rng, *size, _stock(source.sprites, "")[0])
    settings = settings_of_scene(source.scene, rng, size)
    settings = replace(
        settings,
        town=TOWN if source.town else settings.town,
        things=THINGS if source.things else settings.things,
        sun=source.sun,
        boxes=source.boxes,
    )
    return random_training_scene(rng, settings, *_stock(source.sprites, source.photographs))


@lru_cache(maxsize=1)
def _drone_clip(size: tuple[int, int], sun: float, seed: int) -> DroneClip:
    settings = DroneSceneSettings(*size, frames=_PER_CLIP * _APART, people=_DRONE_PEOPLE, focal=_DRONE_FOCAL, sun=sun)
    return DroneClip(settings, seed)


@lru_cache(maxsize=1)
def _stock(sprites: str, photographs: str) -> tuple[SpriteLibrary | None, Photographs | None]:
    return SpriteLibrary(sprites) if sprites else None, Photographs(photographs) if photographs else None
