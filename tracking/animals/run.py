"""Several animals in one's own video: what they stand out from is learnt from the video itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from tsuiseki.tracking.animals.linking import FIELDS, Animal, link_animals
from tsuiseki.tracking.animals.page import AnimalMotion
from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.animals.settings import AnimalChoice, AnimalSettings, SkeletonSettings
from tsuiseki.tracking.animals.skeleton import (
    headed_by_labels,
    learn_body_points,
    learn_skeleton,
    point_table,
    poses_of_points,
    with_centre,
)
from tsuiseki.tracking.animals.tracker import AnimalTracker
from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Contrast, video_background
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.formats.body_points import point_files
from tsuiseki.tracking.formats.body_states import write_states
from tsuiseki.tracking.formats.result_folder import STATES_FILE
from tsuiseki.tracking.report.overlay import draw_marks
from tsuiseki.tracking.result import PageContent, Result, Writer, check_corrections
from tsuiseki.tracking.runs.following import Video, open_checked
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable
from tsuiseki.tracking.video.source import Source, SourceLike, named


def track_animals(
    source: SourceLike,
    *,
    contrast: Contrast = "auto",
    threshold: float | None = None,
    skeleton: SkeletonSettings | None = None,
    frames: str | None = None,
    settings: AnimalSettings | None = None,
    seed: int = 0,
) -> Result[BodyTrack]:
    """Several animals before a fixed camera: place, heading and size of each in every frame.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images in a list.
        contrast: how animals differ from the background; ``auto`` measures it.
        threshold: difference in grey levels from which a pixel belongs to an animal; by default found.
        skeleton: what is known of their points.
        frames: these only, counted from 1 with both ends, such as ``"301-400"``.
        settings: see `AnimalSettings`.
        seed: as all trackers have it; this one draws no random numbers.

    Returns:
        The tracks by id, whose states are a, b, theta, length, width in pixels and radians; with their ``points``,
        where a skeleton is known.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    opened = open_checked(source, frames, images=True, replayable=True)
    skeleton = as_settings(skeleton, SkeletonSettings, "skeleton")
    run_settings = {"contrast": contrast, "source": named(source), "seed": seed}
    with refused():
        choice = AnimalChoice(contrast=contrast, threshold=threshold, animals=as_settings(settings, AnimalSettings))
    return animal_result(opened, opened.frames(), skeleton, skeleton.table(), choice, StageTimes(), run_settings)


def animal_result(
    source: Source,
    frames: Iterable[Frame],
    skeleton: SkeletonSettings,
    table: PointTable | None,
    choice: AnimalChoice,
    times: StageTimes,
    run_settings: Mapping[str, Any],
) -> Result[BodyTrack]:
    """The result of a run over the frames of a video; ``run_settings`` are kept with it."""
    facts = dict[str, Any](frame_rate=source.frame_rate)
    tracker = None
    if skeleton.points is None:
        with times.measure("background"):
            background = video_background(source, choice.contrast, choice.threshold)
        facts |= {"contrast": background.contrast, "threshold": background.threshold, "area": background.area}
        tracker = AnimalTracker(background, choice.animals)
    size, numbers = (0, 0), []
    for frame in frames:
        size = (frame.image.shape[1], frame.image.shape[0])
        with reported_to(frames):
            if tracker is not None:
                with times.measure("poses"):
                    tracker.update(frame)
            numbers.append(frame.index)
    with times.measure("identities"):
        by_frame = tracker.poses if tracker else _poses_by_points(table, skeleton, numbers) if table else []
        linked, placed = _finished(by_frame, numbers, skeleton, table, source.frame_rate, size)
    tracks, fields = [animal.track for animal in linked], list(FIELDS)
    if choice.scale is not None:
        tracks, fields = in_millimetres(tracks, choice.scale, source)
    files: dict[str, Writer] = {STATES_FILE: lambda path, _: write_states(path, tracks, fields)}
    result = Result[BodyTrack].of(
        source,
        tracks,
        settings=run_settings,
        facts=facts,
        seconds=times.seconds,
        frames={"frame": numbers, "animals": [len(poses) for poses in by_frame]},
        files=files if placed is None else files | point_files(placed, numbers[-1] + 1),
        painter=lambda frame: draw_marks(frame, tracks, fields, placed),
        names=tuple(fields),
        points=placed,
    )
    scale = None if choice.scale is None else choice.scale / 1000
    # A video file tells its size by its frames.
    image_size = result.size or (size if any(size) else None)
    motion = partial(AnimalMotion, seconds_of=source.times_of, frame_rate=source.frame_rate, scale=choice.scale)
    return replace(result, size=image_size, page=PageContent(("animal", "animals"), scale=scale, motion=motion))


def _poses_by_points(table: PointTable, skeleton: SkeletonSettings, frames: Sequence[int]) -> list[list[AnimalPose]]:
    """Poses of frames ``frames``, which follow each other, from their points."""
    inside = (table.frames >= frames[0]) & (table.frames <= frames[-1])
    if not inside.any():
        raise RequestError(
            f"expected points in frames {frames[0] + 1} to {frames[-1] + 1}, got none; are they of another video?"
        )
    body = learn_skeleton(table.nodes, table.points, skeleton.line)
    return poses_of_points(table, body, frames[0], len(frames), skeleton.centre)


def _finished(
    poses: Sequence[list[AnimalPose]],
    frames: Sequence[int],
    skeleton: SkeletonSettings,
    table: PointTable | None,
    frame_rate: float,
    size: tuple[int, int],
) -> tuple[list[Animal], PointTable | None]:
    """The animals, and their points where a skeleton is known."""
    labelled = table is not None and skeleton.points is None
    if table is not None and labelled:
        poses = headed_by_labels(poses, table, frames[0] if len(frames) else 0, skeleton.line)
    animals = link_animals(poses, frames, frame_rate, size)
    if table is None:
        return animals, None
    points = learn_body_points(animals, table) if labelled else None
    written = point_table(animals, points, table.nodes)
    if points is not None and skeleton.centre is not None:
        animals = [with_centre(animal, points, skeleton.centre) for animal in animals]
    return animals, written


def in_millimetres(tracks: Sequence[BodyTrack], scale: float, source: Source) -> tuple[list[BodyTrack], list[str]]:
    """Tracks with columns for millimetres behind those for pixels, and the names of all columns.

    Args:
        tracks: of the columns `FIELDS`.
        scale: millimetres of a pixel.
        source: the video, which times its frames, for the speed.
    """
    metric_tracks = []
    for track in tracks:
        metric = scale * track.states[:, [0, 1, 3, 4]]
        speed = np.zeros(len(track))
        if len(track) > 1:
            seconds = source.times_of(track.frames)
            speed = np.linalg.norm(np.gradient(metric[:, :2], seconds, axis=0), axis=1)
        metric_tracks.append(replace(track, states=np.concatenate([track.states, metric, speed[:, None]], axis=1)))
    return metric_tracks, [*FIELDS, "a_mm", "b_mm", "length_mm", "width_mm", "speed_mm_s"]


SKELETON, CHOICE = SkeletonSettings(), AnimalChoice()


def animals(
    video: Video, *, output: Output, skeleton: SkeletonSettings = SKELETON, choice: AnimalChoice = CHOICE
) -> int:
    """Track several animals before a fixed camera: place, heading and size of each, through contact, entering, leaving.

    DIR gets states.csv (frame, id, a,b,theta,length,width in pixels and radians, score, status), report.html
    with its plots and numbers in report/, run.json and, with --overlay, overlay.webm; with --points or --labels also
    points.sleap.csv and points.dlc.csv, and points.sleap.h5 where h5py is installed.
    """
    from tsuiseki.tracking.runs.following import count

    source = video.open(images=True, replayable=True, timed=True)
    table = skeleton.table()
    if choice.corrections is not None:
        check_corrections(choice.corrections, source)
    with output.run() as run:
        steps = run.steps(run.frames(source, record=video.overlay))
        result = animal_result(source, steps, skeleton, table, choice, run.times, output.settings)
        if choice.corrections is not None:
            result = result.corrected(choice.corrections)
        run.save(result, lambda: video.draw(run, source, result))
        hint = "; nothing stands out, give --threshold or another --contrast"
        if skeleton.points is not None:
            hint = f"; the points in {skeleton.points} make none: an animal takes two in a frame, in several frames"
        hint = "" if result else hint
        run.done(f"{count(len(result), 'animal', 'animals')} in {run.count} frames: {output.out / STATES_FILE}{hint}")
    return run.status
