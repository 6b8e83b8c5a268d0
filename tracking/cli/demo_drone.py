"""`tsuiseki demo --scene drone`: people and their actions on a generated clip from a drone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tsuiseki.tracking.cli.drone_models import DroneModels
    from tsuiseki.tracking.cli.drone_run import DroneRun
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.types.labels import GroundTruth
    from tsuiseki.tracking.video import Source

METHODS: Mapping[Literal["flow", "flow-saf", "flow-maf"], str] = {
    "flow": "flow",
    "flow-saf": "flow, single-frame actions",
    "flow-maf": "flow, multi-frame actions",
}
CLIP_FOLDER, REPORT_FILE, THRESHOLD = "drone", "report.html", 0.4


@dataclass(frozen=True)
class _Demo:
    """Everything that the result folder tells."""

    source: Source
    truth: GroundTruth
    runs: Mapping[str, DroneRun]
    scores: Mapping[str, PeopleEvaluation]
    times: StageTimes
    frames: int
    seed: int


def demo_drone(out: Path, frames: int, seed: int, threads: int, *, overwrite: bool) -> None:
    """Generate a clip, look at it once, link it three ways, score and report; see `tsuiseki demo --help`."""
    from tsuiseki.datamodules.scenes.drone.clip import DroneSceneSettings
    from tsuiseki.datamodules.scenes.drone.files import write_drone
    from tsuiseki.tracking.cli.drone_models import DroneModels, prices_of
    from tsuiseki.tracking.cli.drone_run import run_drone
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_people
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.output import output_folder
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.bridging import BridgingSettings
    from tsuiseki.tracking.trackers.drone import DroneSettings
    from tsuiseki.tracking.video import open_source

    times = StageTimes()
    with output_folder(out, overwrite) as work:
        with times.measure("generate the clip"):
            scene = DroneSceneSettings(frames=frames)
            clip = write_drone(
                work / CLIP_FOLDER, scene, seed, watch=lambda drawn: progress(drawn, "generating", frames)
            )
        source = open_source(clip)
        models: DroneModels = DroneModels.choose(
            source, "flow-maf", None, None, None, None, None, 0.3, (0.0, 1.0), threads, 4, camera_motion=True,
            bridging=BridgingSettings(),
        )  # fmt: skip
        truth = read_ground_truth(clip / "gt" / "gt.txt")
        settings = DroneSettings()
        runs, scores = {}, {}
        for method, name in METHODS.items():
            prices = prices_of(method, None, None, threads, scores_known=True, windows=settings.refinement.windows)
            runs[name] = run_drone(str(clip), source, models, method, settings, prices, work / "observations", times)
            tracks = [person.track for person in runs[name].people]
            scores[name] = evaluate_people([SequencePair(CLIP_FOLDER, truth, tracks, frames)])
        _write(work, _Demo(source, truth, runs, scores, times, frames, seed))
    _show(scores, out)


def _write(work: Path, demo: _Demo) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.cli.drone_run import OVERLAY_FILE, write_drone_run
    from tsuiseki.tracking.output import RunRecord, versions
    from tsuiseki.tracking.report.actions import ActionReport, action_timelines, captions_of
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.report.page import BOXES_NOTE, Report, ReportedMethod, write_report

    command = ["tsuiseki", "demo", "--scene", "drone"]
    best = demo.runs[list(METHODS.values())[-1]]
    with demo.times.measure("draw the overlay"):
        tracks = [person.track for person in best.people]
        captions = captions_of(best.people, best.names, THRESHOLD)
        write_overlay(work / OVERLAY_FILE, demo.source.frames(), tracks, demo.source.frame_rate, captions, 0.0)
    for method, name in METHODS.items():
        (work / method).mkdir()
        record = RunRecord(command, {"frames": demo.frames, "method": method}, demo.seed, demo.times.seconds)
        write_drone_run(work / method, demo.runs[name], record, demo.source, THRESHOLD, overlay=False)
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
            ReportedMethod(name, demo.scores[name].combined, [p.track for p in run.people])
            for name, run in demo.runs.items()
        ],
        truth=demo.truth,
        length=demo.frames,
        frame_rate=demo.source.frame_rate,
        overlay=work / OVERLAY_FILE,
        overlay_note=BOXES_NOTE,
        seconds=demo.times.seconds,
        facts={"seed": str(demo.seed)} | versions(),
        more=[timelines],
    )
    write_report(work / REPORT_FILE, report)
    RunRecord(command, {"frames": demo.frames}, demo.seed, demo.times.seconds).write(work)


def _show(scores: Mapping[str, PeopleEvaluation], out: Path) -> None:
    from tsuiseki.tracking.evaluation.table import people_table, show

    show(people_table(scores))
    print(f"report with video, actions and plots: {out / REPORT_FILE}")
