"""`tsuiseki track fisheye`: people under ceiling cameras, and where they are on the floor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.run import Run, count, frames_expected
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.trackers.fisheye import (
    DEFAULT_FLOW,
    FisheyeSettings,
    FisheyeTracker,
    FloorDetections,
    FloorFlowSettings,
    flow_on_floor,
)
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.weights import shipped

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.floor_files import CameraOverFloor
    from tsuiseki.tracking.features.networks.exported import Detector
    from tsuiseki.tracking.pipelines.ceiling import CeilingView
    from tsuiseki.tracking.types.tracks import FloorTrack
    from tsuiseki.tracking.video import Source

HUNGARIAN = FisheyeSettings()
Scaling: TypeAlias = Literal["no", "cut", "widen"]


def fisheye(
    source: list[str],
    /,
    cameras: Path,
    output: SeededOutput,
    method: Literal["hungarian", "flow"] = "hungarian",
    detections: list[Path] | None = None,
    detector: Path | None = None,
    appearance: Path | None = None,
    crops: Literal["upright", "standing", "image"] = "upright",
    person_height: float = 1.7,
    body_radius: float = 0.25,
    score_threshold: float = 0.3,
    score_range: tuple[float, float] = (0.0, 1.0),
    resize: Scaling = "no",
    threads: int = 0,
    tables: Path = Path("out/cache/person-tables"),
    overlay: bool = False,
    hungarian: FisheyeSettings = HUNGARIAN,
    flow: FloorFlowSettings = DEFAULT_FLOW,
) -> int:
    """Track the people under ceiling cameras: where each is in the image and on the floor, in metres.

    DIR gets, for each camera in a folder of its name (or in DIR itself where there is one), tracks.txt (MOTChallenge
    text, boxes in the image), world.csv, floor.png, dwell.png and, with --overlay, overlay.webm; and report.html and
    run.json. Cameras are tracked apart: ids of one say nothing of another's.

    Args:
        source: videos, folders of images or MOTChallenge sequence folders, one for each camera, in their order.
        cameras: cameras.yaml with lens, pose and floor of each camera; tsuiseki calibrate pose writes it.
        method: hungarian decides each frame, by appearance and then by place; flow links the whole video at the end.
        detections: MOTChallenge detections (det.txt) of each source, separated by commas, instead of a detector.
        detector: exported detector; by default the shipped detector_drone.onnx, which knows people from above but finds
            few of them in a fisheye picture: train one with configs/detector_ceiling.yaml, or give detections.
        appearance: exported appearance network; by default the shipped appearance_people.onnx; none does without.
        crops: what it sees: people turned upright, as on a standing screen without perspective, or as in the image.
        person_height: of the model of a person, metres.
        body_radius: of the model of a person, metres.
        score_threshold: the detector keeps what scores at least this, from 0 to 1.
        score_range: smallest and largest score that the rows of --detections may have.
        resize: where images have another size than the calibration, scale it: cut, where they show a part of what was
            calibrated, widen, where they show more at the sides.
        threads: CPU threads of the networks; 0 takes all.
        tables: folder that keeps the tables of the cameras.
        overlay: also write videos with the rotated boxes drawn in.
        seed: of random numbers; kept in run.json, for nothing here draws any.
        hungarian: settings of --method hungarian.
        flow: settings of --method flow.
    """
    from tsuiseki.tracking.cameras.person_model import PersonModel
    from tsuiseki.tracking.features.networks.exported import open_appearance
    from tsuiseki.tracking.formats.mot import read_detections

    _check(score_threshold, score_range, threads)
    if detections is not None and (len(detections) != len(source) or detector is not None):
        raise RequestError(f"`detections`: expected {len(source)} files, one a source, and no `detector`")
    model = None if str(appearance) == "none" else appearance or shipped("appearance_people")
    finds = None if detections is not None else _detector(detector, score_threshold, threads)
    person = PersonModel(height=person_height, body_radius=body_radius)
    views = _views(source, cameras, resize, needs_images=finds is not None or model is not None or overlay)
    describe = None if model is None else open_appearance(model, threads)
    with output.run() as run:
        done = []
        for k, view in enumerate(views):
            if run.interrupted:
                break
            with run.times.measure("table"):
                ceiling = _ceiling(view, tables, person)
            ceiling = ceiling.looking(describe, crops)
            given = None if detections is None else read_detections(detections[k], view.source.length, score_range)
            found = _found(run, view.source, finds, given, ceiling)
            tracks, frames = _followed(run, view, found, method, hungarian, flow)
            done.append(_written(run, view, tracks, "" if len(views) == 1 else f"{view.placed.name}/", overlay))
            run.facts[view.placed.name] = {"people": len(tracks), "frames": frames, "frame_rate": view.rate}
        run.write("report.html", lambda path: path.write_text(_page(run, done), encoding="utf-8"))
        lines = [f"{v.placed.name}: {count(len(t), 'person', 'people')}" for v, t, _ in done]
        run.done("\n".join([*lines, f"results: {output.out}"]))
    return run.status


@dataclass(frozen=True)
class _View:
    """A source, its camera for images of this size, and the floor."""

    source: Source
    placed: CameraOverFloor
    floor: FloatArray

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.placed.frame_rate or self.source.frame_rate


def _check(score_threshold: float, score_range: tuple[float, float], threads: int) -> None:
    if not 0 <= score_threshold <= 1:
        raise RequestError(f"`score_threshold`: expected a number from 0 to 1, got {score_threshold:g}")
    if score_range[0] >= score_range[1]:
        raise RequestError(f"`score_range`: expected SMALLEST,LARGEST, got {score_range[0]:g},{score_range[1]:g}")
    if threads < 0:
        raise RequestError(f"`threads`: expected 0 or more, got {threads}")


def _detector(detector: Path | None, score_threshold: float, threads: int) -> Detector:
    from tsuiseki.tracking.features.networks.exported import Detector

    path = detector or shipped("detector_drone")
    if str(path) == "none":
        raise RequestError("`detector`: expected a detector or `detections`, got none")
    return Detector(path, score_threshold, threads=threads)


def _views(source: Sequence[str], cameras: Path, resize: Scaling, *, needs_images: bool) -> list[_View]:
    """Sources with their cameras, checked against each other."""
    import numpy as np

    from tsuiseki.tracking.cameras.floor_files import read_floor_cameras
    from tsuiseki.tracking.video import open_source

    placed = read_floor_cameras(cameras)
    if len(source) != len(placed):
        raise RequestError(
            f"expected one source for each camera, got {len(source)} sources and {len(placed)} cameras in {cameras}"
        )
    views = []
    for text, entry in zip(source, placed, strict=True):
        opened = open_source(text)
        if needs_images and not opened.has_images:
            raise RequestError(f"{opened.name} has no images; give `detections`, and none for `appearance`")
        fitted = _fitted(entry, opened, resize)
        x, y = fitted.camera.position[:2]
        floor = np.array([x - 10, y - 10, x + 10, y + 10]) if fitted.floor is None else fitted.floor
        views.append(_View(opened, fitted, floor))
    return views


def _fitted(placed: CameraOverFloor, source: Source, resize: Scaling) -> CameraOverFloor:
    """The camera for the source's images."""
    if not source.has_images or source.live:
        return placed
    height, width = next(iter(source.frames())).image.shape[:2]
    have = placed.camera.width, placed.camera.height
    if have == (width, height):
        return placed
    if resize == "no":
        raise RequestError(
            f"{placed.name}: expected images of {have[0]}x{have[1]} as calibrated, got {width}x{height} in "
            f"{source.name}; calibrate at that size, or scale the calibration with `resize` cut or widen"
        )
    return placed.resized(width, height, resize)


def _ceiling(view: _View, tables: Path, person: object) -> CeilingView:
    from tsuiseki.tracking.cameras.person_model import PersonModel, cached_table
    from tsuiseki.tracking.pipelines.ceiling import CeilingView

    assert isinstance(person, PersonModel)
    camera = view.placed.camera
    return CeilingView(camera, cached_table(tables, camera, view.floor, person), person)


def _found(
    run: Run, source: Source, detector: Detector | None, given: Sequence[Detections] | None, ceiling: CeilingView
) -> Iterator[tuple[int, FloorDetections]]:
    """Frame numbers with the people found there, located and described."""
    if given is not None and ceiling.appearance is None:
        for index in range(source.length if source.length is not None else len(given)):
            found = given[index] if index < len(given) else Detections.empty()
            yield index, ceiling.locate(found, run.times)
        return
    for frame in run.frames(source):
        if detector is None:
            assert given is not None
            found = given[frame.index] if frame.index < len(given) else Detections.empty()
        else:
            with run.times.measure("detect"):
                found = detector.detect([frame.image])[0]
        yield frame.index, ceiling.describe(frame.image, ceiling.locate(found, run.times), run.times)


def _followed(
    run: Run,
    view: _View,
    found: Iterator[tuple[int, FloorDetections]],
    method: str,
    hungarian: FisheyeSettings,
    flow: FloorFlowSettings,
) -> tuple[list[FloorTrack], int]:
    """The tracks of a source, and the number of its frames."""
    online, kept = FisheyeTracker(view.rate, hungarian), []
    before = run.count
    for _, each in run.steps(found, f"tracking {view.placed.name}", frames_expected(view.source)):
        if method == "flow":
            kept.append(each)
            continue
        with run.times.measure("associate"):
            online.update(each)
    with run.times.measure("associate"):
        tracks = flow_on_floor(kept, view.rate, flow) if method == "flow" else online.tracks()
    return tracks, run.count - before


def _written(
    run: Run, view: _View, tracks: list[FloorTrack], prefix: str, overlay: bool
) -> tuple[_View, list[FloorTrack], Path | None]:
    """Write what one camera gives; what the page needs of it."""
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.formats.world import write_world
    from tsuiseki.tracking.report.floor import dwell_figure, floor_figure, write_floor_overlay

    spot = view.placed.camera.position[None, :2]
    run.write(f"{prefix}tracks.txt", lambda path: write_tracks(path, [t.track for t in tracks]))
    run.write(f"{prefix}world.csv", lambda path: write_world(path, tracks, view.rate))
    plan, dwell = floor_figure(tracks, view.floor, spot), dwell_figure(tracks, view.floor, view.rate)
    run.write(f"{prefix}floor.png", lambda path: plan.savefig(path, dpi=120, facecolor="white"))
    run.write(f"{prefix}dwell.png", lambda path: dwell.savefig(path, dpi=120, facecolor="white"))
    video = None
    if overlay and not view.source.live:
        frames = run.watched(view.source.frames(), f"drawing {view.placed.name}", frames_expected(view.source))
        video = run.draw(f"{prefix}overlay.webm", lambda path: write_floor_overlay(path, frames, tracks, view.rate))
    return view, tracks, video


def _page(run: Run, done: Sequence[tuple[_View, list[FloorTrack], Path | None]]) -> str:
    from tsuiseki.tracking.report.floor import FloorSection, floor_page

    sections = [
        FloorSection(v.placed.name, tracks, v.floor, v.placed.camera.position[:2], v.rate, video)
        for v, tracks, video in done
    ]
    return floor_page(sections, run.times.seconds, {k: str(v) for k, v in run.output.given.settings.items()})
