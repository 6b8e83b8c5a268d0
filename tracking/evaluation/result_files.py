"""Results that are scored: their names, what they hold, and the labels of the frames that count."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.detection import (
    DetectionEvaluation,
    DetectionScores,
    evaluate_detections,
    labelled_boxes,
)
from tsuiseki.tracking.evaluation.frame_offset import frame_offset, moved
from tsuiseki.tracking.evaluation.multi import MANY, SequencePair, restrict, where_labelled
from tsuiseki.tracking.features.exported import Detect, open_detector
from tsuiseki.tracking.formats.exports import format_at, read_boxes
from tsuiseki.tracking.formats.label_checks import (
    PEOPLE,
    NothingLabelledError,
    compare_with_labels,
    compare_with_picture,
    same_class,
)
from tsuiseki.tracking.formats.labelled import Size, open_labelled
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.okutama import Protocol
from tsuiseki.tracking.formats.result_folder import recorded
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import RUN_FILE, is_partial
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Track
from tsuiseki.tracking.types.class_choice import PERSON_NAMES
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.image_folder import read_image


@dataclass(frozen=True)
class Truth:
    """The labels of one sequence.

    Attributes:
        name: of the sequence.
        labels: its ground truth, of the frames that count.
        length: number of frames; None where nothing tells.
        frames: that count; results in others are passed over.
        size: width and height of the pictures, where the sequence says.
        kind: number or name of the class that the labels are of; None for people, whatever class results have.
        classes: names by number, where the layout has numbers.
        files: one image a frame; empty where only labels are there.
        listed: ``(N,)`` frames that the labels speak of, in order; None for all. Results in others are passed over.
    """

    name: str
    labels: GroundTruth
    length: int | None
    frames: FrameRange = EVERY_FRAME
    size: Size = None
    kind: int | str | None = None
    classes: Mapping[int, str] = field(default_factory=dict)
    files: Sequence[Path] = ()
    listed: IntArray | None = None


def read_truths(
    path: Path,
    frames: FrameRange = EVERY_FRAME,
    protocol: Protocol = "lenient",
    size: Size = None,
    kind: int | str | None = None,
    single: bool = False,
) -> list[Truth]:
    """The labels at ``path``.

    Args:
        path: see `open_labelled`.
        frames: to keep, with their numbers.
        protocol: by which Okutama-Action's labels count, see `okutama_truth`.
        size: width and height of the frames that were tracked, for Okutama-Action's labels; by default those of the
            frames that lie with them, or else of those that come with the data.
        kind: number or name of a class; by default people. Videos in which none of it is labelled are left out.
        single: boxes without ids count, too.

    Raises:
        RequestError: there are none, they are broken, or no label in these frames counts.
    """
    truths, without = [], list[NothingLabelledError]()
    for video in open_labelled(path):
        try:
            labels = video.people(protocol, size, kind, single)
        except NothingLabelledError as error:
            without.append(error)
            continue
        about = video.size, kind, video.classes, video.files, video.listed
        truths.append(Truth(video.name, labels, video.length, video.counted(protocol), *about))
    if without and (kind is None or not truths):
        raise without[0]
    for omission in without:
        warnings.warn(f"{omission}; left out", InputWarning, stacklevel=2)
    return [_restricted(truth, frames) for truth in truths] if frames != EVERY_FRAME else truths


def _restricted(truth: Truth, frames: FrameRange) -> Truth:
    last = int(truth.labels.frames.max())
    within = frames.within(truth.length or last + 1)
    assert within.last is not None
    first = max(within.first, truth.frames.first)
    labels = truth.labels.between(first, within.last)
    if not labels.evaluated.any():
        raise RequestError(f"{truth.name}: expected a labelled box that counts in frames {frames}, got none")
    return replace(truth, labels=labels, frames=FrameRange(first, frames.last))


# Detections of a network from this score on are scored.
LOWEST_SCORE = 0.05
# Shares of a person that are visible, from and below.
VISIBLE = ((0.75, 1.01), (0.5, 0.75), (0.25, 0.5), (0.0, 0.25))
# What results of different runs are called alike tells nothing apart.
USUAL_NAMES = ("tracks.txt", "tracks.json", "det.txt", "gt.txt", "states.csv")


def result_names(results: Sequence[Path]) -> list[str]:
    """One name a result: the ends of their paths, as short as tells them apart.

    Raises:
        RequestError: a result stands twice.
    """
    parts = [_distinctive_parts(path.resolve()) for path in results]
    if len(set(parts)) != len(parts):
        raise RequestError("expected different results to compare, got one twice")
    depths = range(1, max(map(len, parts)) + 1)
    candidates = (["/".join(path[-depth:]) for path in parts] for depth in depths)
    return next(candidate for candidate in candidates if len(set(candidate)) == len(candidate))


def _distinctive_parts(path: Path) -> tuple[str, ...]:
    """The parts of ``path`` without what all results are called."""
    if path.is_file():
        path = path.parent if path.name in USUAL_NAMES else path.with_suffix("")
    return path.parts


def tracked_frames(result: Path) -> FrameRange | None:
    """The frames that were tracked for the file ``result``; None where nothing says so."""
    try:
        values = read_json(result.parent / RUN_FILE, "the record of a run")
        if result.name not in values["files"]:
            return None
        numbers = values["frames"]["frame"]
        return FrameRange(int(numbers[0]) - 1, int(numbers[-1]) - 1)
    except (ValueError, KeyError, IndexError, TypeError):
        return None


def tracked_times(folder: Path) -> FloatArray:
    """``(F,)`` when the frames of the run in a folder were, seconds; none where nothing says so."""
    record = read_json(folder / RUN_FILE, "the record of a run") if (folder / RUN_FILE).is_file() else {}
    try:
        return np.asarray(record["frames"]["time"], dtype=np.float64).reshape(-1)
    except (ValueError, KeyError, TypeError):
        return np.empty(0)


def warn_of_other_frames(result: Path, first: int, last: int, offset: int = 0) -> None:
    """Say that of the file ``result`` frames ``first`` to ``last``, 0-based, are scored that were not tracked.

    The frames that were tracked are ``offset`` later.
    """
    tracked = tracked_frames(result)
    if tracked is not None and offset:
        tracked = FrameRange(max(tracked.first + offset, 0), None if tracked.last is None else tracked.last + offset)
    if tracked is not None and (tracked.first > first or tracked.last is None or tracked.last < last):
        kind = "a partial result, of" if is_partial(result.parent) else "of"
        warnings.warn(
            f"{result} is {kind} frames {tracked} alone, but {first + 1}-{last + 1} are scored; for its own use "
            f"`frames` {tracked}",
            InputWarning,
            stacklevel=3,
        )
    elif tracked is None and is_partial(result.parent):
        warnings.warn(f"{result} is a partial result; score those it has with `frames`", InputWarning, stacklevel=3)


def check_size(result: Path, truth: Truth) -> None:
    """Refuse the file ``result`` of a run on a video of another size than the labels'; raises RequestError."""
    size = recorded(result.parent).size if result.suffix == ".txt" else None
    if size is not None and truth.size is not None and size != tuple(truth.size):
        raise RequestError(
            f"{result}: expected a result of {truth.name}, {truth.size[0]}x{truth.size[1]} pixels, got one of "
            f"{size[0]}x{size[1]}; track the video that is labelled"
        )


# Where the result of the sequence NAME may lie in a folder of results, the most specific place first; and where besides
# when the truth is a single sequence.
Places: TypeAlias = tuple[Sequence[str], Sequence[str]]
RESULT_PLACES: Places = (
    ("{name}/tracks.txt", "{name}.txt", "{name}/{name}.txt", "{name}/gt/gt.txt", "data/{name}.txt"),
    ("tracks.txt", "gt/gt.txt"),
)
DETECTION_PLACES: Places = (
    ("{name}/detections.txt", "{name}.txt", "{name}/det/det.txt"),
    ("detections.txt", "det/det.txt"),
)


def match_results(truths: Sequence[Truth], result: Path, offset: int = 0) -> list[SequencePair]:
    """Every truth with its result in the frames that count.

    Args:
        truths: the labels.
        result: a file that `read_boxes` reads, where there is one truth; or a folder.
        offset: frames to add to the numbers of the result.

    Raises:
        RequestError: a sequence has no result, or it is broken.
    """
    pairs = []
    for truth in truths:
        file = result
        if len(truths) > 1 or not format_at(result):
            file = result_file(truth.name, result, len(truths) == 1, RESULT_PLACES)
        tracks = read_boxes(file, truth.size)
        compare_with_picture(file, np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)]), truth.size)
        check_size(file, truth)
        if offset:
            tracks = moved(file, tracks, offset, FrameRange(0, truth.length - 1 if truth.length else None))
        if fit := frame_offset(truth.labels, tracks):
            warnings.warn(f"{file}: {fit.hint(offset)}", InputWarning, stacklevel=2)
        else:
            warn_of_other_frames(file, int(truth.labels.frames[0]), int(truth.labels.frames[-1]), offset)
        if truth.kind is not None:
            tracks = of_class(truth, tracks, file)
        else:
            warn_of_classes(tracks, file)
        tracks = restrict(tracks, truth.frames, truth.listed)
        pairs.append(SequencePair(truth.name, truth.labels, tracks, truth.length))
    return pairs


def warn_of_classes(tracks: Sequence[Track], file: object) -> None:
    """Say that tracks of which a file says that they are no people are scored as people, beside others that are."""
    others = [track for track in tracks if track.class_name.lower() not in ("", *PERSON_NAMES)]
    if not others or len(others) == len(tracks):
        return
    names = ", ".join(sorted({track.class_name for track in others}))
    line = f"{len(others)} of {len(tracks)} tracks are of {names}, and count as false; `classes` person leaves them out"
    warnings.warn(f"{file}: {line}", InputWarning, stacklevel=3)


def of_class(truth: Truth, tracks: Sequence[Track], file: object) -> list[Track]:
    """The tracks of the class that the labels are of; all where none has a class.

    Names that a run keeps decide, else the numbers of the labels' own layout.

    Raises:
        RequestError: the tracks have numbers that nothing explains.
    """
    name = truth.classes.get(truth.kind, str(truth.kind)) if isinstance(truth.kind, int) else str(truth.kind)
    if all(track.class_id < 0 for track in tracks):
        return list(tracks)
    unknown = {track.class_id for track in tracks if not track.class_name} - {-1, *truth.classes}
    if unknown:
        numbers = ", ".join(map(str, sorted(unknown)))
        raise RequestError(
            f"{file}: expected names of the classes {numbers} in column 8, which the labels' layout does not number; a "
            "run's folder has them in run.json, and a file of one class needs no number"
        )
    chosen = []
    for track in tracks:
        track_name = track.class_name or truth.classes.get(track.class_id, "")
        # The layout may tell several classes of people apart.
        by_name = track.class_name or name == PEOPLE
        same = same_class(track_name, name) if by_name else track_name.lower() == name.lower()
        chosen += [track] if same else []
    return chosen


def evaluate_detection_files(
    truths: Sequence[Truth],
    result: Path,
    iou: float = 0.5,
    score_range: tuple[float, float] = (0.0, 1.0),
) -> DetectionEvaluation:
    """Average precision of detections in files, or of a detector.

    Args:
        truths: the labels.
        result: a text file where there is one truth, a folder, or an exported detector, which runs on the images.
        iou: overlap from which a detection is right.
        score_range: smallest and largest score to expect.

    Raises:
        RequestError: a sequence has no detections, or they are broken.
    """
    network = open_detector(result, max(score_range[0], LOWEST_SCORE)) if result.suffix == ".onnx" else None
    by_sequence: dict[str, tuple[GroundTruth, list[int], list[Detections]]] = {}
    for truth in truths:
        if network is not None:
            file, detections = result, _detected(truth, network, score_range[1])
        else:
            file = result_file(truth.name, result, len(truths) == 1, DETECTION_PLACES)
            detections = read_detections(file, truth.length, score_range)
        by_sequence[truth.name] = (truth.labels, *_frames_that_count(truth, file, detections, network is None))

    def scored(sequences: Iterable[tuple[GroundTruth, list[int], list[Detections]]]) -> DetectionScores:
        parts = list(sequences)
        boxes = [image for labels, numbers, _ in parts for image in labelled_boxes(labels, numbers)]
        return evaluate_detections(boxes, [image for _, _, detections in parts for image in detections], iou)

    visible: dict[str, DetectionScores] = {}
    shares = np.concatenate([labels.visibility[labels.evaluated] for labels, _, _ in by_sequence.values()])
    for low, high in VISIBLE if (shares < 1).any() else ():
        if ((shares >= low) & (shares < high)).any():
            name = f"visible {100 * low:.0f}-{100 * min(high, 1):.0f} %"
            visible[name] = scored((_visible(labels, low, high), n, d) for labels, n, d in by_sequence.values())
    sequences = {name: scored([part]) for name, part in by_sequence.items()}
    for name, (labels, _, images) in by_sequence.items():
        right = round(float(sequences[name].recall.max(initial=0)) * sequences[name].boxes)
        compare_with_labels(name, right, np.concatenate([image.boxes for image in images]), labels.boxes)
    return DetectionEvaluation(sequences, scored(by_sequence.values()), visible)


def _frames_that_count(
    truth: Truth, file: Path, detections: Sequence[Detections], from_text: bool
) -> tuple[list[int], list[Detections]]:
    """Numbers of the frames that a score depends on, and the detections of each; warns of what looks wrong.

    Frames in which there is nothing change no score, and a file may have many of them.
    """
    boxes = np.concatenate([np.empty((0, 4)), *(frame.boxes for frame in detections)])
    compare_with_picture(file, boxes, truth.size)
    warn_of_other_frames(file, int(truth.labels.frames[0]), int(truth.labels.frames[-1]))
    last = max(int(truth.labels.frames[-1]), len(detections) - 1)
    within = truth.frames.within(truth.length or last + 1)
    assert within.last is not None
    filled = {*truth.labels.frames.tolist(), *np.flatnonzero([len(frame) for frame in detections]).tolist()}
    filled &= filled if truth.listed is None else {*truth.listed.tolist()}
    numbers = sorted(number for number in filled if within.first <= number <= within.last)
    counted = np.repeat(numbers, [len(detections[n]) if n < len(detections) else 0 for n in numbers])
    labelled = where_labelled(truth.name, truth.labels.frames, counted, truth.length)
    if from_text:
        _warn_of_a_segment(file, truth.labels, counted)
    left_out = {*counted[~labelled].tolist()}
    numbers = [number for number in numbers if number not in left_out]
    return numbers, [detections[n] if n < len(detections) else Detections.empty() for n in numbers]


def _detected(truth: Truth, network: Detect, highest: float) -> list[Detections]:
    """The detections of a network in the labelled images that count, with scores up to ``most``.

    Raises:
        RequestError: there are no images.
    """
    if not truth.length or len(truth.files) != truth.length:
        raise RequestError(f"{truth.name}: expected images beside the labels, to detect in, found none")
    within = truth.frames.within(truth.length)
    detections = [Detections.empty()] * truth.length
    assert within.last is not None
    numbers = np.arange(within.first, within.last + 1)
    for number in numbers[np.isin(numbers, numbers if truth.listed is None else truth.listed)].tolist():
        image = network.detect([read_image(truth.files[number])])[0]
        detections[number] = image.select(image.scores <= highest)
    return detections


def _warn_of_a_segment(file: Path, labels: GroundTruth, frames: IntArray) -> None:
    """Say that many labels lie before the first frame ``(N,)`` with a detection, or after the last."""
    rows = labels.frames[labels.evaluated]
    if len(frames) and ((rows < frames[0]) | (rows > frames[-1])).sum() > MANY * len(rows):
        there, scored = (f"{numbers[0] + 1}-{numbers[-1] + 1}" for numbers in (frames, rows))
        message = (
            f"{file} has detections in frames {there} alone, but {scored} are scored; for its own use `frames` {there}"
        )
        warnings.warn(message, InputWarning, stacklevel=3)


def _visible(labels: GroundTruth, low: float, high: float) -> GroundTruth:
    """The labels of people of whom such a share is visible; all others are ignored."""
    here = (labels.visibility >= low) & (labels.visibility < high)
    return replace(labels, evaluated=labels.evaluated & here, ignored=labels.ignored | (labels.evaluated & ~here))


def result_file(name: str, result: Path, single: bool, places: Places) -> Path:
    """The file of sequence ``name``; ``single`` says that there is no other sequence."""
    if result.is_file():
        if not single:
            raise RequestError(f"expected a folder with the results of several sequences, got the file {result}")
        return result
    if not result.is_dir():
        raise RequestError(f"expected a result file or a folder of results, found no {result}")
    tried = [*(place.format(name=name) for place in places[0]), *(places[1] if single else ())]
    for place in tried:
        if (result / place).is_file():
            return result / place
    raise RequestError(f"{result}: expected the result of {name} as {' or '.join(tried)}, found none")
