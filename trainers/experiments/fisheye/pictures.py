"""Figures 4.4 and 4.5: switches that places and upright crops prevented, and one that remained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.report.overlay import draw_label, track_colour
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.trainers.experiments.fisheye.observations import Observed
from tsuiseki.trainers.experiments.fisheye.rendered import RATE, plan
from tsuiseki.trainers.experiments.fisheye.rendered import Sequence as Clip

SIDE = 320
Named = dict[tuple[int, int], int]


def switch_pictures(
    sequences: Mapping[int, Sequence[Observed]],
    tracks: Mapping[str, Mapping[int, Sequence[Sequence[FloorTrack]]]],
    seconds: int,
    calibration: Path | None,
) -> dict[str, ImageArray]:
    """``prevented.jpg``: DeepSORT above, both parts below; ``remaining.jpg`` likewise. Missing where there is none."""
    pictures = {}
    for name, switching, keeping in (("prevented.jpg", "DeepSORT", "both"), ("remaining.jpg", "both", None)):
        for seed, each in sequences.items():
            for camera, observed in enumerate(each):
                theirs, ours = (named(observed, tracks[row][seed][camera]) for row in ("DeepSORT", "both"))
                spot = first_switch({"DeepSORT": theirs, "both": ours}[switching], ours if keeping else None)
                if spot is not None and name not in pictures:
                    clip = Clip("large", seed, camera, seconds, 1, calibration)
                    pictures[name] = _strip(clip, observed, spot, theirs, ours)
    return pictures


def named(observed: Observed, tracks: Sequence[FloorTrack]) -> Named:
    """The id that tracks give to each labelled person, by frame and person; no box stands for two."""
    found: Named = {}
    for frame in np.unique(observed.truth.frames).tolist():
        rows = np.flatnonzero(observed.truth.frames == frame)
        here = [(t, int(k)) for t in tracks for k in np.flatnonzero(t.track.frames == frame)]
        if not here:
            continue
        overlaps = iou_matrix(observed.truth.boxes[rows], np.array([t.track.boxes[k] for t, k in here]))
        for row, column in zip(*assign_overlaps(overlaps, MATCH_OVERLAP), strict=True):
            found[frame, int(observed.truth.ids[rows[row]])] = here[int(column)][0].track.id
    return found


def first_switch(switching: Named, keeping: Named | None) -> tuple[int, int] | None:
    """Frame and person of a switch between two frames in a row, which ``keeping`` does not have."""
    for frame, person in sorted(switching):
        before = switching.get((frame - 1, person))
        if before is None or before == switching[frame, person] or (frame - 2, person) not in switching:
            continue
        if keeping is None or (
            (frame - 2, person) in keeping
            and len({keeping.get((f, person)) for f in (frame - 2, frame - 1, frame)}) == 1
        ):
            return frame, person
    return None


def _strip(clip: Clip, observed: Observed, spot: tuple[int, int], theirs: Named, ours: Named) -> ImageArray:
    """Three frames up to a switch, DeepSORT's ids above and those of both parts below, cut out around the person."""
    frame, person = spot
    room = plan(clip)
    view = room.view(clip.camera)
    rows: list[list[ImageArray]] = [[], []]
    for at in range(frame - 2, frame + 1):
        image, _ = room.draw_frame(view, at * RATE)
        which = np.flatnonzero(observed.truth.frames == at)
        ids, boxes = observed.truth.ids[which], observed.truth.boxes[which]
        for row, named in zip(rows, (theirs, ours), strict=True):
            row.append(_drawn(image, ids.tolist(), boxes, named, at, person))
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


def _drawn(image: ImageArray, ids: list[int], boxes: FloatArray, named: Named, frame: int, person: int) -> ImageArray:
    drawn = image.copy()
    centre = np.array([image.shape[1], image.shape[0]]) / 2
    for number, box in zip(ids, boxes, strict=True):
        identity = named.get((frame, number))
        colour = (128, 128, 128) if identity is None else track_colour(identity)
        x1, y1, x2, y2 = np.round(box).astype(int).tolist()
        cv2.rectangle(drawn, (x1, y1), (x2, y2), colour, 2, cv2.LINE_AA)
        draw_label(drawn, "missed" if identity is None else str(identity), (x1, y1 - 2), colour)
        if number == person:
            centre = (box[:2] + box[2:]) / 2
            size = int(0.6 * max(x2 - x1, y2 - y1)) + 8
            cv2.circle(drawn, tuple(np.round(centre).astype(int).tolist()), size, (255, 255, 255), 2, cv2.LINE_AA)
    low = np.clip(np.round(centre - SIDE / 2), 0, [image.shape[1] - SIDE, image.shape[0] - SIDE]).astype(int)
    part = drawn[low[1] : low[1] + SIDE, low[0] : low[0] + SIDE]
    draw_label(part, f"#{frame + 1}", (4, SIDE - 4), (60, 60, 60))
    return np.ascontiguousarray(part)
