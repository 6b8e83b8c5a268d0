"""People under ceiling cameras, and where they are on the floor: in one call, and by `tsuiseki track fisheye`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, as_settings
from tsuiseki.tracking.cameras.person_model import PersonModel, check_height
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError, a_path, check_choice
from tsuiseki.tracking.features.exported import (
    AppearanceLike,
    Describe,
    Detect,
    DetectorLike,
    as_describer,
    as_detector,
)
from tsuiseki.tracking.features.view_choice import devices_of
from tsuiseki.tracking.fields import HIDDEN, Commas, showing
from tsuiseki.tracking.fisheye.settings import CeilingOptions, FisheyeSettings
from tsuiseki.tracking.fisheye.tracker import FloorMethod, link_on_floor
from tsuiseki.tracking.fisheye.unrolled import DETECTORS, ceiling_detector
from tsuiseki.tracking.fisheye.view import CeilingSource, CeilingView, given_detections, open_ceiling
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.rotated import RotatedBoxes, half_turned, write_rotated_detections
from tsuiseki.tracking.formats.world_tables import write_world
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.people.settings import NONE, Detecting
from tsuiseki.tracking.result import Result, Writer
from tsuiseki.tracking.runs.files import CHOSEN
from tsuiseki.tracking.runs.following import count
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import SourceLike, named
from tsuiseki.tracking.weights import shipped


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class CeilingDetecting(Detecting):
    """The networks that detect and describe people under a ceiling camera."""

    score_range: Annotated[Commas[tuple[float, float] | None], HIDDEN] = (0.0, 1.0)


DETECTING = CeilingDetecting()
HUNGARIAN = FisheyeSettings()
OPTIONS = CeilingOptions()


def track_fisheye(
    source: SourceLike,
    cameras: str | Path,
    method: FloorMethod = "flow",
    *,
    camera: str | None = None,
    detections: str | Path | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    options: CeilingOptions = OPTIONS,
    hungarian: FisheyeSettings = HUNGARIAN,
    threads: int = 0,
    device: Device = "auto",
    seed: int = 0,
) -> Result[FloorTrack]:
    """Everyone under a ceiling camera: where each is in the image and on the floor, in metres.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images in a list.
        cameras: ``cameras.yaml`` with lens, pose and floor; `tsuiseki calibrate pose` writes it.
        method: ``flow`` links the whole video at once; ``hungarian`` decides each frame.
        camera: name of the entry in ``cameras``, where there are several.
        detections: file of detections to use instead of a detector, see `tsuiseki track fisheye --help`.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; by default the
            shipped one; ``"none"`` does without.
        options: see `CeilingOptions`.
        hungarian: settings of the method ``hungarian``.
        threads: CPU threads of the networks; 0 takes all.
        device: what networks that are given as files run on, see `opened_on`.
        seed: draws nothing; the methods here are exact.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    from tsuiseki.tracking.fisheye.page import camera_floor, floor_page

    networks: Any = {"detector": detector, "appearance": appearance, "threads": threads, "device": device}
    check_choice(method, get_args(FloorMethod), "method")
    files = None if detections is None else [a_path(detections, "detections")]
    options = as_settings(options, CeilingOptions, "options")
    hungarian = as_settings(hungarian, FisheyeSettings, "hungarian")
    cameras = a_path(cameras, "cameras")
    (inputs,) = opened_ceiling([source], cameras, options, replace(DETECTING, **networks), files, camera)
    video, times = inputs.ceiling.source, StageTimes()
    if video.live:
        raise RequestError(f"expected a video that ends, got {video.name}, which is live; record it, or give a list")
    run_settings = {"method": method, "source": named(source), "seed": seed}
    result = floor_result(inputs, inputs.detections(video.frames(), times), method, hungarian, times, run_settings)

    def page(path: Path, folder: Path) -> None:
        cameras_shown = [camera_floor(inputs.ceiling, result.tracks, folder)]
        path.write_text(floor_page(cameras_shown, times.seconds, run_settings, {}), encoding="utf-8")

    return replace(result, files={**result.files, "report.html": page})


def fisheye(
    source: list[str],
    *,
    cameras: Path,
    output: Output,
    ceiling: CeilingOptions = OPTIONS,
    finding: CeilingDetecting = DETECTING,
    method: FloorMethod | None = None,
    detections: Commas[list[Path] | None] = None,
    hungarian: Annotated[
        FisheyeSettings,
        showing("hungarian", "by_appearance", "by_place", "feature_gate", "place_feature_gate", "start_score"),
    ] = HUNGARIAN,
) -> int:
    """Track the people under ceiling cameras: where each is in the image and on the floor, in metres.

    DIR gets, for each camera in a folder of its name (or in DIR itself where there is one), tracks.txt (MOTChallenge
    text, boxes in the image), world.csv, floor.png, dwell.png and, when asked for, overlay.webm and detections.json;
    and report.html and run.json. Cameras are tracked apart: ids of one say nothing of another's.

    Args:
        source: videos, folders of images or MOTChallenge sequence folders, one for each camera, in their order.
        cameras: cameras.yaml with lens, pose and floor of each camera; tsuiseki calibrate pose writes it.
        method: hungarian decides each frame, by appearance and then by place; flow links the whole video at the end; by
            default flow, of a live source hungarian.
        detections: detections of each source, separated by commas, instead of a detector: MOTChallenge text (det.txt),
            or rotated boxes of a folder of images: a JSON list of image_id, bbox (cx, cy, w, h, degrees clockwise) and
            score, or labels of CEPDOF, MW-R or HABBOF.
        finding.detector: detector of this toolkit or of another, as ONNX; by default the shipped detector_ceiling.onnx
            for unrolled views, detector_drone.onnx for images.
        hungarian: settings of --method hungarian.
    """
    from tsuiseki.tracking.features.view_choice import report_blank, report_models
    from tsuiseki.tracking.fisheye.page import CameraFloor, camera_floor, floor_page

    opened = opened_ceiling(source, cameras, ceiling, finding, detections)
    floors, lines, run_settings = list[CameraFloor](), list[str](), output.settings
    with output.run() as run:
        run.facts |= report_models(opened[0].detector, opened[0].describe)
        for inputs in opened:
            if run.signal:
                break
            name, video = inputs.ceiling.placed.name, inputs.ceiling.source
            folder = "" if len(opened) == 1 else name
            located = inputs.detections(run.frames(video, record=ceiling.overlay), run.times)
            steps = run.steps(located, f"tracking {name}")
            chosen = method or ("hungarian" if video.live else "flow")
            result = floor_result(inputs, steps, chosen, hungarian, run.times, run_settings)
            run.save(result, partial(ceiling.draw, run, video, result, folder), folder)
            floors.append(camera_floor(inputs.ceiling, result.tracks, run.work / folder, folder))
            summary = inputs.summary(hungarian.start_score if chosen == "hungarian" else None)
            lines.append(f"{name}: {count(len(result), 'person', 'people')}{summary}")
        report_blank(opened[0].detector)
        page = floor_page(floors, run.times.seconds, run_settings, {CHOSEN: run.asked})
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        run.done("\n".join(lines))
    return run.status


# How far outside the floor somebody may seem to stand, metres: boxes are not exact.
MARGIN = 1.0
# Likewise as a share of the distance from the camera, which comes on top.
SHARE = 0.15


@dataclass
class CeilingInputs:
    """Where the people under one camera come from, opened and checked; keeps who stands on the floor.

    Attributes:
        ceiling: the source and its camera.
        options: of the camera's input.
        detect: what finds people, or what was found in each frame.
        detector: the detector behind that, where there is one.
        describe: what describes their appearance, if anything does.
        person: the model of a person.
        left_out: detections so far that are not on the floor.
        frames: so far.
        number: of detections so far.
        best: the highest score so far; infinite where a detection has none, for it may always start a track.
        boxes: rotated boxes by the image's name: of a folder the file's without suffix, else its number from 1.
    """

    ceiling: CeilingSource
    options: CeilingOptions
    detect: Detect | Sequence[Detections]
    detector: Detect | None
    describe: Describe | None
    person: PersonModel
    left_out: int = 0
    frames: int = 0
    number: int = 0
    best: float = -np.inf
    boxes: dict[str, RotatedBoxes] = field(default_factory=dict)

    def detections(self, frames: Iterable[Frame], times: StageTimes) -> Iterator[FloorDetections]:
        """The people of each frame, located and described; ``times`` gets the stages."""
        with times.measure("table"):
            view = self.ceiling.view(self.options.tables, self.person)
        view = replace(view, appearance=self.describe, crops=self.options.crops)
        return self._noted(self._located(frames, view, times))

    def _located(self, frames: Iterable[Frame], view: CeilingView, times: StageTimes) -> Iterator[FloorDetections]:
        """The people of each frame; no frame is read where boxes are given and no method needs images."""

        def given_at(boxes: Sequence[Detections], index: int) -> Detections:
            return self._keep(boxes[index]) if index < len(boxes) else Detections.empty()

        detect, length = self.detect, self.ceiling.source.length
        if isinstance(detect, Sequence) and view.appearance is None:
            for index in range(len(detect) if length is None else length):
                yield view.locate(given_at(detect, index), times)
            return
        for frame in frames:
            if isinstance(detect, Sequence):
                detections = given_at(detect, frame.index)
            else:
                with times.measure("detect"):
                    detections = self._keep(detect.detect([frame.image])[0])
            yield view.describe(frame.image, view.locate(detections, times), times)

    def _keep(self, detections: Detections) -> Detections:
        """The detections of those on the floor."""
        camera, floor = self.ceiling.placed.camera, self.ceiling.floor
        places = camera.ground(centres(detections.boxes), self.person.height / 2)[:, :2]
        allowed = MARGIN + SHARE * np.linalg.norm(places - camera.position[:2], axis=1, keepdims=True)
        # A pixel at or above the horizon has no place: every comparison with it is False.
        inside = ((places >= floor[:2] - allowed) & (places <= floor[2:] + allowed)).all(axis=1)
        self.left_out += int((~inside).sum())
        return detections if inside.all() else detections.select(inside)

    def _noted(self, people: Iterable[FloorDetections]) -> Iterator[FloorDetections]:
        source = self.ceiling.source
        images = source.images if isinstance(source, ImageFolder) else ()
        for index, located in enumerate(people):
            scores = located.detections.scores
            self.frames += 1
            self.number += len(scores)
            self.best = max(self.best, float(np.nan_to_num(scores, nan=np.inf).max(initial=-np.inf)))
            if self.options.save_detections:
                rows = located.rotated.copy()
                rows[:, 4] = half_turned(rows[:, 4])
                name = images[index].stem if images else str(index + 1)
                self.boxes[name] = RotatedBoxes(rows, np.full(len(rows), -1), scores)
            yield located

    def summary(self, start_score: float | None) -> str:
        """What to tell of detections outside the floor, and where none starts a track from ``start_score`` on."""
        text = ""
        if self.left_out:
            floor = ",".join(f"{value:g}" for value in self.ceiling.floor)
            text = f"; {count(self.left_out, 'detection', 'detections')} left out, outside the floor {floor}"
        if start_score is not None and self.number and self.best < start_score:
            text += (
                f"; none of {self.number} detections scores {start_score:g}, from which a track starts: the best has "
                f"{self.best:.2f}; give a lower `hungarian.start_score`, or `method` flow"
            )
        return text


def opened_ceiling(
    source: Sequence[SourceLike],
    cameras: Path,
    options: CeilingOptions,
    finding: Detecting,
    detections: list[Path] | None,
    only: str | None = None,
) -> list[CeilingInputs]:
    """Sources, cameras and models, opened and checked; of several cameras ``only`` that of a name."""
    if detections is not None and (len(detections) != len(source) or finding.detector is not None):
        raise RequestError(f"`detections`: expected {len(source)} files, one a source, and no `detector`")
    appearance = shipped("appearance_people") if finding.appearance is None else finding.appearance
    network = None if str(appearance) == NONE else appearance
    person = PersonModel(height=options.person_height, body_radius=options.body_radius)
    needs_images = detections is None or network is not None or options.overlay
    views = open_ceiling(source, cameras, options.resize, needs_images=needs_images, only=only)
    for ceiling in views:
        check_height(ceiling.placed.camera, person)
    detects: list[Detect | list[Detections]] = []
    detector: Detect | None = None
    if detections is None:
        path = shipped(DETECTORS[options.view]) if finding.detector is None else finding.detector
        turned = options.view == "image"
        how = finding.threads, options.detector_options, finding.device
        detector = as_detector(path, finding.score_threshold, *how, turned=turned)
        detects += [ceiling_detector(detector, ceiling.placed.camera, options.view) for ceiling in views]
    else:
        files = [given_detections(p, view, finding.score_range) for p, view in zip(detections, views, strict=True)]
        detects += [[frame.scoring(finding.score_threshold) for frame in frames] for frames in files]
    describe = None if network is None else as_describer(network, finding.threads, device=finding.device)
    return [
        CeilingInputs(ceiling, options, detect, detector, describe, person)
        for ceiling, detect in zip(views, detects, strict=True)
    ]


def floor_result(
    inputs: CeilingInputs,
    located: Iterable[FloorDetections],
    method: FloorMethod,
    hungarian: FisheyeSettings,
    times: StageTimes,
    settings: Mapping[str, Any],
) -> Result[FloorTrack]:
    """The result of a run under one camera, without its page; ``times`` and ``settings`` are of the run."""
    from tsuiseki.tracking.fisheye.page import dwell_figure, floor_figure, floor_painter

    ceiling = inputs.ceiling
    floor, rate, camera = ceiling.floor, ceiling.rate, ceiling.placed.camera.position[None, :2]
    tracks = link_on_floor(located, rate, method, hungarian, times)
    files: dict[str, Writer] = {
        "tracks.txt": lambda path, _: write_tracks(path, [t.track for t in tracks]),
        "world.csv": lambda path, _: write_world(path, tracks, ceiling.seconds),
        "floor.png": lambda path, _: floor_figure(tracks, floor, camera).savefig(path, dpi=120, facecolor="white"),
        "dwell.png": lambda path, _: dwell_figure(tracks, floor, rate).savefig(path, dpi=120, facecolor="white"),
    }
    if inputs.options.save_detections:
        files["detections.json"] = lambda path, _: write_rotated_detections(path, inputs.boxes)
    facts = {
        "method": method,
        "people": len(tracks),
        "frames": inputs.frames,
        "frame_rate": rate,
        "outside_floor": inputs.left_out,
    }
    return Result.of(
        ceiling.source,
        tracks,
        frame_rate=rate,
        size=(ceiling.placed.camera.width, ceiling.placed.camera.height),
        settings=settings,
        facts={ceiling.placed.name: facts, **devices_of(inputs.detector, inputs.describe)},
        seconds=times.seconds,
        files=files,
        painter=floor_painter(tracks, rate),
    )
