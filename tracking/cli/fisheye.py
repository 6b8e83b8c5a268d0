"""`tsuiseki track fisheye`: people under ceiling cameras, and where they are on the floor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.cli.models import chosen
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.trackers.fisheye import DEFAULT_FLOW, FisheyeSettings, FloorFlowSettings

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.floor_files import CameraOverFloor
    from tsuiseki.tracking.video import Source

HUNGARIAN = FisheyeSettings()


def track(
    source: list[str],
    cameras: Path,
    out: Path,
    method: Literal["hungarian", "flow"] = "hungarian",
    detections: list[Path] | None = None,
    detector: Path | None = None,
    appearance: Path | None = None,
    crops: Literal["upright", "standing", "image"] = "upright",
    person_height: float = 1.7,
    body_radius: float = 0.25,
    score_threshold: float = 0.4,
    score_range: tuple[float, float] = (0.0, 1.0),
    resize: bool = False,
    threads: int = 0,
    tables: Path = Path("out/cache/person-tables"),
    overlay: bool = False,
    overwrite: bool = False,
    seed: int = 0,
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
        out: folder for the results.
        method: hungarian decides frame by frame, by looks and then by place; flow links the whole video at the end.
        detections: MOTChallenge detections (det.txt) of each source, separated by commas, instead of a detector.
        detector: exported detector; by default the shipped detector_ceiling.onnx.
        appearance: exported appearance network; by default the shipped appearance_people.onnx; none does without.
        crops: what it sees: people turned upright, as on a standing screen without perspective, or as in the image.
        person_height: of the model of a person, metres.
        body_radius: of the model of a person, metres.
        score_threshold: the detector keeps what scores at least this, from 0 to 1.
        score_range: smallest and largest score that the rows of --detections may have.
        resize: scale the calibration to the images where their sizes differ.
        threads: CPU threads of the networks; 0 takes all.
        tables: folder that keeps the tables of the cameras.
        overlay: also write videos with the rotated boxes drawn in.
        overwrite: replace an earlier result in the folder.
        seed: of random numbers; kept in run.json, for nothing here draws any.
        hungarian: settings of --method hungarian.
        flow: settings of --method flow.
    """
    given = dict(locals())
    import numpy as np

    from tsuiseki.tracking.cameras.floor_files import read_floor_cameras
    from tsuiseki.tracking.cameras.person_model import PersonModel, cached_table
    from tsuiseki.tracking.cli.fisheye_run import CameraRun, Chosen, run_camera, write_fisheye_run
    from tsuiseki.tracking.features.networks import Detector, open_appearance
    from tsuiseki.tracking.formats.mot import read_detections
    from tsuiseki.tracking.output import check_output_folder, output_folder
    from tsuiseki.tracking.pipelines.ceiling import CeilingView
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.video import open_source

    _check(score_threshold, score_range, threads)
    check_output_folder(out, overwrite)
    placed = read_floor_cameras(cameras)
    if len(source) != len(placed):
        raise RequestError(
            f"expected one source for each camera, got {len(source)} sources and {len(placed)} cameras in {cameras}"
        )
    if detections is not None and (len(detections) != len(source) or detector is not None):
        raise RequestError(f"--detections: expected {len(source)} files, one a source, and no --detector")
    sources = [open_source(s) for s in source]
    person = PersonModel(height=person_height, body_radius=body_radius)
    looks = chosen("appearance", appearance)
    describe = None if looks is None else open_appearance(looks, threads)
    find = None
    if detections is None:
        path = chosen("detector_ceiling", detector)
        if path is None:
            raise RequestError("--detector: expected a detector or --detections, got none")
        find = Detector(path, score_threshold, threads=threads)
    times = StageTimes()
    runs: list[CameraRun] = []
    how = Chosen(method, hungarian, flow)
    with output_folder(out, overwrite) as work:
        for k, (opened, entry) in enumerate(zip(sources, placed, strict=True)):
            if not opened.has_images and (find is not None or describe is not None or overlay):
                raise RequestError(f"{opened.name} has no images; give --detections, and --appearance none")
            camera = _fitted(entry, opened, resize)
            floor = camera.floor
            if floor is None:
                x, y = camera.camera.position[:2]
                floor = np.array([x - 10, y - 10, x + 10, y + 10])
            with times.measure("table"):
                table = cached_table(tables, camera.camera, floor, person)
            view = CeilingView(camera.camera, table, person, describe, crops)
            found = None if detections is None else read_detections(detections[k], opened.length, score_range)
            runs.append(run_camera(camera, floor, opened, find, found, view, how, times))
        return write_fisheye_run(work, out, runs, given, times, overlay=overlay)


def _check(score_threshold: float, score_range: tuple[float, float], threads: int) -> None:
    if not 0 <= score_threshold <= 1:
        raise RequestError(f"--score-threshold: expected a number from 0 to 1, got {score_threshold:g}")
    if score_range[0] >= score_range[1]:
        raise RequestError(f"--score-range: expected SMALLEST,LARGEST, got {score_range[0]:g},{score_range[1]:g}")
    if threads < 0:
        raise RequestError(f"--threads: expected 0 or more, got {threads}")


def _fitted(placed: CameraOverFloor, source: Source, resize: bool) -> CameraOverFloor:
    """The camera for the source's images."""
    if not source.has_images:
        return placed
    height, width = next(iter(source.frames())).image.shape[:2]
    have = placed.camera.width, placed.camera.height
    if have == (width, height):
        return placed
    if not resize:
        raise RequestError(
            f"{placed.name}: expected images of {have[0]}x{have[1]} as calibrated, got {width}x{height} in "
            f"{source.name}; calibrate at that size, or add --resize to scale the calibration"
        )
    return placed.resized(width, height)
