"""A room's clip as a folder: a MOTChallenge sequence for each camera, cameras.yaml, and everybody's places."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

from tsuiseki.datamodules.scenes.clip_files import ground_truth, write_images, write_info
from tsuiseki.datamodules.scenes.rooms.ceiling import (
    RoomClip,
    RoomSettings,
    RoomTruth,
    draw_room_frame,
    plan_room,
    view_room,
)
from tsuiseki.tracking.cameras.floor_files import CameraOverFloor, write_floor_cameras
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalLens
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import ImageArray

Drawn: TypeAlias = tuple[ImageArray, RoomTruth]
CAMERAS_FILE, PLACES_FILE = "cameras.yaml", "gt/world.csv"


def write_room(
    folder: str | Path,
    settings: RoomSettings,
    seed: int,
    lens: OmnidirectionalLens | None = None,
    overwrite: bool = False,
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
) -> Path:
    """Write a clip: ``camera1``, ``camera2`` (``img1``, ``gt/gt.txt``, ``gt/world.csv``) and ``cameras.yaml``.

    Ids are the same in all cameras. ``gt/world.csv`` has frame (from 1), id, x, y in metres of those in ``gt.txt``.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        lens: of the cameras, of any size; by default an equidistant one.
        overwrite: a clip that the folder holds is replaced.
        watch: passes the frames of a camera on as they are drawn, to show how far it is.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    clip = plan_room(settings, seed, lens)
    with output_folder(folder, overwrite) as work:
        for number in range(len(clip.cameras)):
            _write_view(work / f"camera{number + 1}", clip, number, watch)
        write_floor_cameras(work / CAMERAS_FILE, cameras_of(clip))
    return folder


def cameras_of(clip: RoomClip) -> list[CameraOverFloor]:
    """The clip's cameras as `cameras.yaml` has them."""
    rate = clip.settings.frame_rate
    return [CameraOverFloor(f"camera{k + 1}", camera, clip.floor, rate) for k, camera in enumerate(clip.cameras)]


def _write_view(folder: Path, clip: RoomClip, number: int, watch: Callable[[Iterator[Drawn]], Iterator[Drawn]]) -> None:
    settings = clip.settings
    view = view_room(clip, number)
    frames = (draw_room_frame(clip, view, frame) for frame in range(settings.frames))
    truths = write_images(folder / "img1", watch(frames), settings.jpeg)
    write_ground_truth(folder / "gt" / "gt.txt", ground_truth(truths))
    write_places(folder / PLACES_FILE, truths)
    write_info(folder, folder.name, settings)


def write_places(path: Path, truths: list[RoomTruth]) -> None:
    """Write frame (from 1), id, x, y (metres) a row."""
    rows = [
        f"{frame + 1},{number},{x:.4f},{y:.4f}\n"
        for frame, truth in enumerate(truths)
        for number, (x, y) in zip(truth.ids.tolist(), truth.places.tolist(), strict=True)
    ]
    path.write_text("frame,id,x,y\n" + "".join(rows), encoding="utf-8")
