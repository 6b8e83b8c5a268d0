"""Passes of trackers over sequences, kept in a folder so that an interrupted experiment goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.street.chase import render_chase
from tsuiseki.tracking.evaluation.single import SequenceScores, evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.trackers.single.interface import SingleTracker
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video import read_image

CODE = ("features", "filters", "likelihoods", "trackers/single", "weights")


@dataclass(frozen=True)
class Clip:
    """A sequence with its images in memory."""

    sequence: SingleSequence
    images: list[ImageArray]

    @cached_property
    def fingerprint(self) -> str:
        """The same for the same labels and images (the first and the last stand for all)."""
        parts = (self.sequence.boxes, self.images[0], self.images[-1], np.array(len(self.images)))
        return hashlib.sha1(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


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


@dataclass(frozen=True)
class Entrant:
    """A tracker of an experiment.

    Attributes:
        described: tells it from every other, constants included.
        make: a new tracker for a seed.
        random: whether the seed makes a difference.
    """

    described: str
    make: Callable[[int], SingleTracker]
    random: bool = True


@dataclass(frozen=True)
class Runs:
    """Results by what was run, one file each in ``folder``; runs of other code, data or constants are not taken."""

    folder: Path

    def recall(self, key: tuple[str, ...], compute: Callable[[], Any]) -> Any:
        """What ``compute`` gives, in JSON's terms, from the file if it is there."""
        name = hashlib.sha1("\n".join((code_fingerprint(), *key)).encode()).hexdigest()
        path = self.folder / f"{name}.json"
        if path.is_file():
            return json.loads(path.read_text(encoding="utf-8"))
        value = compute()
        self.folder.mkdir(parents=True, exist_ok=True)
        with output_file(path, overwrite=True) as work:
            work.write_text(json.dumps(value), encoding="utf-8")
        return value

    def score(self, clip: Clip, entrant: Entrant, seed: int) -> SequenceScores:
        """Scores of one pass."""
        key = ("pass", entrant.described, clip.fingerprint, str(seed if entrant.random else 0))
        boxes = self.recall(key, lambda: follow(clip, entrant.make(seed)).tolist())
        return evaluate_boxes(clip.sequence.boxes, np.array(boxes))


def follow(clip: Clip, tracker: SingleTracker) -> FloatArray:
    """Boxes ``(T, 4)`` of one pass."""
    first = clip.sequence.boxes[0]
    tracker.start(clip.images[0], first)
    return np.array([first] + [tracker.follow(image).box for image in clip.images[1:]])


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Of the sources and models that make a tracker's result."""
    root = resources.files("tsuiseki.tracking")
    digest = hashlib.sha1()
    for folder in CODE:
        for path in sorted(Path(str(root / folder)).iterdir()):
            if path.suffix in (".py", ".json"):
                digest.update(path.read_bytes())
    return digest.hexdigest()
