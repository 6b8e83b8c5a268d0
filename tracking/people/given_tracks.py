"""Tracks given by the user, as detections: actions are recognised along them without tracking."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.formats.okutama import ADVICE, check_frames, is_okutama_file, read_okutama
from tsuiseki.tracking.types import Detections, IntArray, Track
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import Source, VideoFile


def read_given_tracks(path: Path, source: Source) -> list[Track]:
    """The tracks in a MOTChallenge file, or in a label file of Okutama-Action, whose ids, from 0, are counted from 1.

    Args:
        path: of the file.
        source: the video that they belong to.

    Raises:
        RequestError: the file is missing or broken, or it labels frames that the video does not have.
    """
    if not path.is_file() or not is_okutama_file(path):
        tracks = read_tracks(path)
        _check_length(path, tracks, source)
        return tracks
    if not isinstance(source, ImageFolder):
        raise RequestError(f"{path}: expected a folder of the frames that these labels count, got a video; {ADVICE}")
    labels = read_okutama(path, source.size)
    check_frames(labels, len(source.images), source.size, str(path))
    seen = labels.select(~labels.lost)
    rows = [seen.select(np.flatnonzero(seen.ids == identity)) for identity in np.unique(seen.ids).tolist()]
    rows = [one.select(np.argsort(one.frames)) for one in rows]
    return [Track(int(one.ids[0]) + 1, one.frames, one.boxes, np.ones(len(one))) for one in rows]


def _check_length(path: Path, tracks: Sequence[Track], source: Source) -> None:
    # The header of a video file only estimates its length.
    length, slack = (source.promised, source.slack) if isinstance(source, VideoFile) else (source.length, 0)
    last = max((int(track.frames[-1]) for track in tracks), default=0)
    if length and last >= length + slack:
        raise RequestError(
            f"{path}: tracks reach frame {last + 1}, but the video has {length} frames; are these the tracks of "
            "another video?"
        )


def as_detections(tracks: Sequence[Track], length: int | None = None) -> tuple[list[Detections], IntArray]:
    """The boxes of ``tracks`` as detections, one entry a frame, and ``(N,)`` index of the track of each.

    Args:
        tracks: at least one.
        length: number of frames; None ends with the last box.

    Raises:
        RequestError: there is no track.
    """
    if not tracks:
        raise RequestError("expected at least one given track, got none")
    frames = np.concatenate([track.frames for track in tracks])
    labels = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    order = np.lexsort((labels, frames))
    cuts = np.searchsorted(frames[order], np.arange(1, (int(frames.max()) + 1) if length is None else length))
    boxes = np.split(np.concatenate([track.boxes for track in tracks])[order], cuts)
    scores = np.split(np.concatenate([track.scores for track in tracks])[order], cuts)
    return [Detections(*both) for both in zip(boxes, scores, strict=True)], labels[order]
