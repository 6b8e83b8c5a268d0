"""`tsuiseki track single`: follow one target through a video."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import Run, frames_expected
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.single.choice import SingleChoice

if TYPE_CHECKING:
    from tsuiseki.tracking.types import Estimate, FloatArray, ImageArray
    from tsuiseki.tracking.video.source import Source


def single(
    video: Video,
    output: SeededOutput,
    choice: SingleChoice,
    box: str | None = None,
    select: bool = False,
    plot: bool = False,
) -> int:
    """Follow one target through a video, and say in every frame how sure the box is.

    DIR gets boxes.txt (x,y,width,height a line, counted from 1), run.json with the score and status of every frame and,
    with --overlay and --plot, overlay.webm (a dashed box is searched for or lost) and peaks.png.

    Args:
        box: the target in the first frame, X,Y,W,H in pixels counted from 0; a labelled sequence folder has its own.
        select: draw the box with the mouse, on a page in the browser whose address is printed.
        plot: also plot the scores, peaks.png.
    """
    import numpy as np

    from tsuiseki.tracking.formats.single import write_boxes
    from tsuiseki.tracking.report.single_plots import save_peaks
    from tsuiseki.tracking.single.choice import warn_if_not_asked
    from tsuiseki.tracking.single.page import write_target_overlay
    from tsuiseki.tracking.single.tracking import columns_of, follow_measured, open_single, summary_of

    source, labelled = open_single(video.source, video.frames)
    source = video.open(images=True) if labelled is None else source
    given = _first_box(source, box, select, labelled)
    tracker, constants = choice.tracker(output.seed)
    estimates: list[Estimate] = []
    with output.run() as run:
        run.facts["constants"] = constants
        wanted = partial(_drawn, run) if given is None else given
        followed = follow_measured(run.frames(source, record=video.overlay), wanted, tracker, run.times)
        estimates.extend(run.steps(followed, total=frames_expected(source)))
        warn_if_not_asked(tracker)
        run.columns = columns_of(estimates)
        run.write("boxes.txt", lambda path: write_boxes(path, np.array([e.box for e in estimates])))
        if plot:
            run.write("peaks.png", lambda path: save_peaks(estimates, path))
        rate = source.frame_rate
        video.draw(run, source, lambda path, again: write_target_overlay(path, again, estimates, rate))
        run.done(f"{summary_of(estimates)}: {output.out / 'boxes.txt'}")
    return run.status


def _drawn(run: Run, image: ImageArray) -> FloatArray:
    """The box that the user draws."""
    from tsuiseki.tracking.single.selection import select_box

    with run.waiting():
        return select_box(image)


def _first_box(source: Source, box: str | None, select: bool, labelled: FloatArray | None) -> FloatArray | None:
    """The first box; None when it is to be drawn."""
    from tsuiseki.tracking.single.tracking import parse_box

    if select and box is not None:
        raise RequestError("expected one of `box` and `select`, got both")
    if select:
        return None
    if box is not None:
        return parse_box(box)
    if labelled is None:
        raise RequestError(f"{source.name} has no labels; expected `box` X,Y,W,H of the target in the first frame")
    return labelled
