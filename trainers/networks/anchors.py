"""`tsuiseki train detector --propose-anchors`: anchor sizes for a configuration, fitted to labelled video."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsuiseki.datamodules.labelled_images import labelled_images, read_image
from tsuiseki.models.anchors import propose_anchors
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.networks.detector_network import Resize


def anchors_for(
    folder: Path,
    /,
    height: int,
    width: int,
    frames: tuple[int, int] | None = None,
    resize: Resize = "letterbox",
    per_level: tuple[int, ...] = (3, 2, 1),
    scale: tuple[float, float] = (0.8, 1.5),
    seed: int = 0,
) -> str:
    """The ``anchors:`` entry of a detector's configuration that fits the people labelled in ``folder``.

    Args:
        folder: a MOTChallenge sequence, or a folder of sequences.
        height: of the detector's input, pixels.
        width: likewise.
        frames: first and last frame, 1-based and both included; by default all.
        resize: how images are fitted into the input.
        per_level: anchors at strides 8, 16, 32 and, with a fourth number, 64.
        scale: range of enlargements in training, by which the boxes are spread.
        seed: of the clustering's start.

    Raises:
        RequestError: no usable labels, or fewer distinct sizes than anchors.
    """
    if not 3 <= len(per_level) <= 4 or min(per_level) < 1:
        raise RequestError(f"expected 3 or 4 numbers of anchors, each at least 1; got {list(per_level)}")
    rng = np.random.default_rng(seed)
    sizes = _sizes_in_input(folder, frames, (height, width), resize)
    spread = sizes * np.exp(rng.uniform(np.log(scale[0]), np.log(scale[1]), len(sizes)))[:, None]
    try:
        levels, fit = propose_anchors(np.concatenate([np.zeros_like(spread), spread], axis=1), per_level, rng)
    except ValueError as error:
        raise RequestError(f"{folder}: {error}; ask for fewer anchors") from error
    lines = [f"# mean IoU with the best anchor {fit:.3f} over {len(sizes)} boxes of {folder}", "anchors:"]
    lines += ["  - [" + ", ".join(f"[{w:g}, {h:g}]" for w, h in level) + "]" for level in levels]
    return "\n".join(lines)


def _sizes_in_input(folder: Path, frames: tuple[int, int] | None, size: tuple[int, int], resize: Resize) -> FloatArray:
    """``(N, 2)`` widths and heights of the labelled people in input pixels."""
    image_sizes = {s.name: read_image(s.images[0]).shape[:2] for s in find_sequences(folder) if s.images}
    sizes = [np.empty((0, 2))]
    for label in labelled_images(folder, frames):
        boxes = label.boxes[~label.ignored]
        factors = np.array([size[1], size[0]]) / image_sizes[label.sequence][::-1]
        if resize == "letterbox":
            factors = np.full(2, factors.min())
        sizes.append((boxes[:, 2:] - boxes[:, :2]) * factors)
    return np.concatenate(sizes)
