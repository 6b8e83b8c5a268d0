"""A tiny street: people as textured boxes who walk before a fixed view, and a decoy that stands still."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.types import FloatArray, ImageArray, Track

SIZE = (160, 120)
FRAMES = 110
DECOY = np.array([146.0, 80.0, 158.0, 116.0])


def view(seed: int = 0) -> ImageArray:
    """A place with edges and corners, another for each seed."""
    rng = np.random.default_rng(seed)
    image = np.full((SIZE[1], SIZE[0], 3), 120, dtype=np.uint8)
    for _ in range(40):
        x, y = rng.integers(0, SIZE[0]), rng.integers(0, SIZE[1])
        colour = tuple(int(c) for c in rng.integers(60, 190, 3))
        cv2.rectangle(image, (int(x), int(y)), (int(x + rng.integers(6, 30)), int(y + rng.integers(6, 30))), colour, -1)
    return image


def box_of(person: int, frame: int) -> FloatArray:
    """Where ``person`` is."""
    left = 10.0 + 1.1 * frame if person == 0 else 120.0 - 0.9 * frame
    top = 30.0 + 30 * person
    return np.array([left, top, left + 14, top + 40])


def people(frame: int) -> FloatArray:
    """``(2, 4)`` boxes."""
    return np.stack([box_of(0, frame), box_of(1, frame)])


def picture(frame: int, seed: int = 0, moved: int = 0) -> ImageArray:
    """The street at ``frame``, by a camera that has moved by so many pixels."""
    image = np.roll(view(seed), moved, axis=1).copy()
    colours = ((15, 15, 15), (250, 250, 250))
    x1, y1, x2, y2 = DECOY.astype(int)
    image[y1:y2, x1:x2] = (240, 240, 40)
    for box, colour in zip(people(frame), colours, strict=True):
        x1, y1, x2, y2 = box.round().astype(int).clip(0)
        image[y1:y2, x1:x2] = colour
    return image


def write_video(folder: Path, frames: int = FRAMES, seed: int = 0, pan: int = 0) -> Path:
    """A sequence folder of it; ``pan`` is the movement of the camera a frame."""
    (folder / "img1").mkdir(parents=True)
    for frame in range(frames):
        image = picture(frame, seed, pan * frame)
        cv2.imwrite(str(folder / "img1" / f"{frame + 1:06d}.jpg"), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
    write_sequence_info(folder, folder.name, 10.0, frames, *SIZE)
    return folder


def track_of(person: int, frames: int = FRAMES, shift: float = 0.0, score: float = 0.9) -> Track:
    """The track of a person, its boxes off by ``shift`` widths on the right side."""
    boxes = np.stack([box_of(person, f) for f in range(frames)]) + np.array([0, 0, 14 * shift, 0])
    return Track(person + 1, np.arange(frames), boxes, np.full(frames, score))


def decoy_track(frames: int = FRAMES) -> Track:
    """The track of what never moves."""
    return Track(9, np.arange(frames), np.tile(DECOY, (frames, 1)), np.full(frames, 0.95))
