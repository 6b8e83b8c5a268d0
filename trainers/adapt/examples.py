"""Detections of a video and whom they show, as far as its taken tracks tell."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.types import BoolArray, Detections, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.adapt.find import Found
from tsuiseki.trainers.adapt.labels import SHORT, TAKEN, UNSURE, Labels
from tsuiseki.trainers.adapt.watch import Watched
from tsuiseki.trainers.affinity.affinity_samples import NOBODY, LabelledDetections, label_detections

# Frames between the videos of a camera, as far as anybody compares them.
_BREAK = 1_000_000
_NOTHING: IntArray = np.zeros(0, dtype=np.int64)


def first_held_out(watched: Watched, found: Found, held_out: float) -> int:
    """The first frame that nothing is learnt from."""
    return found.first + round((1 - held_out) * watched.length)


def named(found: Found, labels: Labels) -> LabelledDetections:
    """The detections, named by the taken tracks; those that only an uncertain track explains are left out."""
    return label_detections(found.detections, truth_of(labels), found.first)


def between(samples: LabelledDetections, first: int, end: int) -> LabelledDetections:
    """The detections of the frames from ``first`` up to, not including, ``end``."""
    return chosen(samples, (samples.frames >= first) & (samples.frames < end))


def chosen(samples: LabelledDetections, which: BoolArray) -> LabelledDetections:
    """The detections at a mask ``(N,)``."""
    return LabelledDetections(
        samples.frames[which],
        samples.boxes[which],
        samples.scores[which],
        None if samples.features is None else samples.features[which],
        samples.ids[which],
        samples.right[which],
    )


def joined(parts: Sequence[LabelledDetections]) -> LabelledDetections:
    """The detections of several videos as if one came after the other; nobody is in two of them."""
    moved, frames, people = [], 0, 0
    for part in parts:
        ids = np.where(part.ids == NOBODY, NOBODY, part.ids + people)
        moved.append(dataclasses.replace(part, frames=part.frames + frames, ids=ids))
        frames += int(part.frames.max(initial=-1)) + _BREAK
        people += int(part.ids.max(initial=-1)) + 1
    described = [part.features for part in moved if part.features is not None]
    return LabelledDetections(
        np.concatenate([part.frames for part in moved]),
        np.concatenate([part.boxes for part in moved]),
        np.concatenate([part.scores for part in moved]),
        np.concatenate(described) if len(described) == len(moved) else None,
        np.concatenate([part.ids for part in moved]),
        np.concatenate([part.right for part in moved]),
    )


def people_of(samples: LabelledDetections) -> LabelledDetections:
    """The detections that show somebody, and whose appearance is known."""
    known = samples.ids != NOBODY
    if samples.features is not None:
        known &= np.isfinite(samples.features).all(axis=1)
    return chosen(samples, known)


def coexisting(frames: IntArray, ids: IntArray) -> BoolArray:
    """``(N, N)`` whether two detections show different people, who are seen in one frame at some time.

    Tracks that never meet may be one person who went and came back.
    """
    names, who = np.unique(ids, return_inverse=True)
    times, when = np.unique(frames, return_inverse=True)
    seen = np.zeros((len(names), len(times)))
    seen[who, when] = 1
    together = seen @ seen.T > 0
    np.fill_diagonal(together, False)
    return np.asarray(together[who[:, None], who[None]])


def with_gaps(detections: Sequence[Detections], gap: int) -> list[Detections]:
    """Those of ``gap`` frames, nothing in as many, and so on."""
    return [here if n // gap % 2 == 0 else here.select(_NOTHING) for n, here in enumerate(detections)]


def truth_of(labels: Labels) -> GroundTruth:
    """All tracks as labels: those taken are people, uncertain ones are neither."""
    parts = [
        (track, verdict.verdict)
        for track, verdict in zip(labels.everyone, labels.verdicts, strict=True)
        if verdict.verdict in (TAKEN, UNSURE, SHORT)
    ]
    sizes = [len(track) for track, _ in parts]
    sure = np.repeat(np.array([verdict == TAKEN for _, verdict in parts], dtype=np.bool_), sizes)
    frames = np.concatenate([np.empty(0, np.int64), *(track.frames for track, _ in parts)])
    every = GroundTruth(
        frames,
        np.repeat(np.array([track.id for track, _ in parts], dtype=np.int64), sizes),
        np.concatenate([np.empty((0, 4)), *(track.boxes for track, _ in parts)]),
        sure,
        ~sure,
        np.ones(len(sure)),
    )
    return every.select(np.argsort(frames, kind="stable"))
