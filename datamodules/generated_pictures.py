"""Folders of generated pictures of people, in the MOTChallenge layout, that detectors learn from. No torch."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.footage import TrainingSource
from tsuiseki.datamodules.scenes.clip import IMAGES, FrameTruth, ground_truth, write_image
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings, plan_drone
from tsuiseki.datamodules.scenes.figures.library import SpriteLibrary
from tsuiseki.datamodules.scenes.render.photographs import Photographs
from tsuiseki.datamodules.scenes.room_pictures import panorama_picture
from tsuiseki.datamodules.scenes.training_pictures import SETTINGS_OF_SCENE, THINGS, TOWN, Stock, random_training_scene
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.types import FloatArray, ImageArray

_SEQUENCE = "random-scenes"
# Pictures of one clip of a drone, and frames between two of them: long enough for other poses and views.
_PER_CLIP, _APART = 6, 45
# Generated pictures from a drone are as a window of a frame that is half as wide again: people large enough to learn.
_DRONE_PEOPLE, _DRONE_FOCAL = 7, (1.5, 3.0)


def check_source(source: TrainingSource) -> None:
    """Refuse a source that asks for what the pictures of its scene do not show.

    Raises:
        RequestError: it does.
    """
    where = source.folder
    given = [name for name in ("sprites", "photographs", "town", "things") if getattr(source, name)]
    given += ["boxes"] if source.boxes != "silhouettes" else []
    if given and source.scene in ("street", "drone", "ceiling"):
        raise RequestError(
            f"{where}: expected `{given[0]}` with a varied, sparse, aerial, near or overhead scene, got {source.scene}"
        )
    if source.sun and source.scene in ("street", "ceiling"):
        raise RequestError(
            f"{where}: expected `sun` with a varied, sparse, aerial, near, overhead or drone scene, got {source.scene}"
        )
    if source.boxes == "steady" and not source.sprites:
        raise RequestError(f"{where}: expected `sprites` with steady `boxes`, which are theirs, got none")
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
    photographs = _stock(source.sprites, source.photographs).photographs
    if source.things and not (photographs and photographs.paths["things"]):
        where = f"in {source.photographs}/things" if source.photographs else "with `things`"
        raise RequestError(f"expected photographs of things {where}, got none")
    folder.parent.mkdir(parents=True, exist_ok=True)
    together = _PER_CLIP if source.scene == "drone" else 1
    with output_folder(folder, overwrite=False) as work:
        numbers = [range(start, min(start + together, count)) for start in range(0, count, together)]
        found = on_all_cores(partial(_drawn, source, size, work), numbers, 8 // together or 1)
        truth = ground_truth([each for some in found for each in some])
        truth = replace(truth, ids=np.arange(1, len(truth) + 1))
        write_ground_truth(work / "gt" / "gt.txt", truth)
        write_sequence_info(work, _SEQUENCE, 1.0, count, *size)


def _drawn(source: TrainingSource, size: tuple[int, int], folder: Path, numbers: range) -> list[FrameTruth]:
    """Draw the pictures of these numbers into ``folder``, and say what they show; nobody has an id yet."""
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
        image, truth = _drone_clip(size, source.sun, source.seed + number - in_clip).draw_frame(_APART * in_clip)
        return image, truth.boxes, truth.visibility
    rng = np.random.default_rng([source.seed, number])
    if source.scene == "ceiling":
        return panorama_picture(rng, *size)
    settings = replace(
        SETTINGS_OF_SCENE[source.scene](rng, *size),
        town=TOWN if source.town else (0, 0),
        things=THINGS if source.things else (0, 0),
        sun=source.sun,
        boxes=source.boxes,
    )
    return random_training_scene(rng, settings, _stock(source.sprites, source.photographs))


@lru_cache(maxsize=1)
def _drone_clip(size: tuple[int, int], sun: float, seed: int) -> DroneClip:
    settings = DroneSceneSettings(*size, frames=_PER_CLIP * _APART, people=_DRONE_PEOPLE, focal=_DRONE_FOCAL, sun=sun)
    return plan_drone(settings, seed)


@lru_cache(maxsize=1)
def _stock(sprites: str, photographs: str) -> Stock:
    return Stock(
        SpriteLibrary(sprites) if sprites else None,
        Photographs(photographs) if photographs else None,
    )
