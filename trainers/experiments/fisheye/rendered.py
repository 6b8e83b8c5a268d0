"""Rendered rooms, kept on disk as pictures and truth, so that every network and every row sees the same ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.clip import FrameTruth
from tsuiseki.datamodules.scenes.room_clip import (
    SIZES,
    Room,
    RoomClip,
    RoomSettings,
    plan_room,
)
from tsuiseki.tracking.cameras.lens_files import read_lens
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.video.image_folder import read_image

# Frames per second of the rooms (thesis 4.3.1), and people of each sequence; the small room's vary as in Table 4.2.
RATE = 15
PEOPLE: dict[Room, tuple[int, ...]] = {"large": (6,), "small": (4, 10, 3, 6)}
TRUTH = ("ids", "boxes", "visibility", "places")
QUALITY = 95
# Pictures of a part, which is kept when a run is stopped: three quarters of a minute of work.
PART = 180


@dataclass(frozen=True)
class Sequence:
    """One camera of one room, or a part of what it sees.

    Attributes:
        room: large or small.
        seed: of the room.
        camera: 0 or 1.
        seconds: length.
        rate: frames per second that are looked at, 1 or 15.
        calibration: lens file; None takes an equidistant lens.
        part: number of the part of `PART` pictures, from 0.
    """

    room: Room
    seed: int
    camera: int
    seconds: int
    rate: Literal[1, 15]
    calibration: Path | None
    part: int = 0


def parts_of(sequence: Sequence) -> list[Sequence]:
    """The parts of a sequence, in order."""
    return [replace(sequence, part=part) for part in range(-(-sequence.seconds * sequence.rate // PART))]


def plan(sequence: Sequence) -> RoomClip:
    """The room of a sequence; its people walk alike at every rate."""
    people = PEOPLE[sequence.room]
    settings = RoomSettings(
        size=SIZES[sequence.room],
        frames=sequence.seconds * RATE,
        frame_rate=float(RATE),
        people=people[sequence.seed % len(people)],
    )
    lens = None if sequence.calibration is None else read_lens(sequence.calibration)
    return plan_room(settings, 10_000 + sequence.seed, lens)


def frames_of(sequence: Sequence) -> range:
    """The frames of the room's clip that are looked at in a part."""
    every = range(0, sequence.seconds * RATE, RATE // sequence.rate)
    return every[sequence.part * PART : (sequence.part + 1) * PART]


def render(folder: Path, sequence: Sequence) -> None:
    """Write the pictures of a sequence and what they show to ``folder``."""
    clip = plan(sequence)
    view = clip.view(sequence.camera)
    folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[Any]] = {name: [] for name in ("count", *TRUTH)}
    for frame in frames_of(sequence):
        image, truth = clip.draw_frame(view, frame)
        cv2.imwrite(str(_path(folder, frame)), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        rows["count"].append(np.array([len(truth.ids)]))
        for name in TRUTH:
            rows[name].append(getattr(truth, name))
    arrays: dict[str, Any] = {name: np.concatenate(values) for name, values in rows.items()}
    np.savez_compressed(folder / "truth.npz", **arrays)


def read_rendered(folder: Path, sequence: Sequence) -> Iterator[tuple[int, ImageArray, FrameTruth]]:
    """Frame number, picture ``(H, W, 3)`` uint8 RGB and truth of each frame that `render` wrote."""
    with np.load(folder / "truth.npz", allow_pickle=False) as stored:
        ends = np.cumsum(stored["count"])[:-1]
        truths = [np.split(stored[name], ends) for name in TRUTH]
    for frame, *values in zip(frames_of(sequence), *truths, strict=True):
        yield frame, read_image(_path(folder, frame)), FrameTruth(*values)


def _path(folder: Path, frame: int) -> Path:
    return folder / f"{frame:06d}.jpg"
