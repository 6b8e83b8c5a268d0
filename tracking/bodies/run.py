"""Bodies that bend through a video, such as fish seen from above: in one call, and by `tsuiseki track deformable`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.bodies.body import parse_body
from tsuiseki.tracking.bodies.contour import BodyPixels, Extraction
from tsuiseki.tracking.bodies.settings import (
    CONTRASTS,
    BodyChoice,
    DeformableSettings,
    MotionPreset,
    chosen_motion,
    starting_states,
)
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.features.background_difference import StandingOut, video_background
from tsuiseki.tracking.features.colour_region import parse_colour
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting, Range, fit_settings, fitted_text
from tsuiseki.tracking.formats.body_states import write_states
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.fitting import fitted_first, write_fitted
from tsuiseki.tracking.runs.following import Video, open_checked
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Frame, ImageArray, as_numbers
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.tracking.video.source import Source, SourceLike, named

DEFORMABLE = DeformableSettings()


def track_deformable(
    source: SourceLike,
    body: str = "goldfish",
    *,
    colour: str = "any",
    motion: str | Path | None = None,
    preset: MotionPreset | None = None,
    init: ArrayLike | None = None,
    frames: str | None = None,
    settings: DeformableSettings = DEFORMABLE,
    seed: int = 0,
) -> Result[BodyTrack]:
    """Bodies that bend: place, heading and bend of each in every frame.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images in a list.
        body: ``goldfish`` or ``ball``, with its sizes in pixels where they differ, such as
            ``"goldfish,length=40,width=14,tail=20"``, or a file of `tsuiseki train body`.
        colour: of the bodies, by name or as ``"H1-H2,S1-S2,V1-V2"`` with hues in degrees; or ``any``, ``bright`` or
            ``dark`` for what stands out in this way from a background that a fixed camera sees behind them. A live
            source needs a colour.
        motion: file of `tsuiseki train motion`, what was learnt of this body.
        preset: how the body is expected to move; by default ``learnt`` with ``motion`` and ``wide`` without.
        init: ``(K, D)`` states of the bodies in the first frame; by default they are found there.
        frames: only these frames, counted from 1 with both ends, such as ``"301-400"``.
        settings: see `DeformableSettings`.
        seed: of the particles.

    Returns:
        The tracks by id, frames counted from 0 at the beginning of the video.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    opened = open_checked(source, frames, images=True, ends=", or use follow_deformable")
    tracker = body_tracker(_choice(body, colour, motion, preset, init, settings), opened, seed)
    run_settings = {"body": body, "source": named(source), "seed": seed}
    return body_result(opened, tracker, opened.frames(), StageTimes(), run_settings)


def follow_deformable(
    source: SourceLike,
    body: str = "goldfish",
    *,
    colour: str = "any",
    motion: str | Path | None = None,
    preset: MotionPreset | None = None,
    init: ArrayLike | None = None,
    frames: str | None = None,
    settings: DeformableSettings = DEFORMABLE,
    seed: int = 0,
) -> Iterator[tuple[Frame, list[BodyTrack]]]:
    """Each frame with the bodies in it, each as a track of this one frame, while the video comes.

    Arguments and errors are those of `track_deformable`.
    """
    opened = open_checked(source, frames, images=True)
    tracker = body_tracker(_choice(body, colour, motion, preset, init, settings), opened, seed)

    def frames_with_bodies() -> Iterator[tuple[Frame, list[BodyTrack]]]:
        for frame in opened.frames():
            tracker.update(frame)
            yield frame, tracker.tracks()
            tracker.forget()

    return frames_with_bodies()


def _choice(
    body: str,
    colour: str,
    motion: str | Path | None,
    preset: MotionPreset | None,
    init: ArrayLike | None,
    settings: DeformableSettings,
) -> BodyChoice:
    """What the command line would choose."""
    with refused():
        return BodyChoice(
            body=body,
            motion=None if motion is None else a_path(motion, "motion"),
            preset=preset,
            init=None if init is None else np.atleast_2d(as_numbers(init, "init")).tolist(),
            colour=colour,
            deformable=as_settings(settings, DeformableSettings),
        )


def body_pixels(choice: BodyChoice, source: Source) -> BodyPixels:
    """How bodies are distinguished from the background; for a contrast the video is played once.

    Raises:
        RequestError: there is no such colour, or a contrast is asked of a live source.
    """
    if choice.colour not in CONTRASTS:
        return Extraction(parse_colour(choice.colour), choice.deformable.smooth)
    if source.live:
        raise RequestError(
            f"`colour`: expected one with a live source, which cannot be played twice, got {choice.colour}"
        )
    return StandingOut(video_background(source, CONTRASTS[choice.colour]), choice.deformable.smooth)


def body_tracker(
    choice: BodyChoice, source: Source, seed: int = 0, pixels: BodyPixels | None = None
) -> DeformableTracker:
    """A fresh tracker for the bodies in a video, which ``pixels`` distinguish, by default those of `body_pixels`.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    body = parse_body(choice.body)
    moves = chosen_motion(body, choice.motion, choice.preset, source.frame_rate, choice.widen)
    states = starting_states(choice.init, body, source)
    return DeformableTracker(body, moves, pixels or body_pixels(choice, source), choice.deformable, states, seed)


def fit_noise(
    choice: BodyChoice, source: Source, seed: int = 0, begins: Callable[[], object] = lambda: None
) -> tuple[BodyChoice, dict[str, FittedSetting]]:
    """The choice with the most likely ``widen`` and ``spread`` for a video, and intervals of 95 % of both.

    They maximise the tracker's log evidence, with one seed; ``begins`` is called before each of some hundred runs.

    Raises:
        RequestError: the source is live and cannot be played again.
    """
    if source.live:
        raise RequestError(f"`fit`: expected a video that can be played again, got the live source {source.name}")
    pixels, start = body_pixels(choice, source), {"widen": choice.widen, "deformable.spread": choice.deformable.spread}

    def chosen(settings: Mapping[str, float]) -> BodyChoice:
        spread = replace(choice.deformable, spread=settings["deformable.spread"])
        return replace(choice, widen=settings["widen"], deformable=spread)

    def log_evidence(settings: Mapping[str, float]) -> float:
        begins()
        tracker = body_tracker(chosen(settings), source, seed, pixels)
        for frame in source.frames():
            tracker.update(frame)
        return tracker.log_evidence

    fitted = fit_settings(log_evidence, {name: Range.about(value) for name, value in start.items()}, seed)
    return chosen({name: setting.value for name, setting in fitted.items()}), fitted


def body_result(
    source: Source, tracker: DeformableTracker, frames: Iterable[Frame], times: StageTimes, settings: Mapping[str, Any]
) -> Result[BodyTrack]:
    """The result of a run of a fresh tracker over the frames of a video."""
    numbers = []
    for frame in frames:
        with reported_to(frames):
            with times.measure("edges"):
                edges = tracker.edges(frame)
            with times.measure("particles"):
                tracker.update_edges(frame.index, edges)
            numbers.append(frame.index)
    body, tracks = tracker.body, tracker.tracks()

    def plot(path: Path, _: Path) -> None:
        from tsuiseki.tracking.bodies.page import plot_states

        plot_states(path, body, tracks)

    def draw(frame: Frame) -> ImageArray:
        from tsuiseki.tracking.bodies.page import draw_bodies

        return draw_bodies(frame, body, tracks)

    return Result.of(
        source,
        tracks,
        settings=settings,
        facts={"frame_rate": source.frame_rate},
        seconds=times.seconds,
        frames=columns_of(tracks, numbers),
        files={"states.csv": lambda path, _: write_states(path, tracks, body.fields), "states.png": plot},
        painter=draw,
        names=tuple(body.fields),
    )


def columns_of(tracks: Sequence[BodyTrack], frames: Sequence[int]) -> dict[str, list[Any]]:
    """Frame from 0, bodies that are tracked in it, and the score of each body."""
    tracked = [0] * len(frames)
    scores: dict[str, list[Any]] = {}
    for track in tracks:
        scores[f"score_{track.id}"] = [round(float(score), 4) for score in track.scores]
        for frame, tracking in zip(track.frames, track.tracking, strict=True):
            tracked[int(frame) - frames[0]] += int(tracking)
    return {"frame": list(frames), "tracking": list(tracked), **scores}


CHOICE = BodyChoice()


def deformable(video: Video, *, output: SeededOutput, choice: BodyChoice = CHOICE, fit: bool = False) -> int:
    """Track bodies that bend, such as fish seen from above: place, heading and bend of each in every frame.

    DIR gets states.csv (frame, id, the body's state, score, status), states.png (the states over time), run.json and,
    with --overlay, overlay.webm with the contours drawn in.

    Args:
        output.seed: of the particles.
        fit: first fit --widen and --deformable.spread to the video by maximum likelihood, with intervals; DIR also gets
            fitted.yaml for --config. It takes as long as some hundred runs.
    """
    from tsuiseki.tracking.runs.following import count

    source = video.open(images=True)
    fitted = dict[str, FittedSetting]()
    if fit:
        choice, fitted = fitted_first(partial(fit_noise, choice, source, output.seed))
    tracker = body_tracker(choice, source, output.seed)
    with output.run() as run:
        steps = run.steps(run.frames(source, record=video.overlay))
        result = body_result(source, tracker, steps, run.times, output.settings)
        run.save(result, lambda: video.draw(run, source, result))
        options = {"widen": choice.widen, "deformable": {"spread": choice.deformable.spread}}
        write_fitted(run, fitted, "fitted.yaml", fitted_text(fitted, options))
        tracked = sum(int(track.tracking.sum()) for track in result)
        bodies, place = count(len(result), "body", "bodies"), output.out / "states.csv"
        share = f"seen {100 * tracked / max(sum(map(len, result)), 1):.0f} %"
        what = "that stands out" if choice.colour in CONTRASTS else f"of the colour {choice.colour}"
        hint = f"; nothing {what} fits a body, give another --colour, or --init"
        run.done(f"{bodies} in {run.count} frames, {share}: {place}{'' if tracked else hint}")
    return run.status
