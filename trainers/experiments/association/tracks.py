"""The tracks of our methods, as their users get them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.smoothing import GapSettings, fill_gaps
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.people.tracker import PeopleTracker, shifted
from tsuiseki.tracking.people.tracking import track_people
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.trainers.experiments.association.sequences import Clip, read_clip, table_of, tracks_of


def method_tracks(clip: Clip, method: PeopleMethod, delay: float | None = None) -> FloatArray:
    """What `tsuiseki track people --detections … --method METHOD` gives, as `table_of` writes it.

    Pictures are looked at where the sequence has any and all its frames are kept, as the command does.
    """
    found = read_clip(clip)
    if clip.pictures is not None and clip.every == 1:
        first = clip.kept.start
        whole = [Detections.empty()] * first + found
        tracks = track_people(clip.pictures, method, detections=whole, frames=clip.frames, threads=1, delay=delay)
        return table_of([shifted(track, -first) for track in tracks])
    return table_of(without_pictures(clip, found, method, delay))


def tracks_by(clip: Clip, tracker: PeopleTracker) -> list[Track]:
    """What a tracker of one's own gives, pictures looked at where the sequence has any."""
    found = read_clip(clip)
    if clip.pictures is None or clip.every > 1:
        return without_pictures(clip, found, tracker)
    first = clip.kept.start
    whole = [Detections.empty()] * first + found
    tracks = track_people(clip.pictures, tracker, detections=whole, frames=clip.frames, threads=1)
    return [shifted(track, -first) for track in tracks]


def boxes_alone(clip: Clip, method: PeopleMethod) -> FloatArray:
    """The same without looking at pictures."""
    return table_of(without_pictures(clip, read_clip(clip), method))


def without_pictures(
    clip: Clip, found: Sequence[Detections], method: PeopleMethod | PeopleTracker, delay: float | None = None
) -> list[Track]:
    """The tracks of a sequence that is its detections, its rate and the size of its images."""
    with tempfile.TemporaryDirectory() as folder:
        write_sequence_info(Path(folder), clip.name, clip.rate, len(found), *clip.size)
        return track_people(folder, method, detections=list(found), delay=delay)


def filled(table: FloatArray, longest: int) -> FloatArray:
    """A result with its gaps of up to so many frames filled on straight lines."""
    every = GapSettings(longest, support=np.inf, mismatch=np.inf)
    return table_of([fill_gaps(track, every) for track in tracks_of(table)])


def observed_only(table: FloatArray) -> FloatArray:
    """A result without the boxes that were filled in."""
    rows = table.reshape(-1, 8)
    return rows[rows[:, 7] > 0]
