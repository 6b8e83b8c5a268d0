"""Coefficients of `tsuiseki.tracking.single.on_target`, fitted to generated and real clips, and how true they are.

    python -m benchmarks.single.on_target ../shared/data/peers/nanotrackv2/*.onnx --data ../shared/data
    python -m benchmarks.single.on_target tracking/weights/tracker_*.onnx --data ../shared/data

Clips are `benchmarks.single.disappearances` of seeds 0 to 31, walks of `SingleClip`, among look-alikes and behind
obstacles, by other seeds than those of results pages, the clips of sot/, and people of PETS and MOT17-13. Each of these
kinds counts as much as another, and both classes of frames get a fixed share of the weight. How true they are is told
of clips that taught nothing, by fixed folds. The last line is what the module holds, but for the shift of the offset.
Which frames a tracker learns from depends on its own weights, so they change a little when the command is repeated.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from sklearn.linear_model import LogisticRegression

from benchmarks.single.disappearances import drawn
from benchmarks.single.networks import calibration_error, on_and_off, real_clips
from benchmarks.single.people import people_clips
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.single.response_particles import TRACKED, ResponseParticles
from tsuiseki.tracking.single.siamese import SiameseNetwork, open_network
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

DISAPPEARANCES = 32
WALKS = 24
FOLDS = 4
# Share of the weight of frames on the target.
ON_SHARE = 0.8
# Inverse strength of the penalty, on standardised signs.
PENALTY = 0.03


class Labelled(NamedTuple):
    """A clip: its kind, images, boxes ``(T, 4)`` and visible shares ``(T,)``."""

    kind: str
    images: list[ImageArray]
    boxes: FloatArray
    visible: FloatArray


def clips(data: Path) -> Iterator[Labelled]:
    """All clips."""
    for seed in range(DISAPPEARANCES):
        clip = drawn(seed)
        yield Labelled("disappearances", list(clip.images), clip.boxes, clip.visible)
    for number in range(WALKS):
        settings = SingleClipSettings(obstacles=9, passers=7) if number % 2 else SingleClipSettings()
        frames = list(SingleClip(settings, (60, number)).frames())
        boxes = np.concatenate([truth.boxes for _, truth in frames])
        visible = np.concatenate([truth.visibility for _, truth in frames])
        if visible[0] >= 0.75:
            yield Labelled("walks", [image for (image,), _ in frames], boxes, visible)
    for _, images, boxes in real_clips(data):
        yield Labelled("real", images, boxes, np.ones(len(boxes)))
    for person in people_clips(data):
        yield Labelled("people", person.images, person.boxes, person.visible)


class Signs(NamedTuple):
    """Frames of a clip that are clearly on or off the target: signs ``(T, 14)``, and ``(T,)`` which are on it."""

    kind: str
    rows: FloatArray
    on: BoolArray


def signs_of(network: SiameseNetwork, clip: Labelled) -> Signs:
    """What the tracker sees of a clip."""
    tracker = ResponseParticles(network)
    tracker.start(clip.images[0], clip.boxes[0])
    rows, seen = [], []
    for image in clip.images[1:]:
        seen.append(tracker.follow(image))
        rows.append(tracker.signs)
    on, off = on_and_off(np.array([target.box for target in seen]), clip.boxes, clip.visible)
    # A frame that shows nothing has no signs.
    clear = (on | off) & np.array([target.score > 0 for target in seen])[: len(on)]
    return Signs(clip.kind, np.array(rows)[: len(on)][clear], on[clear])


def fitted(parts: Sequence[Signs]) -> tuple[FloatArray, float]:
    """Coefficients ``(14,)`` and offset."""
    signs, on = np.concatenate([part.rows for part in parts]), np.concatenate([part.on for part in parts])
    kinds = np.concatenate([np.full(len(part.on), part.kind) for part in parts])
    weights = np.zeros(len(on))
    for kind in np.unique(kinds):
        for of, share in ((on, ON_SHARE), (~on, 1 - ON_SHARE)):
            which = of & (kinds == kind)
            weights[which] = share / max(which.sum(), 1)
    weights *= len(on) / weights.sum()
    mean, deviation = signs.mean(axis=0), signs.std(axis=0) + 1e-9
    model = LogisticRegression(C=PENALTY, max_iter=500).fit((signs - mean) / deviation, on, sample_weight=weights)
    coefficients = model.coef_[0] / deviation
    return coefficients, float(model.intercept_[0] - coefficients @ mean)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, nargs="+")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    words = parser.parse_args()
    cv2.setNumThreads(1)
    network = open_network(words.network)
    parts = [signs_of(network, clip) for clip in clips(words.data)]
    chances = dict[int, FloatArray]()
    for fold in range(FOLDS):
        coefficients, offset = fitted([part for n, part in enumerate(parts) if n % FOLDS != fold])
        for n in range(fold, len(parts), FOLDS):
            chances[n] = 1 / (1 + np.exp(-(parts[n].rows @ coefficients + offset)))
    for kind in dict.fromkeys(part.kind for part in parts):
        those = [n for n, part in enumerate(parts) if part.kind == kind]
        on, chance = np.concatenate([parts[n].on for n in those]), np.concatenate([chances[n] for n in those])
        print(
            f"{kind}, by folds: tracking in {100 * (chance[~on] >= TRACKED).mean():.1f} % of {(~on).sum()} frames off "
            f"the target, not tracking in {100 * (chance[on] < TRACKED).mean():.1f} % of {on.sum()} on it, calibration "
            f"error {calibration_error(chance, on):.3f}"
        )
    coefficients, offset = fitted(parts)
    now, lasting = (part.round(2).tolist() for part in np.split(coefficients, 2))
    print("now", now, "lasting", lasting, round(offset, 2))


if __name__ == "__main__":
    main()
