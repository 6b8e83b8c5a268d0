"""The ball scene on disk: a folder of images per camera, cameras, empty rooms and truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2

from tsuiseki.datamodules.scenes.ball.carried import CarriedBallSettings, backgrounds, film, make_scene
from tsuiseki.datamodules.scenes.clip_files import numbered, write_image
from tsuiseki.tracking.cameras.files import PlacedCamera, write_cameras
from tsuiseki.tracking.formats.track3d import write_path3d
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.tracks import Path3D

QUALITY = 95


def write_ball(
    folder: Path,
    settings: CarriedBallSettings,
    seed: int,
    watch: Callable[[Iterable[list[ImageArray]]], Iterable[list[ImageArray]]] = iter,
) -> None:
    """Write ``camera1/000001.jpg`` ..., ``background1.png`` ..., ``cameras.yaml`` and ``truth.csv``.

    Args:
        folder: made where it is missing; files in it are overwritten.
        settings: of the film.
        seed: of all random numbers.
        watch: passes the moments through, for progress.
    """
    scene = make_scene(settings, seed)
    names = [f"camera{k + 1}" for k in range(settings.cameras)]
    for name, image in zip(names, backgrounds(scene, seed), strict=True):
        (folder / name).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"{name.replace('camera', 'background')}.png"), image[:, :, ::-1])
    for index, images in enumerate(watch(film(scene, seed))):
        for name, image in zip(names, images, strict=True):
            write_image(folder / name / numbered(index), image, QUALITY)
    placed = [PlacedCamera(n, c, settings.frame_rate) for n, c in zip(names, scene.cameras, strict=True)]
    write_cameras(folder / "cameras.yaml", placed)
    write_path3d(folder / "truth.csv", Path3D(scene.times, scene.truth))
