"""`tsuiseki simulate sprites`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.cli.simulate.options import fill

T = TypeVar("T")


def sprites(
    output: SeededOutput,
    assets: Path,
    people: int = 260,
    views: int = 5,
    height: int = 256,
    tilts: tuple[float, float] = (-0.08, 0.95),
) -> int:
    """Render people from body meshes and clothes, cut out, to be shown in the pictures that detectors learn from.

    DIR gets two pictures of each view, colours and normals, and sprites.csv. Training takes it as data.train's sprites.

    Args:
        out: folder for the sprites.
        assets: folder with the unpacked body packages; docs/methods/rendered-people.md says how to get them.
        people: how many.
        views: poses and sides of each.
        height: of a person, pixels.
        tilts: least and greatest angle that cameras look down, radians; 0.2,1.3 for people under drones.
    """
    from tsuiseki.datamodules.scenes.figures.library import SpriteSettings, write_sprites

    settings = SpriteSettings(people, views, height, tilts=tilts)

    def watch(drawn: Iterable[T]) -> Iterator[T]:
        return progress(drawn, "rendering", people)

    told = f"{people} people of {height} pixels in {views} views each"
    return fill(output, told, lambda folder: write_sprites(folder, assets, settings, output.seed, watch=watch))
