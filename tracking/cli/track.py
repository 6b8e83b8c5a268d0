"""`tsuiseki track`: follow people through a video."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.cli.models import chosen, shipped
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.trackers.bytetrack import ByteTrackSettings
from tsuiseki.tracking.trackers.deepsort import DeepSortSettings
from tsuiseki.tracking.trackers.flow import FlowSettings
from tsuiseki.tracking.trackers.ocsort import OcSortSettings
from tsuiseki.tracking.trackers.sort import SortSettings

if TYPE_CHECKING:
    from tsuiseki.tracking.association.affinity import Affinity
    from tsuiseki.tracking.features.networks import Describe, Detect
    from tsuiseki.tracking.types import Detections
    from tsuiseki.tracking.video import Source

Method = Literal["sort", "deepsort", "bytetrack", "ocsort", "flow"]
BY_PLACE = ("sort", "bytetrack", "ocsort")
SORT, DEEPSORT, FLOW = SortSettings(), DeepSortSettings(), FlowSettings()
BYTETRACK, OCSORT = ByteTrackSettings(), OcSortSettings()
DETECTOR, APPEARANCE = DetectorOptions(), AppearanceOptions()


def people(
    source: str,
    out: Path,
    method: Method = "flow",
    detections: Path | None = None,
    detector: Path | None = None,
    detector_options: DetectorOptions = DETECTOR,
    appearance: Path | None = None,
    appearance_options: AppearanceOptions = APPEARANCE,
    affinity: Path | None = None,
    frames: str | None = None,
    score_threshold: float = 0.3,
    score_range: tuple[float, float] = (0.0, 1.0),
    batch_size: int = 4,
    threads: int = 0,
    moving_camera: bool = False,
    overlay: bool = False,
    overwrite: bool = False,
    seed: int = 0,
    sort: SortSettings = SORT,
    deepsort: DeepSortSettings = DEEPSORT,
    bytetrack: ByteTrackSettings = BYTETRACK,
    ocsort: OcSortSettings = OCSORT,
    flow: FlowSettings = FLOW,
) -> int:
    """Track the people in a video: each gets a number that stays.

    Without further options the people are found, described and linked by the models that ship with the toolkit.
    DIR gets tracks.txt (MOTChallenge text), run.json and, with --overlay, overlay.webm.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, the number of a webcam (0, 1, …) or
            the address of a stream.
        out: folder for the results.
        method: sort follows positions; bytetrack, through low scores, too; ocsort, through gaps; deepsort looks, too;
            flow links the whole video at once, which is the most accurate and gives its result at the end.
        detections: MOTChallenge detections (det.txt) to use instead of a detector.
        detector: detector as ONNX; by default the shipped detector_street.onnx. One of other projects (YOLO, YOLOX,
            RT-DETR, RF-DETR, torchvision) is recognised by its inputs and outputs.
        detector_options: what the file of another project's detector does not tell.
        appearance: appearance network as ONNX for deepsort and flow; by default the shipped appearance_people.onnx;
            none does without. One of other projects may be anything from crops to features.
        appearance_options: what the file of another project's appearance network does not tell.
        affinity: exported link costs for flow; by default the shipped affinity_people.onnx after a detector, and
            hand-set costs after --detections, whose scores it does not know; none takes hand-set costs always.
        frames: track this stretch only, counted from 1 with both ends, such as 301-400.
        score_threshold: the detector keeps what scores at least this, from 0 to 1.
        score_range: smallest and largest score that the rows of --detections may have.
        batch_size: frames of one call of the detector.
        threads: CPU threads of the networks; 0 takes all.
        moving_camera: estimate how the camera moves and link people as if it stood still.
        overlay: also write a video with the tracks drawn in.
        overwrite: replace an earlier result in the folder.
        seed: of random numbers; kept in run.json, for the methods here draw none.
        sort: settings of --method sort.
        deepsort: settings of --method deepsort.
        bytetrack: settings of --method bytetrack.
        ocsort: settings of --method ocsort.
        flow: settings of --method flow.
    """
    given = dict(locals())
    # What runs is imported here, so that help and mistakes in the options come at once.
    from tsuiseki.tracking.cli.people_run import (
        Inputs,
        MethodSettings,
        build_tracker,
        plain,
        report_end,
        run_people,
        write_people_run,
    )
    from tsuiseki.tracking.features.camera_motion import CameraPath
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.compensated import MotionCompensated
    from tsuiseki.tracking.video import open_source

    settings = {name: plain(value) for name, value in given.items()}
    _check_numbers(score_threshold, batch_size, threads)
    check_output_folder(out, overwrite)
    opened = open_source(source, parse_frames(frames))
    inputs = Inputs(
        opened,
        _detections(opened, detections, detector, score_range, score_threshold, threads, detector_options),
        _describer(opened, method, appearance, threads, appearance_options),
        batch_size,
        CameraPath() if moving_camera else None,
    )
    if moving_camera and not opened.has_images:
        raise RequestError(f"{opened.name} has no images to tell how the camera moves; leave --moving-camera out")
    if overlay and not opened.has_images:
        raise RequestError(f"{opened.name} has no images to draw on; leave --overlay out")
    learnt = _affinity(method, affinity, threads, given_scores=detections is not None)
    tracker = build_tracker(method, MethodSettings(sort, deepsort, bytetrack, ocsort, flow), learnt)
    if inputs.camera is not None:
        tracker = MotionCompensated(tracker, inputs.camera)
    times = StageTimes()
    with output_folder(out, overwrite) as work:
        run = run_people(inputs, {method: tracker}, times, record_to=work if overlay else None)
        tracks = run.tracks[method]
        record = RunRecord(["tsuiseki", "track", "people"], settings, seed, times.seconds)
        write_people_run(work, run, tracks, record, opened, overlay=overlay)
    return report_end(run, tracks, out, opened)


def _check_numbers(score_threshold: float, batch_size: int, threads: int) -> None:
    if not 0 <= score_threshold <= 1:
        raise RequestError(f"--score-threshold: expected a number from 0 to 1, got {score_threshold:g}")
    if batch_size < 1:
        raise RequestError(f"--batch-size: expected at least 1 frame, got {batch_size}")
    if threads < 0:
        raise RequestError(f"--threads: expected 0 or more, got {threads}")


def _detections(
    source: Source,
    detections: Path | None,
    detector: Path | None,
    score_range: tuple[float, float],
    score_threshold: float,
    threads: int,
    options: DetectorOptions,
) -> Detect | list[Detections]:
    """The given detections, or what finds them."""
    from tsuiseki.tracking.cli.people_run import given_detections
    from tsuiseki.tracking.features.networks import open_detector

    if detections is not None:
        if detector is not None:
            raise RequestError("expected --detections or --detector, got both; leave one out")
        return given_detections(detections, source, score_range)
    if not source.has_images:
        raise RequestError(f"{source.name} has no images to find people in; give --detections")
    return open_detector(detector or shipped("detector"), score_threshold, threads=threads, options=options)


def _describer(
    source: Source, method: Method, appearance: Path | None, threads: int, options: AppearanceOptions
) -> Describe | None:
    """What describes looks, where the method uses them and there are images."""
    from tsuiseki.tracking.features.networks import open_appearance

    if method in BY_PLACE:
        if appearance is not None:
            raise RequestError(f"--appearance: --method {method} does not look at people; choose deepsort or flow")
        return None
    if not source.has_images and appearance is None:
        return None
    path = chosen("appearance", appearance)
    return None if path is None else open_appearance(path, threads, options=options)


def _affinity(method: Method, affinity: Path | None, threads: int, *, given_scores: bool) -> Affinity | None:
    """The learnt costs, where the method uses them; the shipped ones know nothing of the scores of given detections."""
    from tsuiseki.tracking.association.affinity import Affinity

    if method != "flow":
        if affinity is not None:
            raise RequestError(f"--affinity: expected --method flow, which alone uses it, got {method}")
        return None
    if affinity is None and given_scores:
        return None
    path = chosen("affinity", affinity)
    learnt = None if path is None else Affinity(path, threads)
    if learnt is not None and "action" in learnt.card.class_names:
        raise RequestError(f"{path}: these costs ask for actions, which only `tsuiseki track drone` recognises")
    return learnt
