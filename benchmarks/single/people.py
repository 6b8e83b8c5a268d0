"""People of labelled sequences as single targets: small, alike, and hidden by each other. None taught a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.detectors.accuracy import video_in
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source

# Most frames that a person is followed.
LONGEST = 150
# Fewest frames that a person is labelled.
SHORTEST = 60
# Visible share of a person in the first frame, at least.
CLEAR = 0.9
# People of a sequence, those who are labelled longest.
COUNT = 12


class PersonClip(NamedTuple):
    """One person to follow, from the first frame on.

    Attributes:
        name: of the sequence, and the person's number.
        images: of the frames.
        boxes: ``(T, 4)`` pixels.
        visible: ``(T,)`` share in [0, 1]; 1 where the labels do not say.
    """

    name: str
    images: list[ImageArray]
    boxes: FloatArray
    visible: FloatArray


def people_clips(data: Path) -> Iterator[PersonClip]:
    """Of PETS09-S2L1 and of MOT17-13, whose camera moves; none where ``data`` lacks them."""
    mot = data / "mot"
    pets, bus = mot / "PETS09-S2L1-first", mot / "mot17-13-video"
    for folder in (pets, bus):
        if folder.is_dir():
            yield from _people(folder, folder if folder == pets else video_in(folder))


def _people(folder: Path, source: Path) -> Iterator[PersonClip]:
    truth = read_ground_truth(folder / "gt" / "gt.txt")
    images = [frame.image for frame in open_source(source).frames()]
    rows = truth.select(truth.evaluated & (truth.frames < len(images)))
    people = []
    for person in np.unique(rows.ids):
        of = rows.select(rows.ids == person)
        begin = int(np.argmax(of.visibility >= CLEAR))
        # Up to the first gap in the labels.
        frames = of.frames[begin:]
        end = begin + int(np.argmax(np.append(np.diff(frames) > 1, True))) + 1
        if of.visibility[begin] >= CLEAR and end - begin >= SHORTEST:
            people.append(of.select(slice(begin, min(end, begin + LONGEST))))
    people.sort(key=len, reverse=True)
    for of in people[:COUNT]:
        shown = [images[frame] for frame in of.frames]
        yield PersonClip(f"{folder.name} {of.ids[0]}", shown, of.boxes, of.visibility)
