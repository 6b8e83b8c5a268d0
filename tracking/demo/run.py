"""`tsuiseki demo`: the whole path on a generated labelled clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tsuiseki.tracking.cli.run import Run, SeededOutput
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.demo.page import DemoResult
    from tsuiseki.tracking.drone.run import DroneResult
    from tsuiseki.tracking.people.tracker import FrameLog

REPORT_FILE, OVERLAY_FILE = "report.html", "overlay.webm"
FRAMES, FRAME_RATE = 180, 25.0
OUTPUT = SeededOutput(Path("out/demo"), seed=100)


def demo(
    output: SeededOutput = OUTPUT,
    scene: Literal["street", "drone"] = "street",
    train: bool = False,
    assets: Path | None = None,
    frames: int = FRAMES,
    threads: int = 0,
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
        train: first train the models anew on generated scenes and use those; takes hours, and the train extra.
        assets: with --train, folder of the bodies and clothes that people are rendered of
            (docs/methods/rendered-people.md says how to get them); without it the detector learns from drawn people
            alone.
        frames: length of the clip.
        seed: of the clip.
        threads: CPU threads of the networks; 0 takes all.
        device: what the networks run on, as in track people.
        overwrite: replace an earlier demo in the folder.
    """
    if scene == "drone":
        if train:
            raise RequestError("`train`: expected --scene street; for a drone see docs/how-to/train-and-export.md")
        return _demo_drone(output, frames, threads, device)
    if assets is not None and not train:
        raise RequestError("`assets`: expected it with `train`, which renders people of it; leave it out otherwise")
    return _demo_street(output, frames, threads, device, train=train, assets=assets)


def _demo_street(
    output: SeededOutput, frames: int, threads: int, device: Device, *, train: bool, assets: Path | None
) -> int:
    """Generate a street, track it three ways, score and report."""
    from tsuiseki.datamodules.scenes.clip import write_clip
    from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
    from tsuiseki.tracking.demo.page import DemoResult, scored, shipped_street, street_inputs, street_trackers
    from tsuiseki.tracking.features.standing_camera import StandingCamera
    from tsuiseki.tracking.features.view_choice import report_models
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.people.tracker import run_trackers
    from tsuiseki.tracking.video.source import open_source
    from tsuiseki.trainers.shipped_models import make_models

    with output.run() as run:
        models = make_models(run.work / "models", assets) if train else shipped_street()
        with run.times.measure("generate"):
            planned = StreetClip(StreetSettings(frames=frames, frame_rate=FRAME_RATE), output.seed)
            clip = write_clip(
                run.work / "street", planned, watch=lambda drawn: run.watched(drawn, "generating", frames)
            )
        source = open_source(clip)
        camera = StandingCamera()
        inputs = street_inputs(source, models, threads, camera, device)
        run.facts |= report_models(inputs.detect, inputs.describe)
        found = inputs.detections(run.frames(source), run.times)
        steps = run.steps(found)
        tracks, log = run_trackers(steps, street_trackers(source, models, threads, camera), run.times)
        truth = read_ground_truth(clip / "gt" / "gt.txt").between(0, run.count - 1)
        scores = scored("street", truth, tracks, run.count)
        demo = DemoResult(source, truth, tracks, scores, run.count)
        _write(run, demo, log, models)
    if run.status == 0:
        _show(demo, output.out, "video and plots")
    return run.status


def _write(run: Run, demo: DemoResult, log: FrameLog, models: Mapping[str, Path]) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.demo.page import STREET_METHODS, street_report
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.report.page import write_report

    names = {kind: path.name for kind, path in models.items()}
    for method, name in STREET_METHODS.items():
        tracks = demo.tracks[name]
        run.write(f"{method}/tracks.txt", write_tracks, tracks)
        seconds = {s: v for s, v in run.times.seconds.items() if s not in demo.tracks or s == name}
        settings = {"frames": demo.frames, "models": names, "method": method}
        _record(run, settings, seconds, log.columns(tracks))
    run.facts["models"] = names
    source, best = demo.source, demo.tracks[list(demo.tracks)[-1]]
    overlay = run.draw(OVERLAY_FILE, lambda path: write_overlay(path, source.frames(), best, source.frame_rate))
    facts = {f"{kind} model": name for kind, name in names.items()} | {"seed": str(run.output.settings["seed"])}
    report = street_report(replace(demo, overlay=overlay, seconds=run.times.seconds, facts=facts))
    run.write(REPORT_FILE, lambda path: write_report(path, report))


def _demo_drone(output: SeededOutput, frames: int, threads: int, device: Device) -> int:
    """Generate a clip, detect people once, link them three ways, score and report; see `demo`."""
    from tsuiseki.datamodules.scenes.clip import write_clip
    from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
    from tsuiseki.tracking.demo.page import DRONE_METHODS, DemoResult, scored
    from tsuiseki.tracking.drone.drone_models import DroneModels
    from tsuiseki.tracking.drone.run import link, observations
    from tsuiseki.tracking.drone.settings import DroneSettings
    from tsuiseki.tracking.features.view_choice import report_models
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.people.settings import FindingOptions
    from tsuiseki.tracking.video.source import open_source

    with output.run() as run:
        with run.times.measure("generate the clip"):
            planned = DroneClip(DroneSceneSettings(frames=frames), output.seed)
            clip = write_clip(run.work / "drone", planned, watch=lambda drawn: run.watched(drawn, "generating", frames))
        source = open_source(clip)
        models = DroneModels.choose(source, "flow-maf", FindingOptions(threads=threads, device=device))
        run.facts |= report_models(models.observers.detect, models.observers.describe, models.observers.recognise)
        truth = read_ground_truth(clip / "gt" / "gt.txt")
        cache = str(clip), run.work / "observations"
        results = {
            name: link(
                run.steps(observations(run, source, models, cache)),
                source, models, method, DroneSettings(), run.times, {"frames": frames, "method": method},
            )
            for method, name in DRONE_METHODS.items()
        }  # fmt: skip
        tracks = {name: [person.track for person in found] for name, found in results.items()}
        scores = scored("drone", truth, tracks, frames)
        demo = DemoResult(source, truth, tracks, scores, frames)
        _write_drone(run, demo, results)
    if run.status == 0:
        _show(demo, output.out, "video, actions and plots")
    return run.status


def _write_drone(run: Run, demo: DemoResult, results: Mapping[str, DroneResult]) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.demo.page import DRONE_METHODS, drone_report
    from tsuiseki.tracking.report.overlay import write_drawn
    from tsuiseki.tracking.report.page import write_report

    source, best = demo.source, results[list(results)[-1]]
    rate, painter = source.frame_rate, best.painter
    assert painter is not None
    overlay = run.draw(OVERLAY_FILE, lambda path: write_drawn(path, source.frames(), rate, painter))
    for method, name in DRONE_METHODS.items():
        run.save(results[name], folder=method)
        _record(run, results[name].settings, run.times.seconds, run.columns)
    run.columns, run.facts = {}, {}
    facts = {"seed": str(run.output.settings["seed"])}
    report = drone_report(replace(demo, overlay=overlay, seconds=run.times.seconds, facts=facts), best)
    run.write(REPORT_FILE, lambda path: write_report(path, report))


def _record(
    run: Run, settings: Mapping[str, Any], seconds: Mapping[str, float], columns: Mapping[str, Sequence[Any]]
) -> None:
    """Write the ``run.json`` of one method, into the folder of its name."""
    from tsuiseki.tracking.output import RunRecord

    record = RunRecord(run.output.command, settings, run.output.settings["seed"], seconds, columns)
    record.write(run.work / settings["method"])


def _show(demo: DemoResult, out: Path, what: str) -> None:
    """Print the scores of all methods, and where the report is; ``what`` it shows."""
    from tsuiseki.tracking.demo.page import why_not_best
    from tsuiseki.tracking.evaluation.tables import people_table, show

    show(people_table(demo.scores))
    for line in why_not_best(demo):
        print(line)
    print(f"report with {what}: {out / REPORT_FILE}")
