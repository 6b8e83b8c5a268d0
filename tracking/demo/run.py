"""`tsuiseki demo`: the whole path on a generated labelled clip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import NonNegativeInt, PositiveInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.fields import Threads
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.run import Run

if TYPE_CHECKING:
    from tsuiseki.datamodules.scenes.street_clip import StreetClip
    from tsuiseki.tracking.report.page import Report
    from tsuiseki.tracking.types import Frame, ImageArray
    from tsuiseki.tracking.video.source import Source

REPORT_FILE, OVERLAY_FILE = "report.html", "overlay.webm"
# Frames of the clip.
FRAMES = 180
# Frames a second of the street.
FRAME_RATE = 25.0
# Pixels of the street.
STREET_SIZE = (960, 540)
# People around at a time on the street.
STREET_PEOPLE = 14


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class DemoOutput(SeededOutput):
    """Where the demo goes.

    Attributes:
        seed: of the clip.
        overwrite: replace an earlier demo in the folder.
    """

    out: Path = Path("out/demo")
    seed: NonNegativeInt = 118


OUTPUT = DemoOutput()

# What the page calls stages.
STAGES = {"generate": "generate the clip", "draw": "draw the overlay"}


def demo(
    *,
    output: DemoOutput = OUTPUT,
    scene: Literal["street", "drone"] = "street",
    frames: PositiveInt = FRAMES,
    clip: Path | None = None,
    threads: Threads = 0,
    device: Device = "auto",
) -> int:
    """Run the whole path on a generated clip: detect, describe, track three ways, evaluate, report.

    A street with walking people is generated together with its exact truth. The shipped models find and describe the
    people once; SORT, DeepSORT and min-cost flow link them; each result is scored. DIR gets report.html with everything
    on one page, overlay.webm, METHOD/tracks.txt and METHOD/run.json for each method, and the clip in street/.

    With --scene drone the people act under a drone that jerks; the shipped models also recognise what they do, and the
    flow links them without, with single-frame and with multi-frame action features.

    Args:
        scene: what is generated.
        frames: length of the clip.
        clip: write the street alone, as a video .mp4 or .webm, and end.
        threads: CPU threads of the networks; 0 takes all.
        device: what the networks run on, as in track people.
    """
    if clip is not None:
        return _write_clip(clip, output, frames)
    make = _demo_drone if scene == "drone" else _demo_street
    return make(output, frames, threads, device)


def _street(frames: int, seed: int) -> StreetClip:
    """The street that the demo shows."""
    from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings

    width, height = STREET_SIZE
    return StreetClip(
        StreetSettings(frames=frames, frame_rate=FRAME_RATE, width=width, height=height, people=STREET_PEOPLE), seed
    )


def _write_clip(path: Path, output: SeededOutput, frames: int) -> int:
    """Write the street's pictures into a video."""
    from tsuiseki.tracking.output import output_file
    from tsuiseki.tracking.video.webm import VideoWriter, check_ending

    check_ending(path, "clip")
    with output_file(path, output.overwrite) as work:
        street = _street(frames, output.seed)
        with VideoWriter(work, FRAME_RATE) as writer:
            for frame in progress(range(frames), "generating", frames):
                writer.write(street.draw_frame(frame)[0][0])
    print(f"{frames} frames: {path}")
    return 0


def _demo_street(output: SeededOutput, frames: int, threads: int, device: Device) -> int:
    """Generate a street, track it three ways, score and report."""
    from tsuiseki.datamodules.scenes.clip import write_clip
    from tsuiseki.tracking import weights
    from tsuiseki.tracking.demo.page import STREET_METHODS, STREET_MODELS, street, street_report
    from tsuiseki.tracking.features.view_choice import report_models
    from tsuiseki.tracking.formats.mot import read_ground_truth, write_tracks
    from tsuiseki.tracking.people.run_log import run_trackers
    from tsuiseki.tracking.report.overlay import Overlay
    from tsuiseki.tracking.video.source import open_source

    with output.run() as run:
        models = {kind: weights.shipped(name) for kind, name in STREET_MODELS.items()}
        with run.times.measure("generate"):
            planned = _street(frames, output.seed)
            clip = write_clip(run.work / "street", planned, watch=lambda drawn: progress(drawn, "generating", frames))
        source = open_source(clip)
        inputs, trackers = street(source, models, threads, device)
        run.facts |= report_models(inputs.detect, inputs.describe)
        steps = run.steps(inputs.detections(run.frames(source), run.times))
        tracks, log = run_trackers(steps, trackers, run.times)
        truth = read_ground_truth(clip / "gt" / "gt.txt").between(0, run.count - 1)
        report = street_report(truth, tracks, run.count)
        names = {kind: path.name for kind, path in models.items()}
        for method, name in STREET_METHODS.items():
            run.write(f"{method}/tracks.txt", write_tracks, tracks[name])
            seconds = {s: v for s, v in run.times.seconds.items() if s not in tracks or s == name}
            settings = {"frames": run.count, "models": names, "method": method}
            _record(run, settings, seconds, log.columns(tracks[name]))
        run.facts["models"] = names
        report = replace(report, facts={f"{kind} model": name for kind, name in names.items()})
        _finish(run, source, report, Overlay([*tracks.values()][-1], source.frame_rate).draw)
        _show(report)
    return run.status


def _demo_drone(output: SeededOutput, frames: int, threads: int, device: Device) -> int:
    """Generate a clip, detect people once, link them three ways, score and report; see `demo`."""
    from tsuiseki.datamodules.scenes.clip import write_clip
    from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
    from tsuiseki.tracking.demo.page import DRONE_METHODS, drone_report
    from tsuiseki.tracking.drone.drone_models import DroneModels
    from tsuiseki.tracking.drone.observations import video_observations
    from tsuiseki.tracking.drone.run import link
    from tsuiseki.tracking.drone.settings import DroneSettings
    from tsuiseki.tracking.features.view_choice import report_models
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.people.settings import FindingOptions
    from tsuiseki.tracking.video.source import open_source

    with output.run() as run:
        with run.times.measure("generate the clip"):
            planned = DroneClip(DroneSceneSettings(frames=frames), output.seed)
            clip = write_clip(run.work / "drone", planned, watch=lambda drawn: progress(drawn, "generating", frames))
        source = open_source(clip)
        models = DroneModels.choose(source, "flow-maf", FindingOptions(threads=threads, device=device))
        run.facts |= report_models(models.observers.detect, models.observers.describe, models.observers.recognise)
        truth = read_ground_truth(clip / "gt" / "gt.txt")
        observers, cache = models.observers, run.work / "observations"
        results = {
            name: link(
                run.steps(video_observations(source, observers, models.keys, cache, run.times)),
                source, models, method, DroneSettings(), run.times, {"frames": frames, "method": method},
            )
            for method, name in DRONE_METHODS.items()
        }  # fmt: skip
        report = drone_report(truth, results, frames)
        for method, name in DRONE_METHODS.items():
            run.save(results[name], folder=method)
            _record(run, results[name].settings, run.times.seconds, run.columns)
        run.columns, run.facts = {}, {}
        _finish(run, source, report, [*results.values()][-1].painter)
        _show(report)
    return run.status


def _record(
    run: Run, settings: Mapping[str, Any], seconds: Mapping[str, float], columns: Mapping[str, Sequence[Any]]
) -> None:
    """Write the ``run.json`` of one method, into the folder of its name."""
    from tsuiseki.tracking.output import RunRecord

    record = RunRecord(run.command, settings, run.settings["seed"], seconds, columns)
    record.write(run.work / settings["method"])


def _finish(run: Run, source: Source, report: Report, painter: Callable[[Frame], ImageArray] | None) -> None:
    """Draw the overlay with ``painter``, and write the page."""
    from tsuiseki.tracking.output import versions
    from tsuiseki.tracking.report.overlay import write_drawn
    from tsuiseki.tracking.report.page import report_page

    assert painter is not None
    overlay = run.draw(OVERLAY_FILE, lambda path: write_drawn(path, source.frames(), source.frame_rate, painter))
    seconds = {STAGES.get(stage, stage): value for stage, value in run.times.seconds.items()}
    facts = {**report.facts, "seed": str(run.settings["seed"]), **versions()}
    page = report_page(replace(report, overlay=overlay, seconds=seconds, facts=facts))
    run.write(REPORT_FILE, lambda path: path.write_text(page, encoding="utf-8"))


def _show(report: Report) -> None:
    """Print the scores of all methods."""
    from tsuiseki.tracking.demo.page import why_not_best
    from tsuiseki.tracking.evaluation.tables import people_table, show

    show(people_table(report.scores))
    for line in why_not_best(report):
        print(line)
