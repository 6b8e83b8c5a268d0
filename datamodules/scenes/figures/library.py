"""Sprites of rendered people in a folder: written once, shown in many pictures."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt, PositiveInt
from pydantic.dataclasses import dataclass as settings_dataclass

from tsuiseki.datamodules.scenes.clip import Span
from tsuiseki.datamodules.scenes.figures.assets import Assets
from tsuiseki.datamodules.scenes.figures.rendering import STEEP, Sprite, random_sprites
from tsuiseki.datamodules.scenes.people.poses import draw_pose
from tsuiseki.datamodules.scenes.people.posture import Build
from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.images import decoded_image
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.processes import on_all_cores

_INDEX = "sprites.csv"
_COLUMNS = ("file", "feet_x", "feet_y", "head_x", "head_y", "height", "tilt", "left", "right")
# Only where somebody is placed by the middle, and of who neither stands nor walks; see `Sprite`.
_POSED = ("middle", "heading", "pose")


@settings_dataclass(frozen=True, config=SETTINGS)
class SpriteSettings:
    """A library of rendered people.

    Attributes:
        people: how many.
        views: poses and sides of each.
        height: of a person, pixels.
        processes: how many render at a time; 0 takes all cores.
        tilts: (least, greatest) angle that the cameras look down, radians, -0.5 to 1.55.
        poses: share of the views in which somebody neither stands nor walks, in [0, 1].
    """

    people: PositiveInt = 240
    views: PositiveInt = 5
    height: Annotated[int, Field(ge=32, le=1024)] = 256
    processes: NonNegativeInt = 0
    tilts: Span[Annotated[float, Field(ge=-0.5, le=1.55)]] = (-0.08, 0.95)
    poses: Share = 0.0


class SpriteLibrary:
    """The sprites of a folder, read when they are asked for.

    Raises:
        RequestError: the folder holds no library.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        index = self.folder / _INDEX
        if not index.is_file():
            raise RequestError(
                f"expected a folder of rendered people with a file {_INDEX}, got {self.folder}; "
                "make one with `tsuiseki simulate sprites`"
            )
        with index.open() as file:
            self._rows = list(csv.DictReader(file))
        if self._rows and (missing := [c for c in _COLUMNS if c not in self._rows[0]]):
            raise RequestError(f"{index}: expected columns {', '.join(_COLUMNS)}, got none {missing[0]}; make it anew")
        self.tilts = np.array([float(row["tilt"]) for row in self._rows])
        self.poses = np.array([(row.get("pose") or "").rsplit(" ", 1)[0] for row in self._rows], dtype=str)

    def __len__(self) -> int:
        return len(self._rows)

    @lru_cache(maxsize=4096)  # noqa: B019
    def sprite(self, number: int) -> Sprite:
        """The picture, normals, labels and joints of a row of the index; ``number`` counts from 0."""
        row = self._rows[number]
        name = str(self.folder / row["file"])
        colours = decoded_image(f"{name}.png", cv2.IMREAD_UNCHANGED)
        normals = decoded_image(f"{name}.normal.png")
        if colours is None or normals is None or colours.shape[2:] != (4,):
            raise RequestError(f"expected pictures {name}.png and {name}.normal.png, got none; make the folder anew")
        feet_x, feet_y, head_x, head_y, height, tilt, *sides = (float(row[c]) for c in _COLUMNS[1:])
        albedo, label = np.ascontiguousarray(colours[..., 2::-1], np.uint8), np.asarray(colours[..., 3] // 32, np.uint8)
        normal = (normals[..., ::-1].astype(np.int16) - 128).astype(np.int8)
        feet, head = np.array([feet_x, feet_y]), np.array([head_x, head_y])
        sprite = Sprite(albedo, normal, label, feet, head, height, tilt, np.array(sides), float(row.get("middle", 0)))
        if not (drawn := row.get("pose")):
            return sprite
        pose, seed = drawn.rsplit(" ", 1)
        posed = draw_pose(int(seed), Build(height), pose)
        return replace(sprite, heading=float(row["heading"]), pose=posed, drawn=drawn)

    def near(self, rng: np.random.Generator, tilt: float, pose: str | None = None) -> Sprite:
        """A random one of those seen from about so high, ``tilt`` in radians: of the nearest twentieth.

        With a ``pose``, see `poses.draw_pose`, of those that have it; "" is who stands or walks.

        Raises:
            RequestError: nobody has the pose.
        """
        among = np.arange(len(self)) if pose is None else np.flatnonzero(self.poses == pose)
        if not len(among):
            raise RequestError(
                f"{self.folder}: expected rendered people who are {pose or 'standing'}, got none; "
                "`tsuiseki simulate sprites --poses 0.8` renders some"
            )
        count = max(len(among) // 20, 1)
        nearest = among[np.argpartition(np.abs(self.tilts[among] - tilt), count - 1)[:count]]
        return self.sprite(int(nearest[rng.integers(count)]))


def write_sprites(
    folder: str | Path,
    assets: str | Path,
    settings: SpriteSettings,
    seed: int,
    watch: Callable[[Iterator[list[list[str]]]], Iterator[list[list[str]]]] = iter,
) -> Path:
    """Render a library into ``folder``; person n depends on ``seed``, n and the assets only.

    Args:
        folder: does not exist yet or is empty.
        assets: the unpacked packages, see `assets.Assets`.
        settings: how many and how large.
        seed: of all random numbers.
        watch: passes people on as they are drawn, to show how far it is.

    Raises:
        RequestError: the assets are not there, or ``folder`` is a file or holds files.
    """
    folder = Path(folder).resolve()
    Assets(assets)
    with output_folder(folder, overwrite=False) as work:
        draw = partial(_person, work, Path(assets), settings, seed)
        people = watch(on_all_cores(draw, range(settings.people), 4, settings.processes))
        rows = [row for views in people for row in views]
        with (work / _INDEX).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(_COLUMNS + (_POSED if len(rows[0]) > len(_COLUMNS) else ()))
            for number, row in enumerate(rows):
                person, view = divmod(number, settings.views)
                writer.writerow([f"{person:04d}-{view}", *row])
    return folder


_opened = lru_cache(maxsize=1)(Assets)


def _person(work: Path, assets: Path, settings: SpriteSettings, seed: int, person: int) -> list[list[str]]:
    rng = np.random.default_rng([seed, person])
    rows, placed_anyhow = [], settings.poses > 0 or settings.tilts[1] > STEEP
    sprites = random_sprites(rng, _opened(assets), settings.views, settings.height, settings.tilts, settings.poses)
    for view, sprite in enumerate(sprites):
        name = str(work / f"{person:04d}-{view}")
        # The label lies where a picture viewer expects opacity, so that the files can be viewed.
        opacity = np.where(sprite.label > 0, sprite.label * np.uint8(32) + np.uint8(31), 0).astype(np.uint8)
        _write_png(f"{name}.png", np.dstack([sprite.albedo[..., ::-1], opacity]))
        shifted = (sprite.normal.astype(np.int16) + 128).astype(np.uint8)
        _write_png(f"{name}.normal.png", shifted[..., ::-1])
        numbers = [*sprite.feet, *sprite.head, sprite.height, sprite.tilt, *sprite.steady]
        posed = [f"{sprite.middle:.4f}", f"{sprite.heading:.4f}", sprite.drawn] if placed_anyhow else []
        rows.append([*(f"{number:.4f}" for number in numbers), *posed])
    return rows


def _write_png(path: str, pixels: NDArray[Any]) -> None:
    """Write BGR or BGRA; `cv2.imwrite` would say nothing of a full disk, and takes no names that are not UTF-8."""
    Path(path).write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
