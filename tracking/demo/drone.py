"""`tsuiseki demo --scene drone`: people and their actions on a generated clip from a drone."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tsuiseki.tracking.demo.run import OVERLAY_FILE, REPORT_FILE, record_method, show_scores

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tsuiseki.tracking.cli.run import Run, SeededOutput
    from tsuiseki.tracking.demo.page import DemoResult
    from tsuiseki.tracking.devices import Device
    from tsuiseki.tracking.drone.run import DroneResult

CLIP_FOLDER = "drone"


def demo_drone(output: SeededOutput, frames: int, threads: int, device: Device) -> int:
    """Generate a clip, detect people once, link them three ways, score and report; see `tsuiseki demo --help`."""
    from tsuiseki.datamodules.scenes.clip import write_clip
    from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
    from tsuiseki.tracking.demo.page import DemoResult
    from tsuiseki.tracking.demo.people import DRONE_METHODS, scored
    from tsuiseki.tracking.drone.models import DroneModels
    from tsuiseki.tracking.drone.run import link, observations
    from tsuiseki.tracking.drone.settings import DroneSettings
    from tsuiseki.tracking.features.view_choice import report_models
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.people.settings import FindingOptions
    from tsuiseki.tracking.video.source import open_source

    with output.run() as run:
        with run.times.measure("generate the clip"):
            planned = plan_drone(DroneSceneSettings(frames=frames), output.seed)
            clip = write_clip(
                run.work / CLIP_FOLDER, planned, watch=lambda drawn: run.watched(drawn, "generating", frames)
            )
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
        scores = scored(CLIP_FOLDER, truth, tracks, frames)
        demo = DemoResult(source, truth, tracks, scores, frames)
        _write(run, demo, results)
    if run.status == 0:
        show_scores(demo, output.out, "video, actions and plots")
    return run.status


def _write(run: Run, demo: DemoResult, results: Mapping[str, DroneResult]) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.demo.page import drone_report
    from tsuiseki.tracking.demo.people import DRONE_METHODS
    from tsuiseki.tracking.report.overlay import write_drawn
    from tsuiseki.tracking.report.page import write_report

    source, best = demo.source, results[list(results)[-1]]
    rate, painter = source.frame_rate, best.painter
    assert painter is not None
    overlay = run.draw(OVERLAY_FILE, lambda path: write_drawn(path, source.frames(), rate, painter))
    for method, name in DRONE_METHODS.items():
        run.save(results[name], folder=method)
        record_method(run, results[name].settings, run.times.seconds, run.columns)
    run.columns, run.facts = {}, {}
    facts = {"seed": str(run.output.settings["seed"])}
    report = drone_report(replace(demo, overlay=overlay, seconds=run.times.seconds, facts=facts), best)
    run.write(REPORT_FILE, lambda path: write_report(path, report))
