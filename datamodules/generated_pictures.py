"""A folder of generated pictures of people, in the MOTChallenge layout. No torch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, draw_flight, plan_flight
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.datamodules.scenes.room_pictures import PanoramaPictures, panorama_picture
from tsuiseki.datamodules.scenes.training_pictures import (
    THINGS,
    TOWN,
    BoxConvention,
    Stock,
    TrainingSettings,
    aerial_settings,
    near_settings,
    random_training_scene,
    sparse_settings,
    varied_settings,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.labels import GroundTruth

_QUALITY = 92
_SEQUENCE = "random-scenes"
# Pictures of one flight of a drone, and frames between two of them: long enough for other poses and views.
_PER_FLIGHT, _APART = 6, 45
VariedScene: TypeAlias = Literal["varied", "sparse", "aerial", "near"]
_OF_SCENE: dict[VariedScene, Callable[[np.random.Generator, int, int], TrainingSettings]] = {
    "varied": varied_settings,
    "sparse": lambda _, width, height: sparse_settings(width, height),
    "aerial": lambda _, width, height: aerial_settings(width, height),
    "near": lambda _, width, height: near_settings(width, height),
}

Labels: TypeAlias = tuple[FloatArray, FloatArray]


def write_scene_images(folder: Path, count: int, settings: TrainingSettings, seed: int) -> None:
    """Render ``count`` pictures into the sequence ``folder``, on all cores; picture n depends on ``seed`` and n only.

    The frames have nothing to do with each other; every box has its own id.

    Raises:
        RequestError: fewer than one picture, or the folder holds files.
    """
    _write(folder, count, (settings.width, settings.height), partial(_street_picture, settings, seed))


@dataclass(frozen=True)
class VariedPictures:
    """What pictures of people in streets and towns show.

    Attributes:
        width: pixels.
        height: pixels.
        scene: ``varied``: ordinary streets, crowds, views from afar and nobody in turns; ``sparse``: few people among
            many things; ``aerial``: people from above; ``near``: people who fill a good part of the picture.
        sprites: folder of rendered people (`scenes.figures.library`); without one people are drawn.
        photographs: folder of photographs (`scenes.render.photographs`); without one grounds are drawn.
        town: among things of a town, too.
        things: among photographed things, too.
        sun: share of them in a hard sun, in [0, 1].
        motion: share of them in which people, and perhaps the camera, move while the shutter is open, in [0, 1].
        boxes: how people are boxed, see `scenes.street.conventions.labelled`.
    """

    width: int
    height: int
    scene: VariedScene = "varied"
    sprites: str = ""
    photographs: str = ""
    town: bool = False
    things: bool = False
    sun: float = 0.0
    motion: float = 0.0
    boxes: BoxConvention = "silhouettes"

    def settings(self, rng: np.random.Generator) -> TrainingSettings:
        """Of one picture."""
        return replace(
            _OF_SCENE[self.scene](rng, self.width, self.height),
            town=TOWN if self.town else (0, 0),
            things=THINGS if self.things else (0, 0),
            sun=self.sun,
            motion=self.motion,
            boxes=self.boxes,
        )


def write_varied_images(folder: Path, count: int, pictures: VariedPictures, seed: int) -> None:
    """Render ``count`` pictures of people in streets and towns; else as `write_scene_images`.

    Raises:
        RequestError: fewer than one picture, the folder holds files, there is nothing in the folders that ``pictures``
            names, or things are asked for and there are no photographs of any.
    """
    stock = _stock(pictures.sprites, pictures.photographs)
    if pictures.things and not (stock.photographs and stock.photographs.paths["things"]):
        where = f"in {pictures.photographs}/things" if pictures.photographs else "with `things`"
        raise RequestError(f"expected photographs of things {where}, got none")
    _write(folder, count, (pictures.width, pictures.height), partial(_varied_picture, pictures, seed))


def write_drone_images(folder: Path, count: int, settings: DroneSceneSettings, seed: int) -> None:
    """Render ``count`` pictures of people under drones, `_PER_FLIGHT` of each flight; else as `write_scene_images`.

    ``settings.frames`` does not matter.

    Raises:
        RequestError: fewer than one picture, or the folder holds files.
    """
    settings = replace(settings, frames=_PER_FLIGHT * _APART)
    _write(folder, count, (settings.width, settings.height), partial(_drone_pictures, settings, seed), _PER_FLIGHT)


def write_panorama_images(folder: Path, count: int, settings: PanoramaPictures, seed: int) -> None:
    """Render ``count`` pictures of people in unrolled views of ceiling cameras; else as `write_scene_images`.

    Raises:
        RequestError: fewer than one picture, or the folder holds files.
    """
    _write(folder, count, (settings.width, settings.height), partial(_panorama_picture, settings, seed))


def _write(
    folder: Path, count: int, size: tuple[int, int], render: Callable[[Path, range], list[Labels]], together: int = 1
) -> None:
    if count < 1:
        raise RequestError(f"expected at least one picture to generate for {folder}, got {count}")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with output_folder(folder, overwrite=False) as work:
        (work / "img1").mkdir()
        numbers = [range(start, min(start + together, count)) for start in range(0, count, together)]
        found = on_all_cores(partial(render, work / "img1"), numbers, 8 // together or 1)
        labels = [each for some in found for each in some]
        write_ground_truth(work / "gt" / "gt.txt", _as_ground_truth(labels))
        write_sequence_info(work, _SEQUENCE, 1.0, count, *size)


def _street_picture(settings: TrainingSettings, seed: int, folder: Path, numbers: range) -> list[Labels]:
    return [
        _saved(folder, number, *random_training_scene(np.random.default_rng([seed, number]), settings))
        for number in numbers
    ]


@lru_cache(maxsize=1)
def _stock(sprites: str, photographs: str) -> Stock:
    return Stock(
        SpriteLibrary(sprites) if sprites else None,
        Photographs(photographs) if photographs else None,
    )


def _varied_picture(pictures: VariedPictures, seed: int, folder: Path, numbers: range) -> list[Labels]:
    labels = []
    stock = _stock(pictures.sprites, pictures.photographs)
    for number in numbers:
        rng = np.random.default_rng([seed, number])
        labels.append(_saved(folder, number, *random_training_scene(rng, pictures.settings(rng), stock)))
    return labels


def _drone_pictures(settings: DroneSceneSettings, seed: int, folder: Path, numbers: range) -> list[Labels]:
    flight = plan_flight(settings, seed + numbers.start)
    labels = []
    for number in numbers:
        image, truth = draw_flight(flight, _APART * (number % _PER_FLIGHT))
        labels.append(_saved(folder, number, image, truth.people.boxes, truth.people.visibility))
    return labels


def _panorama_picture(settings: PanoramaPictures, seed: int, folder: Path, numbers: range) -> list[Labels]:
    return [
        _saved(folder, number, *panorama_picture(np.random.default_rng([seed, number]), settings)) for number in numbers
    ]


def _saved(folder: Path, number: int, image: ImageArray, boxes: FloatArray, visibility: FloatArray) -> Labels:
    path = folder / f"{number + 1:06d}.jpg"
    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    large = ((boxes[:, 2:] - boxes[:, :2]) > 1).all(axis=1)
    return boxes[large], visibility[large]


def _as_ground_truth(labels: list[Labels]) -> GroundTruth:
    boxes = np.concatenate([b for b, _ in labels])
    everyone = np.ones(len(boxes), dtype=np.bool_)
    return GroundTruth(
        frames=np.repeat(np.arange(len(labels)), [len(b) for b, _ in labels]),
        ids=np.arange(1, len(boxes) + 1),
        boxes=boxes,
        evaluated=everyone,
        ignored=~everyone,
        visibility=np.concatenate([v for _, v in labels]),
    )
