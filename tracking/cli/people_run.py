"""What `tsuiseki track people` and `tsuiseki demo` share: inputs, the run over the frames, and the result folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.cli.interrupt import graceful_interrupt, report_partial
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.camera_motion import CameraPath
from tsuiseki.tracking.features.networks import Describe, Detect, stream
from tsuiseki.tracking.formats.mot import read_detections, write_tracks
from tsuiseki.tracking.frame_range import FrameRange
from tsuiseki.tracking.output import RunRecord
from tsuiseki.tracking.report.overlay import write_overlay
from tsuiseki.tracking.report.webm import VideoWriter
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.base import PeopleTracker
from tsuiseki.tracking.trackers.bytetrack import ByteTrack, ByteTrackSettings
from tsuiseki.tracking.trackers.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.trackers.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.trackers.ocsort import OcSort, OcSortSettings
from tsuiseki.tracking.trackers.run import FrameLog, run_trackers
from tsuiseki.tracking.trackers.sort import Sort, SortSettings
from tsuiseki.tracking.types import Detections, Frame, Track
from tsuiseki.tracking.video import Source, VideoFile, open_source

Method = Literal["sort", "deepsort", "bytetrack", "ocsort", "flow"]
TRACKS_FILE = "tracks.txt"
OVERLAY_FILE = "overlay.webm"
RECORDING_FILE = "recording.webm"


@dataclass(frozen=True)
class Inputs:
    """Where frames, detections and features come from.

    Attributes:
        source: the video.
        detect: a detector, or the detections of each frame.
        describe: an appearance network, if looks are needed.
        batch_size: frames of one call of the detector.
        camera: gets the frames, where the movement of the camera matters.
    """

    source: Source
    detect: Detect | Sequence[Detections]
    describe: Describe | None
    batch_size: int = 4
    camera: CameraPath | None = None

    @property
    def needs_images(self) -> bool:
        """Whether the frames themselves must be decoded."""
        looked_at = self.describe is not None or self.camera is not None or not isinstance(self.detect, Sequence)
        return looked_at or self.source.length is None


@dataclass(frozen=True)
class MethodSettings:
    """The settings of every method."""

    sort: SortSettings = field(default_factory=SortSettings)
    deepsort: DeepSortSettings = field(default_factory=DeepSortSettings)
    bytetrack: ByteTrackSettings = field(default_factory=ByteTrackSettings)
    ocsort: OcSortSettings = field(default_factory=OcSortSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)


def build_tracker(method: Method, settings: MethodSettings, affinity: Affinity | None) -> PeopleTracker:
    """A fresh tracker; the flow has hand-set costs where there is no affinity."""
    trackers: dict[Method, Callable[[], PeopleTracker]] = {
        "sort": lambda: Sort(settings.sort),
        "deepsort": lambda: DeepSort(settings.deepsort),
        "bytetrack": lambda: ByteTrack(settings.bytetrack),
        "ocsort": lambda: OcSort(settings.ocsort),
        "flow": lambda: FlowTracker(settings.flow, affinity, affinity.observation if affinity else None),
    }
    return trackers[method]()


@dataclass(frozen=True)
class PeopleRun:
    """A finished or interrupted run.

    Attributes:
        tracks: by name of the tracker.
        log: what happened in each frame.
        stopped: the user asked to stop.
        recording: frames of a live source, kept for the overlay.
    """

    tracks: Mapping[str, list[Track]]
    log: FrameLog
    stopped: bool
    recording: Path | None


def given_detections(path: Path, source: Source, score_range: tuple[float, float]) -> list[Detections]:
    """The detections in ``path``, checked against the length of the video as far as it is known.

    Raises:
        RequestError: see `read_detections`; the video is shorter.
    """
    if score_range[0] >= score_range[1]:
        raise RequestError(f"--score-range: expected SMALLEST,LARGEST, got {score_range[0]:g},{score_range[1]:g}")
    found = read_detections(path, source.length, score_range)
    # The header of a video file only estimates its length; what it misses shows when the video has ended.
    if isinstance(source, VideoFile) and source.promised and len(found) > source.promised + source.slack:
        read_detections(path, source.promised, score_range)
    return found


def run_people(
    inputs: Inputs, trackers: Mapping[str, PeopleTracker], times: StageTimes, record_to: Path | None = None
) -> PeopleRun:
    """Track until the video ends or the user presses Ctrl-C.

    Args:
        inputs: where everything comes from.
        trackers: fed with the same detections.
        times: gets the seconds of each stage.
        record_to: keep the frames of a live source in this folder.

    Raises:
        RunError: the video turns out broken, or has fewer frames than the detections.
        KeyboardInterrupt: stopped before the first frame was finished.
    """
    recording = record_to / RECORDING_FILE if record_to is not None and inputs.source.live else None
    total = _frames_expected(inputs)
    with graceful_interrupt() as interrupt:
        frames = interrupt.until_asked(progress(_found(inputs, times, recording), "tracking", total))
        tracks, log = run_trackers(frames, trackers, times)
    if not log.frames:
        if interrupt.asked:
            raise KeyboardInterrupt
        raise RunError(f"{inputs.source.name}: expected frames, got none")
    return PeopleRun(tracks, log, interrupt.asked, recording)


def write_people_run(
    folder: Path, run: PeopleRun, tracks: Sequence[Track], record: RunRecord, source: Source, overlay: bool
) -> None:
    """Write ``tracks.txt``, ``run.json`` and, with ``overlay``, ``overlay.webm``.

    Args:
        folder: where to.
        run: what was done.
        tracks: the result of the tracker that this folder is for.
        record: goes into ``run.json``, filled in with the frames.
        source: the video.
        overlay: draw the tracks; an interrupted run goes without.
    """
    write_tracks(folder / TRACKS_FILE, tracks)
    record.partial = run.stopped and not source.live
    if overlay and not record.partial:
        _write_overlay(folder / OVERLAY_FILE, run, tracks, source)
    record.frames = run.log.columns(tracks)
    record.write(folder)


def _found(inputs: Inputs, times: StageTimes, recording: Path | None) -> Iterator[tuple[int, Detections]]:
    """Frame numbers with what was found there; frames are decoded only where somebody looks at them."""
    if not inputs.needs_images:
        assert isinstance(inputs.detect, Sequence)
        assert inputs.source.length is not None
        wanted = inputs.source.frames_wanted.within(inputs.source.length)
        assert wanted.last is not None
        for index in range(wanted.first, wanted.last + 1):
            yield index, inputs.detect[index] if index < len(inputs.detect) else Detections.empty()
        return
    frames: Iterable[Frame] = inputs.source.frames()
    if recording is not None:
        frames = _recorded(frames, recording, inputs.source.frame_rate)
    last = -1
    for frame, found in stream(frames, inputs.detect, inputs.describe, inputs.batch_size, times):
        last = frame.index
        if inputs.camera is not None:
            with times.measure("camera"):
                inputs.camera.add(frame.image, found.boxes)
        yield last, found
    _check_all_used(inputs, last)


def _recorded(frames: Iterable[Frame], path: Path, frame_rate: float) -> Iterator[Frame]:
    with VideoWriter(path, frame_rate) as writer:
        for frame in frames:
            writer.write(frame.image)
            yield frame


def _write_overlay(path: Path, run: PeopleRun, tracks: Sequence[Track], source: Source) -> None:
    first, last = run.log.frames[0], run.log.frames[-1]
    frames: Iterable[Frame]
    if run.recording is None:
        frames = (frame for frame in source.frames() if frame.index <= last)
    else:
        replay = open_source(run.recording, FrameRange(0, last - first))
        frames = (Frame(frame.index + first, frame.time, frame.image) for frame in replay.frames())
    write_overlay(path, progress(frames, "drawing", len(run.log.frames)), tracks, source.frame_rate)
    if run.recording is not None:
        run.recording.unlink()


def _frames_expected(inputs: Inputs) -> int | None:
    wanted, length = inputs.source.frames_wanted, inputs.source.length
    if length is None and isinstance(inputs.source, VideoFile):
        length = inputs.source.promised or None
    last = length - 1 if wanted.last is None and length else wanted.last
    return None if last is None else last - wanted.first + 1


def _check_all_used(inputs: Inputs, last: int) -> None:
    """Refuse detections for frames that a video turned out not to have."""
    if not isinstance(inputs.detect, Sequence) or inputs.source.frames_wanted.last is not None:
        return
    if inputs.source.length is None and len(inputs.detect) > last + 1:
        raise RunError(
            f"detection for frame {len(inputs.detect)}, but {inputs.source.name} has {last + 1} frames; "
            "are these the detections of another video?"
        )


def report_end(run: PeopleRun, tracks: Sequence[Track], folder: Path, source: Source) -> int:
    """Say what came out; returns the exit status."""
    count, frames = len(tracks), len(run.log.frames)
    if run.stopped and not source.live:
        return report_partial(run.log.frames[-1], folder)
    people, length = "person" if count == 1 else "people", "frame" if frames == 1 else "frames"
    print(f"{count} {people} in {frames} {length}: {folder / TRACKS_FILE}")
    return 0


def plain(value: Any) -> Any:
    """Settings for ``run.json``: dataclasses as mappings, paths as text."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return str(value) if isinstance(value, Path) else value
