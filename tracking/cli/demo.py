"""`tsuiseki demo`: the whole path on a generated labelled clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.cli.run import Run
from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
    from tsuiseki.tracking.pipelines.methods import PeopleMethod
    from tsuiseki.tracking.report.demo import DemoResult
    from tsuiseki.tracking.trackers.people.run import FrameLog
    from tsuiseki.tracking.types import Track
    from tsuiseki.tracking.video import Source

# What each method is called in table and report; the tracks of the last one are drawn.
METHODS: Mapping[PeopleMethod, str] = {"sort": "SORT", "deepsort": "DeepSORT", "flow": "Min-cost flow"}
CLIP_FOLDER = "street"
REPORT_FILE, OVERLAY_FILE = "report.html", "overlay.webm"
FRAMES, FRAME_RATE = 180, 25.0
OUTPUT = SeededOutput(Path("out/demo"), seed=100)


def demo(
    output: SeededOutput = OUTPUT,
    scene: Literal["street", "drone"] = "street",
    train: bool = False,
    frames: int = FRAMES,
    threads: int = 0,
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
        frames: length of the clip.
        seed: of the clip.
        threads: CPU threads of the networks; 0 takes all.
        overwrite: replace an earlier demo in the folder.
    """
    if scene == "drone":
        from tsuiseki.tracking.cli.demo_drone import demo_drone

        if train:
            raise RequestError("`train`: expected --scene street; docs/drone.md has the commands for the drone")
        return demo_drone(output, frames, threads)
    from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street
    from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.report.demo import DemoResult
    from tsuiseki.tracking.video import open_source

    with output.run() as run:
        models = _models(run.work, train=train)
        with run.times.measure("generate"):
            settings = StreetSettings(frames=frames, frame_rate=FRAME_RATE)
            clip = write_street(
                run.work / CLIP_FOLDER,
                settings,
                output.seed,
                watch=lambda drawn: run.watched(drawn, "generating", frames),
            )
        source = open_source(clip)
        tracks, log = _track(run, source, models, threads)
        truth = read_ground_truth(clip / "gt" / "gt.txt").between(0, run.count - 1)
        scores = {
            name: evaluate_sequences([SequencePair(CLIP_FOLDER, truth, found, run.count)])
            for name, found in tracks.items()
        }
        _write(run, DemoResult(source, truth, tracks, scores, run.count), log, models)
    if run.status == 0:
        show_scores(scores, output.out, "video and plots")
    return run.status


def _models(work: Path, *, train: bool) -> dict[str, Path]:
    """The models by kind: those that ship, or freshly trained ones."""
    from tsuiseki.tracking.cli.shipped_models import SHIPPED, make_models
    from tsuiseki.tracking.weights import shipped

    return make_models(work / "models") if train else {kind: shipped(Path(SHIPPED[kind]).stem) for kind in SHIPPED}


def _track(
    run: Run, source: Source, models: Mapping[str, Path], threads: int
) -> tuple[dict[str, list[Track]], FrameLog]:
    """The same detections linked by every method, as `tsuiseki track people` would."""
    from tsuiseki.tracking.association.affinity import Affinity
    from tsuiseki.tracking.cli.run import frames_expected
    from tsuiseki.tracking.features.networks.exported import Appearance, Detector
    from tsuiseki.tracking.pipelines.finding import PeopleInputs
    from tsuiseki.tracking.pipelines.methods import people_tracker
    from tsuiseki.tracking.trackers.people.run import run_trackers

    affinity = Affinity(models["affinity"], threads)
    trackers = {name: people_tracker(method, None, affinity, source=source) for method, name in METHODS.items()}
    detector, appearance = Detector(models["detector"], threads=threads), Appearance(models["appearance"], threads)
    found = PeopleInputs(source, detector, appearance).found(run.frames(source), run.times)
    return run_trackers(run.steps(found, total=frames_expected(source)), trackers, run.times)


def _write(run: Run, demo: DemoResult, log: FrameLog, models: Mapping[str, Path]) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.output import RunRecord
    from tsuiseki.tracking.report.demo import street_report
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.report.page import write_report

    given, seed = run.output.given, run.output.random_seed
    names = {kind: path.name for kind, path in models.items()}
    for method, name in METHODS.items():
        tracks = demo.tracks[name]
        run.write(f"{method}/tracks.txt", lambda path, tracks=tracks: write_tracks(path, tracks))  # type: ignore[misc]
        seconds = {s: v for s, v in run.times.seconds.items() if s not in demo.tracks or s == name}
        record = RunRecord(given.command, {"frames": demo.frames, "models": names, "method": method}, seed, seconds)
        record.frames = log.columns(tracks)
        record.write(run.work / method)
    run.facts["models"] = names
    source, best = demo.source, demo.tracks[list(METHODS.values())[-1]]
    with run.times.measure("overlay"):
        overlay = run.draw(OVERLAY_FILE, lambda path: write_overlay(path, source.frames(), best, source.frame_rate))
    facts = {f"{kind} model": name for kind, name in names.items()} | {"seed": str(seed)}
    report = street_report(replace(demo, overlay=overlay, seconds=run.times.seconds, facts=facts))
    run.write(REPORT_FILE, lambda path: write_report(path, report))


def show_scores(scores: Mapping[str, PeopleEvaluation], out: Path, what: str) -> None:
    """Print the scores of all methods, and where the report is; ``what`` it shows."""
    from tsuiseki.tracking.evaluation.table import people_table, show
    from tsuiseki.tracking.report.demo import why_not_best

    show(people_table(scores))
    for line in why_not_best(scores):
        print(line)
    print(f"report with {what}: {out / REPORT_FILE}")
