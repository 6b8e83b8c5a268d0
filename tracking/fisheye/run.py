"""`tsuiseki track fisheye`: people under ceiling cameras, and where they are on the floor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.run import Run, count, frames_expected
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fisheye.settings import DEFAULT_FLOW, CeilingOptions, FisheyeSettings, FloorFlowSettings
from tsuiseki.tracking.people.settings import Detecting
from tsuiseki.tracking.weights import shipped

if TYPE_CHECKING:
    from tsuiseki.tracking.cameras.person_model import PersonModel
    from tsuiseki.tracking.features.exported import Describe, Detect
    from tsuiseki.tracking.fisheye.page import FloorSection
    from tsuiseki.tracking.fisheye.tracking import CeilingSource
    from tsuiseki.tracking.fisheye.view import FloorGate
    from tsuiseki.tracking.types import Detections
    from tsuiseki.tracking.types.tracks import FloorTrack

DETECTING = Detecting(score_range=(0.0, 1.0))
HUNGARIAN = FisheyeSettings()


def fisheye(
    source: list[str],
    /,
    cameras: Path,
    output: SeededOutput,
    ceiling: CeilingOptions,
    finding: Detecting = DETECTING,
    method: Literal["hungarian", "flow"] | None = None,
    detections: list[Path] | None = None,
    hungarian: FisheyeSettings = HUNGARIAN,
    flow: FloorFlowSettings = DEFAULT_FLOW,
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
        detector: detector of this toolkit or of another, as ONNX; by default the shipped detector_ceiling.onnx for
            unrolled views, detector_drone.onnx for images.
        seed: of random numbers; kept in run.json, for nothing here draws any.
        hungarian: settings of --method hungarian.
        flow: settings of --method flow.
    """
    from tsuiseki.tracking.cli.detector_lines import tell_blank, tell_models
    from tsuiseki.tracking.fisheye.page import floor_page

    opened = _opened(source, cameras, ceiling, finding, detections)
    done, lines = [], []
    with output.run() as run:
        tell_models(run, opened.detector, opened.describe)
        for each, detect in zip(opened.views, opened.detect, strict=True):
            if run.interrupted:
                break
            chosen = method or ("hungarian" if each.source.live else "flow")
            shown, line = _tracked(run, opened, each, detect, ceiling, chosen, hungarian, flow)
            done.append(shown)
            lines.append(line)
        tell_blank(opened.detector)
        settings = {name: str(value) for name, value in output.given.settings.items()}
        page = floor_page(done, run.times.seconds, settings)
        run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
        run.done("\n".join([*lines, f"results: {output.out}"]))
    return run.status


@dataclass(frozen=True)
class _Opened:
    """What a run tracks with: views, what detects people in each, the detector behind that, and the describer."""

    views: list[CeilingSource]
    detect: list[Detect | list[Detections]]
    detector: Detect | None
    describe: Describe | None
    person: PersonModel


def _opened(
    source: list[str], cameras: Path, ceiling: CeilingOptions, finding: Detecting, detections: list[Path] | None
) -> _Opened:
    """Sources, cameras and models, opened and checked."""
    from tsuiseki.tracking.cameras.person_model import PersonModel, check_height
    from tsuiseki.tracking.features.exported import open_appearance, open_detector
    from tsuiseki.tracking.fisheye.tracking import given_detections, open_ceiling
    from tsuiseki.tracking.fisheye.unrolled import DETECTORS, looking

    if detections is not None and (len(detections) != len(source) or finding.detector is not None):
        raise RequestError(f"`detections`: expected {len(source)} files, one a source, and no `detector`")
    network = None if str(finding.appearance) == "none" else finding.appearance or shipped("appearance_people")
    person = PersonModel(height=ceiling.person_height, body_radius=ceiling.body_radius)
    needs_images = detections is None or network is not None or ceiling.overlay
    views = open_ceiling(source, cameras, ceiling.resize, needs_images=needs_images)
    for each in views:
        check_height(each.placed.camera, person)
    found: list[Detect | list[Detections]] = []
    detector: Detect | None = None
    if detections is None:
        path, options = finding.detector or shipped(DETECTORS[ceiling.view]), ceiling.detector_options
        detector = found_by = open_detector(
            path, finding.score_threshold, threads=finding.threads, options=options, device=finding.device
        )
        found += [looking(found_by, each.placed.camera, ceiling.view, ceiling.unrolling) for each in views]
    else:
        found += [given_detections(p, each, finding.score_range) for p, each in zip(detections, views, strict=True)]
    describe = None if network is None else open_appearance(network, finding.threads, device=finding.device)
    return _Opened(views, found, detector, describe, person)


def _tracked(
    run: Run,
    opened: _Opened,
    each: CeilingSource,
    detect: Detect | list[Detections],
    ceiling: CeilingOptions,
    method: Literal["hungarian", "flow"],
    hungarian: FisheyeSettings,
    flow: FloorFlowSettings,
) -> tuple[FloorSection, str]:
    """Track under one camera and write what came of it; what the page needs, and a line for the user."""
    from tsuiseki.tracking.fisheye.tracking import link_on_floor, people_on_floor
    from tsuiseki.tracking.fisheye.view import BestScore, FloorGate, FoundBoxes
    from tsuiseki.tracking.formats.rotated import write_rotated_detections

    with run.times.measure("table"):
        view = each.view(ceiling.tables, opened.person).looking(opened.describe, ceiling.crops)
    gate = FloorGate(each.placed.camera, each.floor, opened.person.height / 2)
    people = people_on_floor(run.frames(each.source), detect, view, run.times, each.source.length, gate)
    before, name = run.count, each.placed.name
    prefix = "" if len(opened.views) == 1 else f"{name}/"
    boxes, scores = FoundBoxes(each.source), BestScore()
    kept = scores.watched(boxes.watched(people) if ceiling.save_detections else people)
    watched = run.steps(kept, f"tracking {name}", frames_expected(each.source))
    tracks = link_on_floor(watched, each.rate, method, hungarian, flow, run.times)
    if ceiling.save_detections:
        run.write(f"{prefix}detections.json", partial(write_rotated_detections, found=boxes.boxes))
    shown = _written(run, each, tracks, prefix, ceiling.overlay)
    run.facts[name] = {
        "method": method,
        "people": len(tracks),
        "frames": run.count - before,
        "frame_rate": each.rate,
        "outside_floor": gate.left_out,
    }
    unstarted = scores.too_low(hungarian.start_score) if method == "hungarian" else ""
    return shown, f"{name}: {count(len(tracks), 'person', 'people')}{_left_out(gate, each)}{unstarted}"


def _left_out(gate: FloorGate, view: CeilingSource) -> str:
    """What to tell of detections outside the floor."""
    if gate.left_out == 0:
        return ""
    floor = ",".join(f"{value:g}" for value in view.floor)
    return f"; {count(gate.left_out, 'detection', 'detections')} left out, outside the floor {floor}"


def _written(run: Run, view: CeilingSource, tracks: list[FloorTrack], prefix: str, overlay: bool) -> FloorSection:
    """Write what one camera gives; what the page needs of it."""
    from tsuiseki.tracking.fisheye.page import FloorSection, dwell_figure, floor_figure, write_floor_overlay
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.formats.track3d import write_world

    position = view.placed.camera.position
    run.write(f"{prefix}tracks.txt", lambda path: write_tracks(path, [t.track for t in tracks]))
    run.write(f"{prefix}world.csv", lambda path: write_world(path, tracks, view.rate))
    plan, dwell = floor_figure(tracks, view.floor, position[None, :2]), dwell_figure(tracks, view.floor, view.rate)
    run.write(f"{prefix}floor.png", lambda path: plan.savefig(path, dpi=120, facecolor="white"))
    run.write(f"{prefix}dwell.png", lambda path: dwell.savefig(path, dpi=120, facecolor="white"))
    video = None
    if overlay and not view.source.live:
        frames = run.watched(view.source.frames(), f"drawing {view.placed.name}", frames_expected(view.source))
        video = run.draw(f"{prefix}overlay.webm", lambda path: write_floor_overlay(path, frames, tracks, view.rate))
    return FloorSection(view.placed.name, tracks, view.floor, position[:2], view.rate, video)
