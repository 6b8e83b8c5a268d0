"""`tsuiseki demo`: the whole path on a generated labelled clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.cli.people_run import Inputs, Method, PeopleRun
    from tsuiseki.tracking.evaluation.multi import PeopleEvaluation
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.base import PeopleTracker
    from tsuiseki.tracking.types.labels import GroundTruth
    from tsuiseki.tracking.video import Source

# What each method is called in table and report; the tracks of the last one are drawn.
METHODS: Mapping[Method, str] = {"sort": "SORT", "deepsort": "DeepSORT", "flow": "Min-cost flow"}
CLIP_FOLDER = "street"
REPORT_FILE = "report.html"
STAGES = {
    "generate": "generate the clip",
    "decode": "decode",
    "detect": "detect",
    "describe": "describe",
    "overlay": "draw the overlay",
}
FRAMES, FRAME_RATE = 180, 25.0


def demo(
    out: Path = Path("out/demo"),
    scene: Literal["street", "drone"] = "street",
    train: bool = False,
    frames: int = FRAMES,
    seed: int = 100,
    threads: int = 0,
    overwrite: bool = False,
) -> None:
    """Run the whole path on a generated clip: detect, describe, track three ways, evaluate, report.

    A street with walking people is generated together with its exact truth. The shipped models find and describe the
    people once; SORT, DeepSORT and min-cost flow link them; each result is scored. DIR gets report.html with everything
    on one page, overlay.webm, METHOD/tracks.txt and METHOD/run.json for each method, and the clip in street/.

    With --scene drone the people act under a drone that jerks; the shipped models also recognise what they do, and the
    flow links them without, with single-frame and with multi-frame action features.

    Args:
        out: folder for the results.
        scene: what is generated.
        train: first train the models anew on generated scenes and use those; takes hours, and the train extra.
        frames: length of the clip.
        seed: of the clip.
        threads: CPU threads of the networks; 0 takes all.
        overwrite: replace an earlier demo in the folder.
    """
    from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street
    from tsuiseki.tracking.cli.people_run import run_people
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_people
    from tsuiseki.tracking.formats.mot import read_ground_truth
    from tsuiseki.tracking.output import output_folder
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.video import open_source

    if scene == "drone":
        from tsuiseki.tracking.cli.demo_drone import demo_drone

        if train:
            raise RequestError("--train: expected --scene street; docs/drone.md has the commands for the drone")
        demo_drone(out, frames, seed, threads, overwrite=overwrite)
        return
    times = StageTimes()
    with output_folder(out, overwrite) as work:
        models = _models(work, train=train)
        with times.measure("generate"):
            settings = StreetSettings(frames=frames, frame_rate=FRAME_RATE)
            clip = write_street(
                work / CLIP_FOLDER, settings, seed, watch=lambda drawn: progress(drawn, "generating", frames)
            )
        source = open_source(clip)
        inputs, trackers = _prepare(source, models, threads)
        run = run_people(inputs, {METHODS[name]: tracker for name, tracker in trackers.items()}, times)
        if run.stopped:
            raise KeyboardInterrupt
        truth = read_ground_truth(clip / "gt" / "gt.txt")
        scores = {
            name: evaluate_people([SequencePair(CLIP_FOLDER, truth, tracks, frames)])
            for name, tracks in run.tracks.items()
        }
        _write(work, _Demo(source, truth, run, scores, times, models, frames, seed))
    _show(scores, out)


@dataclass(frozen=True)
class _Demo:
    """Everything that the result folder tells."""

    source: Source
    truth: GroundTruth
    run: PeopleRun
    scores: Mapping[str, PeopleEvaluation]
    times: StageTimes
    models: Mapping[str, Path]
    frames: int
    seed: int


def _models(work: Path, *, train: bool) -> dict[str, Path]:
    """The models by kind: those that ship, or freshly trained ones."""
    from tsuiseki.tracking.cli.models import SHIPPED, shipped

    if not train:
        return {kind: shipped(kind) for kind in SHIPPED}
    from tsuiseki.tracking.cli.shipped_models import make_models

    return make_models(work / "models")


def _prepare(source: Source, models: Mapping[str, Path], threads: int) -> tuple[Inputs, dict[Method, PeopleTracker]]:
    """Models and trackers as `tsuiseki track people` would use them."""
    from tsuiseki.tracking.association.affinity import Affinity
    from tsuiseki.tracking.cli.people_run import Inputs, MethodSettings, build_tracker
    from tsuiseki.tracking.features.networks import Appearance, Detector

    affinity = Affinity(models["affinity"], threads)
    trackers = {method: build_tracker(method, MethodSettings(), affinity) for method in METHODS}
    detector = Detector(models["detector"], threads=threads)
    return Inputs(source, detector, Appearance(models["appearance"], threads)), trackers


def _write(work: Path, demo: _Demo) -> None:
    """A folder for each method, the overlay, the report."""
    from tsuiseki.tracking.cli.people_run import OVERLAY_FILE, TRACKS_FILE, write_people_run
    from tsuiseki.tracking.output import RunRecord
    from tsuiseki.tracking.report.overlay import write_overlay

    settings = {"frames": demo.frames, "models": {kind: path.name for kind, path in demo.models.items()}}
    command = ["tsuiseki", "demo"]
    best = list(METHODS.values())[-1]
    with demo.times.measure("overlay"):
        tracks = demo.run.tracks[best]
        write_overlay(work / OVERLAY_FILE, demo.source.frames(), tracks, demo.source.frame_rate)
    for method, name in METHODS.items():
        (work / method).mkdir()
        seconds = {s: v for s, v in demo.times.seconds.items() if s not in demo.run.tracks or s == name}
        record = RunRecord(command, {**settings, "method": method}, demo.seed, seconds)
        write_people_run(work / method, demo.run, demo.run.tracks[name], record, demo.source, overlay=False)
        assert (work / method / TRACKS_FILE).is_file()
    _write_report(work, demo)
    RunRecord(command, settings, demo.seed, demo.times.seconds).write(work)


def _write_report(work: Path, demo: _Demo) -> None:
    from tsuiseki.tracking.cli.people_run import OVERLAY_FILE
    from tsuiseki.tracking.output import versions
    from tsuiseki.tracking.report.page import Report, ReportedMethod, write_report

    methods = [ReportedMethod(name, demo.scores[name].combined, demo.run.tracks[name]) for name in METHODS.values()]
    people = len(set(demo.truth.ids.tolist()))
    facts = {f"{kind} model": path.name for kind, path in demo.models.items()}
    facts |= {"seed": str(demo.seed)} | versions()
    report = Report(
        title="Tsuiseki demo",
        introduction=f"{people} people on a generated street, {demo.frames} frames. Networks trained on generated "
        "scenes found and described them once; three methods linked what they found, each scored against the truth.",
        methods=methods,
        truth=demo.truth,
        length=demo.frames,
        frame_rate=demo.source.frame_rate,
        overlay=work / OVERLAY_FILE,
        seconds={STAGES.get(stage, stage): value for stage, value in demo.times.seconds.items()},
        facts=facts,
    )
    write_report(work / REPORT_FILE, report)


def _show(scores: Mapping[str, PeopleEvaluation], out: Path) -> None:
    from tsuiseki.tracking.evaluation.table import people_table, show

    show(people_table(scores))
    print(f"report with video and plots: {out / REPORT_FILE}")
