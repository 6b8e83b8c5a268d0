"""How much of a box is hidden: by boxes nearer to the camera, or outside the image.

Of two people on the ground the one whose feet are lower in the image is nearer. Parts that several boxes hide count
once for each, up to the whole box.
"""

from __future__ import annotations

import itertools

import numpy as np

from tsuiseki.tracking.association.nearby import centres, near_pairs, sizes
from tsuiseki.tracking.types import FloatArray, IntArray

PAIRS_AT_ONCE = 500_000


def hidden_parts(frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(N,)`` share of each box behind nearer boxes of its frame, in [0, 1].

    Args:
        frames: ``(N,)``.
        boxes: ``(N, 4)`` pixels, where the image shows them.
    """
    if len(boxes) == 0:
        return np.empty(0)
    every = np.arange(len(boxes))
    size = sizes(boxes)
    # Boxes overlap if their centres differ by less than their mean sizes.
    reach = (size + size.max(axis=0)) / 2
    i, j = near_pairs(frames, centres(boxes), reach, 0, every, every)
    return np.asarray(np.minimum(_overlaps(boxes, i, boxes, j) / size.prod(axis=1), 1))


def hidden_between(
    tails: IntArray, heads: IntArray, frames: IntArray, boxes: FloatArray, size: tuple[int, int] | None
) -> FloatArray:
    """``(P,)`` share of a person hidden or outside the image in the middle of the gap between two detections.

    Args:
        tails: ``(P,)`` indices of the earlier detections.
        heads: ``(P,)`` of the later ones.
        frames: ``(N,)`` increasing.
        boxes: ``(N, 4)`` pixels, where the image shows them.
        size: width and height of the image; None where it is not known.
    """
    hidden = np.zeros(len(tails))
    gap = frames[heads] - frames[tails]
    asked = np.flatnonzero(gap > 1)
    if len(asked) == 0:
        return hidden
    tails, heads, gap = tails[asked], heads[asked], gap[asked]
    middle = (frames[tails] + frames[heads]) // 2
    share = ((middle - frames[tails]) / gap)[:, None]
    box = boxes[tails] * (1 - share) + boxes[heads] * share
    area = _area(sizes(box))
    lost = _hidden_area(box, middle, frames, boxes)
    if size is not None:
        inside = np.minimum(box[:, 2:], size) - np.maximum(box[:, :2], 0)
        lost += area - _area(inside.clip(min=0))
    hidden[asked] = np.minimum(lost / area, 1)
    return hidden


def _hidden_area(box: FloatArray, when: IntArray, frames: IntArray, boxes: FloatArray) -> FloatArray:
    """``(P,)`` area of boxes at given frames behind nearer ones of ``boxes``, the detections of all frames."""
    # Only boxes of the same frame whose left edge is right of where the widest one still reaches it, and left of its
    # own right edge, can overlap: in the order of frames and left edges these follow each other.
    left = min(float(boxes[:, 0].min()), float(box[:, 0].min()))
    widest = float((boxes[:, 2] - boxes[:, 0]).max())
    width = max(float(boxes[:, 2].max()), float(box[:, 2].max())) - left + widest + 1.0
    key = (frames - frames[0]) * width + (boxes[:, 0] - left)
    order = np.argsort(key, kind="stable")
    key, ordered = key[order], boxes[order]
    base = (when - frames[0]) * width - left
    first = np.searchsorted(key, base + box[:, 0] - widest)
    last = np.maximum(np.searchsorted(key, base + box[:, 2], side="right"), first)
    lost = np.zeros(len(box))
    for part in _parts(last - first):
        count = (last - first)[part]
        p = np.repeat(np.arange(part.start, part.stop), count)
        q = np.arange(len(p)) - np.repeat(np.cumsum(count) - count - first[part], count)
        lost += _overlaps(box, p, ordered, q)
    return lost


def _parts(counts: IntArray) -> list[slice]:
    """Ranges of rows with about ``PAIRS_AT_ONCE`` pairs each."""
    block = np.cumsum(counts) // PAIRS_AT_ONCE
    bounds = np.append(np.unique(block, return_index=True)[1], len(counts))
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(bounds)]


def _overlaps(boxes: FloatArray, i: IntArray, others: FloatArray, j: IntArray) -> FloatArray:
    """``(N,)`` area that each of ``boxes`` shares with those of ``others`` whose lower edge is lower."""
    nearer = (others[j, 3] > boxes[i, 3]) & (others[j, 2] > boxes[i, 0]) & (others[j, 0] < boxes[i, 2])
    i, j = i[nearer], j[nearer]
    corner = np.minimum(boxes[i, 2:], others[j, 2:]) - np.maximum(boxes[i, :2], others[j, :2])
    return np.bincount(i, _area(corner.clip(min=0)), len(boxes)).astype(np.float64)


def _area(size: FloatArray) -> FloatArray:
    """``(N,)`` products of ``(N, 2)`` widths and heights; a product along so short an axis is slow."""
    return np.asarray(size[:, 0] * size[:, 1])
