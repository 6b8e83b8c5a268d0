"""Strips of pictures of one person: a row a result, a column a frame, the person in the middle and enlarged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.tracking.drone.page import captions_of
from tsuiseki.tracking.features.action import crop_squares
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.report.overlay import Overlay, draw_label
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.trainers.experiments.drone.clips import Clip

# Pixels of a cell, of the bands above the rows and below them, and of the lines between the cells.
CELL, BAND, LINE = 200, 20, 2
# Side of what a cell shows, in longer sides of the person's largest box.
AROUND = 2.6
THRESHOLD = 0.4
QUALITY = 70
# Of a person's actions, so that the label fits into a cell.
MOST_NAMED = 2
LEGEND = (
    f"In the middle the person, with id and actions above {THRESHOLD:g}; all others with their ids. "
    "Dashed: not detected, filled in. Bottom left: the frame."
)
DARK, WHITE = (40, 40, 40), (255, 255, 255)


@dataclass(frozen=True)
class StripRow:
    """A result to show.

    Attributes:
        name: stands above the row.
        people: of the clip.
        followers: ids of the tracks that follow the person, one a frame shown; 0 for none.
        single: whether to name what single frames say of actions, not windows.
    """

    name: str
    people: Sequence[ActingTrack]
    followers: Sequence[int]
    single: bool = False


def strip(clip: Clip, person: int, frames: range, rows: Sequence[StripRow]) -> bytes:
    """The strip as the bytes of a JPEG file.

    Args:
        clip: where the person is seen.
        person: id in the ground truth.
        frames: 0-based, to show.
        rows: what to show in them.
    """
    images = list_images(clip.folder / "img1")
    views = [
        (Frame(frame, 0.0, read_image(images[frame])), square)
        for frame, square in zip(frames, _squares(clip, person, frames), strict=True)
    ]
    parts = []
    for row in rows:
        cells = [
            _cell(view, square, row, follower, clip.labels.names)
            for (view, square), follower in zip(views, row.followers, strict=True)
        ]
        parts += [_band(row.name, len(cells)), np.concatenate(cells, axis=1)]
    whole = np.concatenate([*parts, _band(LEGEND, len(frames))], axis=0)
    return bytes(cv2.imencode(".jpg", whole[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])


def _squares(clip: Clip, person: int, frames: range) -> FloatArray:
    """``(T, 4)`` what to show of the frames: one size, whole pixels, around the label that is nearest in time."""
    truth = clip.truth.select(clip.truth.ids == person)
    boxes = truth.boxes[[int(np.argmin(np.abs(truth.frames - frame))) for frame in frames]]
    half = np.rint(AROUND * (boxes[:, 2:] - boxes[:, :2]).max() / 2)
    middle = np.rint((boxes[:, :2] + boxes[:, 2:]) / 2)
    return np.concatenate([middle - half, middle + half], axis=1)


def _cell(view: Frame, square: FloatArray, row: StripRow, follower: int, names: Sequence[str]) -> ImageArray:
    """``(CELL + LINE, CELL + LINE, 3)`` a square of the frame, enlarged before the tracks are drawn."""
    scale = CELL / (square[2] - square[0])
    tracks, captions = [], {}
    # The person last, on top of the others.
    for person in sorted(row.people, key=lambda p: p.track.id == follower):
        whole = person.track
        at = np.flatnonzero(whole.frames == view.index)
        boxes = (whole.boxes[at] - np.tile(square[:2], 2)) * scale
        # Only what reaches into the cell: labels of others would be moved into it.
        if len(at) and (boxes[0, :2] < CELL).all() and (boxes[0, 2:] > 0).all():
            tracks.append(Track(whole.id, whole.frames[at], boxes, whole.scores[at], whole.observed[at]))
            if whole.id == follower:
                captions[follower] = [_actions(person, int(at[0]), row, names)]
    image = crop_squares(view.image, square[None], CELL)[0]
    drawn = Overlay(tracks, 1.0, captions, trail_seconds=0.0).draw(Frame(view.index, view.time, image))
    return np.asarray(cv2.copyMakeBorder(drawn, 0, LINE, 0, LINE, cv2.BORDER_CONSTANT, value=WHITE))


def _actions(person: ActingTrack, at: int, row: StripRow, names: Sequence[str]) -> str:
    """The likeliest actions of a person at an index of the track; nothing without action features."""
    said = replace(person, multi=person.single) if row.single else person
    named = captions_of([said], names, THRESHOLD).get(person.track.id)
    return "" if named is None else ", ".join(named[at].split(", ")[:MOST_NAMED])


def _band(text: str, cells: int) -> ImageArray:
    """A line of text as wide as so many cells."""
    band = np.full((BAND, cells * (CELL + LINE), 3), DARK, dtype=np.uint8)
    draw_label(band, text, (4, BAND - 2), DARK)
    return band
