"""One target through a video, from its box in the first frame: `follow_single`, and `tsuiseki track single`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting, Range, fit_settings, fitted_text
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.single import find_single_sequences, has_labels, write_boxes
from tsuiseki.tracking.geometry import corners_from_xywh, iou_matrix
from tsuiseki.tracking.report.overlay import Overlay
from tsuiseki.tracking.result import PageContent, Result, Writer
from tsuiseki.tracking.runs.fitting import fitted_first, write_fitted
from tsuiseki.tracking.runs.following import Video
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.run import Run
from tsuiseki.tracking.single.matching import PlaceNoise, TemplateMatching
from tsuiseki.tracking.single.settings import SingleChoice, SingleMethod, SinglePreset, warn_if_not_asked
from tsuiseki.tracking.single.tracker import SingleTracker, as_box, follow_target
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import STATUSES, Estimate, FloatArray, Frame, ImageArray, Status, Track
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.video.source import Source, SourceLike, named, open_source

# Frames that the trail of a target goes back.
TRAIL = 49
# Frames that are followed back from a correction at most; so many pictures are held.
BACK = 300
# Overlap (IoU) from which the way forward and the way back are at one place.
AGREED = 0.5


def follow_single(
    source: SourceLike,
    box: Sequence[float] | ArrayLike | None = None,
    method: SingleMethod | SingleTracker = "combined",
    *,
    network: Sequence[str | Path] = (),
    preset: SinglePreset = "robust",
    frames: str | None = None,
    seed: int = 0,
) -> Iterator[tuple[Frame, Estimate]]:
    """One target of any kind: each frame with the target's box, a score, and a status.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, VOT, UAV123), images in a
            list or as they come, the number of a webcam or the address of a stream.
        box: ``(4,)`` the target in the first frame, x1, y1, x2, y2 in 0-based pixels; a labelled sequence folder has
            its own.
        method: ``combined`` is a ``network`` and particles, or without one a correlation filter with colours and sizes
            that particles help when the target is hidden; ``siamese`` is the plain loop about a ``network``; ``kcf`` is
            a plain filter, and faster; ``kcf-particle`` is the thesis's way of joining filter and particles; or a
            tracker of one target.
        network: ONNX files of a tracker, for ``combined`` and ``siamese``; see `open_network`. By default the shipped
            ones; ``("none",)`` leaves ``combined`` to its filter.
        preset: constants of ``kcf`` and ``kcf-particle``: ``robust`` is ours; ``thesis``, ``paper`` (both ``kcf`` only)
            and ``printed`` (``kcf-particle`` only: to the letter) are the published ones.
        frames: these only, counted from 1 with both ends, such as ``"301-400"``.
        seed: of all random numbers.

    Returns:
        An iterator over all frames in order; the first answer is ``box`` itself.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off, or changes its size.
    """
    opened, first_box = _opened(source, box, frames)
    return follow_target(opened.frames(), first_box, _tracker(method, network, preset, seed), StageTimes())


def track_single(
    source: SourceLike,
    box: Sequence[float] | ArrayLike | None = None,
    method: SingleMethod | SingleTracker = "combined",
    *,
    network: Sequence[str | Path] = (),
    preset: SinglePreset = "robust",
    frames: str | None = None,
    seed: int = 0,
) -> Result[Track]:
    """One target of any kind through a whole video: one track, with what is known of the run.

    Arguments and errors are those of `follow_single`. The track has a box in every frame, where the target is not
    tracked without support by it; ``frames`` of the result has the score and the status.
    """
    opened, first_box = _opened(source, box, frames)
    if opened.endless:
        raise RequestError(f"{opened.name} does not end by itself; give frames, or use follow_single")
    tracker, times = _tracker(method, network, preset, seed), StageTimes()
    followed = follow_target(opened.frames(), first_box, tracker, times)
    name = method if isinstance(method, str) else type(method).__name__
    return single_result(
        opened,
        followed,
        times,
        {"method": name, "network": [*map(str, network)], "source": named(source), "seed": seed},
    )


def _tracker(
    method: SingleMethod | SingleTracker, network: Sequence[str | Path], preset: SinglePreset, seed: int
) -> SingleTracker:
    if not isinstance(method, str):
        return method
    with refused():
        return SingleChoice(method=method, network=tuple(map(Path, network)), preset=preset).tracker(seed)


def _opened(
    source: SourceLike, box: Sequence[float] | ArrayLike | None, frames: str | None
) -> tuple[Source, FloatArray]:
    """The video and the target in its first frame, checked."""
    opened, labelled = open_single(source, frames)
    first_box = labelled if box is None else as_box(box)
    if first_box is None:
        raise RequestError(f"{opened.name} has no labels; expected the `box` of the target in the first frame")
    return opened, first_box


def open_single(source: SourceLike, frames: str | None = None) -> tuple[Source, FloatArray | None]:
    """The video, and the labelled box of its first frame where it is a sequence folder with labels.

    Raises:
        RequestError: see `open_source` and `find_single_sequences`.
    """
    frame_range, folder = parse_frames(frames), Path(named(source))
    if not isinstance(source, str | Path) or not folder.is_dir() or not has_labels(folder):
        return open_source(source, frame_range), None
    sequence = find_single_sequences(folder)[0]
    if not sequence.images:
        raise RequestError(f"{folder}: expected images beside its labels, found none")
    frame_range = frame_range.within(len(sequence.images))
    skipped = list_images(sequence.images[0].parent).index(sequence.images[0])
    assert frame_range.last is not None
    used = FrameRange(skipped + frame_range.first, skipped + frame_range.last)
    return open_source(sequence.images[0].parent, used), sequence.boxes[frame_range.first]


def parse_box(text: str) -> FloatArray:
    """``(4,)`` corners of ``X,Y,W,H``.

    Raises:
        RequestError: it is something else.
    """
    words = re.split(r"[,\s]+", text.strip())
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise RequestError(f"`box`: expected X,Y,W,H in pixels, such as 120,80,40,90, got {text!r}")
    return corners_from_xywh(numbers)


def single_result(
    source: Source,
    followed: Iterable[tuple[Frame, Estimate]],
    times: StageTimes,
    settings: Mapping[str, Any],
    constants: Mapping[str, Any] | None = None,
    plot: bool = False,
) -> Result[Track]:
    """The result of a run, whose frames are ``followed``; ``constants`` of the method are kept as facts.

    With ``plot`` it also saves a plot of the scores.
    """
    estimates = [estimate for _, estimate in followed]
    track = Track(
        1,
        np.array([e.frame for e in estimates]),
        np.array([e.box for e in estimates]).reshape(-1, 4),
        np.array([e.score for e in estimates]),
        np.array([e.status == "tracking" for e in estimates], dtype=np.bool_),
    )
    files: dict[str, Writer] = {"boxes.txt": lambda path, _: write_boxes(path, track.boxes)}
    if plot:
        from tsuiseki.tracking.report.plots import peaks_figure

        files["peaks.png"] = lambda path, _: peaks_figure(estimates).savefig(path, dpi=130, facecolor="white")
    return Result.of(
        source,
        [track],
        settings=settings,
        facts={} if constants is None else {"constants": constants},
        seconds=times.seconds,
        frames={
            "frame": [e.frame for e in estimates],
            "score": [round(e.score, 5) for e in estimates],
            "status": [e.status for e in estimates],
        },
        files=files,
        painter=Overlay([track], 1.0, trail_seconds=TRAIL).draw,
        page=PageContent(("target", "targets"), "centre"),
    )


def summary_of(statuses: Sequence[Status]) -> str:
    """How many frames there are, and how many of each status."""
    parts = [f"{count} {status}" for status in STATUSES if (count := statuses.count(status))]
    return f"{len(statuses)} frames ({', '.join(parts)})"


CHOICE = SingleChoice()


def single(
    video: Video,
    *,
    output: SeededOutput,
    choice: SingleChoice = CHOICE,
    box: str | None = None,
    select: bool = False,
    plot: bool = False,
    corrections: Path | None = None,
    fit: bool = False,
) -> int:
    """Follow one target through a video, and say in every frame how sure the box is.

    DIR gets boxes.txt (x,y,width,height a line, counted from 1), report.html with its plots and numbers in report/,
    run.json with the score and status of every frame and, with --overlay and --plot, overlay.webm (a dashed box is
    searched for or lost) and peaks.png.

    Args:
        box: X,Y,W,H of the target in the first frame, pixels; or as labelled.
        select: draw the box with the mouse, on a page whose address is printed.
        plot: also plot the scores, peaks.png.
        corrections: corrections.jsonl of a reviewed result; from each box in it the target is followed on, and back.
        fit: first fit --noise by maximum likelihood; see fitted.yaml.
    """
    source, labelled = open_single(video.source, video.frames) if Path(video.source).is_dir() else (None, None)
    source = video.open(images=True) if source is None or labelled is None else source
    first_box = _first_box(source, box, select, labelled)
    fitted = dict[str, FittedSetting]()
    if fit:
        choice, fitted = fitted_first(partial(fit_noise, choice, source, first_box, output.seed))
    tracker = choice.tracker(output.seed)
    tracker_settings = getattr(tracker, "settings", None)
    constants = {} if tracker_settings is None else asdict(tracker_settings)
    chosen_boxes = None if corrections is None else corrected_boxes(corrections, source)
    with output.run() as run:
        start_box = partial(_drawn, run) if first_box is None else first_box
        followed = follow_target(run.frames(source, record=video.overlay), start_box, tracker, run.times, chosen_boxes)
        if chosen_boxes is not None:
            followed = from_both_sides(followed, chosen_boxes, choice.tracker(output.seed))
        steps = run.steps(followed)
        result = single_result(source, steps, run.times, output.settings, constants, plot)
        warn_if_not_asked(tracker)
        run.save(result, lambda: video.draw(run, source, result))
        options = {"method": choice.method, "noise": [setting.value for setting in fitted.values()]}
        write_fitted(run, fitted, "fitted.yaml", fitted_text(fitted, options))
        run.done(f"{summary_of(result.frames['status'])}: {output.out / 'boxes.txt'}")
    return run.status


def fit_noise(
    choice: SingleChoice,
    source: Source,
    box: FloatArray | None,
    seed: int = 0,
    begins: Callable[[], object] = lambda: None,
) -> tuple[SingleChoice, dict[str, FittedSetting]]:
    """The choice with the most likely noise of ``kalman`` for a video, and intervals of 95 %, by `PlaceNoise`'s names.

    It maximises the filter's log evidence; ``begins`` is called before each of some hundred runs.

    Raises:
        RequestError: another method, no first ``box``, or a source that cannot be played again.
    """
    if choice.method != "kalman" or box is None or source.live:
        got = "a live source" if source.live else "no `box`" if box is None else choice.method
        raise RequestError(f"`fit`: expected `method` kalman, a video and the `box` of its first frame, got {got}")

    def log_evidence(settings: Mapping[str, float]) -> float:
        begins()
        tracker = TemplateMatching(noise=PlaceNoise(**settings))
        for _ in follow_target(source.frames(), box, tracker, StageTimes()):
            pass
        return tracker.log_evidence

    start = asdict(PlaceNoise() if choice.noise is None else PlaceNoise(*choice.noise))
    fitted = fit_settings(log_evidence, {name: Range.about(value) for name, value in start.items()}, seed)
    return replace(choice, noise=(fitted["velocity"].value, fitted["measurement"].value)), fitted


def _drawn(run: Run, image: ImageArray) -> FloatArray:
    from tsuiseki.tracking.single.selection import select_box

    with run.waiting():
        return select_box(image)


def _first_box(source: Source, box: str | None, select: bool, labelled: FloatArray | None) -> FloatArray | None:
    """The first box; None when it is to be drawn."""
    if select and box is not None:
        raise RequestError("expected one of `box` and `select`, got both")
    if select:
        return None
    if box is not None:
        return parse_box(box)
    if labelled is None:
        raise RequestError(f"{source.name} has no labels; expected `box` X,Y,W,H of the target in the first frame")
    return labelled


def corrected_boxes(path: Path, source: Source) -> dict[int, FloatArray]:
    """Boxes ``(4,)`` of the target by 0-based frame, from corrections of a result.

    Raises:
        RequestError: the file cannot be read, speaks of a video of another size, or moves or adds no box.
    """
    from tsuiseki.tracking.association.correction_demands import corners
    from tsuiseki.tracking.formats.correction_log import CorrectedVideo, read_corrections

    file = read_corrections(path, CorrectedVideo(Path(source.name).name, source.size, 0)).corrections
    parts = [part for correction in file for part in (correction.parts or (correction,)) if part.kind == "box"]
    if not parts:
        raise RequestError(f"{path}: expected boxes that show where the target is, got none")
    return {part.there[-1].frame: corners(part.there[-1]) for part in parts}


def from_both_sides(
    followed: Iterable[tuple[Frame, Estimate]], boxes: Mapping[int, FloatArray], tracker: SingleTracker
) -> Iterator[tuple[Frame, Estimate]]:
    """What was followed, and before each given box what is followed back from it, until that agrees with the former.

    Args:
        followed: frames with the target, begun anew at each of the boxes.
        boxes: ``(4,)`` each, by frame.
        tracker: for the way back.
    """
    held: list[tuple[Frame, Estimate]] = []
    for frame, estimate in followed:
        if frame.index in boxes:
            yield from _back(held, boxes, tracker, frame)
            held = []
        held.append((frame, estimate))
        if len(held) > BACK:
            yield held.pop(0)
    yield from held


def _back(
    held: list[tuple[Frame, Estimate]], boxes: Mapping[int, FloatArray], tracker: SingleTracker, last: Frame
) -> list[tuple[Frame, Estimate]]:
    """The frames before ``last``, with the target as it is followed back from there."""
    tracker.start(last.image, boxes[last.index])
    answers = held.copy()
    for n, (frame, forward) in reversed([*enumerate(held)]):
        now = tracker.follow(frame.image)
        agreed = forward.status == "tracking" and iou_matrix(now.box[None], forward.box[None])[0, 0] >= AGREED
        if now.status == "lost" or agreed or frame.index in boxes:
            break
        answers[n] = frame, Estimate(forward.frame, now.box, now.score, now.status)
    return answers
