"""Which result belongs to which truth: files and folders as they are given on a command line.

A truth is a ``gt.txt``, a sequence folder, or a folder of sequences. A result is a text file, or a folder that holds
one for each sequence, in any of the places of `RESULT_PLACES`.
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
from tsuiseki.tracking.formats.mot import (
    GroundTruth,
    find_sequences,
    read_detections,
    read_ground_truth,
    read_sequence,
    read_tracks,
)
from tsuiseki.tracking.frame_range import FrameRange
from tsuiseki.tracking.types import Detections, Track

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


@dataclass(frozen=True)
class Truth:
    """The labels of one sequence.

    Attributes:
        name: of the sequence.
        labels: its ground truth.
        length: number of frames; None where nothing tells.
    """

    name: str
    labels: GroundTruth
    length: int | None


def read_truths(path: Path, frames: FrameRange | None = None) -> list[Truth]:
    """The labels at ``path``: a ``gt.txt``, a sequence folder, or a folder of sequences.

    Args:
        path: where they are.
        frames: the stretch to keep; frames keep their numbers.

    Raises:
        RequestError: there are none, they are broken, or nothing in the stretch counts.
    """
    if path.is_dir():
        found = [(s.name, s.ground_truth_path, s.length) for s in find_sequences(path)]
    elif path.is_file():
        found = [_of_file(path)]
    else:
        raise RequestError(f"expected a ground truth, a sequence folder or a folder of sequences, found no {path}")
    truths = [Truth(name, read_ground_truth(file), length or None) for name, file, length in found]
    return [_restricted(truth, frames) for truth in truths] if frames else truths


def match_results(truths: Sequence[Truth], result: Path, frames: FrameRange | None = None) -> list[SequencePair]:
    """Every truth with its result.

    Args:
        truths: the labels.
        result: a text file where there is one truth, or a folder.
        frames: the stretch to keep.

    Raises:
        RequestError: a sequence has no result, or it is broken.
    """
    pairs = []
    for truth in truths:
        tracks = read_tracks(result_file(truth.name, result, len(truths) == 1, RESULT_PLACES, SINGLE_RESULT_PLACES))
        pairs.append(SequencePair(truth.name, truth.labels, _cut(tracks, frames), truth.length))
    return pairs


def evaluate_detection_files(
    truths: Sequence[Truth],
    result: Path,
    frames: FrameRange | None = None,
    iou: float = 0.5,
    score_range: tuple[float, float] = (0.0, 1.0),
) -> DetectionEvaluation:
    """Average precision of detections in files.

    Args:
        truths: the labels, already cut to ``frames``.
        result: a text file where there is one truth, or a folder.
        frames: the stretch to score.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score to expect.

    Raises:
        RequestError: a sequence has no detections, or they are broken.
    """
    images: dict[str, tuple[list[LabelledBoxes], list[Detections]]] = {}
    for truth in truths:
        file = result_file(truth.name, result, len(truths) == 1, DETECTION_PLACES, SINGLE_DETECTION_PLACES)
        found = read_detections(file, truth.length, score_range)
        last = max(int(truth.labels.frames[-1]), len(found) - 1)
        wanted = (frames or FrameRange()).within(truth.length or last + 1)
        assert wanted.last is not None
        numbers = range(wanted.first, wanted.last + 1)
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


def _of_file(path: Path) -> tuple[str, Path, int]:
    """Name and length of the sequence that a ``gt/gt.txt`` lies in, where it lies in one."""
    folder = path.resolve().parent.parent
    if path.name == "gt.txt" and path.resolve().parent.name == "gt" and (folder / "seqinfo.ini").is_file():
        sequence = read_sequence(folder)
        return sequence.name, path, sequence.length
    return (folder.name if path.name == "gt.txt" else path.stem), path, 0


def _restricted(truth: Truth, frames: FrameRange) -> Truth:
    last = int(truth.labels.frames.max())
    wanted = frames.within(truth.length or last + 1)
    assert wanted.last is not None
    labels = truth.labels.between(wanted.first, wanted.last)
    if not labels.evaluated.any():
        raise RequestError(f"{truth.name}: expected a labelled box that counts in frames {frames}, got none")
    return Truth(truth.name, labels, truth.length)


def _cut(tracks: list[Track], frames: FrameRange | None) -> list[Track]:
    if frames is None:
        return tracks
    latest = max((int(track.frames[-1]) for track in tracks), default=0)
    return restrict(tracks, frames.first, latest if frames.last is None else frames.last)


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
