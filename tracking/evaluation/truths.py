"""What results are scored against: the labels at a path, whose layout is seen from what is there.

A MOTChallenge ``gt.txt``, sequence folder or folder of sequences; a label file or the folder of Okutama-Action; the
folders of VisDrone-MOT and of Drone-Action. Which boxes count is said where each format is read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.drone_action import find_drone_action, has_drone_action_layout, read_drone_action_boxes
from tsuiseki.tracking.formats.mot import find_sequences, list_images, read_ground_truth, read_sequence
from tsuiseki.tracking.formats.okutama import Protocol, counted_from, okutama_truth
from tsuiseki.tracking.formats.okutama_folders import (
    OkutamaVideo,
    clip_labelled_by,
    find_okutama,
    has_okutama_layout,
    is_okutama_file,
    read_clip_labels,
    read_okutama_video,
)
from tsuiseki.tracking.formats.visdrone import VisDroneSequence, find_visdrone, is_visdrone, read_visdrone
from tsuiseki.tracking.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth


@dataclass(frozen=True)
class Truth:
    """The labels of one sequence.

    Attributes:
        name: of the sequence.
        labels: its ground truth, of the frames that count.
        length: number of frames; None where nothing tells.
        frames: that count; results in others are passed over.
    """

    name: str
    labels: GroundTruth
    length: int | None
    frames: FrameRange = EVERY_FRAME


def read_truths(
    path: Path,
    frames: FrameRange = EVERY_FRAME,
    protocol: Protocol = "lenient",
    size: tuple[int, int] | None = None,
) -> list[Truth]:
    """The labels at ``path``.

    Args:
        path: see the module.
        frames: the stretch to keep; frames keep their numbers.
        protocol: by which Okutama-Action's labels count, see `okutama_truth`.
        size: width and height of the frames that were tracked, for Okutama-Action's labels; by default those of the
            frames that lie with them, or else of those that come with the data.

    Raises:
        RequestError: there are none, they are broken, or nothing in the stretch counts.
    """
    if path.is_dir() and has_okutama_layout(path):
        truths = [_of_okutama(video, protocol, size) for video in find_okutama(path)]
    elif path.is_dir() and is_visdrone(path):
        truths = [_of_visdrone(sequence) for sequence in find_visdrone(path)]
    elif path.is_dir() and has_drone_action_layout(path):
        truths = _of_drone_action(path)
    elif path.is_dir():
        truths = [Truth(s.name, read_ground_truth(s.ground_truth_path), s.length or None) for s in find_sequences(path)]
    elif path.is_file() and is_okutama_file(path):
        truths = [_of_label_file(path, protocol, size)]
    elif path.is_file() and is_visdrone(path.parent.parent) and path.parent.name == "annotations":
        truths = [_of_visdrone(s) for s in find_visdrone(path.parent.parent) if s.labels.name == path.name]
    elif path.is_file():
        truths = [_of_file(path)]
    else:
        raise RequestError(f"expected a ground truth, a sequence folder or a folder of sequences, found no {path}")
    return [_restricted(truth, frames) for truth in truths] if frames != EVERY_FRAME else truths


def _of_label_file(path: Path, protocol: Protocol, size: tuple[int, int] | None) -> Truth:
    clip = clip_labelled_by(path)
    if clip is not None:
        return _by_protocol(clip.name, read_clip_labels(clip), protocol, clip.length or None)
    return _of_okutama(OkutamaVideo(path.stem, (), path), protocol, size)


def _of_okutama(video: OkutamaVideo, protocol: Protocol, size: tuple[int, int] | None) -> Truth:
    return _by_protocol(video.name, read_okutama_video(video, size=size), protocol, len(video.images) or None)


def _by_protocol(name: str, labels: ActionLabels, protocol: Protocol, length: int | None) -> Truth:
    truth, _ = okutama_truth(labels, protocol)
    if not truth.evaluated.any():
        raise RequestError(f"{name}: expected a labelled person who is neither lost nor occluded, got none")
    return Truth(name, truth, length, counted_from(protocol))


def _of_visdrone(sequence: VisDroneSequence) -> Truth:
    length = len(sequence.images)
    return Truth(sequence.name, read_visdrone(sequence.labels, length), length)


def _of_drone_action(folder: Path) -> list[Truth]:
    truths = []
    for clip in find_drone_action(folder):
        length = len(list_images(clip.source)) or None
        truths.append(Truth(clip.name, read_drone_action_boxes(clip.labelled(), length), length))
    return truths


def _of_file(path: Path) -> Truth:
    """Labels with name and length of the sequence that a ``gt/gt.txt`` lies in, where it lies in one."""
    folder = path.resolve().parent.parent
    if path.name == "gt.txt" and path.resolve().parent.name == "gt" and (folder / "seqinfo.ini").is_file():
        sequence = read_sequence(folder)
        return Truth(sequence.name, read_ground_truth(path), sequence.length or None)
    return Truth(folder.name if path.name == "gt.txt" else path.stem, read_ground_truth(path), None)


def _restricted(truth: Truth, frames: FrameRange) -> Truth:
    last = int(truth.labels.frames.max())
    wanted = frames.within(truth.length or last + 1)
    assert wanted.last is not None
    first = max(wanted.first, truth.frames.first)
    labels = truth.labels.between(first, wanted.last)
    if not labels.evaluated.any():
        raise RequestError(f"{truth.name}: expected a labelled box that counts in frames {frames}, got none")
    return replace(truth, labels=labels, frames=FrameRange(first, frames.last))
