"""The thesis's chapter 3 again: sweeps, comparison, intervals of search, attributes; paper beside here.

The paper's numbers are areas under the success curve with 11 thresholds over the 50 sequences of TB-50; here they are
the same over the sequences that are given, so levels differ and the shapes of the curves are what can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.datamodules.scenes.chase import render_chase
from tsuiseki.tracking.evaluation.single import SequenceScores, evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.trackers.single import kcf
from tsuiseki.tracking.trackers.single.interface import SingleTracker
from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST, THESIS, KcfParticleSettings
from tsuiseki.tracking.trackers.single.kcf_tracker import KcfTracker
from tsuiseki.tracking.trackers.single.methods import Method, make_tracker
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.video import read_image

AFTERWARDS = 10
BASELINES: tuple[Method, ...] = (
    "csk", "mosse", "template", "histogram", "kalman", "meanshift", "camshift", "medianflow", "colour-particle", "mil",
)  # fmt: skip


@dataclass(frozen=True)
class Clip:
    """A sequence with its images in memory."""

    sequence: SingleSequence
    images: list[ImageArray]


@dataclass(frozen=True)
class Sweep:
    """One parameter, the others at the thesis's values.

    Attributes:
        name: of the parameter.
        figure: of the thesis.
        paper: its areas by value, where the text gives them, in percent.
        values: tried here.
        settings: for a value.
    """

    name: str
    figure: str
    paper: Mapping[float, float]
    values: tuple[float, ...]
    settings: Callable[[float], KcfParticleSettings]


SWEEPS = (
    Sweep(
        "epsilon_2", "Fig. 3.6", {0.0: 32.84, 0.03: 37.73}, (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.1),
        lambda v: replace(THESIS, convergence=v, response_share=1.0, hypotheses=1),
    ),
    Sweep(
        "alpha", "Fig. 3.7", {0.3: 38.60, 1.0: 37.73}, (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0),
        lambda v: replace(THESIS, response_share=v, hypotheses=1),
    ),
    Sweep(
        "M", "Fig. 3.8", {1: 38.60, 20: 40.64}, (1, 2, 5, 10, 20, 30, 40, 50),
        lambda v: replace(THESIS, hypotheses=int(v)),
    ),
    Sweep(
        "mu, uniform", "Table 3.4", {0.0: 39.97, 0.25: 39.28, 0.5: 40.64, 0.75: 38.95, 1.0: 38.84},
        (0.0, 0.25, 0.5, 0.75, 1.0), lambda v: replace(THESIS, past_share=v),
    ),
    Sweep(
        "mu, score", "Table 3.4", {}, (0.0, 0.25, 0.5, 0.75, 1.0),
        lambda v: replace(THESIS, past_share=v, past="score"),
    ),
)  # fmt: skip


def load(sequences: Iterable[SingleSequence]) -> list[Clip]:
    """The sequences that have images, with them."""
    return [Clip(s, [read_image(path) for path in s.images]) for s in sequences if s.images]


def generated_clips(count: int) -> list[Clip]:
    """Generated chases, for a run without data."""
    clips = []
    for k in range(count):
        made = render_chase(np.random.default_rng([17, k]))
        clips.append(Clip(SingleSequence(f"chase-{k}", (), made.boxes), list(made.images)))
    return clips


def follow(clip: Clip, tracker: SingleTracker) -> FloatArray:
    """Boxes ``(T, 4)`` of one pass."""
    first = clip.sequence.boxes[0]
    tracker.start(clip.images[0], first)
    return np.array([first] + [tracker.follow(image).box for image in clip.images[1:]])


def score(clip: Clip, tracker: SingleTracker) -> SequenceScores:
    """Scores of one pass."""
    return evaluate_boxes(clip.sequence.boxes, follow(clip, tracker))


@dataclass(frozen=True)
class Repeated:
    """One tracker over sequences and seeds.

    Attributes:
        scores: per seed, by sequence.
    """

    scores: tuple[Mapping[str, SequenceScores], ...]

    def areas(self, thesis: bool = True, names: Sequence[str] | None = None) -> FloatArray:
        """Mean areas over sequences in percent, one a seed, with 11 (``thesis``) or 21 thresholds."""
        return 100 * np.array(
            [
                np.mean([(s.thesis_auc if thesis else s.auc) for n, s in one.items() if names is None or n in names])
                for one in self.scores
            ]
        )

    def success(self) -> FloatArray:
        """``(21,)`` mean success curve."""
        return np.asarray(np.mean([s.success for one in self.scores for s in one.values()], axis=0))


def repeat(clips: Sequence[Clip], make: Callable[[int], SingleTracker], seeds: Sequence[int]) -> Repeated:
    """A new tracker for every seed and sequence."""
    return Repeated(tuple({c.sequence.name: score(c, make(seed)) for c in clips} for seed in seeds))


def run_sweep(sweep: Sweep, clips: Sequence[Clip], seeds: Sequence[int]) -> dict[float, Repeated]:
    """Results by value of the parameter."""

    def maker(value: float) -> Callable[[int], SingleTracker]:
        return lambda seed: KcfParticle(sweep.settings(value), seed)

    return {value: repeat(clips, maker(value), seeds) for value in sweep.values}


def compare(
    clips: Sequence[Clip], seeds: Sequence[int], baselines: Sequence[Method] = BASELINES
) -> dict[str, Repeated]:
    """Fig. 3.9: KCF and the combined tracker, the thesis's and ours, and the baselines of chapter 2."""
    first = seeds[:1]
    results = {
        "KCF, fixed size": repeat(clips, lambda _: KcfTracker(kcf.THESIS), first),
        "KCF, scale search": repeat(clips, lambda _: KcfTracker(kcf.KcfSettings()), first),
        "combined, thesis": repeat(clips, lambda seed: KcfParticle(THESIS, seed), seeds),
        "combined, robust, fixed size": repeat(clips, lambda s: KcfParticle(replace(ROBUST, kcf=kcf.THESIS), s), seeds),
        "combined, robust": repeat(clips, lambda seed: KcfParticle(ROBUST, seed), seeds),
    }
    for method in baselines:
        used = seeds if method == "colour-particle" else first
        results[method] = repeat(clips, _maker(method), used)
    return results


def _maker(method: Method) -> Callable[[int], SingleTracker]:
    return lambda seed: make_tracker(method, seed=seed)


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


def intervals(clips: Sequence[Clip], settings: KcfParticleSettings, seeds: Sequence[int]) -> Intervals:
    """At each start of a search, KCF and a standing box go on from the same state beside the particles."""
    during: dict[str, list[float]] = {name: [] for name in ("KCF", "Fix", "Proposed")}
    after: dict[str, list[float]] = {name: [] for name in ("KCF", "Fix", "Proposed")}
    for clip in clips:
        for seed in seeds:
            _one_pass(clip, KcfParticle(settings, seed), during, after)
    return Intervals(*({n: np.array(v) for n, v in part.items()} for part in (during, after)))


def _one_pass(clip: Clip, tracker: KcfParticle, during: dict[str, list[float]], after: dict[str, list[float]]) -> None:
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


def by_attribute(clips: Sequence[Clip], results: Mapping[str, Repeated]) -> dict[str, dict[str, float]]:
    """Fig. 3.11: mean areas by attribute and tracker, for the attributes that occur."""
    attributes = sorted({a for c in clips for a in c.sequence.attributes})
    names = {a: [c.sequence.name for c in clips if a in c.sequence.attributes] for a in attributes}
    return {a: {t: float(r.areas(names=names[a]).mean()) for t, r in results.items()} for a in attributes}
