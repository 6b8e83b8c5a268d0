"""Labelled images to learn objectness from: sequences with many labelled people, or with one labelled target."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.objectness import ObjectnessModel, propose, recall
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.trainers.objectness.objectness import LabelledImage, generated_images

WINDOWS = (1, 3, 10, 30, 100, 300, 1000)


def labelled_images(folder: Path, interval: int) -> list[LabelledImage]:
    """Every ``interval``-th image with its boxes, of MOTChallenge sequences or of sequences with one target.

    Raises:
        RequestError: there are neither, or they have no images.
    """
    try:
        sequences = [s for s in find_sequences(folder) if s.ground_truth_path.is_file()]
    except RequestError:
        sequences = []
    found: list[tuple[Path, FloatArray]] = []
    for sequence in sequences:
        truth = read_ground_truth(sequence.ground_truth_path)
        truth = truth.select(truth.evaluated & (truth.visibility > 0.5))
        found += [(p, truth.boxes[truth.frames == t]) for t, p in enumerate(sequence.images) if t % interval == 0]
    if not sequences:
        for single in find_single_sequences(folder):
            found += [(p, single.boxes[[t]]) for t, p in enumerate(single.images) if t % interval == 0]
    if not found:
        raise RequestError(f"{folder}: expected labelled sequences with images, found none")
    return [_loaded(path, boxes) for path, boxes in found]


def some_images(
    folders: Sequence[Path] | None, interval: int, count: int, seed: int
) -> tuple[list[LabelledImage], str]:
    """Every ``interval``-th image of ``folders``, or ``count`` generated ones; and what they are, in words.

    Raises:
        RequestError: as `labelled_images`.
    """
    if folders:
        images = [item for folder in folders for item in labelled_images(folder, interval)]
        return images, ", ".join(folder.name for folder in folders)
    return generated_images(count, seed), f"{count} images of generated chases, seed {seed}"


def _loaded(path: Path, boxes: FloatArray) -> LabelledImage:
    image = read_image(path)
    inside = clip_boxes(boxes[np.isfinite(boxes).all(axis=1)], image.shape[1], image.shape[0])
    return LabelledImage(image, inside[((inside[:, 2:] - inside[:, :2]) >= 4).all(axis=1)])


def recall_by_windows(images: list[LabelledImage], model: ObjectnessModel) -> dict[int, float]:
    """Share of labelled boxes covered by half or more, by the number of windows, for `WINDOWS`."""
    labelled = [item for item in images if len(item.boxes)]
    proposals = [propose(item.image, model, max(WINDOWS))[0] for item in labelled]
    shares = recall([item.boxes for item in labelled], proposals, list(WINDOWS))
    return dict(zip(WINDOWS, shares.tolist(), strict=True))


def plot_recall(shares: dict[int, float], path: Path) -> None:
    """The recall over the number of windows, on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(list(shares), [100 * share for share in shares.values()], marker="o", color=COLOURS[0])
    axes.set_xscale("log")
    axes.set_xticks(list(shares), [str(windows) for windows in shares])
    axes.minorticks_off()
    axes.set_ylim(0, 102)
    axes.set_xlabel("Windows")
    axes.set_ylabel("Boxes found, overlap 0.5 [%]")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110, facecolor="white")
