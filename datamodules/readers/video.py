"""Labelled video of any layout that is known, as labelled images: the layout is seen from the folder."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.datamodules.readers import mot
from tsuiseki.datamodules.readers.mot import LabelledImage
from tsuiseki.datamodules.readers.okutama import okutama_images
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.okutama_folders import has_okutama_layout
from tsuiseki.tracking.formats.visdrone import find_visdrone, is_visdrone, read_visdrone


def labelled_images(folder: str | Path, frames: tuple[int, int] | None = None) -> list[LabelledImage]:
    """The labelled images in ``folder``, of MOTChallenge's, VisDrone-MOT's or Okutama-Action's layout.

    Args:
        folder: of a data set, or a sequence or a folder of sequences of MOTChallenge.
        frames: first and last frame of each sequence, 1-based and both included; by default all.

    Raises:
        RequestError: nothing usable is there.
    """
    folder = Path(folder)
    if has_okutama_layout(folder):
        samples = okutama_images(folder, frames)
    elif is_visdrone(folder):
        samples = _visdrone_images(folder, frames)
    else:
        return mot.labelled_images(folder, frames)
    if not samples:
        raise RequestError(f"{folder}: no frame lies within {frames}; frames count from 1")
    return samples


def _visdrone_images(folder: Path, frames: tuple[int, int] | None) -> list[LabelledImage]:
    samples = []
    for sequence in find_visdrone(folder):
        truth = read_visdrone(sequence.labels, len(sequence.images))
        truth = truth.select(truth.evaluated | truth.ignored)
        first, last = frames or (1, len(sequence.images))
        for frame in range(max(first, 1) - 1, min(last, len(sequence.images))):
            rows = truth.between(frame, frame)
            image = sequence.images[frame]
            samples.append(
                LabelledImage(image, sequence.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility)
            )
    return samples
