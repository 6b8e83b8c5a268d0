"""Labelled video of every layout that is known; the layout is recognised by its files.

| at the path | layout |
|---|---|
| ``gt.txt``, a sequence folder, a folder of sequences | MOTChallenge, with ``gt/actions.txt`` where there are actions |
| the folder, or a label file in it | Okutama-Action |
| the folder, or a label file in it | VisDrone-MOT, KITTI tracking, BDD100K |
| the folder | Drone-Action |
| the file, or a folder with it as ``annotations.xml`` or ``annotations.json`` | CVAT; COCO, Label Studio |
| the folder, or each that it holds, with ``labels``; its ``data.yaml`` | YOLO's rows |
| the JSON, a folder of such or with ``annotations``, a folder of text files | rotated boxes of CEPDOF, MW-R, HABBOF |
| the folder with ``corrections.jsonl`` | a result that was reviewed: its tracks, in the frames that were tracked |
| a folder of any of these folders | all of them |

The reader of each format says which boxes count. Pictures that were labelled one by one have boxes without ids.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.box_labels import BOX_LAYOUTS, BoxLayout
from tsuiseki.tracking.formats.drone_action import (
    DroneActionClip,
    drone_action_labels,
    find_drone_action,
    is_drone_action,
    read_drone_action_boxes,
)
from tsuiseki.tracking.formats.exports import exported_in, format_at, read_exported
from tsuiseki.tracking.formats.label_checks import LabelFile, compare_with_picture, identified, wanted_numbers
from tsuiseki.tracking.formats.listed_images import other_sizes, picture_paths
from tsuiseki.tracking.formats.mot import LABELS as MOT_LABELS
from tsuiseki.tracking.formats.mot import class_names, read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import (
    MotSequence,
    image_size,
    is_sequence,
    left_out,
    list_images,
    read_sequence,
)
from tsuiseki.tracking.formats.okutama import (
    ACTIONS_FILE,
    Protocol,
    counted_from,
    find_okutama,
    is_okutama,
    is_okutama_file,
    okutama_truth,
    read_clip_labels,
    read_okutama_video,
)
from tsuiseki.tracking.formats.result_folder import read_folder
from tsuiseki.tracking.formats.rotated import about_bodies, is_rotated, read_rotated_labels
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks, inside
from tsuiseki.tracking.formats.yolo import ABOUT, picture_places
from tsuiseki.tracking.types import IntArray, Track
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import ActionLabels, GroundTruth

Size: TypeAlias = tuple[int, int] | None
"""Width and height of the frames that labels are wanted for; None takes those of the frames that lie with them."""
CountedClass: TypeAlias = int | str | None
"""Number or name of the class that counts; None for people."""


@dataclass(frozen=True)
class LabelledVideo:
    """A video and its labels, which are read when they are asked for.

    Attributes:
        name: of the video.
        files: one image a frame, by frame; or the video file alone; empty where only labels are there.
        length: number of frames; None where nothing tells.
        read_people: who is where, of a class, by default people; None where a protocol says which of the actions' rows
            count.
        read_actions: who does what, in pixels of a size; None without such labels.
        size: width and height of the pictures, where the sequence says.
        classes: names of the classes by the numbers that results bear, where the layout has numbers.
        labelled_classes: these are the classes that somebody labelled, and no layout's own.
        first: frame of a video file, from 0, that is frame 0 of the labels.
        frame_rate: frames a second, where the layout says; None elsewhere.
        lacks: which images are left out in their numbers, in words; empty where none is.
        network: file of the detections of a reviewed result, whose frames count as in the video; None elsewhere.
        listed: ``(N,)`` frames that the labels speak of, in order; None for all. `files` has a folder for each other.
    """

    name: str
    files: tuple[Path, ...]
    length: int | None
    read_people: Callable[[Size, CountedClass], GroundTruth] | None
    read_actions: Callable[[Size], ActionLabels] | None = None
    size: Size = None
    classes: Mapping[int, str] = field(default_factory=dict)
    labelled_classes: bool = False
    first: int = 0
    frame_rate: float | None = None
    network: Path | None = None
    listed: IntArray | None = None
    lacks: str = ""

    def people(
        self, protocol: Protocol = "lenient", size: Size = None, kind: CountedClass = None, single: bool = False
    ) -> GroundTruth:
        """Who is where.

        Args:
            protocol: by which Okutama-Action's labels count, see `okutama_truth`.
            size: for Okutama-Action's labels, and those in shares of a picture.
            kind: the class that counts, by number or name; by default people.
            single: keep boxes without an id, whose ids are -1.

        Raises:
            RequestError: labels are missing or broken, no box is to be scored, most boxes have no id, or there is no
                such class.
        """
        if self.read_people is not None:
            truth = self.read_people(size, kind)
            compare_with_picture(self.name, truth.boxes, self.size)
            return truth if single else identified(self.name, truth)
        wanted_numbers(kind, {}, (), self.name)
        truth, _ = okutama_truth(self.actions(size), protocol)
        if not truth.evaluated.any():
            raise RequestError(f"{self.name}: expected a labelled person who is neither lost nor occluded, got none")
        return truth

    def actions(self, size: Size = None) -> ActionLabels:
        """Who does what; raises RequestError where actions are not labelled, or labels are broken."""
        if self.read_actions is None:
            raise RequestError(f"{self.name}: expected people labelled with actions, found labels of boxes alone")
        return self.read_actions(size)

    def counted(self, protocol: Protocol) -> FrameRange:
        """The frames of `people` that count."""
        return EVERY_FRAME if self.read_people is not None else counted_from(protocol)


def open_labelled(path: Path) -> list[LabelledVideo]:
    """The labelled videos at ``path``, by name.

    Raises:
        RequestError: nothing known is there, or its layout is broken.
    """
    path = path.parent if path.name == ABOUT else path
    if path.is_dir():
        parts = (part for part in sorted(path.iterdir()) if part.is_dir())
        videos = _in_folder(path)
        videos = videos or [video for part in parts for video in _in_folder(part)]
        if not videos:
            raise RequestError(
                f"{path}: expected labelled video, such as img1/ and gt/gt.txt, annotations.json, annotations.xml, or "
                "images/ and labels/; found none"
            )
        return videos
    if boxes := [_of_boxes(layout, file) for layout in BOX_LAYOUTS for file in layout.at(path)]:
        return boxes
    if is_rotated(path):
        return [_rotated(path)]
    if not path.is_file():
        raise RequestError(f"expected a ground truth, a sequence folder or a folder of sequences, found no {path}")
    if format_at(path):
        return [_exported(path)]
    folder = path.absolute().parent.parent
    if path.absolute().match(f"*/{ACTIONS_FILE}") and is_sequence(folder):
        # The rows with actions of a generated clip say who is where.
        clip = read_sequence(folder)
        return [LabelledVideo(clip.name, clip.images, clip.length or None, None, partial(read_clip_labels, clip))]
    if is_okutama_file(path):
        return [_okutama(LabelFile(path.stem, (), path))]
    return [_ground_truth(path)]


def _in_folder(folder: Path) -> list[LabelledVideo]:
    """The videos of a folder; none where its layout is not known."""
    if (folder / "corrections.jsonl").is_file():
        return [_reviewed(folder)]
    if is_okutama(folder):
        return [_okutama(video) for video in find_okutama(folder)]
    for layout in BOX_LAYOUTS:
        if files := layout.at(folder):
            return [_of_boxes(layout, file) for file in files]
    if is_drone_action(folder):
        return [_drone_action(clip) for clip in find_drone_action(folder)]
    exported = exported_in(folder)
    json_files = (path for place in ("annotations/*.json", "*.json") for path in sorted(folder.glob(place)))
    if rotated := [path for path in exported or json_files if is_rotated(path)]:
        return [_rotated(path) for path in rotated]
    if list_images(folder) and is_rotated(folder):
        return [_rotated(folder)]
    return [_exported(path) for path in exported] or ([_sequence(read_sequence(folder))] if is_sequence(folder) else [])


def _reviewed(folder: Path) -> LabelledVideo:
    """A result that somebody corrected; a box that no detection supports is neither right nor wrong."""
    loaded, facts = read_folder(folder)
    tracks: list[Track] = [getattr(track, "track", track) for track in loaded]
    if not tracks or not all(isinstance(track, Track) for track in tracks):
        raise RequestError(f"{folder}: expected tracks of boxes to learn from, got none")
    source = Path(facts.get("source") or folder / "img1")
    images = (list_images(source / "img1") or list_images(source)) if source.is_dir() else ()
    tracked = facts["frames"].get("frame") or range(len(images) or 1 + max(int(t.frames[-1]) for t in tracks))
    first, last = min(tracked), max(tracked)

    def read(_: Size, kind: CountedClass) -> GroundTruth:
        wanted_numbers(kind, {}, (), folder)
        rows = boxes_of_tracks(tracks)
        everyone = np.ones(len(rows.ids))
        return GroundTruth(rows.frames - first, rows.ids, rows.boxes, rows.observed, ~rows.observed, everyone)

    files = images[first : last + 1] or ((source,) if source.is_file() else ())
    video = LabelledVideo(folder.name, files, last + 1 - first, read, size=facts.get("size"), first=first)
    return replace(video, frame_rate=facts.get("frame_rate"), network=folder / "flow.npz")


def _sequence(sequence: MotSequence) -> LabelledVideo:
    gap = left_out(sequence.images)
    return LabelledVideo(
        sequence.name,
        sequence.images,
        sequence.length or None,
        lambda _, kind: read_ground_truth(sequence.ground_truth_path, kind),
        (lambda size: read_clip_labels(sequence, size)) if (sequence.folder / ACTIONS_FILE).is_file() else None,
        _size_of(sequence),
        class_names(sequence.ground_truth_path),
        sequence.ground_truth_path.with_name(MOT_LABELS).is_file(),
        lacks=f"{sequence.folder}: {gap}; labels go by the numbers, so add them" if gap else "",
    )


def _size_of(sequence: MotSequence) -> Size:
    """Width and height of the pictures of a sequence that says them; where they are others, those of the pictures."""
    stated = (sequence.width, sequence.height)
    if min(stated) <= 0:
        return None
    actual = image_size(sequence.images[0]) if sequence.images else stated
    if actual != stated:
        line = f"says pictures of {stated[0]}x{stated[1]}, but {sequence.images[0].name} has {actual[0]}x{actual[1]}"
        warnings.warn(f"{sequence.folder}: seqinfo.ini {line}, which counts", InputWarning, stacklevel=3)
    return actual


def _ground_truth(path: Path) -> LabelledVideo:
    """Labels with name and length of the sequence that a ``gt/gt.txt`` lies in, where it lies in one."""
    folder = path.resolve().parent.parent
    name = folder.name if path.name == "gt.txt" else path.stem
    alone = LabelledVideo(name, (), None, lambda _, kind: read_ground_truth(path, kind), classes=class_names(path))
    if path.name != "gt.txt" or path.resolve().parent.name != "gt" or not (folder / "seqinfo.ini").is_file():
        return alone
    return replace(_sequence(read_sequence(folder)), files=(), read_people=alone.read_people, read_actions=None)


def _okutama(video: LabelFile) -> LabelledVideo:
    length = len(video.images) or None
    return LabelledVideo(video.name, video.images, length, None, lambda size: read_okutama_video(video, size))


def _of_boxes(layout: BoxLayout, file: LabelFile) -> LabelledVideo:
    length = len(file.images) or None
    read: Callable[[Size, CountedClass], GroundTruth] = lambda _, kind: layout.read(file.labels, length, kind)  # noqa: E731
    size = image_size(file.images[0]) if file.images else None
    return LabelledVideo(file.name, file.images, length, read, size=size, classes=layout.names)


def _drone_action(clip: DroneActionClip) -> LabelledVideo:
    images = list_images(clip.source)
    length = len(images) or None

    def read(_: Size, kind: CountedClass) -> GroundTruth:
        wanted_numbers(kind, {}, (), clip.source)
        return read_drone_action_boxes(clip.labelled(), length)

    return LabelledVideo(clip.name, images or (clip.source,), length, read, lambda _: drone_action_labels(clip, length))


def _rotated(path: Path) -> LabelledVideo:
    """Upright boxes about the people in rotated ones; an image is a frame, in the order of the names."""
    labels = read_rotated_labels(path)
    near = (path.parent, path.parent.parent, path.parent.parent / "frames")
    places = (path,) if path.is_dir() else tuple(place / path.stem for place in near)
    places += (path.parent, *(place / "images" for place in near[:2]))
    named = [{name: image for image in list_images(place) for name in (image.stem, image.name)} for place in places]
    files = next((tuple(map(images.__getitem__, labels)) for images in named if labels.keys() <= images.keys()), ())

    def read(_: Size, kind: CountedClass) -> GroundTruth:
        wanted_numbers(kind, {}, (), path)
        frames = np.repeat(np.arange(len(labels)), [len(image.boxes) for image in labels.values()])
        boxes, ids = (np.concatenate([getattr(image, name) for image in labels.values()]) for name in ("boxes", "ids"))
        # Ids of tracks count from 1; these may be 0.
        return GroundTruth.of_boxes(frames, np.where(ids < 0, -1, ids + 1), about_bodies(boxes))

    return LabelledVideo(path.stem, files, len(labels), read)


def _exported(path: Path) -> LabelledVideo:
    """Labels of another program, with the pictures that they name, those in ``images``, or their video beside them."""
    exported, folder = read_exported(path, single=True), path if path.is_dir() else path.parent
    names = tuple(name for name in exported.images if name)
    named = picture_paths(path, names)
    pictures = named or list_images(picture_places(folder)[1])
    sizes = [exported.image_sizes.get(name) for name in names]
    if not named:
        sizes = [exported.image_sizes.get(picture.name, None if names else exported.size) for picture in pictures]
    frames = np.flatnonzero(exported.images) if named and exported.listed is None else exported.listed
    frames = np.arange(len(pictures)) if frames is None or not named else frames
    other = other_sizes(path, pictures, sizes)
    unusable = [frame for frame, picture in zip(frames.tolist(), pictures, strict=True) if picture in other]
    length, listed = exported.length or len(pictures), exported.listed
    if unusable:
        listed = np.setdiff1d(np.arange(length) if listed is None else listed, unusable)
    files = _by_frame(pictures, frames, length) if named else pictures
    video = folder / (inside(exported.name) or "")
    files = files or ((video,) if video.is_file() else ())
    name = exported.stem if exported.name and not exported.stem.endswith("annotations") else folder.name

    def read(size: Size, kind: CountedClass) -> GroundTruth:
        truth = exported.in_pixels(path, size).labels(path, kind)
        return truth.select(~np.isin(truth.frames, unusable))

    kinds = {number: kind for kind, number in exported.kinds.items()}
    about: dict[str, Any] = {"classes": kinds, "labelled_classes": True, "listed": listed}
    return LabelledVideo(name, files, length or len(files) or None, read, None, exported.size, **about)


def _by_frame(pictures: Sequence[Path], frames: IntArray, length: int) -> tuple[Path, ...]:
    """One path a frame: the picture that labels name; of other frames the folder's own where its pictures fit, or it.

    Args:
        pictures: those that labels name.
        frames: ``(N,)`` of these, in order.
        length: number of frames.
    """
    folder = pictures[0].parent
    around = list_images(folder)
    if len(around) >= length and all(around[n] == path for n, path in zip(frames.tolist(), pictures, strict=True)):
        return around[:length]
    files = [folder] * length
    for frame, picture in zip(frames.tolist(), pictures, strict=True):
        files[frame] = picture
    return tuple(files)
