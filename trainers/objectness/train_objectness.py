"""`tsuiseki train objectness`: binarised normed gradients, into a file."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import PlottedFile, Seed
from tsuiseki.trainers.objectness.objectness import ObjectnessSettings, fit_objectness
from tsuiseki.trainers.objectness.objectness_data import plot_recall, recall_by_windows, some_images


def train_objectness(
    output: PlottedFile,
    chance: Seed,
    data: list[Path] | None = None,
    test: list[Path] | None = None,
    interval: int = 10,
    images: int = 800,
) -> None:
    """Learn binarised normed gradients (BING) from labelled boxes, and report the recall by number of windows.

    Args:
        out: file to write, JSON.
        data: folders of labelled sequences (MOTChallenge, OTB, VOT, UAV123), separated by commas; by default generated
            chases.
        test: folders to measure the recall on; by default generated chases of another seed.
        interval: take every so many frames of the folders.
        images: number of generated images, where nothing is given.
        plot: also plot the recall to this file (PNG, SVG or PDF).
    """
    if interval < 1 or images < 1:
        raise RequestError(f"expected `interval` and `images` of at least 1, got {interval} and {images}")
    training, described = some_images(data, interval, images, chance.seed)
    model = fit_objectness(training, ObjectnessSettings(seed=chance.seed), described)
    held_out, _ = some_images(test, interval, max(1, images // 4), chance.seed + 1)
    shares = recall_by_windows(held_out, model)
    output.write(output.out, model.write)
    output.draw(lambda path: plot_recall(shares, path))
    print(f"{len(model.sizes)} window sizes, learnt from {described}: {output.out}")
    print("windows  boxes found (overlap 0.5)")
    for windows, share in shares.items():
        print(f"{windows:7d}  {100 * share:5.1f} %")
