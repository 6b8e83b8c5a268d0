"""`tsuiseki track single`: follow one target through a video."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import frames_expected
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.trackers.single.kcf_particle_settings import Past
from tsuiseki.tracking.trackers.single.methods import Preset, SingleMethod

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.single.interface import SingleTracker
    from tsuiseki.tracking.types import Estimate, FloatArray, Frame, ImageArray
    from tsuiseki.tracking.video import Source

# Estimates that the trail of an overlay goes back.
TRAIL = 50


def single(
    video: Video,
    output: SeededOutput,
    box: str | None = None,
    select: bool = False,
    method: SingleMethod = "combined",
    preset: Preset = "robust",
    scale: bool | None = None,
    past: Past | None = None,
    redetect: bool = False,
    objectness: Path | None = None,
    plot: bool = False,
) -> int:
    """Follow one target through a video, and say in every frame how sure the box is.

    DIR gets boxes.txt (x,y,width,height a line, counted from 1), run.json with the score and status of every frame and,
    with --overlay and --plot, overlay.webm (a dashed box is searched for or lost) and peaks.png.

    Args:
        box: the target in the first frame, X,Y,W,H in pixels counted from 0; a labelled sequence folder has its own.
        select: draw the box with the mouse; needs a display.
        method: how to follow. combined is a correlation filter with colours and sizes that particles help when the
            target is hidden; regularised is that filter alone; kcf is a plain filter, and faster; kcf-particle joins
            kcf and particles as the thesis does; the others are simpler and are there to compare with.
        preset: constants of kcf and kcf-particle. robust is ours; thesis, printed (kcf-particle only: the thesis to
            the letter) and paper (kcf only) are the published ones.
        scale: whether combined, regularised, kcf and kcf-particle also look for other sizes; by default the first two
            do, and the others as the preset says.
        past: how kcf-particle draws filters of the past, all alike or by their score; by default as the preset says.
        redetect: combined and kcf-particle search a wider area for a lost target, which takes longer.
        objectness: model for kcf-particle from `tsuiseki train objectness`; by default the shipped one.
        plot: also plot the scores, peaks.png.
    """
    import numpy as np

    from tsuiseki.tracking.formats.boxes import write_boxes
    from tsuiseki.tracking.report.single_plots import save_peaks

    source, labelled = _opened(video)
    wanted = _first_box(source, box, select, labelled)
    tracker, constants = _tracker(method, preset, scale, past, redetect, objectness, output.seed)
    estimates: list[Estimate] = []
    with output.run() as run:
        run.facts["constants"] = constants
        followed = _followed(run.frames(source, record=video.overlay), wanted, tracker, run.times)
        estimates.extend(run.steps(followed, total=frames_expected(source)))
        run.columns = _columns(estimates)
        run.write("boxes.txt", lambda path: write_boxes(path, np.array([e.box for e in estimates])))
        if plot:
            run.write("peaks.png", lambda path: save_peaks(estimates, path))
        if video.overlay:
            run.draw(video.overlay_file, lambda path: _draw(path, run.replay(source), estimates, source.frame_rate))
        run.done(_summary(estimates, output.out))
    return run.status


def _opened(video: Video) -> tuple[Source, FloatArray | None]:
    """The video, and the labelled box of its first frame where it is a sequence folder with labels."""
    from tsuiseki.tracking.pipelines.single import open_single

    source, labelled = open_single(video.source, video.frames)
    return (video.open(images=True) if labelled is None else source), labelled


def parse_box(text: str) -> FloatArray:
    """``(4,)`` corners of ``X,Y,W,H``.

    Raises:
        RequestError: it is something else.
    """
    import numpy as np

    from tsuiseki.tracking.geometry import corners_from_xywh

    words = re.split(r"[,\s]+", text.strip())
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != 4 or not np.isfinite(numbers).all():
        raise RequestError(f"`box`: expected X,Y,W,H in pixels, such as 120,80,40,90, got {text!r}")
    return corners_from_xywh(numbers)


def _tracker(
    method: SingleMethod,
    preset: Preset,
    scale: bool | None,
    past: Past | None,
    redetect: bool,
    objectness: Path | None,
    seed: int,
) -> tuple[SingleTracker, Any]:
    from dataclasses import asdict, replace

    from tsuiseki.tracking.features.objectness import read_objectness
    from tsuiseki.tracking.pipelines.single import check_preset
    from tsuiseki.tracking.trackers.single.combined import Combined
    from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
    from tsuiseki.tracking.trackers.single.methods import make_tracker

    check_preset(method, preset)
    tracker = make_tracker(method, preset, scale, seed)
    if isinstance(tracker, KcfParticle):
        settings = tracker.settings
        if past is not None:
            settings = replace(settings, past=past)
        if redetect:
            settings = replace(settings, redetect_reach=3)
        model = read_objectness(objectness) if objectness is not None else None
        return KcfParticle(settings, seed, model), asdict(settings)
    if isinstance(tracker, Combined) and redetect:
        tracker, redetect = Combined(replace(tracker.settings, reach=3), seed), False
    for name, value in (("past", past), ("redetect", redetect or None), ("objectness", objectness)):
        if value is not None:
            raise RequestError(f"`{name}`: expected with --method kcf-particle only, got --method {method}")
    if scale is not None and method not in ("combined", "regularised", "kcf"):
        sized = "combined, regularised, kcf-particle or kcf"
        raise RequestError(f"`scale`: expected with --method {sized}, got --method {method}")
    own = getattr(tracker, "settings", None)
    return tracker, asdict(own) if own is not None else {}


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


def _selected(image: ImageArray) -> FloatArray:
    import os
    import sys

    import cv2
    import numpy as np

    needed = "a display and an OpenCV with windows (pip install opencv-python)"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        # Without this OpenCV's window library ends the process.
        raise RequestError(f"`select`: expected {needed}, found no display; give `box` X,Y,W,H instead")
    try:
        x, y, w, h = cv2.selectROI("target", np.ascontiguousarray(image[..., ::-1]))
        cv2.destroyWindow("target")
    except (cv2.error, AttributeError) as error:
        raise RequestError(f"`select`: expected {needed}; give `box` X,Y,W,H instead") from error
    if w <= 0 or h <= 0:
        raise RequestError("`select`: expected a box, got none")
    return np.array([x, y, x + w, y + h], dtype=np.float64)


def _followed(
    frames: Iterator[Frame], box: FloatArray | None, tracker: SingleTracker, times: StageTimes
) -> Iterator[Estimate]:
    """The target in every frame."""
    from tsuiseki.tracking.trackers.single.interface import follow_target

    first = next(frames, None)
    if first is None:
        return
    start = _selected(first.image) if box is None else box
    estimates = follow_target(chain((first,), frames), start, tracker)
    while True:
        with times.measure("read and track"):
            estimate = next(estimates, None)
        if estimate is None:
            return
        yield estimate


def _draw(path: Path, frames: Iterator[Frame], estimates: list[Estimate], frame_rate: float) -> None:
    from tsuiseki.tracking.report.overlay import Overlay
    from tsuiseki.tracking.report.webm import VideoWriter

    with VideoWriter(path, frame_rate) as writer:
        for number, frame in enumerate(frames):
            writer.write(Overlay([_track(estimates[max(0, number - TRAIL + 1) : number + 1])], 25.0).draw(frame))


def _track(estimates: list[Estimate]) -> Any:
    import numpy as np

    from tsuiseki.tracking.types import Track

    return Track(
        1,
        np.array([e.frame for e in estimates]),
        np.array([e.box for e in estimates]),
        np.array([e.score for e in estimates]),
        np.array([e.status == "tracking" for e in estimates]),
    )


def _columns(estimates: list[Estimate]) -> dict[str, list[Any]]:
    return {
        "frame": [e.frame + 1 for e in estimates],
        "score": [round(e.score, 5) for e in estimates],
        "status": [e.status for e in estimates],
    }


def _summary(estimates: list[Estimate], out: Path) -> str:
    counts = {status: sum(e.status == status for e in estimates) for status in ("tracking", "searching", "lost")}
    parts = [f"{count} {status}" for status, count in counts.items() if count]
    return f"{len(estimates)} frames ({', '.join(parts)}): {out / 'boxes.txt'}"
