"""`tsuiseki train objectness`: which boxes look like an object, from any labelled boxes."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.cli.extra import needs_train_extra
from tsuiseki.tracking.errors import RequestError


def objectness(
    out: Path,
    data: list[Path] | None = None,
    test: list[Path] | None = None,
    interval: int = 10,
    images: int = 800,
    plot: Path | None = None,
    overwrite: bool = False,
    seed: int = 0,
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
        overwrite: replace an existing file.
        seed: of all random numbers.
    """
    from tsuiseki.tracking.cli.evaluate import _check_plot
    from tsuiseki.tracking.output import check_output_file, output_file

    if interval < 1 or images < 1:
        raise RequestError(f"expected --interval and --images of at least 1, got {interval} and {images}")
    for path in (out, plot):
        if path is not None:
            check_output_file(path, overwrite)
    _check_plot(plot)
    with needs_train_extra():
        from tsuiseki.trainers.objectness.objectness import ObjectnessSettings, fit_objectness, generated_images
        from tsuiseki.trainers.objectness.objectness_data import labelled_images, plot_recall, recall_by_windows

        if data:
            training = [item for folder in data for item in labelled_images(folder, interval)]
            described = ", ".join(folder.name for folder in data)
        else:
            training = generated_images(images, seed)
            described = f"{images} images of generated chases, seed {seed}"
        model = fit_objectness(training, ObjectnessSettings(seed=seed), described)
        held_out = [item for folder in test for item in labelled_images(folder, interval)] if test else None
        shares = recall_by_windows(held_out or generated_images(max(1, images // 4), seed + 1), model)
    with output_file(out, overwrite) as work:
        model.write(work)
    if plot is not None:
        with output_file(plot, overwrite) as work:
            plot_recall(shares, work)
    print(f"{len(model.sizes)} window sizes, learnt from {described}: {out}")
    print("windows  boxes found (overlap 0.5)")
    for windows, share in shares.items():
        print(f"{windows:7d}  {100 * share:5.1f} %")
