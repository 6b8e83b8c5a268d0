"""Several animals in one's own video: what they stand out from is learnt from the video itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.animals.linking import FIELDS, Animal, link_animals
from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.animals.settings import AnimalSettings, SkeletonSettings
from tsuiseki.tracking.animals.skeleton import (
    headed_by_labels,
    learn_body_points,
    learn_skeleton,
    point_table,
    poses_of_points,
    with_centre,
)
from tsuiseki.tracking.animals.tracker import AnimalTracker
from tsuiseki.tracking.cli.options import Output, Video
from tsuiseki.tracking.cli.run import Run
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Contrast, video_background
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable
from tsuiseki.tracking.video.frame_times import NotedTimes
from tsuiseki.tracking.video.source import open_source


def track_animals(
    source: str | Path | int,
    *,
    contrast: Contrast = "auto",
    threshold: float | None = None,
    skeleton: SkeletonSettings | None = None,
    frames: str | None = None,
    settings: AnimalSettings | None = None,
    seed: int = 0,
) -> tuple[list[BodyTrack], PointTable | None]:
    """Several animals before a fixed camera: place, heading and size of each in every frame.

    Args:
        source: a video file, a folder of images, or a MOTChallenge sequence folder.
        contrast: how animals differ from what lies behind them; ``auto`` finds out.
        threshold: difference in grey levels from which a pixel belongs to an animal; by default found.
        skeleton: what is known of their points.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        settings: see `AnimalSettings`.
        seed: as all trackers have it; this one draws no random numbers.

    Returns:
        The tracks by id, whose states are a, b, theta, length, width in pixels and radians; and their points, where a
        skeleton is known.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    del seed
    opened, skeleton = open_source(str(source), parse_frames(frames)), skeleton or SkeletonSettings()
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
    table, settings = skeleton.table(), settings or AnimalSettings()
    seen: list[list[AnimalPose]]
    if skeleton.points is not None and table is not None:
        numbers = [frame.index for frame in opened.frames()]
        seen = poses_by_points(table, skeleton, numbers)
    else:
        tracker = AnimalTracker(video_background(opened, contrast, threshold), settings, opened.frame_rate)
        for frame in opened.frames():
            tracker.update(frame)
        numbers, seen = tracker.frames, tracker.poses
    height, width = next(iter(opened.frames())).image.shape[:2]
    animals, points = finished(seen, numbers, settings, opened.frame_rate, (width, height), skeleton, table)
    return [animal.track for animal in animals], points


def poses_by_points(table: PointTable, skeleton: SkeletonSettings, frames: Sequence[int]) -> list[list[AnimalPose]]:
    """Poses of frames ``frames``, which follow each other, from points seen in them.

    Raises:
        RequestError: no point lies in these frames, or see `learn_skeleton`.
    """
    inside = (table.frames >= frames[0]) & (table.frames <= frames[-1])
    if not inside.any():
        raise RequestError(
            f"expected points in frames {frames[0] + 1} to {frames[-1] + 1}, got none; are they of another video?"
        )
    body = learn_skeleton(table.nodes, table.points, skeleton.line)
    return poses_of_points(table, body, frames[0], len(frames), skeleton.centre)


def finished(
    poses: Sequence[list[AnimalPose]],
    frames: Sequence[int],
    settings: AnimalSettings,
    frame_rate: float,
    size: tuple[int, int],
    skeleton: SkeletonSettings,
    table: PointTable | None,
) -> tuple[list[Animal], PointTable | None]:
    """The animals, and their points where a skeleton is known.

    Args:
        poses: of each frame.
        frames: 0-based numbers.
        settings: of the tracker.
        frame_rate: frames a second.
        size: width and height of the images.
        skeleton: what is known of the points.
        table: those of its file.
    """
    if table is None:
        return link_animals(poses, frames, settings, frame_rate, size), None
    if skeleton.points is not None:
        animals = link_animals(poses, frames, settings, frame_rate, size)
        return animals, point_table(animals, None, table.nodes)
    known = headed_by_labels(poses, table, frames[0] if len(frames) else 0, skeleton.line)
    animals = link_animals(known, frames, replace(settings, forward=0.0), frame_rate, size)
    points = learn_body_points(animals, table)
    written = point_table(animals, points, table.nodes)
    if skeleton.centre is not None:
        animals = [with_centre(animal, points, skeleton.centre) for animal in animals]
    return animals, written


def in_millimetres(tracks: Sequence[BodyTrack], scale: float, times: NotedTimes) -> tuple[list[BodyTrack], list[str]]:
    """Tracks with columns for millimetres behind those for pixels, and the names of all columns.

    Args:
        tracks: of the columns `FIELDS`.
        scale: millimetres of a pixel.
        times: of the frames, for the speed.

    Raises:
        RequestError: the scale is not above 0.
    """
    if not 0 < scale < np.inf:
        raise RequestError(f"`scale`: expected millimetres a pixel above 0, got {scale:g}")
    found = []
    for track in tracks:
        metric = scale * track.states[:, [0, 1, 3, 4]]
        speed = np.zeros(len(track))
        if len(track) > 1:
            speed = np.linalg.norm(np.gradient(metric[:, :2], times.at(track.frames), axis=0), axis=1)
        found.append(replace(track, states=np.concatenate([track.states, metric, speed[:, None]], axis=1)))
    return found, [*FIELDS, "a_mm", "b_mm", "length_mm", "width_mm", "speed_mm_s"]


SETTINGS = AnimalSettings()


def animals(
    video: Video,
    output: Output,
    skeleton: SkeletonSettings,
    contrast: Contrast = "auto",
    threshold: float | None = None,
    scale: float | None = None,
    animals: AnimalSettings = SETTINGS,
) -> int:
    """Track several animals before a fixed camera: place, heading and size of each, through contact, entering, leaving.

    DIR gets states.csv (frame, id, a,b,theta,length,width in pixels and radians, score, status), run.json and, with
    --overlay, overlay.webm; with --points or --labels also points.sleap.csv and points.dlc.csv, and
    points.sleap.h5 where h5py is installed.

    Args:
        contrast: how animals differ from what lies behind them: bright, dark or any; auto finds out.
        threshold: difference in grey levels from which a pixel belongs to an animal; by default found in the video.
        scale: millimetres of a pixel; adds a_mm,b_mm,length_mm,width_mm,speed_mm_s.
        animals: settings of the tracker.
    """
    from tsuiseki.tracking.animals.page import write_animals
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.body_states import write_states

    source = video.open(images=True, replayable=True, timed=True)
    table = skeleton.table()
    if scale is not None:
        in_millimetres([], scale, NotedTimes(source.frame_rate))
    with output.run() as run:
        run.facts["frame_rate"] = source.frame_rate
        tracker = None
        if skeleton.points is None:
            with run.times.measure("background"):
                background = video_background(source, contrast, threshold)
            run.facts |= {"contrast": background.contrast, "threshold": background.threshold, "area": background.area}
            tracker = AnimalTracker(background, animals, source.frame_rate)
        size, numbers = (0, 0), []
        for frame in run.steps(run.frames(source, record=video.overlay), total=frames_expected(source)):
            size = (frame.image.shape[1], frame.image.shape[0])
            numbers.append(frame.index)
            if tracker is not None:
                with run.times.measure("poses"):
                    tracker.update(frame)
        with run.times.measure("identities"):
            seen = tracker.poses if tracker else poses_by_points(table, skeleton, numbers) if table else []
            found, placed = finished(seen, numbers, animals, source.frame_rate, size, skeleton, table)
        tracks, fields = [one.track for one in found], list(FIELDS)
        if scale is not None:
            tracks, fields = in_millimetres(tracks, scale, run.seconds_of(source))
        run.columns = {"frame": [n + 1 for n in numbers], "animals": [len(poses) for poses in seen]}
        run.write("states.csv", lambda path: write_states(path, tracks, fields))
        if placed is not None:
            _write_points(run, placed, numbers[-1] + 1)
        video.draw(run, source, lambda path, again: write_animals(path, again, tracks, placed, source.frame_rate))
        hint = "" if tracks else "; nothing stands out, give `threshold` or another `contrast`"
        run.done(f"{count(len(tracks), 'animal', 'animals')} in {run.count} frames: {output.out / 'states.csv'}{hint}")
    return run.status


def _write_points(run: Run, placed: PointTable, frames: int) -> None:
    """The points of all animals in the files of other programs, of so many ``frames``."""
    from tsuiseki.tracking.formats.body_points import write_deeplabcut, write_sleap
    from tsuiseki.tracking.formats.sleap_hdf5 import hdf5_installed, write_sleap_analysis

    run.write("points.sleap.csv", lambda path: write_sleap(path, placed))
    run.write("points.dlc.csv", lambda path: write_deeplabcut(path, placed, frames))
    if hdf5_installed():
        run.write("points.sleap.h5", lambda path: write_sleap_analysis(path, placed, frames))
