"""A moving camera followed by boxes, by pictures, or not at all (`reproduce association --parts camera`).

MOT17-13 is filmed from a bus, and is the one sequence of the MOT17 set whose pictures are there: at half size, in one
video with the frames before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from tsuiseki.tracking.evaluation.resampling import score_sums, scores_of
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import open_source
from tsuiseki.trainers.experiments.association.labelled import with_labels
from tsuiseki.trainers.experiments.association.sequences import Clip, read_clip
from tsuiseki.trainers.experiments.experiment import Bench, Table

SEQUENCE, VIDEO, FRAMES = "MOT17-13", "mot/mot17-13-video/MOT17-13-960x540.h265", "377-750"
# Pictures are half as wide and high as the boxes' pixels count.
SCALE = 2.0
By: TypeAlias = Literal["boxes", "pictures", "nothing"]


@dataclass(frozen=True)
class Followed:
    """A sequence tracked with one notion of its camera.

    Attributes:
        sums: of the scores.
        shifts: ``(T - 1, 2)`` where the middle of the image goes with each step, pixels.
        unknown: frames whose step is said to be unknown, from 1 on.
    """

    sums: FloatArray
    shifts: FloatArray
    unknown: IntArray


def picture_steps(video: Path, clip: Clip) -> list[CameraStep]:
    """The camera's steps by the pictures of the clip's frames in a video, in the pixels of the clip's boxes."""
    path = CameraPath()
    for frame, found in zip(open_source(video, parse_frames(FRAMES)).frames(), read_clip(clip), strict=True):
        path.add(frame.image, found.boxes / SCALE)
    steps = [path.step(frame) for frame in range(len(path))]
    return [CameraStep(step.similarity * [[1, 1, SCALE]], step.deviation * SCALE) for step in steps]


def followed(clip: Clip, by: By, steps: Sequence[CameraStep]) -> Followed:
    """The flow with the camera as ``by`` tells it; ``steps`` are those of the pictures."""
    settings, path = FlowSettings(), None
    if by == "nothing":
        settings = replace(settings, input=replace(settings.input, camera=None))
    if by == "pictures":
        path = CameraPath()
        for step in steps:
            path.follow(step)
    tracker = FlowTracker(settings, frame_rate=clip.rate, size=clip.size, camera=path)
    found = read_clip(clip)
    for one in found:
        tracker.update(one)
    sums = score_sums(with_labels(clip, tracker.tracks()))
    camera, frames = tracker.camera, np.arange(len(found))
    middle = np.tile(np.array(clip.size) / 2, (len(found) - 1, 2))
    moved = camera.from_first(camera.to_first(middle, frames[:-1]), frames[1:])
    unknown = np.array([frame for frame in camera.unknown if frame > 0], dtype=np.int64)
    return Followed(sums, (moved - middle)[:, :2], unknown)


def camera_table(bench: Bench, data: Path, clips: Sequence[Clip]) -> Table | None:
    """The rows; None where the sequence or its pictures are not there."""
    clip = next((one for one in clips if one.name == SEQUENCE), None)
    if clip is None or not (data / VIDEO).is_file():
        return None
    steps = bench.store.recall(picture_steps, data / VIDEO, clip)
    rows = []
    ways: tuple[By, ...] = ("boxes", "pictures", "nothing")
    by = {way: bench.store.recall(followed, clip, way, steps) for way in ways}
    known = np.ones(len(by["boxes"].shifts), dtype=np.bool_)
    known[by["boxes"].unknown - 1] = False
    apart = np.hypot(*(by["boxes"].shifts - by["pictures"].shifts).T)
    for way in ways:
        scores = scores_of(by[way].sums)
        shown = [f"{float(scores[k]):.3f}" for k in ("hota", "mota", "idf1")]
        rows.append([way, *shown, str(int(scores["id_switches"])), str(len(by[way].unknown))])
    middle = float(np.median(np.hypot(*by["pictures"].shifts.T)))
    off = f"{np.median(apart[known]):.1f} px where they know"
    if not known.all():
        off += f", {np.median(apart[~known]):.1f} px where they say that they do not"
    told = f"Median step by the pictures: {middle:.1f} px. By the boxes it differs by {off}"
    columns = (f"{SEQUENCE}, camera by", "HOTA", "MOTA", "IDF1", "IDSW", "steps unknown")
    return Table(told, columns, rows)
