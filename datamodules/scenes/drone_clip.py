"""A drone's clip as a folder: the MOTChallenge layout, and the actions in Okutama-Action's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.drone import DroneSettings, DroneTruth, draw_flight, plan_flight
from tsuiseki.datamodules.scenes.street import as_ground_truth
from tsuiseki.tracking.formats.mot import write_ground_truth, write_sequence_info
from tsuiseki.tracking.formats.okutama import ActionLabels, actions_of, write_okutama
from tsuiseki.tracking.output import output_folder
from tsuiseki.tracking.types import ImageArray

Drawn: TypeAlias = tuple[ImageArray, DroneTruth]
ACTIONS_FILE = "gt/actions.txt"
# Somebody of whom less than this share shows is labelled as occluded.
OCCLUDED = 0.4


def drone_frames(settings: DroneSettings, seed: int) -> Iterator[Drawn]:
    """The frames of a clip as ``(H, W, 3)`` uint8 RGB images, before JPEG, and what they show."""
    flight = plan_flight(settings, seed)
    for frame in range(settings.frames):
        yield draw_flight(flight, frame)


def write_drone(
    folder: str | Path,
    settings: DroneSettings,
    seed: int,
    overwrite: bool = False,
    name: str = "",
    watch: Callable[[Iterator[Drawn]], Iterator[Drawn]] = iter,
) -> Path:
    """Write a clip: ``img1/000001.jpg``, ..., ``gt/gt.txt``, ``seqinfo.ini``, and Okutama-Action's ``gt/actions.txt``.

    Args:
        folder: does not exist yet or is empty, unless ``overwrite``.
        settings: of the clip.
        seed: of all chance.
        overwrite: a clip that the folder holds is replaced.
        name: of the sequence; by default the folder's.
        watch: passes the frames on as they are drawn, to show how far it is.

    Raises:
        RequestError: ``folder`` is a file, holds files while ``overwrite`` is False, or cannot be made.
    """
    folder = Path(folder).resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with output_folder(folder, overwrite) as work:
        (work / "img1").mkdir()
        truths = []
        for frame, (image, truth) in enumerate(watch(drone_frames(settings, seed))):
            truths.append(truth)
            data = cv2.imencode(".jpg", image[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, settings.jpeg])[1]
            (work / "img1" / f"{frame + 1:06d}.jpg").write_bytes(data.tobytes())
        size = settings.width, settings.height
        rows = as_ground_truth([t.people for t in truths])
        write_ground_truth(work / "gt" / "gt.txt", rows)
        hidden, none = rows.visibility < OCCLUDED, np.zeros(len(rows), dtype=np.bool_)
        actions = actions_of([names for t in truths for names in t.actions])
        write_okutama(
            work / ACTIONS_FILE, ActionLabels(rows.frames, rows.ids, rows.boxes, none, hidden, none, actions), size
        )
        write_sequence_info(work, name or folder.name, settings.frame_rate, settings.frames, *size)
    return folder
