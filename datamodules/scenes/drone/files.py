"""A drone's clip as a folder: MOTChallenge's layout with actions, or Okutama-Action's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.clip_files import write_images, write_info
from tsuiseki.datamodules.scenes.drone.clip import DroneSceneSettings, DroneTruth, draw_flight, plan_flight
from tsuiseki.datamodules.scenes.street.street import as_ground_truth
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.formats.okutama import ACTIONS_FILE, actions_of, write_okutama
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.labels import ActionLabels

Drawn: TypeAlias = tuple[ImageArray, DroneTruth]
Layout = Literal["mot", "okutama"]
OKUTAMA_FRAMES = "Drone1/Morning/Extracted-Frames-1280x720"
OKUTAMA_LABELS = "Labels/SingleActionTrackingLabels/3840x2160"
# Somebody of whom less than this share shows is labelled as occluded.
OCCLUDED = 0.4


def drone_frames(settings: DroneSceneSettings, seed: int) -> Iterator[Drawn]:
    """The frames of a clip as ``(H, W, 3)`` uint8 RGB images, before JPEG, and what they show."""
    flight = plan_flight(settings, seed)
    for frame in range(settings.frames):
        yield draw_flight(flight, frame)


def write_drone(
    folder: str | Path,
    settings: DroneSceneSettings,
    seed: int,
    overwrite: bool = False,
    name: str = "",
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
    layout: Layout = "mot",
) -> Path:
    """Write a clip in MOTChallenge's layout with ``gt/actions.txt``, or in Okutama-Action's.

    The former is ``img1/000001.jpg``, ..., ``gt/gt.txt``, ``seqinfo.ini``; the latter
    ``Drone1/Morning/Extracted-Frames-1280x720/NAME/0.jpg``, ... and
    ``Labels/SingleActionTrackingLabels/3840x2160/NAME.txt``.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        overwrite: a clip that the folder holds is replaced.
        name: of the sequence; by default the folder's, in Okutama-Action's layout ``1.1.1``.
        watch: passes the frames on as they are drawn, to show how far it is.
        layout: ``mot`` or ``okutama``.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with output_folder(folder, overwrite) as work:
        name = name or (folder.name if layout == "mot" else "1.1.1")
        frames = watch(drone_frames(settings, seed))
        if layout == "mot":
            truths = write_images(work / "img1", frames, settings.jpeg)
        else:
            truths = write_images(work / OKUTAMA_FRAMES / name, frames, settings.jpeg, "{}.jpg".format)
        _write_labels(work, settings, truths, name, layout)
    return folder


def _write_labels(
    work: Path, settings: DroneSceneSettings, truths: list[DroneTruth], name: str, layout: Layout
) -> None:
    rows = as_ground_truth([t.people for t in truths])
    hidden, none = rows.visibility < OCCLUDED, np.zeros(len(rows), dtype=np.bool_)
    actions = actions_of([names for t in truths for names in t.actions])
    labels = ActionLabels(rows.frames, rows.ids, rows.boxes, none, hidden, none, actions, OKUTAMA_ACTIONS)
    size = settings.width, settings.height
    if layout == "okutama":
        write_okutama(work / OKUTAMA_LABELS / f"{name}.txt", labels, size)
        return
    write_okutama(work / ACTIONS_FILE, labels, size)
    write_ground_truth(work / "gt" / "gt.txt", rows)
    write_info(work, name, settings)
