"""The thesis's chapter 3 (`reproduce multi-correlation-filter`): what particles beside a correlation filter gain.

The paper's numbers are areas under the success curve over the 50 sequences of TB-50; here they are those of the
sequences that are given, so levels differ and gains are what can be compared.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.single_clip import draw_single_clip
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.single import evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence, find_single_sequences
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST, KcfParticle
from tsuiseki.tracking.single.particles import KcfParticleSettings
from tsuiseki.tracking.single.regularised import RegularisedSettings, RegularisedTracker
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.experiments import study
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.study import Bench, Column, Name, Outcome, Study, Table, tabulated

CSRT = Path(__file__).with_name("single_csrt.py")
FIRST_GENERATED = 48
"""Number of the first generated clip; `combined` was tuned on the first 24."""


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


@lru_cache(maxsize=4)
def _drawn(number: int) -> TargetClip:
    made = draw_single_clip(np.random.default_rng([17, number]))
    return TargetClip(SingleSequence(f"generated-{number + 1}", (), made.boxes), list(made.images))


@dataclass(frozen=True)
class GeneratedClip:
    """A generated sequence by its number, drawn where it is needed: all together would fill the memory."""

    number: int
    sequence = property(lambda self: _drawn(self.number).sequence)
    images = property(lambda self: _drawn(self.number).images)


AnyClip: TypeAlias = TargetClip | GeneratedClip


@dataclass(frozen=True)
class Csrt:
    """CSRT of OpenCV-contrib in the environment of ``peer``; it tries so many ``scales``, and 1 keeps the first."""

    peer: Peer
    scales: int


Entrant: TypeAlias = CombinedSettings | KcfParticleSettings | RegularisedSettings | kcf.KcfSettings | Csrt
"""A tracker of an experiment: ours, the thesis's, their filters alone, or the peer."""
Row: TypeAlias = tuple[Entrant, int]
"""A tracker, and its random seeds: so many from 0 on."""


@dataclass(frozen=True)
class ClipGroup:
    """Trackers that all try other sizes, or none: KCF, others beside it, and candidates of ours to choose from."""

    base: kcf.KcfSettings
    others: Mapping[str, Entrant]
    candidates: Mapping[str, CombinedSettings]


FIXED = CombinedSettings(filter=RegularisedSettings(sizes=1))
GROUPS: Mapping[str, ClipGroup] = {
    "scale search": ClipGroup(
        kcf.KcfSettings(),
        {"kcf-particle, robust": ROBUST, "filter alone": RegularisedSettings(),
         "combined as shipped": CombinedSettings()},
        {},
    ),
    "fixed size": ClipGroup(
        kcf.THESIS,
        {"kcf-particle, printed": PRINTED, "kcf-particle, robust": replace(ROBUST, kcf=kcf.THESIS),
         "filter alone": FIXED.filter, "combined as shipped": FIXED},
        {
            f"colours {share:g}, doubt {doubt:g}": replace(
                FIXED, filter=replace(FIXED.filter, colour_share=share), doubt=doubt
            )
            for share in (0.2, 0.3) for doubt in (0.5, 0.6)
        },
    ),
}  # fmt: skip
OURS = "combined, chosen on the others"
GENERATED: Mapping[str, Entrant] = {
    "KCF": kcf.KcfSettings(),
    "combined": CombinedSettings(),
    "kcf-particle, robust": ROBUST,
}


def reproduce(
    bench: Bench, data: list[Path] | None = None, seeds: int = 5, generated: int = 48, peer: str | None = None
) -> Outcome:
    """Correlation filters selected by a particle filter: what they gain over the filter alone, paper and here.

    DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        data: folders of sequences (OTB, VOT, UAV123), separated by commas; by default none.
        seeds: how many random seeds, of which areas are means.
        generated: how many generated clips beside them, on which nothing was tuned; 0 leaves them out.
        peer: python of an environment with opencv-contrib-python-headless, whose CSRT the given sequences get rows of;
            by default this one, if it has it.

    Raises:
        RequestError: a number below 1 (`generated`: below 0), no sequence with images, a single one, or a python
            without the package.
    """
    study.at_least_one(seeds=seeds)
    if generated < 0:
        raise RequestError(f"`generated`: expected 0 or more, got {generated}")
    sequences = [s for folder in data or () for s in find_single_sequences(folder) if s.images]
    if data and len(sequences) < 2:
        raise RequestError(f"`data`: expected two sequences with images, or more, got {len(sequences)}")
    clips = [TargetClip(s, [read_image(path) for path in s.images]) for s in sequences]
    environment = find_peer(peer, CSRT, "opencv-contrib-python-headless") if clips else None
    values: dict[str, Any] = {}
    tables: list[Table] = []
    for name, group in GROUPS.items() if clips else ():
        found, chosen = compared(bench, clips, name, group, seeds, environment)
        title = f"Given clips, {name}: AUC [%], 21 thresholds; gain with 95 % over sequences"
        tables += [_gains(found, title), _by_clip(found, clips, f"The same, {name}, by sequence")]
        values[name] = {"chosen": chosen, **{row: areas.tolist() for row, areas in found.items()}}
    if generated:
        drawn = [GeneratedClip(FIRST_GENERATED + k) for k in range(generated)]
        found = scored(bench, drawn, GENERATED, seeds, "generated clips")
        title = f"Generated clips {FIRST_GENERATED + 1} to {FIRST_GENERATED + generated}: AUC [%], 21 thresholds"
        tables.append(_gains(found, title))
        values["generated"] = {row: areas.tolist() for row, areas in found.items()}
    return Outcome({"sequences": [clip.sequence.name for clip in clips], **values}, tables)


def compared(
    bench: Bench, clips: Sequence[AnyClip], name: str, group: ClipGroup, seeds: int, peer: Peer | None = None
) -> tuple[dict[str, FloatArray], list[str]]:
    """Areas of each tracker of a group on each clip, and the candidate that was chosen for each.

    Of the candidates the one with the best mean over all *other* sequences, with the first seed, is scored on a
    sequence, with all seeds; so no sequence is scored with settings that it helped to choose.
    """
    rows: dict[str, Entrant] = {"KCF": group.base, **group.others}
    rows |= {"CSRT": Csrt(peer, 33 if name == "scale search" else 1)} if peer else {}
    found = scored(bench, clips, rows, seeds, name)
    if not group.candidates:
        return found, []
    chosen = leave_one_out(scored(bench, clips, group.candidates, 1, f"{name}, candidates"))
    jobs = [((group.candidates[one], seeds), clip) for clip, one in zip(clips, chosen, strict=True)]
    return {**found, OURS: np.array(bench.each(area, jobs, f"{name}, chosen"))}, chosen


def scored(
    bench: Bench, clips: Sequence[AnyClip], entrants: Mapping[str, Entrant], seeds: int, what: str
) -> dict[str, FloatArray]:
    """``(C,)`` areas of each tracker on C clips."""
    rows: dict[str, Row] = {name: (entrant, seeds) for name, entrant in entrants.items()}
    return {name: np.array(areas) for name, areas in Study(rows, clips, area, what).run(bench).items()}


def _gains(found: Mapping[str, FloatArray], title: str) -> Table:
    def gain(gains: FloatArray, form: str) -> str:
        return f"{study.with_bootstrap(gains, form)}, worst {gains.min():{form}}"

    return tabulated(found, [Column("mean", form=".1f", gain=gain)], ("tracker",), title, "KCF")


def _by_clip(found: Mapping[str, FloatArray], clips: Sequence[AnyClip], title: str) -> Table:
    rows: dict[Name, list[dict[str, float]]] = {
        clip.sequence.name: [{row: float(areas[k]) for row, areas in found.items()}] for k, clip in enumerate(clips)
    }
    return tabulated(rows, [Column(row, itemgetter(row), ".1f") for row in found], ("sequence",), title)


def leave_one_out(candidates: Mapping[str, FloatArray]) -> list[str]:
    """For each of S > 1 sequences the name of the candidate that is best in the mean of the others.

    Args:
        candidates: ``(S,)`` scores by name; of equal ones the first is taken.
    """
    names, scores = list(candidates), np.array(list(candidates.values()))
    others = scores.sum(axis=1, keepdims=True) - scores
    return [names[k] for k in np.argmax(others, axis=0)]


def area(row: Row, clip: AnyClip) -> float:
    """Area under the success curve with 21 thresholds on a clip, percent, mean over the seeds."""
    entrant, seeds = row
    passes = []
    for seed in range(seeds):
        boxes, drew = follow(clip, entrant, seed)
        passes.append(100 * evaluate_boxes(clip.sequence.boxes, boxes).auc)
        if not drew:
            break
    return float(np.mean(passes))


def follow(clip: AnyClip, entrant: Entrant, seed: int) -> tuple[FloatArray, bool]:
    """Boxes ``(T, 4)`` of one pass, and whether random numbers were drawn; else every seed gives the same boxes."""
    first = clip.sequence.boxes[0]
    if isinstance(entrant, Csrt):
        return follow_with_csrt(entrant, clip.images, first), False
    tracker = start(entrant, seed)
    tracker.start(clip.images[0], first)
    boxes = np.array([first] + [tracker.follow(image).box for image in clip.images[1:]])
    # Particles are the only ones that draw, and these two count the frames in which they have any.
    return boxes, getattr(tracker, "searched_frames", 0) > 0


def start(entrant: Entrant, seed: int) -> SingleTracker:
    """A new tracker."""
    if isinstance(entrant, CombinedSettings):
        return Combined(entrant, seed)
    if isinstance(entrant, KcfParticleSettings):
        return KcfParticle(entrant, seed)
    if isinstance(entrant, RegularisedSettings):
        return RegularisedTracker(entrant)
    assert not isinstance(entrant, Csrt)
    return kcf.KcfTracker(entrant)


def follow_with_csrt(settings: Csrt, images: Sequence[ImageArray], box: FloatArray) -> FloatArray:
    """Boxes ``(T, 4)`` from the first one on; where it reports a failure the box before stands."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "images.npy"
        np.save(path, np.stack(images)[..., ::-1])
        job = {"images": str(path), "box": xywh_from_corners(box).tolist(), "scales": settings.scales}
        found = np.array(settings.peer.answer(CSRT, job), dtype=np.float64)
    return np.asarray(np.concatenate([box[None], corners_from_xywh(found)]))
