"""Fig. 3.10 of the thesis again: how the frames of search end with and without the particles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.constants import KcfParticleSettings
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.store import Store

AFTERWARDS = 10
WAYS = ("KCF", "Fix", "Proposed")


@dataclass(frozen=True)
class Intervals:
    """Fig. 3.10: overlaps in the frames of search and in the ten frames after, by what is done in the search.

    Attributes:
        during: overlaps by ``KCF``, ``Fix`` and ``Proposed``.
        after: likewise, once the correlation filter tracks alone again.
    """

    during: Mapping[str, FloatArray]
    after: Mapping[str, FloatArray]

    @staticmethod
    def area(overlaps: FloatArray) -> float:
        """Area under the success curve with 11 thresholds, percent; NaN without frames."""
        if not len(overlaps):
            return float("nan")
        return 100 * float(np.mean([(overlaps > t).mean() for t in np.linspace(0, 1, 11)]))


def intervals(store: Store, clips: Sequence[Clip], settings: KcfParticleSettings, seeds: Sequence[int]) -> Intervals:
    """At each start of a search, KCF and a standing box go on from the same state beside the particles."""
    found = [store.recall(one_pass, clip, settings, seed) for clip in clips for seed in seeds]
    parts = ({way: np.concatenate([np.array(one[part][way]) for one in found]) for way in WAYS} for part in range(2))
    return Intervals(*parts)


def one_pass(clip: Clip, settings: KcfParticleSettings, seed: int) -> list[dict[str, list[float]]]:
    """Overlaps during the searches of one pass and after them, by way."""
    tracker = KcfParticle(settings, seed)
    during: dict[str, list[float]] = {way: [] for way in WAYS}
    after: dict[str, list[float]] = {way: [] for way in WAYS}
    tracker.start(clip.images[0], clip.sequence.boxes[0])
    boxes, searching, states = [clip.sequence.boxes[0]], [False], [tracker.target]
    for image in clip.images[1:]:
        count = tracker.searched_frames
        boxes.append(tracker.follow(image).box)
        searching.append(tracker.searched_frames > count)
        states.append(tracker.target)
    starts = [t for t in range(1, len(searching)) if searching[t] and not searching[t - 1]]
    for start in starts:
        end = next((t for t in range(start, len(searching)) if not searching[t]), len(searching))
        stop = next((t for t in range(end, len(searching)) if searching[t]), len(searching))
        last = min(end + AFTERWARDS, stop)
        ways = {
            "KCF": _kcf_boxes(clip, tracker, states[start - 1], range(start, last), learn_from=start),
            "Fix": _kcf_boxes(clip, tracker, states[start - 1], range(start, last), learn_from=end),
            "Proposed": boxes[start:last],
        }
        truth = clip.sequence.boxes[start:last]
        for name, found in ways.items():
            overlaps = iou_pairs(truth, np.array(found))
            labelled: BoolArray = np.asarray(np.isfinite(truth).all(axis=1))
            during[name] += overlaps[: end - start][labelled[: end - start]].tolist()
            after[name] += overlaps[end - start :][labelled[end - start :]].tolist()
    return [during, after]


def _kcf_boxes(
    clip: Clip, tracker: KcfParticle, state: kcf.KcfState, frames: range, learn_from: int
) -> list[FloatArray]:
    """KCF from ``learn_from`` on; before that the box stands still."""
    boxes = []
    for t in frames:
        if t >= learn_from:
            state = kcf.step(tracker.model, state, clip.images[t])
        boxes.append(tracker.model.box(state.centre, state.size))
    return boxes
