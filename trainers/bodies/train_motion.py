"""`tsuiseki train motion`: how a body moves, from tracks into a file."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.bodies.choice import parse_body
from tsuiseki.tracking.filters.motion.learnt import write_motion
from tsuiseki.tracking.options import OutputFile
from tsuiseki.trainers.bodies.motion import learn_motion
from tsuiseki.trainers.bodies.motion_tracks import common_frame_rate, read_stretches


def train_motion(
    tracks: list[Path], /, output: OutputFile, body: str = "goldfish", frame_rate: float | None = None
) -> None:
    """Learn how a body moves from tracks of it: the principal components of its changes of shape and motion.

    Good tracks come from a slow, wide run (tsuiseki track deformable --deformable.particles 3000) or from labels. Only
    frames with the status tracking count.

    Args:
        tracks: states.csv files, or folders that hold one.
        out: file to write, JSON; tsuiseki track deformable --motion takes it.
        body: the one that was tracked: goldfish, ball, or a file of tsuiseki train body.
        frame_rate: frames per second of the tracks; by default what run.json or seqinfo.ini beside them says.
    """
    shape = parse_body(body)
    stretches, rate = read_stretches(tracks, shape), common_frame_rate(tracks, frame_rate)
    learnt = learn_motion(stretches, shape.name, shape.fields, shape.angles, rate)
    output.write(output.out, lambda path: write_motion(path, learnt))
    print(f"learnt from {learnt.steps} steps at {rate:g} frames/s: {output.out}")
