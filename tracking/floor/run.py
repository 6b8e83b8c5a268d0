"""People on one floor through several cameras: in one call, and by `tsuiseki track floor`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, Seconds, as_settings
from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras
from tsuiseki.tracking.cameras.multicamera import StandingPeople, is_floor_folder, read_floor_folder, read_standing
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike, as_describer, as_detector
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.fisheye.unrolled import ceiling_detector
from tsuiseki.tracking.floor.delayed_floor import people_later
from tsuiseki.tracking.floor.live_run import floor_live, open_live_floor
from tsuiseki.tracking.floor.measured_floor import CameraFeed, MeasuredFloor, around, measured_floor, plan_of
from tsuiseki.tracking.floor.online_floor import people_online
from tsuiseki.tracking.floor.page import FloorPage
from tsuiseki.tracking.floor.tracker import flow_on_one_floor, tracks_in
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.formats.measurement_tables import is_point_file
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.world_tables import FloorPositions, read_floor_positions
from tsuiseki.tracking.monitor.watching import Watching
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.settings import NONE, Detecting
from tsuiseki.tracking.report.overlay import Overlay
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.files import CHOSEN
from tsuiseki.tracking.runs.following import Drawing, count
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.rolling import LiveOptions
from tsuiseki.tracking.runs.run import Run
from tsuiseki.tracking.sphere.settings import FrameTimes
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange, parse_frames
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.tracking.types.recording import Recording
from tsuiseki.tracking.video.recording import recording_of
from tsuiseki.tracking.video.source import Source, SourceLike, file_of, frames_of_size, is_live, named, open_source
from tsuiseki.tracking.weights import shipped

OneFloorMethod = Literal["flow", "lmb"]


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class OneFloorSettings(Options):
    """How people are followed on one floor.

    Attributes:
        method: flow links the whole video at the end; lmb decides at each moment, and does not use certain ids.
        tolerance: frames of different cameras within so many seconds count as taken together; by default a quarter of
            the shortest time between frames.
        delay: seconds after which flow decides on a moment; by default at the end, live 3.
        floor: X1,Y1,X2,Y2 of the plan, metres; by default that of cameras.yaml, or where people are.
    """

    method: OneFloorMethod = "flow"
    tolerance: Seconds | None = None
    delay: Seconds | None = None
    floor: Commas[tuple[float, float, float, float] | None] = None

    @model_validator(mode="after")
    def _floor_has_an_area(self) -> Self:
        if self.floor is not None and not (self.floor[0] < self.floor[2] and self.floor[1] < self.floor[3]):
            raise ValueError(f"`floor`: expected X1 < X2 and Y1 < Y2, got {self.floor}")
        if self.delay is not None and self.method != "flow":
            raise ValueError(f"`delay`: expected it with the method flow, got it with {self.method}")
        return self


ONE_FLOOR = OneFloorSettings()
TIMES = FrameTimes()
DETECTING = Detecting()
DRAWING = Drawing()
LIVE = LiveOptions()
WATCHING = Watching()
NO_SOURCES: list[str] = []
# Options where none were asked for.
NOTHING: Mapping[str, Any] = {}
Watch = Callable[[Iterable[Any], str, int | None], Iterable[Any]]


@dataclass(frozen=True)
class FloorRun:
    """Sources, cameras and models, opened and checked.

    Attributes:
        placed: the cameras.
        sources: one of each camera, or none where there are only detections.
        people: in each frame of each camera, where there is a file of them.
        detecting: detector and appearance network otherwise.
        positions: of other sensors.
        settings: of the tracker.
        times: of the frames.
        wanted: the frames of each camera that are tracked.
    """

    placed: Sequence[CameraOverFloor]
    sources: Sequence[Source]
    people: Sequence[Sequence[StandingPeople]] | None
    detecting: Detecting
    positions: Sequence[FloorPositions]
    settings: OneFloorSettings
    times: FrameTimes
    wanted: FrameRange = EVERY_FRAME

    def measured(self, stages: StageTimes, watch: Watch | None = None) -> MeasuredFloor:
        """Everything that cameras and sensors measured, on the floor."""
        part = slice(self.wanted.first, None if self.wanted.last is None else self.wanted.last + 1)
        if self.sources:
            stamps = self.times.of_videos(self.sources, self.placed)
        else:
            of_all = self.times.of_pixels([np.zeros((len(frames), 2)) for frames in self.people or ()], self.placed)
            stamps = [times[part] for times in of_all]
        people = self._inferred(stages, watch) if self.people is None else [frames[part] for frames in self.people]
        feeds = [
            CameraFeed(c, s[: len(frames)], frames) for c, s, frames in zip(self.placed, stamps, people, strict=True)
        ]
        with stages.measure("locate"):
            return measured_floor(feeds, self._positions_beside(feeds), self.floor, self.settings.tolerance)

    @property
    def floor(self) -> FloatArray | None:
        """``(4,)`` of the plan, where settings or cameras have it."""
        return plan_of(self.placed, self.settings.floor)

    def _positions_beside(self, feeds: Sequence[CameraFeed]) -> list[FloorPositions]:
        """The positions of other sensors; where only some frames are wanted, those of their time."""
        if self.wanted == EVERY_FRAME:
            return list(self.positions)
        times = np.concatenate([feed.times for feed in feeds])
        return [reports.between(float(times.min()), float(times.max())) for reports in self.positions]

    def _inferred(self, stages: StageTimes, watch: Watch | None) -> list[list[StandingPeople]]:
        """What the networks detect in each frame of each video."""
        detecting, describe = self.detecting, None
        if str(detecting.appearance) != NONE:
            network = detecting.appearance or shipped("appearance_people")
            describe = as_describer(network, detecting.threads, device=detecting.device)
        file = detecting.detector or shipped("detector_people")
        people = []
        for source, placed in zip(self.sources, self.placed, strict=True):
            camera, threads = placed.camera, detecting.threads
            detect = as_detector(file, detecting.score_threshold, threads, device=detecting.device)
            if not isinstance(camera, PinholeCamera):
                detect = ceiling_detector(detect, camera, "unrolled")
            inputs = PeopleInputs(source, detect, describe, threads=threads)
            rows = inputs.with_frames(frames_of_size(source, camera.width, camera.height), stages)
            watched = rows if watch is None else watch(rows, f"detecting in {placed.name}", source.frames_expected)
            people.append([StandingPeople.of(detections) for _, detections in watched])
        return people

    def result(
        self,
        stages: StageTimes,
        run_settings: Mapping[str, Any],
        watch: Watch | None = None,
        asked: Mapping[str, Any] = NOTHING,
    ) -> tuple[Result[PersonOnFloor], list[list[Track]]]:
        """The people with the files that show them, and the same people in each camera; ``asked`` are its options."""
        measured = self.measured(stages, watch)
        with stages.measure("associate"):
            if self.settings.method == "lmb":
                people = people_online(measured, int(run_settings.get("seed", 0)))
            elif self.settings.delay is not None:
                people = people_later(measured, self.settings.delay)
            else:
                people = flow_on_one_floor(measured)
        if self.floor is None and people:
            measured = replace(measured, floor=around([person.positions for person in people]))
        steps = np.diff(measured.times)
        facts = {
            "people": len(people), "moments": len(measured.moments),
            "detections": {n: int((measured.points.sensor == k).sum()) for k, n in enumerate(measured.names)},
            "outside_floor": measured.outside, "floor": measured.floor.tolist(),
        }  # fmt: skip
        first = self.wanted.first
        tracks = [
            [replace(track, frames=track.frames + first) for track in tracks_in(measured, people, camera)]
            for camera in range(len(self.placed))
        ]
        numbers = [moment.frames[: len(tracks)] for moment in measured.moments]
        page = FloorPage(measured, people, tracks, self.sources, stages.seconds, run_settings, {CHOSEN: asked})
        result = Result(
            people,
            self.sources[0].address if self.sources else "",
            float(1.0 / np.median(steps)) if len(steps) else 0.0,
            size=self.sources[0].size if self.sources else None,
            recording=recording_of(self.sources[0]) if self.sources else Recording(),
            settings=run_settings,
            facts=facts,
            seconds=stages.seconds,
            frames={"frame": list(range(len(measured.moments))), "time": measured.times.round(6).tolist(),
                    "frame_of_each_video": [[None if n is None else n + first for n in row] for row in numbers]},
            files=page.files(),
        )  # fmt: skip
        return result, tracks


def open_floor(
    sources: Sequence[SourceLike],
    cameras: str | Path | None,
    detections: Sequence[str | Path] | None,
    positions: Sequence[str | Path],
    detecting: Detecting = DETECTING,
    settings: OneFloorSettings = ONE_FLOOR,
    times: FrameTimes = TIMES,
    frames: str | None = None,
) -> FloorRun:
    """Everything opened and checked; see `track_floor`.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    settings = as_settings(settings, OneFloorSettings)
    if settings.delay is not None and positions:
        raise RequestError("`delay`: expected cameras alone, got `positions`, which come all at once; leave one out")
    wanted = parse_frames(frames)
    files = [read_floor_positions(a_path(path, "positions")) for path in positions]
    folder = sources[0] if len(sources) == 1 and cameras is None else None
    if isinstance(folder, str | Path) and is_floor_folder(Path(folder)):
        data_set = read_floor_folder(Path(folder))
        wanted.within(max(map(len, data_set.people)))
        return FloorRun(data_set.cameras, [], data_set.people, detecting, files, settings, times, wanted)
    if cameras is None:
        if not files or sources or detections:
            if missing := [source for source in sources if isinstance(source, str) and file_of(source) is None]:
                raise RequestError(f"expected videos, or a folder of WILDTRACK or Shelf, found no {missing[0]}")
            raise RequestError("`cameras`: expected cameras.yaml with the videos or detections, got none")
        if wanted != EVERY_FRAME:
            raise RequestError("`frames`: expected videos or detections, got positions alone, which have none")
        return FloorRun([], [], [], detecting, files, settings, times)
    placed = read_cameras(a_path(cameras, "cameras"))
    number = len(sources) if sources else len(detections or ())
    if number != len(placed):
        raise RequestError(
            f"expected one source for each camera, got {number} and {len(placed)} cameras in {cameras}; give them in "
            "the order of its entries"
        )
    opened = [open_source(source, wanted) for source in sources]
    if live := [video.name for video in opened if video.live]:
        raise RequestError(f"expected videos that end, got {live[0]}, which is live; use tsuiseki track floor")
    if detections is None:
        if blind := [video.name for video in opened if not video.has_images]:
            raise RequestError(f"{blind[0]} has no images to find people in; give `detections`")
        return FloorRun(placed, opened, None, detecting, files, settings, times, wanted)
    if len(detections) != len(placed):
        raise RequestError(f"`detections`: expected {len(placed)} files, one a camera, got {len(detections)}")
    lengths = [video.length for video in opened] or [None] * len(placed)
    standing = [_read(a_path(path, "detections"), length) for path, length in zip(detections, lengths, strict=True)]
    for path, people, entry in zip(detections, standing, placed, strict=True):
        boxes = np.concatenate([np.empty((0, 4)), *(in_frame.detections.boxes for in_frame in people)])
        compare_with_picture(path, boxes, (entry.camera.width, entry.camera.height))
    if not opened:
        longest = max(map(len, standing))
        empty = [StandingPeople.of(Detections.empty())]
        standing = [people + empty * (longest - len(people)) if people else people for people in standing]
        wanted.within(longest)
    return FloorRun(placed, opened, standing, detecting, files, settings, times, wanted)


def _read(path: Path, length: int | None) -> list[StandingPeople]:
    if is_point_file(path):
        return read_standing(path, length)
    people = [StandingPeople.of(detections) for detections in read_detections(path, length)]
    return people + [StandingPeople.of(Detections.empty())] * ((length or 0) - len(people))


def track_floor(
    sources: Sequence[SourceLike] = (),
    cameras: str | Path | None = None,
    *,
    detections: Sequence[str | Path] | None = None,
    positions: Sequence[str | Path] = (),
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    settings: OneFloorSettings = ONE_FLOOR,
    times: FrameTimes = TIMES,
    frames: str | None = None,
    seed: int = 0,
) -> Result[PersonOnFloor]:
    """Everyone on one floor that several calibrated cameras see, each with one id in all of them.

    Args:
        sources: a video, folder or list of images of each camera, in their order; or one folder of WILDTRACK or Shelf.
        cameras: ``cameras.yaml`` with pose and lens of each, projective or omnidirectional.
        detections: of each camera, instead of a detector: MOTChallenge text, or the CSV of `cameras.multicamera`.
        positions: files of other sensors, ``time,x,y`` and optionally ``sd,id``.
        detector: an exported detector's file, a `Detector`, or a function; by default the shipped one.
        appearance: an exported network's file, an `Appearance`, or a function; ``"none"`` does without.
        settings: see `OneFloorSettings`.
        times: of the frames, where cameras.yaml does not say.
        frames: of each camera these only, counted from 1 with both ends, such as ``"301-400"``.
        output.seed: of the particles of the method ``lmb``.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: a video breaks off.
    """
    networks: Any = {"detector": detector, "appearance": appearance}
    detecting = replace(DETECTING, **networks)
    opened = open_floor(sources, cameras, detections, positions, detecting, settings, times, frames)
    run_settings = {"source": [named(source) for source in sources], "frames": frames, "seed": seed}
    return opened.result(StageTimes(), run_settings)[0]


def floor(
    source: list[str] = NO_SOURCES,
    *,
    output: SeededOutput,
    drawing: Drawing = DRAWING,
    detecting: Detecting = DETECTING,
    settings: OneFloorSettings = ONE_FLOOR,
    times: FrameTimes = TIMES,
    live: LiveOptions = LIVE,
    watching: Watching = WATCHING,
    frames: str | None = None,
    cameras: Path | None = None,
    detections: Commas[list[Path] | None] = None,
    positions: Commas[list[Path] | None] = None,
) -> int:
    """Track people on one floor through several calibrated cameras: one id each in all of them.

    DIR gets world.csv (time, id, place, covariance, cameras), floor.png, dwell.png, report.html and run.json, and in a
    folder for each camera tracks.txt and overlay.webm. Of live cameras it gets a world.csv for each hour.

    Args:
        source: a video, folder of images, webcam or stream of each camera, in their order; or one folder of WILDTRACK
            or Shelf.
        frames: of each camera these only, counted from 1, such as 301-400.
        cameras: lens and pose of each camera; tsuiseki calibrate pose writes it.
        detections: file of each camera instead of a detector: MOTChallenge text, or a CSV with frame,x1,y1,x2,y2 and
            optionally score,ankle_u,ankle_v; frames count from 1, in a column frame_idx instead from 0.
        positions: CSV of other sensors: time,x,y, optionally sd,id; an id is certain.
        output.seed: of the particles of --method lmb.
    """
    watching.check_scene(overlay=False)
    if live.roll is not None or any(map(is_live, source)):
        if drawing.overlay or detections or positions or settings.method != "flow" or times != TIMES:
            raise RequestError(
                "expected live cameras, or `roll`, with the method flow and without `overlay`, `detections`, "
                "`positions`, `offsets` and `timestamps`"
            )
        how = settings.delay, settings.tolerance, settings.floor, live.give_up
        wanted = parse_frames(frames)
        opened_live = live.opened(output.out, lambda: open_live_floor(source, cameras, detecting, *how, wanted))
        seen = partial(watching.observers, output.out, opened_live.videos, on_floor=True)
        with watching.own_output():
            number = floor_live(output, opened_live, live, seen)
            print(f"{count(number, 'person', 'people')} on the floor: {output.out}")
        return 0
    _check_recorded(watching, live)
    opened = open_floor(source, cameras, detections, positions or [], detecting, settings, times, frames)
    if drawing.overlay and not (opened.sources and all(source.has_images for source in opened.sources)):
        raise RequestError("expected videos with images for `overlay`, got none of some cameras; leave it out")
    with output.run() as run:
        run.sources += opened.sources
        result, tracks = opened.result(
            run.times, output.settings, run.steps if opened.people is None else None, run.asked
        )
        run.save(result, partial(_draw_cameras, run, drawing, opened, result, tracks))
        run.done(f"{count(len(result), 'person', 'people')} on the floor: {output.out / 'world.csv'}")
    return run.status


def _draw_cameras(
    run: Run, drawing: Drawing, opened: FloorRun, result: Result[PersonOnFloor], tracks: Sequence[Sequence[Track]]
) -> None:
    """Draw the tracks of each camera into its video, where that is wanted."""
    if drawing.overlay:
        for video, placed, camera_tracks in zip(opened.sources, opened.placed, tracks, strict=True):
            rate = placed.frame_rate or video.frame_rate
            painted = replace(result, painter=Overlay(camera_tracks, rate).draw, frame_rate=rate)
            drawing.draw(run, video, painted, placed.name)


def _check_recorded(watching: Watching, live: LiveOptions) -> None:
    """Refuse what recorded videos cannot have."""
    if watching.wanted:
        raise RequestError("expected live cameras, or `roll`, with `events`, `page` and `show`, got recorded ones")
    if live.give_up is not None:
        raise RequestError("`give_up`: expected live sources, got recorded ones; leave it out")
