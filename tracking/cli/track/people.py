"""`tsuiseki track people`: everyone in view, each with an id."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.track.finding import Finding
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.pipelines.methods import MethodSettings, PeopleMethod
from tsuiseki.tracking.trackers.people.bytetrack import ByteTrackSettings
from tsuiseki.tracking.trackers.people.deepsort import DeepSortSettings
from tsuiseki.tracking.trackers.people.flow import FlowSettings
from tsuiseki.tracking.trackers.people.ocsort import OcSortSettings
from tsuiseki.tracking.trackers.people.sort import SortSettings

if TYPE_CHECKING:
    from tsuiseki.tracking.features.networks.exported import Describe
    from tsuiseki.tracking.trackers.base import PeopleTracker
    from tsuiseki.tracking.types import IntArray
    from tsuiseki.tracking.video import Source

DEFAULT = MethodSettings()
DETECTOR, APPEARANCE = DetectorOptions(), AppearanceOptions()


def people(
    video: Video,
    output: SeededOutput,
    finding: Finding,
    method: PeopleMethod = "flow",
    detector_options: DetectorOptions = DETECTOR,
    view: str = "auto",
    appearance: Path | None = None,
    appearance_options: AppearanceOptions = APPEARANCE,
    affinity: Path | None = None,
    moving_camera: bool = False,
    classes: list[int] | None = None,
    delay: float | None = None,
    sort: SortSettings = DEFAULT.sort,
    deepsort: DeepSortSettings = DEFAULT.deepsort,
    bytetrack: ByteTrackSettings = DEFAULT.bytetrack,
    ocsort: OcSortSettings = DEFAULT.ocsort,
    flow: FlowSettings = DEFAULT.flow,
) -> int:
    """Track the people in a video: each gets a number that stays.

    Without further options the people are found, described and linked by the models that ship with the toolkit.
    DIR gets tracks.txt (MOTChallenge text), report.html, run.json and, with --overlay, overlay.webm.

    Args:
        method: sort follows positions; bytetrack, through low scores, too; ocsort, through gaps; deepsort compares
            appearance, too; flow links the whole video at once, which is the most accurate and gives its result at the
            end, or with --delay a fixed time after each frame.
        detector: detector as ONNX; by default the shipped detector_street.onnx. One of other projects (YOLO, YOLOX,
            RT-DETR, RF-DETR, torchvision) is recognised by its inputs and outputs.
        detector_options: what the file of another project's detector does not tell.
        view: in how many overlapping tiles the detector looks at a frame: auto (as many as find more people in the
            first frames), tiles across such as 3 (1 is the whole frame alone), or across and down such as 3x2.
        appearance: appearance network as ONNX for deepsort and flow; by default the shipped appearance_people.onnx;
            none does without. One of other projects may be anything from crops to features.
        appearance_options: what the file of another project's appearance network does not tell.
        affinity: exported link costs for flow; by default the shipped affinity_people.onnx after a detector, and
            hand-set costs after --detections, whose scores it does not know; none takes hand-set costs always.
        moving_camera: estimate how the camera moves and link people as if it stood still.
        classes: track the rows of --detections of these classes (column 8), each class apart, such as 1,3; tracks.txt
            then has the class in column 8. By default all rows, as one class.
        delay: seconds after which --method flow decides on a frame for good, such as 1.0, with memory that does not
            grow but for the result; by default it decides at the end.
        seed: of random numbers; kept in run.json, for the methods here draw none.
        sort: settings of --method sort.
        deepsort: settings of --method deepsort.
        bytetrack: settings of --method bytetrack.
        ocsort: settings of --method ocsort.
        flow: settings of --method flow.
    """
    # What runs is imported here, so that help and mistakes in the options come at once.
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.features.motion.camera_path import CameraPath
    from tsuiseki.tracking.features.motion.camera_trajectory import said_of_camera
    from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.pipelines.finding import PeopleInputs, threads_of_a_call
    from tsuiseki.tracking.pipelines.methods import people_affinity, people_tracker
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.report.people import PeopleReport, people_page
    from tsuiseki.tracking.trackers.people.by_class import ByClass
    from tsuiseki.tracking.trackers.people.flow import FlowTracker
    from tsuiseki.tracking.trackers.people.run import FrameLog, shifted

    source = video.open(timed=True)
    if moving_camera and not source.has_images:
        raise RequestError(f"{source.name} has no images to tell how the camera moves; leave `moving_camera` out")
    call = threads_of_a_call(source, finding.threads)
    kinds: list[IntArray] = []
    if classes is None:
        detect = finding.detect(source, "detector_street", detector_options, view, call)
    else:
        detect, kinds = finding.classed(source, classes)
    inputs = PeopleInputs(
        source,
        detect,
        _describer(source, method, appearance, call, appearance_options),
        finding.batch_size,
        CameraPath() if moving_camera else None,
        finding.threads,
    )
    learnt = people_affinity(method, affinity, finding.threads, known_scores=knows_scores(inputs.detect))
    settings = MethodSettings(sort, deepsort, bytetrack, ocsort, flow)

    def make() -> PeopleTracker:
        return people_tracker(method, settings, learnt, output.seed, source, inputs.camera, delay)

    tracker = make() if classes is None else ByClass(make, kinds[source.frames_wanted.first :], classes)
    class_of = tracker.class_of if isinstance(tracker, ByClass) else lambda _: -1
    log = FrameLog()
    with output.run() as run:
        frames = run.frames(source, record=video.overlay)
        for index, found in run.steps(inputs.found(frames, run.times), total=frames_expected(source)):
            log.add(index, found)
            with run.times.measure(method):
                tracker.update(found)
        with run.times.measure(method):
            tracks = [shifted(track, log.frames[0]) for track in tracker.tracks()]
        if isinstance(tracker, FlowTracker):
            run.facts["flow"] = tracker.facts()
            if moving_camera and tracker.camera.unknown:
                print(said_of_camera([frame + 1 for frame in tracker.camera.unknown]))
            if tracker.duplicates:
                print(f"{count(tracker.duplicates, 'box', 'boxes')} left out that lay on another")
            rejected, given = tracker.rejected
            if 2 * rejected > given:
                print(f"{rejected} of {given} detections belong to no track: too rarely found again")
        if isinstance(inputs.detect, ViewedDetector) and inputs.detect.summary:
            run.facts["view"] = inputs.detect.summary
            print(f"looked at {inputs.detect.summary}; --view says how many")
        run.columns = log.columns(tracks)
        run.write("tracks.txt", lambda path: write_tracks(path, tracks, class_of))
        drawn = None
        if video.overlay:
            drawn = run.draw(
                video.overlay_file, lambda path: write_overlay(path, run.replay(source), tracks, source.frame_rate)
            )
        seconds, facts = run.times.seconds, {"method": method, "source": video.source}
        page = people_page(PeopleReport(source.name, tracks, log.frames, source.frame_rate, drawn, seconds, facts))
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        who, length = count(len(tracks), "person", "people"), count(run.count, "frame", "frames")
        run.done(f"{who} in {length}: {output.out / 'tracks.txt'}")
    return run.status


def _describer(
    source: Source, method: PeopleMethod, appearance: Path | None, threads: int, options: AppearanceOptions
) -> Describe | None:
    """What describes appearance, where the method compares it and there are images."""
    from tsuiseki.tracking.features.networks.exported import open_appearance
    from tsuiseki.tracking.pipelines.finding import people_describer
    from tsuiseki.tracking.pipelines.methods import compares_appearance

    compared = compares_appearance(method)
    if not compared or appearance is None or str(appearance) == "none":
        return people_describer(source, compared, appearance, threads)
    return open_appearance(appearance, threads, options=options)
