"""`tsuiseki track single`: follow one target through a video."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.trackers.single.kcf_particle_settings import Past
from tsuiseki.tracking.trackers.single.methods import Preset, SingleMethod

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tsuiseki.tracking.trackers.single.interface import SingleTracker
    from tsuiseki.tracking.types import Estimate, FloatArray, Frame, ImageArray
    from tsuiseki.tracking.video import Source

BOXES_FILE, OVERLAY_FILE, PEAKS_FILE = "boxes.txt", "overlay.webm", "peaks.png"


def single(
    source: str,
    out: Path,
    box: str | None = None,
    select: bool = False,
    method: SingleMethod = "kcf-particle",
    preset: Preset = "robust",
    scale: bool | None = None,
    past: Past | None = None,
    redetect: bool = False,
    objectness: Path | None = None,
    frames: str | None = None,
    overlay: bool = False,
    plot: bool = False,
    overwrite: bool = False,
    seed: int = 0,
) -> int:
    """Follow one target through a video, and say in every frame how sure the box is.

    DIR gets boxes.txt (x,y,width,height a line, counted from 1), run.json with the score and status of every frame and,
    with --overlay and --plot, overlay.webm (a dashed box is searched for or lost) and peaks.png.

    Args:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, VOT, UAV123), the number of a
            webcam or the address of a stream.
        out: folder for the results.
        box: the target in the first frame, X,Y,W,H in pixels counted from 0; a labelled sequence folder has its own.
        select: draw the box with the mouse; needs a display.
        method: how to follow. kcf-particle is a correlation filter that particles help when the target is hidden or
            changes; kcf is the filter alone, and faster; the others are simpler and are
            there to compare with.
        preset: constants of kcf and kcf-particle. robust suits most videos; thesis and paper (kcf only) are the
            published ones.
        scale: whether kcf and kcf-particle also look for other sizes; by default as the preset says.
        past: how kcf-particle draws filters of the past, all alike or by their score; by default as the preset says.
        redetect: once the target is lost, kcf-particle searches a wider area, which takes longer.
        objectness: model for kcf-particle from `tsuiseki train objectness`; by default the shipped one.
        frames: follow through this stretch only, counted from 1 with both ends, such as 301-400.
        overlay: also write a video with the box drawn in.
        plot: also plot the scores, peaks.png.
        overwrite: replace an earlier result in the folder.
        seed: of all random numbers.
    """
    given = dict(locals())
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.tracking.timing import StageTimes

    check_output_folder(out, overwrite)
    tracker, settings = _tracker(method, preset, scale, past, redetect, objectness, seed)
    opened, labelled = open_single(source, frames)
    wanted = _first_box(opened, box, select, labelled)
    times = StageTimes()
    with output_folder(out, overwrite) as work:
        estimates, stopped = _run(opened, wanted, tracker, times, work / OVERLAY_FILE if overlay else None)
        _write(work, estimates, plot)
        described = {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
        record = RunRecord(["tsuiseki", "track", "single"], described | {"constants": settings}, seed, times.seconds)
        record.frames = _columns(estimates)
        record.partial = stopped and not opened.live
        record.write(work)
    print(_summary(estimates, out))
    return 130 if record.partial else 0


def open_single(source: str, frames: str | None) -> tuple[Source, FloatArray | None]:
    """The video, and the labelled box of its first frame where it is a sequence folder with labels.

    Raises:
        RequestError: see `open_source` and `find_single_sequences`.
    """
    from tsuiseki.tracking.formats.mot import list_images
    from tsuiseki.tracking.formats.single import LABEL_NAMES, find_single_sequences
    from tsuiseki.tracking.frame_range import FrameRange, parse_frames
    from tsuiseki.tracking.video import open_source

    stretch, folder = parse_frames(frames), Path(source)
    if not folder.is_dir() or not any(LABEL_NAMES.fullmatch(p.name) for p in folder.iterdir()):
        return open_source(source, stretch), None
    sequence = find_single_sequences(folder)[0]
    if not sequence.images:
        raise RequestError(f"{folder}: expected images beside its labels, found none")
    stretch = stretch.within(len(sequence.images))
    skipped = list_images(sequence.images[0].parent).index(sequence.images[0])
    assert stretch.last is not None
    used = FrameRange(skipped + stretch.first, skipped + stretch.last)
    return open_source(sequence.images[0].parent, used), sequence.boxes[stretch.first]


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
        raise RequestError(f"--box: expected X,Y,W,H in pixels, such as 120,80,40,90, got {text!r}")
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
    from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
    from tsuiseki.tracking.trackers.single.methods import make_tracker

    if preset == "paper" and method != "kcf":
        raise RequestError(f"--preset paper: expected with --method kcf only, got --method {method}")
    tracker = make_tracker(method, preset, scale, seed)
    if isinstance(tracker, KcfParticle):
        settings = tracker.settings
        if past is not None:
            settings = replace(settings, past=past)
        if redetect:
            settings = replace(settings, redetect_reach=3)
        model = read_objectness(objectness) if objectness is not None else None
        return KcfParticle(settings, seed, model), asdict(settings)
    for name, value in (("--past", past), ("--redetect", redetect or None), ("--objectness", objectness)):
        if value is not None:
            raise RequestError(f"{name}: expected with --method kcf-particle only, got --method {method}")
    if scale is not None and method != "kcf":
        raise RequestError(f"--scale: expected with --method kcf-particle or kcf only, got --method {method}")
    own = getattr(tracker, "settings", None)
    return tracker, asdict(own) if own is not None else {}


def _first_box(source: Source, box: str | None, select: bool, labelled: FloatArray | None) -> FloatArray | None:
    """The first box; None when it is to be drawn."""
    if select and box is not None:
        raise RequestError("expected one of --box and --select, got both")
    if select:
        return None
    if box is not None:
        return parse_box(box)
    if labelled is None:
        raise RequestError(f"{source.name} has no labels; expected --box X,Y,W,H of the target in the first frame")
    return labelled


def _selected(image: ImageArray) -> FloatArray:
    import os
    import sys

    import cv2
    import numpy as np

    needed = "a display and an OpenCV with windows (pip install opencv-python)"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        # Without this OpenCV's window library ends the process.
        raise RequestError(f"--select: expected {needed}, found no display; give --box X,Y,W,H instead")
    try:
        x, y, w, h = cv2.selectROI("target", np.ascontiguousarray(image[..., ::-1]))
        cv2.destroyWindow("target")
    except (cv2.error, AttributeError) as error:
        raise RequestError(f"--select: expected {needed}; give --box X,Y,W,H instead") from error
    if w <= 0 or h <= 0:
        raise RequestError("--select: expected a box, got none")
    return np.array([x, y, x + w, y + h], dtype=np.float64)


def _run(
    source: Source, box: FloatArray | None, tracker: SingleTracker, times: Any, overlay: Path | None
) -> tuple[list[Estimate], bool]:
    from contextlib import ExitStack

    from tsuiseki.tracking.cli.interrupt import graceful_interrupt
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.report.webm import VideoWriter

    estimates: list[Estimate] = []
    with graceful_interrupt() as interrupt, ExitStack() as stack:
        writer = stack.enter_context(VideoWriter(overlay, source.frame_rate)) if overlay is not None else None
        frames = interrupt.until_asked(progress(source.frames(), "tracking"))
        for frame, estimate in _followed(frames, box, tracker, times):
            estimates.append(estimate)
            if writer is not None:
                with times.measure("draw"):
                    writer.write(_drawn(frame, estimates))
        stopped = interrupt.asked
    if not estimates:
        raise KeyboardInterrupt if stopped else RunError(f"{source.name}: expected frames, got none")
    return estimates, stopped


def _followed(
    frames: Iterator[Frame], box: FloatArray | None, tracker: SingleTracker, times: Any
) -> Iterator[tuple[Frame, Estimate]]:
    """Frames with their estimates, one at a time."""
    from tsuiseki.tracking.trackers.single.interface import follow_target

    current: list[Frame] = []

    def noted() -> Iterator[Frame]:
        for frame in frames:
            current[:] = [frame]
            yield frame

    stream = noted()
    first = next(stream, None)
    if first is None:
        return
    start = _selected(first.image) if box is None else box
    estimates = follow_target((f for part in ((first,), stream) for f in part), start, tracker)
    while True:
        with times.measure("read and track"):
            estimate = next(estimates, None)
        if estimate is None:
            return
        yield current[0], estimate


def _drawn(frame: Frame, estimates: list[Estimate]) -> ImageArray:
    from tsuiseki.tracking.report.overlay import Overlay

    return Overlay([_track(estimates[-50:])], 25.0).draw(frame)


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


def _write(folder: Path, estimates: list[Estimate], plot: bool) -> None:
    import numpy as np

    from tsuiseki.tracking.formats.boxes import write_boxes

    write_boxes(folder / BOXES_FILE, np.array([e.box for e in estimates]))
    if plot:
        from tsuiseki.tracking.report.single_plots import save_peaks

        save_peaks(estimates, folder / PEAKS_FILE)


def _columns(estimates: list[Estimate]) -> dict[str, list[Any]]:
    return {
        "frame": [e.frame + 1 for e in estimates],
        "score": [round(e.score, 5) for e in estimates],
        "status": [e.status for e in estimates],
    }


def _summary(estimates: list[Estimate], out: Path) -> str:
    counts = {status: sum(e.status == status for e in estimates) for status in ("tracking", "searching", "lost")}
    parts = [f"{count} {status}" for status, count in counts.items() if count]
    return f"{len(estimates)} frames ({', '.join(parts)}): {out / BOXES_FILE}"
