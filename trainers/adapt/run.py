"""`tsuiseki adapt`: a detector that learns a camera from its unlabelled video."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import Interrupted, RequestError
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.view_choice import report_models
from tsuiseki.tracking.people.settings import ForeignDetector
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.weights import LEARNING_DETECTOR, PEOPLE_DETECTOR, shipped, shipped_or_file
from tsuiseki.trainers.adapt.settings import AdaptSettings

if TYPE_CHECKING:
    from tsuiseki.tracking.features.exported import SizedDetect
    from tsuiseki.tracking.runs.run import Run
    from tsuiseki.trainers.adapt.rounds import Adaptation, Round
    from tsuiseki.trainers.adapt.watch import Watched

# Pictures, labels and detectors of the rounds, until the result is whole.
WORK = ".adapt"
DETECTOR_OPTIONS = DetectorOptions()
_ALONE = (
    "the tracks alone teach; boxes stay as they are tracked, nothing is composed, and what never moves may be "
    "learnt as a person"
)


HOW = AdaptSettings()


def adapt(
    sources: list[str],
    *,
    output: SeededOutput,
    how: AdaptSettings = HOW,
    frames: str | None = None,
    detector: Path | None = None,
    teacher: Path | None = None,
    corrections: Path | None = None,
    view: str = "auto",
    detector_options: ForeignDetector = DETECTOR_OPTIONS,
) -> int:
    """Learn a camera from its unlabelled video: who is tracked with confidence teaches the detector.

    Works best where the camera stands still and people walk: then boxes are fitted to silhouettes, people are composed
    onto the empty view, and what never moves is learnt as background. DIR gets detector.onnx, report.html with what
    changed and what was learnt from, and run.json; the command for track people is printed. A run that was stopped
    goes on where the same command is given again.

    Args:
        sources: videos, folders of images or sequence folders, all of one camera; 100 frames at least, some minutes
            are better.
        frames: learn from these of each only, counted from 1 with both ends, such as 1-300.
        detector: exported detector, or the name of a shipped one, to start from and to keep where no round is better;
            by default it starts from figures, and keeps people.
        teacher: detector of any project for the first round, where the one to start from misses too many.
        corrections: reviewed result of the only video, or its corrections.jsonl. Corrected boxes teach
            people, deleted ones background.
        view: tiles of a frame, as in track people.
        detector_options: what the file of the teacher does not tell, where that is another project's.
    """
    from tsuiseki.trainers.adapt.rounds import Adaptation, contents_of, resumed
    from tsuiseki.trainers.adapt.track_labels import certain_boxes, corrections_in
    from tsuiseki.trainers.adapt.watch import open_camera

    span, settings, work = parse_frames(frames), replace(how, seed=output.seed), output.out / WORK
    # What cannot be learnt from, or used, is refused before any detection.
    start, first = _detector(detector), _teacher(teacher, detector_options, settings.device)
    lines = None if corrections is None else corrections_in(corrections, sources)
    named = None if teacher is None else shipped_or_file("detector", teacher)
    # What the command must repeat for a later run to go on.
    request = {"sources": sources, "frames": frames, "view": view, "options": asdict(detector_options)}
    request |= {"settings": asdict(settings), **contents_of(sources, start, teacher=named, corrections=lines)}
    with output.run() as run:
        run.facts |= report_models(first)
        if resumed(work, request):
            print("going on with what an earlier run has finished")
        with _kept(work):
            videos = open_camera(sources, span, work, settings)
            for line in _motion_lines(videos):
                print(line, flush=True)
            default = shipped(PEOPLE_DETECTOR)
            certain = None if lines is None else certain_boxes(lines, videos[0].size)
            adaptation = Adaptation(videos, start, work, settings, default, first, certain, view)
            _run(run, adaptation, default if detector is None else start)
    if not run.status:
        shutil.rmtree(work, ignore_errors=True)
    return run.status


@contextmanager
def _kept(work: Path) -> Iterator[None]:
    """What is finished in ``work`` outlives an interrupt, and no refusal."""
    try:
        yield
    except RequestError:
        shutil.rmtree(work, ignore_errors=True)
        raise
    except Interrupted as error:
        advice = "what is finished is kept, and the same command goes on from there"
        raise Interrupted(error.number, advice) from error


def _motion_lines(videos: Sequence[Watched]) -> list[str]:
    """What of the camera's movement is worth a line, and what follows."""
    lines = []
    for video in videos:
        if video.turned is not None:
            at = f"the camera turns at about frame {video.turned + 1}; give --frames of one place"
            lines.append(f"{video.source}: {at}; as it is, {_ALONE}")
        elif video.motion == "unknown":
            lines.append(f"{video.source}: too little to see to tell whether the camera moves: {_ALONE}")
        elif not video.fixed:
            lines.append(f"{video.source}: the camera moves: {_ALONE}")
    return lines


def _teacher(detector: Path | None, options: DetectorOptions, device: Device) -> SizedDetect | None:
    """The detector of the first round."""
    from tsuiseki.tracking.features.exported import open_detector
    from tsuiseki.trainers.adapt.rounds import LOWEST_SCORE

    if detector is not None:
        return open_detector(detector, LOWEST_SCORE, threads=1, options=options, device=device)
    if options != DETECTOR_OPTIONS:
        raise RequestError("expected `detector_options` with a `teacher` of another project, got no teacher")
    return None


def _detector(detector: Path | None) -> Path:
    """The detector to start from, whose layout can be learnt."""
    from tsuiseki.tracking.onnx import kind_of
    from tsuiseki.trainers.exporting.exported_weights import layout_of

    start = shipped(LEARNING_DETECTOR) if detector is None else shipped_or_file("detector", detector)
    if not kind_of(start):
        raise RequestError(
            f"{detector}: expected a detector of this toolkit, which can learn, got another file; give it as `teacher`"
        )
    layout_of(start)
    return start


def _run(run: Run, adaptation: Adaptation, unlearnt: Path) -> None:
    """All rounds, and the files of the best.

    The detector ``unlearnt`` is left where none is better than the start, the default where that is better.
    """
    from tsuiseki.tracking.report.adapted import adapted_page
    from tsuiseki.trainers.adapt.rounds import against_default, best_of, default_round, rounds
    from tsuiseki.trainers.adapt.summary import summary

    finished: list[Round] = []
    for finished_round in rounds(adaptation):
        finished.append(finished_round)
        print(_line(finished_round, finished[0]), flush=True)
    notes = _motion_lines(adaptation.videos)
    notes += [
        _line(finished_round, finished[0])
        for finished_round in finished
        if finished_round.scores.collapsed(finished[0].scores)
    ]
    best = best_of(finished)
    if len(finished) > 1:
        default = default_round(adaptation)
        run.facts["default"] = asdict(default.scores)
    for finished_round in finished[1:]:
        beats, line = against_default(finished_round, default)
        notes.append(line)
        print(line, flush=True)
        if finished_round is best and not beats:
            best, unlearnt = finished[0], adaptation.default
    run.facts["rounds"] = [asdict(finished_round.scores) for finished_round in finished]
    run.facts["best"] = best.number
    run.facts["start"] = adaptation.start.name
    run.facts["detector"] = f"learnt in round {best.number}" if best.number else unlearnt.name
    learnt = best.detector if best.number and isinstance(best.detector, Path) else unlearnt
    run.write("detector.onnx", partial(shutil.copyfile, learnt))
    page = adapted_page(summary(adaptation, finished, best, notes, unlearnt.name))
    run.write("report.html", lambda path: path.write_text(page, encoding="utf-8"))
    detector = shlex.quote(str(run.out / "detector.onnx"))
    usage = f"to use it: tsuiseki track people VIDEO --detector {detector} --out DIR"
    run.done(f"{_summary(best, finished[0], run.out, unlearnt)}\n{usage}")


def _line(finished: Round, start: Round) -> str:
    scores = finished.scores
    collapsed = scores.collapsed(start.scores)
    fate = f"; stopped, for {collapsed}" if collapsed else ""
    return (
        f"round {finished.number}: {scores.people} people, {scores.boxes:.1f} boxes and {scores.rejected:.1f} rejected "
        f"detections a frame, agreement with the tracks {scores.agreement:.3f}{fate}"
    )


def _summary(best: Round, start: Round, out: Path, unlearnt: Path) -> str:
    if not best.number:
        return f"no round is kept; {out / 'detector.onnx'} is {unlearnt.name}, which learnt nothing"
    return (
        f"round {best.number} is the best, agreement {start.scores.agreement:.3f} -> {best.scores.agreement:.3f}: "
        f"{out / 'detector.onnx'}"
    )
