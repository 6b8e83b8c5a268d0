"""Coefficients of `tsuiseki.tracking.single.on_target`, fitted to generated clips, and how true they are by folds.

    python -m benchmarks.single.on_target ../shared/data/peers/nanotrackv2/*.onnx
    python -m benchmarks.single.on_target benchmarks/filters/tracker_*.onnx

Clips are `benchmarks.single.disappearances` of seeds 0 to 31, and walks of `SingleClip`, among look-alikes and behind
obstacles, by other seeds than those of results pages. Both classes of frames get a fixed share of the weight. The
last line is what the module holds, but for the shift of the offset. Which frames a tracker learns from depends on its
own weights, so the command is repeated until they stay.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression

from benchmarks.single.disappearances import drawn
from benchmarks.single.networks import on_and_off
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.single.response_particles import ResponseParticles
from tsuiseki.tracking.single.siamese import SiameseNetwork, open_network
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

DISAPPEARANCES = 32
WALKS = 24
FOLDS = 4
# Share of the weight of frames on the target.
ON_SHARE = 0.8
# Inverse strength of the penalty, on standardised signs.
PENALTY = 0.03


def clips() -> Iterator[tuple[list[ImageArray], FloatArray, FloatArray]]:
    """Images, boxes and visible shares."""
    for seed in range(DISAPPEARANCES):
        clip = drawn(seed)
        yield list(clip.images), clip.boxes, clip.visible
    for number in range(WALKS):
        settings = SingleClipSettings(obstacles=9, passers=7) if number % 2 else SingleClipSettings()
        frames = list(SingleClip(settings, (60, number)).frames())
        boxes = np.concatenate([truth.boxes for _, truth in frames])
        visible = np.concatenate([truth.visibility for _, truth in frames])
        if visible[0] >= 0.75:
            yield [image for (image,), _ in frames], boxes, visible


def signs_of(
    network: SiameseNetwork, images: list[ImageArray], boxes: FloatArray, visible: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Signs ``(T, 14)`` of the frames that are clearly on or off the target, and ``(T,)`` which are on it."""
    tracker = ResponseParticles(network)
    tracker.start(images[0], boxes[0])
    rows, seen = [], []
    for image in images[1:]:
        seen.append(tracker.follow(image))
        rows.append(tracker.signs)
    on, off = on_and_off(np.array([target.box for target in seen]), boxes, visible)
    # A frame that shows nothing has no signs.
    clear = (on | off) & np.array([target.score > 0 for target in seen])
    return np.array(rows)[clear], on[clear]


def fitted(parts: list[tuple[FloatArray, BoolArray]]) -> tuple[FloatArray, float]:
    """Coefficients ``(14,)`` and offset."""
    signs, on = (np.concatenate(side) for side in zip(*parts, strict=True))
    weights = np.where(on, ON_SHARE / on.sum(), (1 - ON_SHARE) / (~on).sum()) * len(on)
    mean, deviation = signs.mean(axis=0), signs.std(axis=0) + 1e-9
    model = LogisticRegression(C=PENALTY, max_iter=500).fit((signs - mean) / deviation, on, sample_weight=weights)
    coefficients = model.coef_[0] / deviation
    return coefficients, float(model.intercept_[0] - coefficients @ mean)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", type=Path, nargs="+")
    network = open_network(parser.parse_args().network)
    parts = [signs_of(network, *clip) for clip in clips()]
    alarms, missed = [], []
    for fold in range(FOLDS):
        coefficients, offset = fitted([part for n, part in enumerate(parts) if n % FOLDS != fold])
        for signs, on in parts[fold::FOLDS]:
            tracked = signs @ coefficients + offset >= 0
            alarms.append(~tracked[on])
            missed.append(tracked[~on])
    print(
        f"by folds: tracking in {100 * np.concatenate(missed).mean():.1f} % of the frames off the target, not tracking "
        f"in {100 * np.concatenate(alarms).mean():.1f} % of those on it"
    )
    coefficients, offset = fitted(parts)
    now, lasting = (part.round(2).tolist() for part in np.split(coefficients, 2))
    print("now", now, "lasting", lasting, round(offset, 2))


if __name__ == "__main__":
    main()
