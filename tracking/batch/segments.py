"""People detected in segments of a video, each by itself, with the same result as one process for the whole.

What a detector chooses on its way is chosen once, before: its number of tiles, and for networks of other
projects the score from which on boxes count. A segment begins where a batch of frames does. What only the frames before
tell, as the ground and the flow, is left to the one who puts the segments together.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.features.tiles import TileView
from tsuiseki.tracking.features.view_choice import ViewChoice, ViewedDetector, ViewHistory, inner_detector
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.opening import OpenedPeople, open_people
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.runs.run import Run
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Frame, ImageArray
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import SeekableVideo, Source, VideoFile

# Frames before a segment that its camera is watched from: some that it is compared with in turn.
WATCHED = 3
# File of a plan.
PLAN = "plan.npz"
COLUMNS = ("boxes", "scores", "features", "angles", "classes", "sources")


@dataclass(frozen=True)
class Observations:
    """Detections of frames that follow each other, in a file of numbers that is read without unpickling.

    Attributes:
        detections: of each frame, with features where they were described.
        about: what else is to be kept, for JSON.
        arrays: likewise, by name.
    """

    detections: Sequence[Detections]
    about: Mapping[str, Any]
    arrays: Mapping[str, Any]

    def write(self, path: Path) -> None:
        """Write a file, whole or not at all; what `read` makes of it is the same, bit for bit.

        Raises:
            RequestError: the disk is full, or the folder cannot be written to.
        """
        arrays = dict(self.arrays)
        arrays["counts"] = np.array([len(frame) for frame in self.detections], dtype=np.int64)
        for name in COLUMNS:
            parts = [getattr(frame, name) for frame in self.detections]
            arrays[f"known_{name}"] = present = np.array([part is not None for part in parts], dtype=np.bool_)
            if present.any():
                width = max((np.shape(part)[1:] for part in parts if part is not None), default=())
                values = np.concatenate([part for part in parts if part is not None and len(part)] or [np.empty(0)])
                arrays[name] = values.reshape(-1, *width)
        names = {number: name for frame in self.detections for number, name in frame.names.items()}
        arrays["about"] = np.array(json.dumps({**self.about, "names": names}))
        with whole_file(path) as file:
            np.savez(file, **arrays)

    @classmethod
    def read(cls, path: Path) -> Observations:
        """What `write` wrote."""
        arrays = read_arrays(path, "observations of a part")
        about, counts = json_of(str(arrays.pop("about")), str(path), "observations of a part"), arrays.pop("counts")
        names = {int(number): name for number, name in about.pop("names").items()}
        columns: dict[str, list[Any]] = {}
        for name in COLUMNS:
            present = arrays.pop(f"known_{name}")
            parts: list[Any] = [None] * len(counts)
            if present.any():
                pieces = np.split(arrays.pop(name), np.cumsum(counts * present)[:-1])
                parts = [piece if is_known else None for piece, is_known in zip(pieces, present.tolist(), strict=True)]
            columns[name] = parts
        rows = zip(*columns.values(), strict=True)
        return cls([Detections(**dict(zip(COLUMNS, row, strict=True)), names=names) for row in rows], about, arrays)


class KnownViewHistory(ViewHistory):
    """The views of a video whose tiles were chosen before."""

    def take(self, images: Sequence[ImageArray], *_: Any) -> ViewChoice:
        self.choice = next(choice for frame, choice in reversed(self.changes) if frame <= self.frames)
        self.frames += len(images)
        return self.choice


@dataclass(frozen=True)
class SegmentPlan:
    """How a video is cut, and what is chosen before.

    Attributes:
        parts: first and last frame of each segment, 0-based.
        begins: first frame that is detected with these choices; boxes of those before are ``beginning``.
        counted: frames that the choice of tiles counts before it.
        views: tiles from which frame of theirs on, as `ViewChoice`; by the size of the frames.
        floor: score that the beginning tells; None where it does not.
        threshold: score from which boxes count; None where it is not chosen here.
        gave: whether pictures there gave boxes of any class.
        beginning: detections by frame from the first on.
        stamps: of the video, see `SeekableVideo`.
        times: of its frames in seconds, see `SeekableVideo`.
    """

    parts: list[tuple[int, int]]
    begins: int
    counted: int = 0
    views: Sequence[tuple[list[int], list[tuple[int, dict[str, Any]]]]] = ()
    floor: float | None = None
    threshold: float | None = None
    gave: Sequence[bool] = ()
    beginning: Sequence[Detections] = ()
    stamps: FloatArray = field(default_factory=lambda: np.empty(0))
    times: FloatArray = field(default_factory=lambda: np.empty(0))

    def write(self, path: Path) -> None:
        """Write a file that `read` reads."""
        about = {column.name: getattr(self, column.name) for column in fields(self)}
        beginning, arrays = about.pop("beginning"), {name: about.pop(name) for name in ("stamps", "times")}
        Observations(beginning, about, arrays).write(path)

    @classmethod
    def read(cls, path: Path) -> SegmentPlan:
        """What `write` wrote."""
        observations = Observations.read(path)
        return cls(**observations.about, beginning=observations.detections, **observations.arrays)

    def seekable(self, source: Source) -> SeekableVideo:
        """Of the video, which is opened anew."""
        assert isinstance(source, VideoFile | ImageFolder)
        return SeekableVideo(source, self.stamps, self.times)

    def prepare(self, opened: OpenedPeople, first: int) -> None:
        """Let what was opened detect as planned, from frame ``first`` on."""
        inputs, network = opened.inputs, inner_detector(opened.inputs.detect)
        if isinstance(inputs.detect, ViewedDetector):
            for size, changes in self.views:
                choices = []
                for frame, values in changes:
                    view = TileView(values["columns"], np.array(values["tiles"], dtype=np.int64))
                    people = {int(columns): count for columns, count in values["people"].items()}
                    choices.append((frame, ViewChoice(view, values["milliseconds"], people)))
                rate, count = inputs.detect.frame_rate, self.counted + max(first - self.begins, 0)
                inputs.detect.histories[tuple(size)] = KnownViewHistory(
                    rate, choices[-1][1], changes=choices, frames=count, due=None
                )
                peopled = [choice for _, choice in choices if choice.sees_somebody]
                inputs.detect.histories[tuple(size)].peopled = peopled
        if inputs.choice is not None and self.threshold is not None:
            assert isinstance(network, ForeignDetector)
            inputs.choice.floor, network.score_threshold = self.floor, self.threshold
            if inputs.ground is not None:
                inputs.ground.score_threshold = self.threshold


def _values(choice: ViewChoice) -> dict[str, Any]:
    tiles = choice.view.tiles.tolist()
    return {
        "columns": choice.view.columns, "tiles": tiles, "milliseconds": choice.milliseconds, "people": choice.people
    }  # fmt: skip


def cut(source: Source, finding: PeopleFinding, linking: Linking, seconds: float) -> SegmentPlan | None:
    """The plan of a video, in segments of so many seconds; None where it has to be done in one piece.

    Raises:
        RequestError: see `open_people`.
        RunError: the video breaks off where it is read.
    """
    opened = open_people(source, replace(finding, threads=1), linking, 0)
    inputs = opened.inputs
    seekable = SeekableVideo.of(source) if inputs.needs_images else None
    if seekable is None or inputs.inferred.stride > 1:
        return None
    frame_range, detected = seekable.frame_range, dict[int, Detections]()
    assert frame_range.last is not None
    if frame_range.last < frame_range.first:
        return None
    if inputs.choice is not None:
        detected = inputs.choice.choose(source, inputs.batch_size, 1, StageTimes())
    begins, counted = frame_range.first + len(detected), 0
    views = []
    if isinstance(inputs.detect, ViewedDetector):
        counted = max((history.frames for history in inputs.detect.histories.values()), default=0)
        _choose_views(inputs.detect, seekable, begins, frame_range.last, inputs.batch_size)
        for size, history in inputs.detect.histories.items():
            views.append((list(size), [(frame, _values(choice)) for frame, choice in history.changes]))
    batches = max(round(seconds * source.frame_rate / inputs.batch_size), 1)
    parts = _parts(frame_range.first, begins - 1, batches * inputs.batch_size)
    parts += _parts(begins, frame_range.last, batches * inputs.batch_size)
    beginning = [detected.get(number, Detections.empty()) for number in range(frame_range.first, begins)]
    choice, network = inputs.choice, inner_detector(inputs.detect)
    floor, threshold = (None, None) if choice is None else (choice.floor, choice.threshold)
    gave = [*network.gave] if isinstance(network, ForeignDetector) else []
    beside = beginning, seekable.stamps, seekable.times
    return SegmentPlan(parts, begins, counted, views, floor, threshold, gave, *beside)


def _parts(first: int, last: int, length: int) -> list[tuple[int, int]]:
    return [(start, min(start + length - 1, last)) for start in range(first, last + 1, length)]


def _choose_views(detect: ViewedDetector, seekable: SeekableVideo, first: int, last: int, batch: int) -> None:
    """Let the detector choose its tiles as if it were shown all batches from frame ``first`` on."""
    history = next(iter(detect.histories.values()), None)
    counted = 0 if history is None else history.frames
    frame = first
    while frame <= last and (history is None or history.due is not None):
        if history is not None and history.due is not None:
            frame = max(frame, first + batch * ceil((ceil(history.due) - counted) / batch))
            if frame > last:
                return
            history.frames = counted + frame - first
        count = min(batch, last + 1 - frame)
        images = [loaded.image for loaded in seekable.frames(frame, frame + (count - 1 if history is None else 0))]
        detect.prepare(images if history is None else images * count)
        history = next(iter(detect.histories.values()))
        frame += count


def detect_segment(
    plan: SegmentPlan, part: int, source: Source, finding: PeopleFinding, linking: Linking
) -> Observations:
    """The observations of a segment; raises RunError, see `SeekableVideo.frames`."""
    opened = open_people(source, replace(finding, threads=1), linking, 0)
    seekable, inputs = plan.seekable(source), opened.inputs
    first, last = plan.parts[part]
    plan.prepare(opened, first)
    begins = seekable.frame_range.first
    camera = StandingCamera() if isinstance(inputs.camera, StandingCamera) else None
    watched_from = first
    if camera is not None and first > begins:
        # One that stands still is compared with every so many frames, counted from the beginning.
        turns = max((first - begins - 1) // camera.patience - (WATCHED - 1), 0)
        watched_from = begins + turns * camera.patience
    times, same, compared = StageTimes(), list[bool](), list[int]()
    size: list[int] = []

    def watched() -> Iterator[Frame]:
        for frame in seekable.frames(watched_from, last):
            size[:] = frame.image.shape[:2]
            if camera is not None:
                with times.measure("camera"):
                    compared_with = watched_from + camera.compared
                    still = camera.add(frame.image)
                if frame.index >= first:
                    same.append(still)
                    compared.append(compared_with)
            if frame.index >= first:
                yield frame

    detect: Any = inputs.detect
    if first < plan.begins:
        detect = [Detections.empty()] * begins + [*plan.beginning]
    detections = [rows for _, rows in stream(watched(), detect, inputs.describe, inputs.batch_size, times, 1)]
    network = inner_detector(inputs.detect)
    gave = [*network.gave] if isinstance(network, ForeignDetector) else []
    about = {"size": size, "seconds": times.seconds, "gave": gave}
    return Observations(detections, about, {"same": np.array(same, bool), "compared": np.array(compared, np.int64)})


def standing(begins: int, files: Sequence[Path]) -> BoolArray | None:
    """``(F,)`` whether the camera stood still at each frame, if all were compared with the right one; else None."""
    camera, stands = StandingCamera(), list[bool]()
    for path in files:
        arrays = read_arrays(path, "observations of a part")
        pairs = zip(arrays["same"].tolist(), arrays["compared"].tolist(), strict=True)
        for same, compared in pairs:
            if len(camera) and compared != begins + camera.compared:
                return None
            stands.append(same)
            camera.take(same)
    return np.array(stands, dtype=np.bool_)


class Again:
    """A video whose detections are known: its frames come again with ``detections``, and tiles of the last of them.

    An image is blank where it is not needed again. What was chosen and compared goes to the fresh ``opened``, and the
    seconds that the segments took to ``times``.
    """

    def __init__(self, plan: SegmentPlan, files: Sequence[Path], opened: OpenedPeople, times: StageTimes) -> None:
        self.plan, self.files, self._seconds = plan, files, times.seconds
        self.source, self.detections = opened.inputs.source, Detections.empty()
        self._network, camera = inner_detector(opened.inputs.detect), opened.inputs.camera
        plan.prepare(opened, plan.parts[-1][0])
        self._images = isinstance(camera, CameraPath)
        if isinstance(camera, StandingCamera):
            camera.comparisons = standing(plan.parts[0][0], files)
            self._images = camera.comparisons is None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def frames(self) -> Iterator[Frame]:
        seekable = self.plan.seekable(self.source)
        first, last = self.plan.parts[0][0], self.plan.parts[-1][1]
        images = seekable.frames(first, last) if self._images else None
        gave = {*self.plan.gave}
        for (start, _), path in zip(self.plan.parts, self.files, strict=True):
            part = Observations.read(path)
            gave |= {*part.about["gave"]}
            if isinstance(self._network, ForeignDetector):
                self._network.gave |= gave
            for stage, seconds in part.about["seconds"].items():
                self._seconds[stage] = self._seconds.get(stage, 0.0) + seconds
            blank = np.broadcast_to(np.zeros(1, dtype=np.uint8), (*part.about["size"], 3))
            for number, self.detections in enumerate(part.detections, start):
                frame = Frame(number, float(seekable.times[number]), blank) if images is None else next(images)
                yield self.source.noted(frame)
        seekable.check_end(last)


def again(
    run: Run, opened: OpenedPeople, plan: SegmentPlan, files: Sequence[Path], tracker: PeopleTracker | None = None
) -> tuple[OpenedPeople, Iterator[tuple[int, Detections]]]:
    """The observations of every frame, for ``run``, in order; see `Again`. Another ``tracker`` may take it."""
    video: Any = Again(plan, files, opened, run.times)
    pairs = ((frame, video.detections) for frame in run.frames(video))
    detections = ((frame.index, rows) for frame, rows in opened.inputs.in_order(pairs, run.times))
    return opened if tracker is None else replace(opened, tracker=tracker), detections
