"""Several animals in one's own video: what they stand out from is learnt from the video itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.animals.linking import FIELDS, Animal, AnimalSettings, link_animals
from tsuiseki.tracking.animals.pose import AnimalPose
from tsuiseki.tracking.animals.skeleton import learn_skeleton
from tsuiseki.tracking.animals.skeletons import (
    headed_by_labels,
    learn_body_points,
    point_table,
    poses_of_points,
    with_centre,
)
from tsuiseki.tracking.animals.tracker import AnimalTracker
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Background, Contrast, learn_background
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.types import ImageArray
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import BodyTrack, PointTable
from tsuiseki.tracking.video.source import Source, open_source

SAMPLED = 32
"""Frames, spread over the video, that the background is learnt from."""


@dataclass(frozen=True)
class SkeletonSettings(Shared):
    """What is known of the animals' points.

    Attributes:
        points: points seen in every frame: SLEAP's .slp, .h5 or analysis CSV, or DeepLabCut's CSV; the image is not
            looked at.
        labels: points that you marked in a few frames of this video, likewise; they teach where on the body each lies.
        line: names of a point at the back and one at the front of the body, such as tail,nose; by default found.
        centre: name of the point whose place is reported; by default the middle of the body.
    """

    points: Path | None = None
    labels: Path | None = None
    line: tuple[str, str] | None = None
    centre: str | None = None

    def table(self) -> PointTable | None:
        """The points of the file that is given; None for none.

        Raises:
            RequestError: both are given, the file cannot be used, or ``centre`` is no point of it.
        """
        if self.points is not None and self.labels is not None:
            raise RequestError("expected one of `points` and `labels`, got both")
        path = self.points or self.labels
        if path is None:
            if self.centre is not None or self.line is not None:
                raise RequestError("`centre` and `line` name points; give `points` or `labels`")
            return None
        table = read_poses_file(path)
        if self.centre is not None:
            table.node(self.centre)
        return table


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


def video_background(source: Source, contrast: Contrast = "auto", threshold: float | None = None) -> Background:
    """The background of a video, from frames spread over it.

    Raises:
        RequestError: the source is live and cannot be played twice.
    """
    if source.live:
        raise RequestError("expected a video that can be played again, got a live source; record it first")
    kept: list[ImageArray] = []
    every = 1
    for number, frame in enumerate(source.frames()):
        if number % every:
            continue
        kept.append(frame.image)
        if len(kept) == 2 * SAMPLED:
            kept, every = kept[::2], 2 * every
    chosen = np.unique(np.linspace(0, len(kept) - 1, SAMPLED).round().astype(int))
    return learn_background([kept[n] for n in chosen], contrast, threshold=threshold)


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


def in_millimetres(tracks: Sequence[BodyTrack], scale: float, frame_rate: float) -> tuple[list[BodyTrack], list[str]]:
    """Tracks with columns for millimetres behind those for pixels, and the names of all columns.

    Args:
        tracks: of the columns `FIELDS`.
        scale: millimetres of a pixel.
        frame_rate: frames a second, for the speed.

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
            seconds = track.frames / frame_rate
            speed = np.linalg.norm(np.gradient(metric[:, :2], seconds, axis=0), axis=1)
        found.append(replace(track, states=np.concatenate([track.states, metric, speed[:, None]], axis=1)))
    return found, [*FIELDS, "a_mm", "b_mm", "length_mm", "width_mm", "speed_mm_s"]
