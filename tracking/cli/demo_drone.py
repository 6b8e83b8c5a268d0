"""`tsuiseki demo --scene drone`: people and their actions on a generated clip from a drone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tsuiseki.tracking.cli.options import SeededOutput
    from tsuiseki.tracking.cli.run import Run
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
    from tsuiseki.tracking.pipelines.drone import DroneResult
    from tsuiseki.tracking.pipelines.drone_models import DroneModels
    from tsuiseki.tracking.types.labels import GroundTruth
    from tsuiseki.tracking.video import Source

METHODS: Mapping[Literal["flow", "flow-saf", "flow-maf"], str] = {
    "flow": "flow",
    "flow-saf": "flow, single-frame actions",
    "flow-maf": "flow, multi-frame actions",
}
CLIP_FOLDER, REPORT_FILE, OVERLAY_FILE, THRESHOLD = "drone", "report.html", "overlay.webm", 0.4


@dataclass(frozen=True)
class _Demo:
    """Everything that the result folder tells."""

    source: Source
    truth: GroundTruth
    results: Mapping[str, DroneResult]
    scores: Mapping[str, PeopleEvaluation]
    frames: int


def demo_drone(output: SeededOutput, frames: int, threads: int) -> int:
    """Generate a clip, look at it once, link it three ways, score and report; see `tsuiseki demo --help`."""
    from tsuiseki.datamodules.scenes.drone.clip import DroneSceneSettings
    from tsuiseki.datamodules.scenes.drone.files import write_drone
    from tsuiseki.tracking.cli.track.drone_run import follow
    from tsuiseki.tracking.cli.track.finding import Finding
    from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.pipelines.drone_models import DroneModels, prices_of
    from tsuiseki.tracking.trackers.drone import DroneSettings
    from tsuiseki.tracking.trackers.people.bridging import BridgingSettings
    from tsuiseki.tracking.video import open_source

    with output.run() as run:
        with run.times.measure("generate the clip"):
            scene = DroneSceneSettings(frames=frames)
            clip = write_drone(
                run.work / CLIP_FOLDER,
                scene,
                output.seed,
                watch=lambda drawn: run.watched(drawn, "generating", frames),
            )
        source = open_source(clip)
        finding = Finding(threads=threads)
        models: DroneModels = DroneModels.choose(source, "flow-maf", finding, bridging=BridgingSettings())
        truth = read_ground_truth(clip / "gt" / "gt.txt")
        settings = DroneSettings()
        results, scores = {}, {}
        for method, name in METHODS.items():
            prices = prices_of(method, None, None, threads, scores_known=True, windows=settings.refinement.windows)
            cache = str(clip), run.work / "observations"
            results[name] = follow(run, source, models, method, settings, prices, cache)
            scores[name] = evaluate_sequences([SequencePair(CLIP_FOLDER, truth, results[name].tracks, frames)])
        _write(run, _Demo(source, truth, results, scores, frames))
    if run.status == 0:
        _show(scores, output.out)
    return run.status


def _write(run: Run, demo: _Demo) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.cli.track.drone_run import write_result
    from tsuiseki.tracking.output import RunRecord, versions
    from tsuiseki.tracking.report.actions import ActionReport, action_timelines, captions_of
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.report.page import BOXES_NOTE, Report, ReportedMethod, write_report

    best = demo.results[list(METHODS.values())[-1]]
    captions = captions_of(best.people, best.names, THRESHOLD)
    with run.times.measure("draw the overlay"):
        overlay = run.draw(
            OVERLAY_FILE,
            lambda path: write_overlay(
                path, demo.source.frames(), best.tracks, demo.source.frame_rate, captions, trail_seconds=0.0
            ),
        )
    given, seed = run.output.given, run.output.random_seed
    for method, name in METHODS.items():
        write_result(run, demo.results[name], demo.source, THRESHOLD, f"{method}/")
        record = RunRecord(given.command, {"frames": demo.frames, "method": method}, seed, run.times.seconds)
        record.frames, run.columns = run.columns, {}
        record.write(run.work / method)
    people = len(set(demo.truth.ids.tolist()))
    timelines = action_timelines(
        ActionReport(demo.source.name, best.people, best.names, best.log.frames, THRESHOLD, demo.source.frame_rate)
    )
    report = Report(
        title="Tsuiseki demo, from a drone",
        introduction=f"{people} people on generated ground under a drone that jerks, {demo.frames} frames. Networks "
        "trained on generated clips found and described them and recognised what they do, once; three ways link what "
        "was found, each scored against the truth.",
        methods=[
            ReportedMethod(name, demo.scores[name].combined, found.tracks) for name, found in demo.results.items()
        ],
        truth=demo.truth,
        length=demo.frames,
        frame_rate=demo.source.frame_rate,
        overlay=overlay,
        overlay_note=BOXES_NOTE,
        seconds=run.times.seconds,
        facts={"seed": str(seed)} | versions(),
        more=[timelines],
    )
    run.write(REPORT_FILE, lambda path: write_report(path, report))


def _show(scores: Mapping[str, PeopleEvaluation], out: Path) -> None:
    from tsuiseki.tracking.evaluation.table import people_table, show

    show(people_table(scores))
    print(f"report with video, actions and plots: {out / REPORT_FILE}")
