"""Passes of single-target trackers over sequences, each kept, and what is read off them: scores, losses, searches."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.single_clip import draw_single_clip
from tsuiseki.tracking.evaluation.single import OVERLAPS, evaluate_boxes
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.geometry import corners_from_xywh, iou_pairs, xywh_from_corners
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.particles import KcfParticleSettings
from tsuiseki.tracking.single.recognised import Recognised
from tsuiseki.tracking.single.regularised import RegularisedSettings, RegularisedTracker
from tsuiseki.tracking.single.settings import SingleMethod, make_tracker
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.trainers.experiments.peers import Peer
from tsuiseki.trainers.experiments.store import Store

CSRT = Path(__file__).with_name("single_csrt.py")
WITHIN, FOLLOWED = 10, 0.5
"""Frames without overlap that are a loss, to be noticed within them; overlap above which a target is followed."""
AFTERWARDS = 10
WAYS = ("KCF", "Fix", "Proposed")
"""Of going on at the start of a search (Fig. 3.10): KCF, a box that stands still, and the particles."""


@dataclass(frozen=True)
class TargetClip:
    """A sequence with its images in memory."""

    sequence: SingleSequence
    images: list[ImageArray]

    @cached_property
    def fingerprint(self) -> str:
        """The same for the same labels and images."""
        digest = hashlib.sha256(np.ascontiguousarray(self.sequence.boxes).tobytes())
        for image in self.images:
            digest.update(repr(image.shape).encode() + np.ascontiguousarray(image).tobytes())
        return digest.hexdigest()


@lru_cache(maxsize=1)
def chase(number: int) -> TargetClip:
    """A generated sequence, drawn once for all trackers that follow it in turn: all together would fill the memory."""
    made = draw_single_clip(np.random.default_rng([17, number]))
    return TargetClip(SingleSequence(f"chase-{number}", (), made.boxes), list(made.images))


@dataclass(frozen=True)
class Recognising:
    """The tracker ``combined`` that recognises a person by an appearance ``network``."""

    network: Path


@dataclass(frozen=True)
class Csrt:
    """CSRT of OpenCV-contrib in the environment of ``peer``; it tries so many ``scales``, and 1 keeps the first."""

    peer: Peer
    scales: int


Entrant: TypeAlias = (
    CombinedSettings | KcfParticleSettings | RegularisedSettings | kcf.KcfSettings | SingleMethod | Recognising | Csrt
)
"""A tracker of an experiment: ours, the thesis's, their filters alone, one of chapter 2, or the peer."""


@dataclass(frozen=True)
class Pass:
    """A tracker's way through a sequence.

    Attributes:
        boxes: ``(T, 4)``.
        lost: ``(T,)`` whether the status was ``lost``.
        drew: whether random numbers were drawn; else every seed gives the same boxes.
    """

    boxes: FloatArray
    lost: BoolArray
    drew: bool


def start(entrant: Entrant, seed: int) -> SingleTracker:
    """A new tracker."""
    if isinstance(entrant, Recognising):
        return Recognised(Combined(seed=seed), Appearance(entrant.network, threads=1).describe)
    if isinstance(entrant, CombinedSettings):
        return Combined(entrant, seed)
    if isinstance(entrant, KcfParticleSettings):
        return KcfParticle(entrant, seed)
    if isinstance(entrant, RegularisedSettings):
        return RegularisedTracker(entrant)
    assert not isinstance(entrant, Csrt)
    return kcf.KcfTracker(entrant) if isinstance(entrant, kcf.KcfSettings) else make_tracker(entrant, seed=seed)


def passes(store: Store, clip: TargetClip | int, entrant: Entrant, seeds: Sequence[int]) -> list[Pass]:
    """Passes over a clip or the chase of a number, one a seed; one where the tracker never draws random numbers."""
    run: Callable[[Any, Entrant, int], Pass] = follow_chase if isinstance(clip, int) else follow
    first = store.recall(run, clip, entrant, 0)
    if not (isinstance(entrant, CombinedSettings | KcfParticleSettings | Recognising) or entrant == "colour-particle"):
        return [first]
    return [store.recall(run, clip, entrant, seed) if first.drew else first for seed in seeds]


def follow_chase(number: int, entrant: Entrant, seed: int) -> Pass:
    """`follow` on a generated sequence."""
    return follow(chase(number), entrant, seed)


def follow(clip: TargetClip, entrant: Entrant, seed: int) -> Pass:
    """One pass."""
    first = clip.sequence.boxes[0]
    if isinstance(entrant, Csrt):
        boxes = follow_with_csrt(entrant, clip.images, first)
        return Pass(boxes, np.zeros(len(boxes), dtype=np.bool_), drew=False)
    tracker = start(entrant, seed)
    tracker.start(clip.images[0], first)
    states = [tracker.follow(image) for image in clip.images[1:]]
    boxes = np.array([first] + [state.box for state in states])
    lost = np.array([False] + [state.status == "lost" for state in states])
    # Particles are the only ones that draw, and these two count the frames in which they have any.
    searched = getattr(tracker, "searched_frames", None)
    return Pass(boxes, lost, drew=searched is None or searched > 0)


def follow_with_csrt(settings: Csrt, images: Sequence[ImageArray], box: FloatArray) -> FloatArray:
    """Boxes ``(T, 4)`` from the first one on; where it reports a failure the box before stands."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "images.npy"
        np.save(path, np.stack(images)[..., ::-1])
        job = {"images": str(path), "box": xywh_from_corners(box).tolist(), "scales": settings.scales}
        found = np.array(settings.peer.answer(CSRT, job), dtype=np.float64)
    return np.asarray(np.concatenate([box[None], corners_from_xywh(found)]))


@dataclass(frozen=True)
class ClipScores:
    """One tracker on one clip.

    Attributes:
        auc_11, auc_21: ``(S,)`` by seed, areas under the success curve with so many thresholds, percent.
        success: ``(S, 21)`` success curves.
        losses: stretches of ten frames and more without any overlap, of all seeds together.
        noticed: of them, those called lost within ten frames.
        followed: frames with an overlap above 0.5.
        alarms: of them, those called lost.
    """

    auc_11: FloatArray
    auc_21: FloatArray
    success: FloatArray
    losses: int
    noticed: int
    followed: int
    alarms: int


def clip_scores(clip: TargetClip, found: Sequence[Pass]) -> ClipScores:
    """Scores of the passes over a clip, one a seed."""
    truth = clip.sequence.boxes
    scores = [evaluate_boxes(truth, one.boxes) for one in found]
    counts = np.zeros(4, dtype=np.int64)
    for one in found:
        overlaps = iou_pairs(truth[1:], one.boxes[1:])
        overlaps[~np.isfinite(truth[1:]).all(axis=1)] = np.nan
        counts += count_losses(overlaps, one.lost[1:])
    return ClipScores(
        100 * np.array([one.thesis_auc for one in scores]),
        100 * np.array([one.auc for one in scores]),
        np.array([one.success for one in scores]),
        *counts.tolist(),
    )


def count_losses(overlaps: FloatArray, lost: BoolArray) -> tuple[int, int, int, int]:
    """Losses, those noticed, followed frames, and those called lost, of one pass.

    Args:
        overlaps: ``(T,)`` with the true box, in [0, 1]; NaN without label, which ends a stretch.
        lost: ``(T,)`` whether the status was ``lost``.
    """
    gone = np.concatenate([[False], overlaps <= 0, [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(gone) == 1), np.flatnonzero(np.diff(gone) == -1)
    long = ends - starts >= WITHIN
    noticed = sum(bool(lost[begin : begin + WITHIN].any()) for begin in starts[long])
    followed = overlaps > FOLLOWED
    return int(long.sum()), noticed, int(followed.sum()), int((followed & lost).sum())


def searches(clip: TargetClip, settings: KcfParticleSettings, seed: int) -> list[dict[str, list[float]]]:
    """Overlaps during the searches of one pass, and in the ten frames after each, by what is done in the search.

    At each start of a search, KCF and a box that stands still go on from the same state beside the particles.
    """
    tracker, truth = KcfParticle(settings, seed), clip.sequence.boxes
    during: dict[str, list[float]] = {way: [] for way in WAYS}
    after: dict[str, list[float]] = {way: [] for way in WAYS}
    tracker.start(clip.images[0], truth[0])
    boxes, searching, states = [truth[0]], [False], [tracker.target]
    for image in clip.images[1:]:
        count = tracker.searched_frames
        boxes.append(tracker.follow(image).box)
        searching.append(tracker.searched_frames > count)
        states.append(tracker.target)
    for begin in [t for t in range(1, len(searching)) if searching[t] and not searching[t - 1]]:
        end = next((t for t in range(begin, len(searching)) if not searching[t]), len(searching))
        stop = next((t for t in range(end, len(searching)) if searching[t]), len(searching))
        last = min(end + AFTERWARDS, stop)
        frames, before = range(begin, last), states[begin - 1]
        found = (
            _kcf_boxes(clip, tracker, before, frames, learn_from=begin),
            _kcf_boxes(clip, tracker, before, frames, learn_from=end),
            boxes[begin:last],
        )
        labelled: BoolArray = np.asarray(np.isfinite(truth[begin:last]).all(axis=1))
        for way, path in zip(WAYS, found, strict=True):
            overlaps = iou_pairs(truth[begin:last], np.array(path))
            during[way] += overlaps[: end - begin][labelled[: end - begin]].tolist()
            after[way] += overlaps[end - begin :][labelled[end - begin :]].tolist()
    return [during, after]


def _kcf_boxes(
    clip: TargetClip, tracker: KcfParticle, state: kcf.KcfState, frames: range, learn_from: int
) -> list[FloatArray]:
    """KCF from ``learn_from`` on; before that the box stands still."""
    boxes = []
    for t in frames:
        if t >= learn_from:
            state = kcf.step(tracker.model, state, clip.images[t])
        boxes.append(tracker.model.box(state.centre, state.size))
    return boxes


def success(overlaps: FloatArray) -> FloatArray:
    """``(21,)`` percent of the frames with a greater overlap than each threshold; NaN without frames."""
    if not len(overlaps):
        return np.full(len(OVERLAPS), np.nan)
    return np.array([100 * (overlaps > threshold).mean() for threshold in OVERLAPS])


def area(overlaps: FloatArray) -> float:
    """Area under the success curve with 11 thresholds, percent; NaN without frames."""
    return float(success(overlaps)[::2].mean())
