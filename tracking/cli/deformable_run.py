"""A run of the tracker of bodies over a video, and its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.cli.interrupt import graceful_interrupt, report_partial
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.formats.states import write_states
from tsuiseki.tracking.likelihoods.contour import EdgeImage, Extraction
from tsuiseki.tracking.output import RunRecord
from tsuiseki.tracking.report.bodies import write_contours
from tsuiseki.tracking.report.state_plots import plot_states
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.deformable import DeformableTracker
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.tracking.video import Source

STATES_FILE = "states.csv"


@dataclass(frozen=True)
class DeformableRun:
    """A finished or interrupted run.

    Attributes:
        tracks: of each body.
        frames: 0-based numbers.
        stopped: the user asked to stop.
    """

    tracks: Sequence[BodyTrack]
    frames: Sequence[int]
    stopped: bool


def follow(source: Source, tracker: DeformableTracker, extraction: Extraction, times: StageTimes) -> DeformableRun:
    """Track until the video ends or the user presses Ctrl-C.

    Raises:
        RunError: the video breaks off, or has no frame.
        KeyboardInterrupt: stopped before the first frame was finished.
    """
    frames: list[int] = []
    with graceful_interrupt() as interrupt:
        for frame in interrupt.until_asked(progress(source.frames(), "tracking", source.length)):
            with times.measure("edges"):
                edges = EdgeImage.of(frame.image, extraction)
            with times.measure("particles"):
                tracker.update_edges(frame.index, edges)
            frames.append(frame.index)
    if not frames:
        if interrupt.asked:
            raise KeyboardInterrupt
        raise RunError(f"{source.name}: expected frames, got none")
    return DeformableRun(tracker.tracks(), frames, interrupt.asked)


def write_run(folder: Path, run: DeformableRun, body: Body, record: RunRecord, source: Source, overlay: bool) -> None:
    """Write ``states.csv``, ``states.png``, ``run.json`` and, with ``overlay``, ``overlay.webm``.

    Args:
        folder: where to.
        run: what was done.
        body: of the tracks.
        record: goes into ``run.json``, filled in with the frames.
        source: the video.
        overlay: draw the contours; an interrupted run goes without.
    """
    write_states(folder / STATES_FILE, run.tracks, body.fields)
    plot_states(folder / "states.png", body, run.tracks)
    record.partial = run.stopped and not source.live
    if overlay and not record.partial:
        frames = progress(source.frames(), "drawing", len(run.frames))
        write_contours(folder / "overlay.webm", frames, body, run.tracks, source.frame_rate)
    record.frames = _columns(run)
    record.write(folder)


def _columns(run: DeformableRun) -> dict[str, list[object]]:
    """Frame from 1, bodies that are tracked in it, and the score of each body."""
    first = run.frames[0]
    seen = [0] * len(run.frames)
    scores: dict[str, list[object]] = {}
    for track in run.tracks:
        scores[f"score_{track.id}"] = [round(float(score), 4) for score in track.scores]
        for frame, tracking in zip(track.frames, track.tracking, strict=True):
            seen[int(frame) - first] += int(tracking)
    return {"frame": [index + 1 for index in run.frames], "tracking": list(seen), **scores}


def report_end(run: DeformableRun, folder: Path, source: Source) -> int:
    """Say what came out; returns the exit status."""
    if run.stopped and not source.live:
        return report_partial(run.frames[-1], folder)
    bodies = "body" if len(run.tracks) == 1 else "bodies"
    seen = sum(int(track.tracking.sum()) for track in run.tracks)
    share = seen / max(sum(map(len, run.tracks)), 1)
    print(f"{len(run.tracks)} {bodies} in {len(run.frames)} frames, seen {100 * share:.0f} %: {folder / STATES_FILE}")
    return 0
