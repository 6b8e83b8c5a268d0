"""MOTChallenge folders as training samples: one labelled image a frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import Sequence, find_sequences, read_ground_truth
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class LabelledImage:
    """One image and the people labelled in it.

    Attributes:
        path: of the image.
        sequence: name of the sequence it belongs to.
        frame: 0-based.
        boxes: ``(N, 4)`` pixels, of evaluated and ignored people.
        ids: ``(N,)`` one number a person within the sequence.
        ignored: ``(N,)`` boxes that are neither an example nor a counter-example.
        visibility: ``(N,)`` visible share in [0, 1].
    """

    path: Path
    sequence: str
    frame: int
    boxes: FloatArray
    ids: IntArray
    ignored: BoolArray
    visibility: FloatArray


def labelled_images(folder: str | Path, frames: tuple[int, int] | None = None) -> list[LabelledImage]:
    """The labelled images of a sequence folder, or of every sequence in a folder of them.

    Args:
        folder: in the MOTChallenge layout.
        frames: first and last frame, 1-based and both included as the files count; by default all.

    Raises:
        RequestError: there is no sequence, a sequence has no images or no usable label, or no frame is left.
    """
    samples = [sample for sequence in find_sequences(folder) for sample in _images_of(sequence, frames)]
    if not samples:
        raise RequestError(f"{folder}: no frame lies within {frames}; frames count from 1")
    return samples


def _images_of(sequence: Sequence, frames: tuple[int, int] | None) -> Iterable[LabelledImage]:
    if not sequence.images:
        raise RequestError(f"{sequence.folder}: expected images in img1/, found none; training needs them")
    truth = read_ground_truth(sequence.ground_truth_path)
    truth = truth.select(truth.evaluated | truth.ignored)
    first, last = frames or (1, sequence.length)
    for frame in range(max(first, 1) - 1, min(last, sequence.length)):
        rows = truth.between(frame, frame)
        yield LabelledImage(
            sequence.images[frame], sequence.name, frame, rows.boxes, rows.ids, rows.ignored, rows.visibility
        )
