"""Which poses of all frames are one animal: the flow, appearance across contacts, and heads.

The flow of `FlowTracker` links poses by motion and size, and carries identities through a contact. Size and brightness
are steadier than that: for two tracks that were in contact, what each looked like before and after is compared, both
ways round, and the two are exchanged where appearance says so. `heading` finds the heads, and gaps of up to a second
are filled on straight lines.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from tsuiseki.tracking.animals.pose import AnimalPose, head_signs, heads
from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings, InputSettings
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Status
from tsuiseki.tracking.types.tracks import BodyTrack

# By how much the exchanged way must be likelier, in units of log-likelihood.
EVIDENCE = 4.0
# Frames on each side of a contact that tell appearances, at least; and most frames of a parting that does not end one.
FEWEST = 5
# Frames before and after a contact that are compared.
WINDOW = 100
# Most that appearances may differ, in deviations: one odd frame does not decide.
FARTHEST = 5.0
# Two animals are in contact where their pixels were separated and they are nearer than this many lengths.
NEAR = 1.0


def exchanged_after_contacts(labels: list[IntArray], poses: Sequence[list[AnimalPose]]) -> tuple[list[IntArray], int]:
    """Tracks of the poses in each frame, exchanged where their appearance says so, and how often they were.

    Args:
        labels: for each frame ``(N,)`` the track of each pose, 0 for none.
        poses: of each frame.
    """
    labels = [row.copy() for row in labels]
    exchanges = 0
    pending = contacts(labels, poses)
    while pending:
        first, last, track_a, track_b = pending.pop(0)
        earlier, later = (range(max(0, first - WINDOW), first), range(last + 1, min(len(labels), last + 1 + WINDOW)))
        appearances = [
            _appearance(labels, poses, frames, track) for frames in (earlier, later) for track in (track_a, track_b)
        ]
        if min(map(len, appearances)) < FEWEST:
            continue
        if _gain(appearances) > EVIDENCE:
            for row in labels[last + 1 :]:
                was_a, was_b = row == track_a, row == track_b
                row[was_a], row[was_b] = track_b, track_a
            pending = [_renamed(contact, last, {track_a: track_b, track_b: track_a}) for contact in pending]
            exchanges += 1
    return labels, exchanges


def contacts(labels: list[IntArray], poses: Sequence[list[AnimalPose]]) -> list[tuple[int, int, int, int]]:
    """First and last frame of each contact, and the two tracks, by the first frame; short partings do not end one."""
    running: dict[tuple[int, int], tuple[int, int]] = {}
    ended: list[tuple[int, int, int, int]] = []
    for frame, (row, present) in enumerate(zip(labels, poses, strict=True)):
        touching = [n for n, pose in enumerate(present) if pose.contact and row[n] > 0]
        for i, a in enumerate(touching):
            for b in touching[i + 1 :]:
                away = float(np.linalg.norm(present[a].place - present[b].place))
                if away > NEAR * max(present[a].length, present[b].length):
                    continue
                pair = (int(min(row[a], row[b])), int(max(row[a], row[b])))
                first, last = running.get(pair, (frame, frame))
                if frame - last > FEWEST:
                    ended.append((first, last, *pair))
                    first = frame
                running[pair] = (first, frame)
    return sorted(ended + [(*span, *pair) for pair, span in running.items()])


def _renamed(contact: tuple[int, int, int, int], exchange: int, names: dict[int, int]) -> tuple[int, int, int, int]:
    """A contact with the names that its tracks have since the frame of an ``exchange``."""
    first, last, a, b = contact
    if first <= exchange:
        return contact
    a, b = sorted((names.get(a, a), names.get(b, b)))
    return first, last, a, b


def _appearance(labels: list[IntArray], poses: Sequence[list[AnimalPose]], frames: range, track: int) -> FloatArray:
    """``(T, 3)`` appearance of a track in frames in which nothing touches it."""
    appearances = [
        pose.appearance
        for frame in frames
        for label, pose in zip(labels[frame], poses[frame], strict=True)
        if label == track and not pose.contact
    ]
    return np.array(appearances).reshape(-1, 3)


def _gain(appearances: list[FloatArray]) -> float:
    """How much likelier it is that the two were exchanged: first and second before, first and second after."""
    middle = [np.median(part, axis=0) for part in appearances]
    spread = np.concatenate([part - centre for part, centre in zip(appearances, middle, strict=True)])
    deviation = np.maximum(1.4826 * np.median(np.abs(spread), axis=0), 0.02)
    # Frames that follow each other look alike: each side counts as one observation.

    def away(a: FloatArray, b: FloatArray) -> float:
        return float((np.minimum(np.abs(a - b) / deviation, FARTHEST) ** 2).sum())

    first, second, then_first, then_second = middle
    return 0.5 * (
        away(first, then_first) + away(second, then_second) - away(first, then_second) - away(second, then_first)
    )


# Columns of a track's states.
FIELDS = ("a", "b", "theta", "length", "width")
# Least time for which an animal is detected, seconds.
SHORTEST = 0.4
# Seconds of walking, of all animals together, from which heads are more than a guess.
WALKED = 0.4
# Seconds over which the ends of a body, seen by region, are taken together.
STEADY = 0.4


@dataclass(frozen=True)
class Animal:
    """One animal through a video.

    Attributes:
        track: its states, of the columns `FIELDS`: pixels and radians.
        poses: of each frame of the track; None where a gap was filled.
    """

    track: BodyTrack
    poses: tuple[AnimalPose | None, ...]


def link_animals(
    poses: Sequence[list[AnimalPose]], frames: Sequence[int], frame_rate: float, size: tuple[int, int] | None
) -> list[Animal]:
    """The animals by id, numbered by their first frames.

    Args:
        poses: of each frame, in no particular order.
        frames: their 0-based numbers, without a gap.
        frame_rate: frames a second.
        size: width and height of the images; None where not known.
    """
    labels, _ = exchanged_after_contacts(_flow(poses, frame_rate, size), poses)
    at, all_poses = np.repeat(np.arange(len(poses)), list(map(len, poses))), list(itertools.chain.from_iterable(poses))
    longest = round(frame_rate)
    # Of each animal the rows in its segments, which no gap that is too long to be filled interrupts.
    animals = [
        np.split(rows, np.flatnonzero(np.diff(at[rows]) > longest) + 1)
        for rows in long_tracks(np.concatenate([np.empty(0, np.int64), *labels]) - 1)
    ]
    segments = [[[all_poses[row] for row in part] for part in parts] for parts in animals]
    apart = list(itertools.chain.from_iterable(segments))
    signs, walked = head_signs(apart, frame_rate)
    if apart and walked < WALKED and not any(pose.headed for part in apart for pose in part):
        warnings.warn("hardly any animal walks: which end is the head is a guess", InputWarning, stacklevel=2)
    linked = []
    for number, (parts, animal_segments) in enumerate(zip(animals, segments, strict=True), start=1):
        headings = np.concatenate([heads(part, signs, frame_rate) for part in animal_segments])
        rows, joined = at[np.concatenate(parts)], list(itertools.chain.from_iterable(animal_segments))
        linked.append(_animal(number, rows, joined, headings, np.asarray(frames), longest))
    return linked


def _flow(poses: Sequence[list[AnimalPose]], frame_rate: float, size: tuple[int, int] | None) -> list[IntArray]:
    """For each frame the track of each pose, 0 for none."""
    still = InputSettings(follow_camera=False)
    settings = FlowSettings(input=still, smoothing=False, min_time=SHORTEST, fill=0.0).alike()
    flow = FlowTracker(settings, frame_rate=frame_rate, size=size)
    for present in poses:
        flow.update(_detections(present))
    labels = [np.zeros(len(present), dtype=np.int64) for present in poses]
    for track in flow.tracks():
        for frame, row in zip(track.frames.tolist(), track.detection.tolist(), strict=True):
            labels[frame][row] = track.id
    return labels


def _detections(poses: list[AnimalPose]) -> Detections:
    """Upright squares about the animals, as wide as they are long."""
    if not poses:
        return Detections.empty()
    places, half = np.array([pose.place for pose in poses]), np.array([pose.length for pose in poses])[:, None] / 2
    return Detections(np.concatenate([places - half, places + half], axis=1), np.ones(len(poses)))


def _animal(
    number: int,
    at: IntArray,
    poses: list[AnimalPose],
    headings: FloatArray,
    frames: IntArray,
    longest: int,
) -> Animal:
    """One animal, its gaps of up to ``longest`` frames filled on straight lines, which nothing supports."""
    states = np.array([[*p.place, heading, p.length, p.width] for p, heading in zip(poses, headings, strict=True)])
    if poses[0].points is None:
        _steadied(states, poses, round(STEADY * longest))
    scores = np.array([pose.score for pose in poses])
    gaps = [np.arange(first, last) for first, last in itertools.pairwise(at.tolist()) if last - first <= longest]
    filled = np.unique(np.concatenate([at, *gaps]))
    observed = np.isin(filled, at)
    states[:, 2] = np.unwrap(states[:, 2])
    full = np.stack([np.interp(filled, at, column) for column in states.T], axis=1)
    full[:, 2] = np.angle(np.exp(1j * full[:, 2]))
    full_scores = np.zeros(len(filled))
    full_scores[observed] = scores
    statuses: list[Status] = ["tracking" if supported else "searching" for supported in observed]
    remaining = iter(poses)
    frame_poses = tuple(next(remaining) if supported else None for supported in observed)
    return Animal(BodyTrack(number, frames[filled], full, full_scores, tuple(statuses)), frame_poses)


def _steadied(states: FloatArray, poses: list[AnimalPose], window: int) -> None:
    """The length as median over ``window`` frames, for legs and wings come and go; the middle held to both ends.

    Contact hides both: there they are taken over from the frames before and after.

    Args:
        states: ``(T, 5)``, changed in place.
        poses: of the same frames.
        window: frames.
    """
    heading = np.stack([np.cos(states[:, 2]), np.sin(states[:, 2])], axis=1)
    cores = np.array([pose.core for pose in poses])
    shift = ((states[:, :2] - cores) * heading).sum(axis=1)
    free = np.flatnonzero([not pose.contact for pose in poses])
    if len(free) == 0:
        free = np.arange(len(poses))
    measured_ends = [ends for n in free if (ends := poses[n].ends) is not None]
    smooth = [median_filter(column[free], max(window, 1), mode="nearest") for column in (shift, states[:, 3])]
    if len(measured_ends) == len(free):
        same = np.cos([poses[n].axis - states[n, 2] for n in free]) >= 0
        ahead = np.where(same[:, None, None], measured_ends, -np.array(measured_ends)[:, :, ::-1])
        smooth[0] = _held_by_ends(shift[free], ahead)
    shift, states[:, 3] = (np.interp(np.arange(len(poses)), free, column) for column in smooth)
    states[:, :2] = cores + shift[:, None] * heading


def _held_by_ends(shift: FloatArray, ends: FloatArray) -> FloatArray:
    """``(T,)`` ways from core to middle at which the middle keeps its usual distance from the ends of the body.

    Each end counts by how sharp it is: where folded wings or a tail make one soft, the other holds the middle alone.

    Args:
        shift: ``(T,)`` the ways as seen.
        ends: ``(T, 2, 2)`` see `AnimalPose`, the second of each pair towards the head.
    """
    # A pixel is no sharper than half of itself.
    blur = np.median(np.abs(ends[:, 0] - ends[:, 1]), axis=0) + 0.5
    weight = blur**-2 / (blur**-2).sum()
    return np.asarray((ends[:, 0] - np.median(ends[:, 0] - shift[:, None], axis=0)) @ weight)
