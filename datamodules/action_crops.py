"""Video in which people are labelled with what they do, of any layout."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ENLARGEMENT, STREAMS, StreamName, crop_squares, flow_to, square_boxes
from tsuiseki.tracking.features.optical_flow import FlowName
from tsuiseki.tracking.formats.drone_action import DRONE_ACTION_CLASSES, VIDEO_SUFFIXES
from tsuiseki.tracking.formats.labelled import LabelledVideo, open_labelled
from tsuiseki.tracking.formats.okutama import check_frames
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.types import BoolArray, ImageArray, IntArray
from tsuiseki.tracking.types.labels import ActionLabels
from tsuiseki.tracking.video.image_folder import one_image
from tsuiseki.tracking.video.source import open_source


@dataclass(frozen=True)
class ActionSequence:
    """A video and what everybody in it does.

    Attributes:
        name: of the video.
        files: one image a frame, by frame number; or one video file.
        labels: in pixels of the frames.
    """

    name: str
    files: tuple[Path, ...]
    labels: ActionLabels

    def digest(self) -> str:
        """A digest of labels and files, by their names and sizes."""
        rows = self.labels
        content = hashlib.sha256()
        for values in (rows.frames, rows.ids, np.round(rows.boxes, 3), rows.lost, rows.occluded, rows.actions):
            content.update(np.ascontiguousarray(values).tobytes())
        content.update(repr([(path.name, path.stat().st_size) for path in self.files]).encode())
        return content.hexdigest()[:32]


def action_sequences(folder: str | Path) -> list[ActionSequence]:
    """The videos at ``folder`` that are labelled with actions: of Okutama-Action, of Drone-Action, or generated clips.

    Args:
        folder: see `open_labelled`.

    Raises:
        RequestError: there is none, labels are broken, frames are missing, or frames and labels do not match.
    """
    videos = [video for video in open_labelled(Path(folder)) if video.read_actions is not None]
    if not videos:
        raise RequestError(f"{folder}: expected video labelled with actions, found none")
    return [_sequence(video) for video in videos]


def _sequence(video: LabelledVideo) -> ActionSequence:
    if not video.files:
        place = f"Drone*/*/Extracted-Frames-1280x720/{video.name}/, or img1/ of a generated clip"
        raise RequestError(f"{video.name}: expected its frames in {place}; found none")
    if video.length is None:
        return ActionSequence(video.name, video.files, video.actions())
    size = one_image(video.files[0])
    labels = video.actions(size)
    # Drone-Action's labels are in pixels of their frames, whatever those are.
    if labels.class_names != DRONE_ACTION_CLASSES:
        check_frames(labels, video.length, size, video.name)
    return ActionSequence(video.name, video.files, labels)


# (H, W, 3) uint8 RGB of a 0-based frame number; numbers are asked for in rising order.
ReadFrame: TypeAlias = Callable[[int], ImageArray]


def frame_reader(sequence: ActionSequence) -> ReadFrame:
    """What reads the frames of ``sequence``; it raises RequestError where one cannot be read."""
    files = sequence.files
    if len(files) == 1 and files[0].suffix.lower() in VIDEO_SUFFIXES:
        return _forward(files[0])
    return lambda number: read_image(files[number])


def _forward(path: Path) -> ReadFrame:
    """Frames of a video file; what lies between those that are asked for is passed over."""
    frames = open_source(path).frames()

    def read(number: int) -> ImageArray:
        image = next((frame.image for frame in frames if frame.index == number), None)
        if image is None:
            raise RequestError(
                f"{path}: expected at least {number + 1} frames, got fewer; are its labels another video's?"
            )
        return image

    return read


# Of the files of cut crops: a digest holds it, so that files of another layout are cut anew.
VERSION = 3


@dataclass(frozen=True)
class CropSettings:
    """How crops are cut from video.

    Attributes:
        size: side of the network's input, pixels.
        margin: of the stored crops on every side, in input sizes: how far training can shift them.
        flow: how it is estimated.
        step: every how many frames people are cut out.
    """

    size: int = 64
    margin: float = 0.0625
    flow: FlowName = "dis"
    step: int = 5

    @property
    def stored_size(self) -> int:
        """Side of the stored crops, pixels."""
        return round(self.size * (1 + 2 * self.margin))


@dataclass(frozen=True)
class ActionCrops:
    """The crops of one or several clips.

    Attributes:
        images: ``(N, S, S, C)`` uint8 by stream, one array a clip.
        actions: ``(N, A)`` which actions each person performs.
        clip: ``(N,)`` which clip a row lies in, and ``row`` where in it.
        row: ``(N,)``.
    """

    images: dict[StreamName, list[ImageArray]]
    actions: BoolArray
    clip: IntArray
    row: IntArray

    def __len__(self) -> int:
        return len(self.actions)

    def crops(self, stream: StreamName, rows: IntArray) -> ImageArray:
        """``(B, S, S, C)`` of the samples ``rows`` ``(B,)``."""
        arrays = self.images[stream]
        chosen = [arrays[c][r] for c, r in zip(self.clip[rows].tolist(), self.row[rows].tolist(), strict=True)]
        return np.stack(chosen)


def cut_clip(clip: ActionSequence, settings: CropSettings, folder: Path) -> None:
    """Cut the labelled people of a clip out and keep them in ``folder``, which appears when it is complete.

    Args:
        clip: with at least one of `rows_to_cut`.
        settings: how they are cut.
        folder: for the crops.

    Raises:
        RequestError: a frame cannot be read.
    """
    labels, rows = clip.labels, rows_to_cut(clip.labels, settings)
    frame_numbers = np.unique(labels.frames[rows]).tolist()
    crops: dict[StreamName, list[ImageArray]] = {name: [] for name in STREAMS}
    for frame, image, flow in _pictures(frame_reader(clip), frame_numbers, settings):
        boxes = labels.boxes[rows[labels.frames[rows] == frame]]
        for name in STREAMS:
            scale = (ENLARGEMENT if name.endswith("global") else 1.0) * (1 + 2 * settings.margin)
            picture = flow if name.startswith("flow") else image
            crops[name].append(crop_squares(picture, square_boxes(boxes, scale), settings.stored_size))
    folder.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".unfinished", dir=folder.parent))
    try:
        for name, parts in crops.items():
            np.save(work / f"{name}.npy", np.concatenate(parts))
        np.savez(work / "rows.npz", actions=labels.actions[rows])
        (work / "settings.json").write_text(_described(clip, settings), encoding="utf-8")
        if folder.exists():
            shutil.rmtree(folder)
        work.replace(folder)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def clips_to_cut(clips: Sequence[ActionSequence], settings: CropSettings, purpose: str) -> list[ActionSequence]:
    """The clips with one of `rows_to_cut`, the others named in a warning: a drone may look away all through a clip.

    Args:
        clips: labelled video.
        settings: how they are to be cut.
        purpose: of the clips, for the error.

    Raises:
        RequestError: no person can be cut out of any of them.
    """
    people = [len(rows_to_cut(clip.labels, settings)) for clip in clips]
    if not any(people):
        raise RequestError(f"expected labelled people with a frame before in the {purpose} clips, got none")
    if not all(people):
        empty = ", ".join(clip.name for clip, count in zip(clips, people, strict=True) if not count)
        print(f"tsuiseki: warning: left out, since no person is labelled there:  {empty}", file=sys.stderr)
    return [clip for clip, count in zip(clips, people, strict=True) if count]


def rows_to_cut(labels: ActionLabels, settings: CropSettings) -> IntArray:
    """``(N,)`` labels of people who are visible, in frames of which every so many are taken, in the order of time."""
    first = labels.frames == 0
    rows = np.flatnonzero(~(labels.lost | labels.occluded | first) & (labels.frames % settings.step == 0))
    return np.asarray(rows[np.argsort(labels.frames[rows], kind="stable")])


def _pictures(
    read: ReadFrame, frame_numbers: Sequence[int], settings: CropSettings
) -> Iterator[tuple[int, ImageArray, ImageArray]]:
    """The wanted frames, each with the flow that leads to it; an image is read once."""
    held: dict[int, ImageArray] = {}
    for frame in frame_numbers:
        held = {t: held[t] if t in held else read(t) for t in (frame - 1, frame)}
        flow = flow_to(held[frame - 1], held[frame], settings.flow)
        yield frame, held[frame], flow


def has_crops(folder: Path, clip: ActionSequence, settings: CropSettings) -> bool:
    """Whether ``folder`` holds just this clip, cut with just these settings."""
    try:
        return (folder / "settings.json").read_text(encoding="utf-8") == _described(clip, settings)
    except OSError:
        return False


def load_crops(folders: Sequence[Path], streams: Sequence[StreamName]) -> ActionCrops:
    """The crops of several clips; the pictures stay on disk until they are asked for.

    Raises:
        RequestError: a folder is incomplete.
    """
    images: dict[StreamName, list[ImageArray]] = {name: [] for name in streams}
    actions = list[BoolArray]()
    for folder in folders:
        try:
            for name in streams:
                images[name].append(np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False))
            actions.append(read_arrays(folder / "rows.npz", "crops of a clip")["actions"])
        except (OSError, ValueError, KeyError, EOFError, SyntaxError) as error:
            raise RequestError(f"{folder}: expected crops of a clip, got {error}") from error
    counts = [len(of_sequence) for of_sequence in actions]
    row = np.concatenate([np.arange(count) for count in counts])
    return ActionCrops(images, np.concatenate(actions), np.repeat(np.arange(len(counts)), counts), row)


def _described(clip: ActionSequence, settings: CropSettings) -> str:
    facts = {"version": VERSION, "clip": clip.digest(), "actions": list(clip.labels.class_names)}
    return json.dumps({**facts, **dataclasses.asdict(settings)}, sort_keys=True)
