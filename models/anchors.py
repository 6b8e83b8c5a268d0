"""Anchor boxes of single-shot detectors, the box code, and anchors fitted to labelled boxes.

The box code is that of SSD (Liu et al. 2016, eq. 2):
``(dx / w / 0.1, dy / h / 0.1, log(w'/w) / 0.2, log(h'/h) / 0.2)``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

# Divisors of the offsets of centres and of log sizes (SSD, Liu et al. 2016): they bring both to about 1.
VARIANCES = (0.1, 0.2)
# Beyond this a predicted size is a thousand times its anchor: the exponential would overflow.
_LARGEST_LOG_SIZE = 6.9

AnchorSizes = Sequence[Sequence[Sequence[float]]]


def grid_anchors(map_sizes: Sequence[tuple[int, int]], strides: Sequence[int], sizes: AnchorSizes) -> Tensor:
    """Anchors centred on the cells of feature maps.

    Args:
        map_sizes: height and width of each map.
        strides: input pixels per cell of each map.
        sizes: for each map, the ``(w, h)`` of its anchors in input pixels.

    Returns:
        ``(A, 4)`` float32 centre x, centre y, width, height in input pixels; ordered by map, row, column, anchor.
    """
    levels = []
    for (height, width), stride, shapes in zip(map_sizes, strides, sizes, strict=True):
        x = (torch.arange(width) + 0.5) * stride
        y = (torch.arange(height) + 0.5) * stride
        shape = torch.tensor(shapes, dtype=torch.float32)
        grid_y, grid_x = torch.meshgrid(y, x, indexing="ij")
        centre = torch.stack((grid_x, grid_y), dim=-1).reshape(-1, 1, 2).expand(-1, len(shape), -1)
        levels.append(torch.cat((centre, shape.expand(len(centre), -1, -1)), dim=-1).reshape(-1, 4))
    return torch.cat(levels)


def corners_from_centres(boxes: Tensor) -> Tensor:
    """``(..., 4)`` centre x, centre y, width, height to x1, y1, x2, y2."""
    half = boxes[..., 2:] / 2
    return torch.cat((boxes[..., :2] - half, boxes[..., :2] + half), dim=-1)


def centres_from_corners(boxes: Tensor) -> Tensor:
    """``(..., 4)`` x1, y1, x2, y2 to centre x, centre y, width, height."""
    return torch.cat(((boxes[..., :2] + boxes[..., 2:]) / 2, boxes[..., 2:] - boxes[..., :2]), dim=-1)


def encode(boxes: Tensor, anchors: Tensor) -> Tensor:
    """Offsets ``(..., 4)`` that turn ``anchors`` (centre form) into ``boxes`` (x1, y1, x2, y2) of positive area."""
    centre_form = centres_from_corners(boxes)
    shift = (centre_form[..., :2] - anchors[..., :2]) / anchors[..., 2:] / VARIANCES[0]
    size = torch.log(centre_form[..., 2:] / anchors[..., 2:]) / VARIANCES[1]
    return torch.cat((shift, size), dim=-1)


def decode(offsets: Tensor, anchors: Tensor) -> Tensor:
    """Boxes ``(..., 4)`` x1, y1, x2, y2 from ``offsets`` and ``anchors`` (centre form); inverse of `encode`."""
    centre = offsets[..., :2] * VARIANCES[0] * anchors[..., 2:] + anchors[..., :2]
    size = torch.exp((offsets[..., 2:] * VARIANCES[1]).clamp(max=_LARGEST_LOG_SIZE)) * anchors[..., 2:]
    return corners_from_centres(torch.cat((centre, size), dim=-1))


def propose_anchors(
    boxes: NDArray[np.float64], per_level: Sequence[int], rng: np.random.Generator, rounds: int = 50
) -> tuple[list[list[tuple[float, float]]], float]:
    """Anchor sizes that fit labelled boxes: k-means over widths and heights with IoU as the similarity.

    The sizes are grouped by area, the smallest to the first level (the finest map).

    Args:
        boxes: ``(N, 4)`` x1, y1, x2, y2 in pixels of the network's input.
        per_level: how many anchors each level has.
        rng: draws the first sizes.
        rounds: of k-means at most.

    Returns:
        For each level its ``(w, h)``, and the mean over the boxes of the IoU with the best anchor of the same centre.

    Raises:
        ValueError: there are fewer distinct box sizes than anchors.
    """
    sizes = boxes[:, 2:] - boxes[:, :2]
    count = sum(per_level)
    if len(np.unique(sizes, axis=0)) < count:
        raise ValueError(f"expected at least {count} distinct box sizes for {count} anchors, got {len(sizes)} boxes")
    anchors = _spread_start(sizes, count, rng)
    for _ in range(rounds):
        nearest = np.argmax(size_iou(sizes, anchors), axis=1)
        members = np.bincount(nearest, minlength=count)[:, None]
        sums = np.stack([np.bincount(nearest, np.log(sizes[:, i]), count) for i in range(2)], axis=1)
        updated = np.where(members > 0, np.exp(sums / np.maximum(members, 1)), anchors)
        if np.allclose(updated, anchors):
            break
        anchors = updated
    anchors = anchors[np.argsort(anchors.prod(axis=1))]
    fit = float(size_iou(sizes, anchors).max(axis=1).mean())
    ends = np.cumsum(per_level)
    levels = [anchors[end - n : end].round(1) for n, end in zip(per_level, ends, strict=True)]
    return [[(float(w), float(h)) for w, h in level] for level in levels], fit


def size_iou(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """``(N, M)`` IoU of boxes of sizes ``a`` ``(N, 2)`` and ``b`` ``(M, 2)`` with one centre."""
    shared = np.minimum(a[:, None], b[None]).prod(axis=2)
    return np.asarray(shared / (a.prod(axis=1)[:, None] + b.prod(axis=1)[None] - shared))


def _spread_start(sizes: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """k-means++: each next start is drawn with probability proportional to its squared distance to the others."""
    chosen = [sizes[rng.integers(len(sizes))]]
    for _ in range(count - 1):
        distance = 1 - size_iou(sizes, np.array(chosen)).max(axis=1)
        weight = distance**2
        chosen.append(sizes[rng.choice(len(sizes), p=weight / weight.sum())])
    return np.array(chosen)
