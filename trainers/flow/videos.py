"""Labelled sequences with detections: what stands beside the labels, drawn from them, or those of a detector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.datamodules.labelled_images import picture_files
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.detection_tables import boxes_of_frames
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import owners_of
from tsuiseki.tracking.features.action import ActionRecogniser, averaged
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import Describe, Detector
from tsuiseki.tracking.formats.labelled import LabelledVideo, open_labelled
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.mot_sequence import MotSequence, find_sequences
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.flow.graphs import DetectedVideo

# About what detections of MOT17, MOT15, KITTI and PETS are off their labels: much, and much the same a frame later.
LIKE_REAL = DetectorFaults(jitter=0.03, steady=0.8)
# Frames per second where nothing says it: that of Okutama-Action's videos.
OTHER_RATE = 30.0
# Intersection over union with its label from which a detected box lies right.
RIGHT_OVERLAP = 0.5
# A badly placed box still shows its person: links through it are right, though the box itself counts as wrong.
SAME_OVERLAP = 0.25
# Where detections come from: det/det.txt, drawn from the labels, or a detector.
Find: TypeAlias = Detector | Literal["given", "simulated"]


def labelled_sequences(folders: Sequence[Path], frame_rate: float = OTHER_RATE) -> Iterator[DetectedVideo]:
    """The labelled sequences of folders, without detections but those of reviewed results.

    Args:
        folders: sequences, or folders of them.
        frame_rate: of layouts that do not tell it, frames a second.

    Raises:
        RequestError: nothing known is there, or an id stands twice in a frame.
    """
    for folder in folders:
        sequences = _sequences(folder)
        for labelled in open_labelled(folder):
            sequence = next((candidate for candidate in sequences if candidate.name == labelled.name), None)
            truth = labelled.people()
            length = labelled.length or int(truth.frames.max(initial=-1)) + 1
            images = picture_files(labelled)
            if sequence is not None:
                images, width, height = sequence.images, sequence.width, sequence.height
            else:
                height, width = read_image(images[0]).shape[:2] if images else (0, 0)
            yield DetectedVideo(
                labelled.name,
                _solved(labelled, length),
                truth,
                labelled.frame_rate or (frame_rate if sequence is None else sequence.frame_rate),
                (width, height) if min(width, height) > 0 else None,
                images,
                detections_file=None if sequence is None else sequence.detections_path,
            )


def _solved(video: LabelledVideo, length: int) -> list[Detections]:
    """The detections that a reviewed result was solved on; none elsewhere."""
    if video.network is None or not video.network.is_file():
        return [Detections.empty()] * length
    network = SolvedNetwork.read(video.network)
    rows = [np.flatnonzero(network.frames == video.first + n) for n in range(length)]
    return [Detections(network.boxes[here], network.scores[here]) for here in rows]


def detected(
    video: DetectedVideo,
    find: Find,
    rng: np.random.Generator,
    faults: DetectorFaults = LIKE_REAL,
    frames: tuple[int, int] | None = None,
) -> DetectedVideo:
    """The sequence with detections.

    Args:
        video: the sequence.
        find: where they come from.
        rng: of drawn detections.
        faults: of drawn detections.
        frames: first and last frame for a detector, 1-based; by default all.

    Raises:
        RequestError: labels without detections, or images for a detector that are not there.
    """
    if find == "given":
        if any(map(len, video.detections)):
            return video
        if video.detections_file is None or not video.detections_file.is_file():
            raise RequestError(
                f"expected det/det.txt beside the labels of {video.name}, found none; give a detector, or detections "
                "simulated"
            )
        return replace(video, detections=read_detections(video.detections_file, len(video.detections)))
    if find == "simulated":
        wide, tall = video.size or np.ceil(video.truth.boxes[:, 2:].max(axis=0)).astype(int).tolist()
        drawn = simulate_detections(rng, video.truth, len(video.detections), wide, tall, faults)
        return replace(video, detections=drawn)
    if not video.images:
        raise RequestError(
            f"{video.name}: expected images for the detector, in img1/ say; found none, so give detections"
        )
    first, last = frames or (1, len(video.images))
    nothing = Detections.empty(), np.empty(0, dtype=np.int64)
    simulated: list[tuple[Detections, IntArray]] = [
        find.detect_at_anchors([read_image(path)])[0] if first <= number <= last else nothing
        for number, path in enumerate(video.images, start=1)
    ]
    return replace(
        video,
        detections=[detections for detections, _ in simulated],
        anchors=tuple(anchors for _, anchors in simulated),
    )


def span_of(video: DetectedVideo, frames: tuple[int, int] | None) -> tuple[int, int]:
    """The first of some ``frames`` of a sequence, which count from 1, and the one after the last, both from 0.

    Raises:
        RequestError: the sequence has no such frame.
    """
    length = len(video.detections)
    first, last = (1, length) if frames is None else (max(frames[0], 1), min(frames[1], length))
    if first > last:
        raise RequestError(f"{video.name}: no frame lies within {frames}; it has {length}")
    return first - 1, last


def detected_videos(
    folders: Sequence[Path],
    find: Find,
    frames: tuple[int, int] | None = None,
    seed: int = 0,
    frame_rate: float = OTHER_RATE,
) -> Iterator[DetectedVideo]:
    """The labelled sequences of folders with detections, cut to ``frames``; see `labelled_sequences` and `detected`.

    Raises:
        RequestError: see these two; no person to learn from, or detections that lie on none.
    """
    rng = np.random.default_rng(seed)
    for sequence in labelled_sequences(folders, frame_rate):
        video = detected(sequence, find, rng, frames=frames)
        check_video(video)
        yield video if frames is None else between(video, frames[0] - 1, frames[1])


def described(video: DetectedVideo, appearance: Describe | None, span: tuple[int, int] | None = None) -> DetectedVideo:
    """The sequence with what its detections look like.

    Args:
        video: the sequence.
        appearance: describes them; None leaves them as they are.
        span: first frame that is described, from 0, and the one after the last; by default all.

    Raises:
        RequestError: it has no images.
    """
    if appearance is None:
        return video
    _check_images(video, "the appearance")
    first, end = span or (0, len(video.detections))
    detections = [
        observed.with_features(appearance.describe(read_image(path), observed.boxes))
        if first <= frame < end
        else observed
        for frame, (observed, path) in enumerate(zip(video.detections, video.images, strict=False))
    ]
    return replace(video, detections=detections)


def acting(video: DetectedVideo, recognise: ActionRecogniser | None) -> DetectedVideo:
    """The sequence with what people do, by the mean of all streams.

    Raises:
        RequestError: it has no images.
    """
    if recognise is None:
        return video
    _check_images(video, "the actions")
    detections, images = [], list[ImageArray]()
    for observed, path in zip(video.detections, video.images, strict=False):
        images = [*images, read_image(path)][-1 - recognise.history :]
        detections.append(replace(observed, actions=averaged(recognise.recognise(images, observed.boxes))))
    return replace(video, detections=detections)


def filmed(video: DetectedVideo) -> DetectedVideo:
    """The sequence with the camera's motion, from its images, as `track drone` takes it.

    Raises:
        RequestError: it has no images.
    """
    _check_images(video, "the camera's motion")
    path, steps = CameraPath(), []
    for detections, image in zip(video.detections, video.images, strict=False):
        path.add(read_image(image), detections.boxes)
        steps.append(path.step(len(path) - 1))
    return replace(video, camera=tuple(steps))


def _check_images(video: DetectedVideo, what: str) -> None:
    if len(video.images) < len(video.detections):
        raise RequestError(f"{video.name}: expected an image a frame in img1/ for {what}, got {len(video.images)}")


def check_video(video: DetectedVideo) -> None:
    """Refuse what would be learnt from silently and wrongly.

    Raises:
        RequestError: no person to learn from, or detections that lie on none.
    """
    truth = video.truth.select(video.truth.evaluated)
    if not len(truth):
        raise RequestError(
            f"{video.name}: expected labels of people who count, got none; see columns 7 and 8 of gt.txt"
        )
    frames, boxes, _ = boxes_of_frames(video.detections)
    if len(boxes) and not (owners_of(frames, boxes, truth) >= 0).any():
        raise RequestError(
            f"{video.name}: expected detections on labelled people, but none of {len(boxes)} overlaps one by half; are "
            "they of the same class, size and frames?"
        )


def _sequences(folder: Path) -> list[MotSequence]:
    try:
        return list(find_sequences(folder))
    except RequestError:
        return []


def part_of(video: DetectedVideo, first: float, last: float) -> DetectedVideo:
    """The part from one share of the frames to another, both in [0, 1]."""
    count = len(video.detections)
    return between(video, round(first * count), round(last * count))


def between(video: DetectedVideo, first: int, end: int) -> DetectedVideo:
    """The frames from ``first`` to before ``end``, numbered from 0."""
    first, end = max(first, 0), min(end, len(video.detections))
    truth: GroundTruth = video.truth.between(first, end - 1)
    moved = replace(truth, frames=truth.frames - first)
    detections, images, anchors = list(video.detections[first:end]), video.images[first:end], video.anchors[first:end]
    camera = video.camera[first:end]
    return replace(video, detections=detections, truth=moved, images=images, anchors=anchors, camera=camera)


def match_boxes(boxes: FloatArray, labelled: FloatArray) -> tuple[IntArray, BoolArray]:
    """``(N,)`` index of the label that each detected box shows, -1 for none, and whether the box lies right."""
    overlaps = iou_matrix(boxes, labelled)
    person = _assign(overlaps, RIGHT_OVERLAP)
    right = person >= 0
    # What is matched already takes no further part.
    overlaps[right] = 0
    overlaps[:, person[right]] = 0
    return np.maximum(person, _assign(overlaps, SAME_OVERLAP)), right


def _assign(overlaps: FloatArray, least: float) -> IntArray:
    """``(N,)`` column assigned to each row, best total first (Hungarian), -1 where there is none."""
    result = np.full(len(overlaps), -1, dtype=np.int64)
    rows, columns = assign_overlaps(overlaps, least)
    result[rows] = columns
    return result
