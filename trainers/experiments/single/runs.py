"""Passes of trackers over sequences, each kept."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.single_clip import render_chase
from tsuiseki.tracking.evaluation.single import SequenceScores, evaluate_boxes
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.constants import CombinedSettings, KcfParticleSettings, RegularisedSettings
from tsuiseki.tracking.single.kcf import KcfSettings, KcfTracker
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.single.recognised import Recognised
from tsuiseki.tracking.single.regularised import RegularisedTracker
from tsuiseki.tracking.single.settings import SingleMethod, make_tracker
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.experiments.single.contrib import Contrib, follow_with_contrib
from tsuiseki.trainers.experiments.store import Store


@dataclass(frozen=True)
class Clip:
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


def load(sequences: Iterable[SingleSequence]) -> list[Clip]:
    """The sequences that have images, with them."""
    return [Clip(s, [read_image(path) for path in s.images]) for s in sequences if s.images]


def generated_clips(count: int) -> list[Clip]:
    """Generated chases, for a run without data."""
    return [generated_clip(number) for number in range(count)]


def generated_clip(number: int) -> Clip:
    """One of them."""
    made = render_chase(np.random.default_rng([17, number]))
    return Clip(SingleSequence(f"chase-{number}", (), made.boxes), list(made.images))


Ours: TypeAlias = CombinedSettings | KcfParticleSettings | RegularisedSettings | KcfSettings | SingleMethod
"""A tracker of this package: ours, the thesis's, their filters alone, or one of chapter 2."""
Entrant: TypeAlias = Ours | Contrib
"""A tracker of an experiment."""


@dataclass(frozen=True)
class Pass:
    """A tracker's way through a sequence.

    Attributes:
        boxes: ``(T, 4)``.
        drew: whether random numbers were drawn; else every seed gives the same boxes.
    """

    boxes: FloatArray
    drew: bool


def start(entrant: Ours, seed: int, network: Path | None = None) -> SingleTracker:
    """A new tracker; with an appearance ``network`` it recognises a person by it."""
    if network is not None:
        return Recognised(start(entrant, seed), Appearance(network, threads=1).describe)
    if isinstance(entrant, CombinedSettings):
        return Combined(entrant, seed)
    if isinstance(entrant, KcfParticleSettings):
        return KcfParticle(entrant, seed)
    if isinstance(entrant, RegularisedSettings):
        return RegularisedTracker(entrant)
    return KcfTracker(entrant) if isinstance(entrant, KcfSettings) else make_tracker(entrant, seed=seed)


def seeds_of(entrant: Entrant, seeds: Sequence[int]) -> Sequence[int]:
    """The seeds that make a difference: one where a tracker draws no random numbers."""
    drawing = isinstance(entrant, CombinedSettings | KcfParticleSettings) or entrant == "colour-particle"
    return seeds if drawing else seeds[:1]


def score(store: Store, clip: Clip, entrant: Entrant, seed: int) -> SequenceScores:
    """Scores of one pass; a pass without random numbers stands for all seeds."""
    first = store.recall(follow, clip, entrant, 0)
    found = store.recall(follow, clip, entrant, seed) if first.drew else first
    return evaluate_boxes(clip.sequence.boxes, found.boxes)


def follow(clip: Clip, entrant: Entrant, seed: int) -> Pass:
    """One pass."""
    first = clip.sequence.boxes[0]
    if isinstance(entrant, Contrib):
        return Pass(follow_with_contrib(entrant, clip.images, first), drew=False)
    tracker = start(entrant, seed)
    tracker.start(clip.images[0], first)
    boxes = np.array([first] + [tracker.follow(image).box for image in clip.images[1:]])
    # Particles are the only ones that draw, and these two count the frames in which they have any.
    searched = getattr(tracker, "searched_frames", None)
    return Pass(boxes, drew=searched is None or searched > 0)
