"""Which result belongs to which truth: files and folders as they are given on a command line.

A result is a text file, or a folder that holds one for each sequence, in any of the places of `RESULT_PLACES`. What it
is scored against is read by `read_truths`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import (
    DetectionScores,
    LabelledBoxes,
    evaluate_detections,
    labelled_boxes,
)
from tsuiseki.tracking.evaluation.multi import SequencePair, restrict
from tsuiseki.tracking.evaluation.stretch import warn_of_other_frames
from tsuiseki.tracking.evaluation.truths import Truth
from tsuiseki.tracking.formats.mot import read_detections, read_tracks
from tsuiseki.tracking.types import Detections

# Where the result of the sequence NAME may lie in a folder of results, the most specific place first.
RESULT_PLACES = ("{name}/tracks.txt", "{name}.txt", "{name}/{name}.txt", "{name}/gt/gt.txt")
# Where it may lie when the truth is a single sequence.
SINGLE_RESULT_PLACES = ("tracks.txt", "gt/gt.txt")
DETECTION_PLACES = ("{name}/detections.txt", "{name}.txt", "{name}/det/det.txt")
SINGLE_DETECTION_PLACES = ("detections.txt", "det/det.txt")


@dataclass(frozen=True)
class DetectionEvaluation:
    """Scores of detections on every sequence, and on the images of all of them."""

    sequences: Mapping[str, DetectionScores]
    combined: DetectionScores


def match_results(truths: Sequence[Truth], result: Path) -> list[SequencePair]:
    """Every truth with its result in the frames that count.

    Args:
        truths: the labels.
        result: a text file where there is one truth, or a folder.

    Raises:
        RequestError: a sequence has no result, or it is broken.
    """
    pairs = []
    for truth in truths:
        file = result_file(truth.name, result, len(truths) == 1, RESULT_PLACES, SINGLE_RESULT_PLACES)
        tracks = read_tracks(file)
        warn_of_other_frames(file, int(truth.labels.frames[0]), int(truth.labels.frames[-1]))
        pairs.append(SequencePair(truth.name, truth.labels, restrict(tracks, truth.frames), truth.length))
    return pairs


def evaluate_detection_files(
    truths: Sequence[Truth],
    result: Path,
    iou: float = 0.5,
    score_range: tuple[float, float] = (0.0, 1.0),
) -> DetectionEvaluation:
    """Average precision of detections in files.

    Args:
        truths: the labels.
        result: a text file where there is one truth, or a folder.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score to expect.

    Raises:
        RequestError: a sequence has no detections, or they are broken.
    """
    images: dict[str, tuple[list[LabelledBoxes], list[Detections]]] = {}
    for truth in truths:
        file = result_file(truth.name, result, len(truths) == 1, DETECTION_PLACES, SINGLE_DETECTION_PLACES)
        found = read_detections(file, truth.length, score_range)
        warn_of_other_frames(file, int(truth.labels.frames[0]), int(truth.labels.frames[-1]))
        last = max(int(truth.labels.frames[-1]), len(found) - 1)
        wanted = truth.frames.within(truth.length or last + 1)
        assert wanted.last is not None
        # Frames in which there is nothing change no score, and a file may have many of them.
        filled = {*truth.labels.frames.tolist(), *(n for n, one in enumerate(found) if len(one))}
        numbers = sorted(number for number in filled if wanted.first <= number <= wanted.last)
        none = Detections.empty()
        images[truth.name] = (
            labelled_boxes(truth.labels, numbers),
            [found[n] if n < len(found) else none for n in numbers],
        )
    return DetectionEvaluation(
        {name: evaluate_detections(boxes, found, iou) for name, (boxes, found) in images.items()},
        evaluate_detections(
            [image for boxes, _ in images.values() for image in boxes],
            [image for _, found in images.values() for image in found],
            iou,
        ),
    )


def result_file(name: str, result: Path, single: bool, places: Sequence[str], single_places: Sequence[str]) -> Path:
    """The file of sequence ``name``; ``single`` says that there is no other sequence."""
    if result.is_file():
        if not single:
            raise RequestError(f"expected a folder with the results of several sequences, got the file {result}")
        return result
    if not result.is_dir():
        raise RequestError(f"expected a result file or a folder of results, found no {result}")
    tried = [*(place.format(name=name) for place in places), *(single_places if single else ())]
    for place in tried:
        if (result / place).is_file():
            return result / place
    raise RequestError(f"{result}: expected the result of {name} as {' or '.join(tried)}, found none")
