"""`tsuiseki track animals`: several animals before a fixed camera."""

from __future__ import annotations

from tsuiseki.tracking.animals.linking import AnimalSettings
from tsuiseki.tracking.animals.tracking import SkeletonSettings
from tsuiseki.tracking.cli.options import Output, Video
from tsuiseki.tracking.features.background_difference import Contrast

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
    from tsuiseki.tracking.animals.linking import FIELDS
    from tsuiseki.tracking.animals.page import write_animals
    from tsuiseki.tracking.animals.tracker import AnimalTracker
    from tsuiseki.tracking.animals.tracking import (
        finished,
        in_millimetres,
        poses_by_points,
        video_background,
    )
    from tsuiseki.tracking.cli.run import count, frames_expected
    from tsuiseki.tracking.formats.body_points import write_deeplabcut, write_sleap
    from tsuiseki.tracking.formats.body_states import write_states
    from tsuiseki.tracking.formats.sleap_hdf5 import hdf5_installed, write_sleap_analysis

    source = video.open(images=True, replayable=True, timed=True)
    table = skeleton.table()
    if scale is not None:
        in_millimetres([], scale, source.frame_rate)
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
            tracks, fields = in_millimetres(tracks, scale, source.frame_rate)
        run.columns = {"frame": [n + 1 for n in numbers], "animals": [len(poses) for poses in seen]}
        run.write("states.csv", lambda path: write_states(path, tracks, fields))
        if placed is not None:
            run.write("points.sleap.csv", lambda path: write_sleap(path, placed))
            run.write("points.dlc.csv", lambda path: write_deeplabcut(path, placed, numbers[-1] + 1))
            if hdf5_installed():
                run.write("points.sleap.h5", lambda path: write_sleap_analysis(path, placed, numbers[-1] + 1))
        video.draw(run, source, lambda path, again: write_animals(path, again, tracks, placed, source.frame_rate))
        hint = "" if tracks else "; nothing stands out, give `threshold` or another `contrast`"
        run.done(f"{count(len(tracks), 'animal', 'animals')} in {run.count} frames: {output.out / 'states.csv'}{hint}")
    return run.status
