"""The ball scene on disk: a folder of images per camera, cameras, empty rooms and truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2

from tsuiseki.datamodules.scenes.ball import BallSettings, backgrounds, film, make_scene
from tsuiseki.tracking.cameras.files import PlacedCamera, write_cameras
from tsuiseki.tracking.formats.track3d import Path3D, write_path3d
from tsuiseki.tracking.output import RunRecord, output_folder
from tsuiseki.tracking.types import ImageArray

QUALITY = 95


def write_ball(
    folder: Path,
    settings: BallSettings,
    seed: int,
    overwrite: bool = False,
    watch: Callable[[Iterable[list[ImageArray]]], Iterable[list[ImageArray]]] = iter,
) -> Path:
    """Write ``camera1/000001.jpg`` ..., ``background1.png`` ..., ``cameras.yaml`` and ``truth.csv``.

    Raises:
        RequestError: as `tracking.output.output_folder`.
    """
    with output_folder(folder, overwrite) as work:
        scene = make_scene(settings, seed)
        names = [f"camera{k + 1}" for k in range(settings.cameras)]
        for name, image in zip(names, backgrounds(scene, seed), strict=True):
            (work / name).mkdir()
            cv2.imwrite(str(work / f"{name.replace('camera', 'background')}.png"), image[:, :, ::-1])
        for index, images in enumerate(watch(film(scene, seed))):
            for name, image in zip(names, images, strict=True):
                file = work / name / f"{index + 1:06d}.jpg"
                cv2.imwrite(str(file), image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        placed = [PlacedCamera(n, c, settings.frame_rate) for n, c in zip(names, scene.cameras, strict=True)]
        write_cameras(work / "cameras.yaml", placed)
        write_path3d(work / "truth.csv", Path3D(scene.times, scene.truth))
        words = ("tsuiseki", "simulate", "sphere")
        RunRecord(words, {name: getattr(settings, name) for name in settings.__dataclass_fields__}, seed).write(work)
    return folder
