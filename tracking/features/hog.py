"""Histograms of oriented gradients in 31 channels, for a batch of patches at once.

Felzenszwalb et al., "Object detection with discriminatively trained part-based models", PAMI 2010, section 6. Each
pixel votes for one of 18 signed directions, with its gradient magnitude. The vote is shared bilinearly among the four
nearest cells. Each cell is normalised by the energy of its four 2x2 blocks of cells and cut off at 0.2.

A gradient of 8-bit values takes one of 511 x 511 values, so direction and magnitude are read from a table. The table is
sorted by magnitude. So the colour channel with the strongest gradient is found by a plain maximum of table positions.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.types import ImageArray

Float32Array = NDArray[np.float32]

# 18 signed and 9 unsigned directions, and the energies of four blocks.
CHANNELS = 31
# Directions over the whole circle.
_SIGNED = 18
# Differences of two 8-bit values: -255 ... 255.
_LEVELS = 511
# Normalised histograms are cut off here, as in the paper.
_TRUNCATION = 0.2
# Weight of the energies of the blocks.
_TEXTURE_SCALE = 1 / np.sqrt(_SIGNED)
# Added to a block's energy, so that a constant patch divides by no zero.
_SMALLEST_ENERGY = 1e-4


@lru_cache(maxsize=1)
def _gradient_tables() -> tuple[NDArray[np.int32], NDArray[np.intp], Float32Array]:
    """Rank of every gradient by magnitude, and direction (0 ... 17) and magnitude by rank."""
    steps = np.arange(_LEVELS) - 255
    dy, dx = np.meshgrid(steps, steps, indexing="ij")
    squared = (dx * dx + dy * dy).ravel()
    order = np.argsort(squared, kind="stable")
    rank = np.empty(_LEVELS * _LEVELS, dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    direction = np.round(np.arctan2(dy, dx).ravel() / (2 * np.pi / _SIGNED)).astype(np.intp) % _SIGNED
    return rank, direction[order], np.sqrt(squared[order]).astype(np.float32)


@lru_cache(maxsize=32)
def _voting_plan(height: int, width: int, cell: int) -> tuple[NDArray[np.intp], Float32Array]:
    """For each pixel its four nearest cells, as flat indices ``(4, H*W)``, and its votes' shares, of the same shape."""
    shares, indices = [], []
    for length in (height, width):
        position = (np.arange(length) + 0.5) / cell - 0.5
        lower = np.floor(position).astype(np.intp)
        upper_share = position - lower
        cells = length // cell
        both = np.stack([lower, lower + 1])
        inside = (both >= 0) & (both < cells)
        shares.append(np.where(inside, np.stack([1 - upper_share, upper_share]), 0.0))
        indices.append(np.clip(both, 0, cells - 1))
    index = indices[0][:, None, :, None] * (width // cell) + indices[1][None, :, None, :]
    share = shares[0][:, None, :, None] * shares[1][None, :, None, :]
    return index.reshape(4, -1), share.reshape(4, -1).astype(np.float32)


# Gives the place of a gradient in the tables, dy * 511 + dx, but for a constant.
_GRADIENT_KERNEL = np.array([[0, -_LEVELS, 0], [-1, 0, 1], [0, _LEVELS, 0]], dtype=np.float32)


def _strongest_gradients(patches: ImageArray) -> NDArray[np.int32]:
    """Table rank ``(B, H, W)`` of each pixel's strongest gradient over the colour channels."""
    count, height, width = patches.shape[:3]
    # All patches as one tall picture, each between copies of its first and last rows: filtering each costs more.
    tall = np.empty((count, height + 2, *patches.shape[2:]), dtype=np.uint8)
    tall[:, 1:-1], tall[:, 0], tall[:, -1] = patches, patches[:, 0], patches[:, -1]
    # One linear filter gives the position dy * 511 + dx in the table; float32 holds these whole numbers exactly.
    position = cv2.filter2D(
        tall.reshape(-1, *tall.shape[2:]),
        cv2.CV_32F,
        _GRADIENT_KERNEL,
        delta=255 * _LEVELS + 255,
        borderType=cv2.BORDER_REPLICATE,
    )
    ranks: NDArray[np.int32] = _gradient_tables()[0].take(position.astype(np.intp))
    ranks = ranks.reshape(count, height + 2, width, -1)[:, 1:-1]
    strongest = ranks[..., 0]
    for channel in range(1, ranks.shape[-1]):
        strongest = np.maximum(strongest, ranks[..., channel])
    return strongest


def _cell_histograms(patches: ImageArray, cell: int) -> Float32Array:
    """``(B, 18, H/cell, W/cell)`` signed histograms of patches ``(B, H, W[, C])``."""
    count, height, width = patches.shape[:3]
    rows, columns = height // cell, width // cell
    _, direction, magnitude = _gradient_tables()
    index, share = _voting_plan(height, width, cell)
    ranks = _strongest_gradients(patches).reshape(count, -1)
    bins = direction.take(ranks)
    bins += (np.arange(count) * _SIGNED)[:, None]
    bins *= rows * columns
    where = bins[:, None] + index
    votes = magnitude.take(ranks)[:, None] * share
    histogram = np.bincount(where.ravel(), votes.ravel(), minlength=count * _SIGNED * rows * columns)
    return histogram.astype(np.float32).reshape(count, _SIGNED, rows, columns)


def _block_scales(unsigned: Float32Array) -> Float32Array:
    """``(B, 4, rows - 2, columns - 2)`` inverse root energy of the four blocks around each inner cell."""
    energy = np.einsum("bkij,bkij->bij", unsigned, unsigned)
    pairs = energy[:, :-1] + energy[:, 1:]
    blocks = pairs[:, :, :-1] + pairs[:, :, 1:]
    scale = 1 / np.sqrt(blocks + np.float32(_SMALLEST_ENERGY))
    return np.stack([scale[:, 1:, 1:], scale[:, :-1, 1:], scale[:, 1:, :-1], scale[:, :-1, :-1]], axis=1)


def hog(patches: ImageArray, cell: int = 4) -> Float32Array:
    """31-channel histograms of oriented gradients.

    Args:
        patches: ``(B, H, W, 3)`` or ``(B, H, W)`` uint8; H and W are multiples of ``cell``, at least three cells.
        cell: side of a cell in pixels.

    Returns:
        ``(B, 31, H/cell - 2, W/cell - 2)`` float32 in [0, 1): 18 signed and 9 unsigned directions and the energies of
        the four blocks; the outermost cells only normalise. A constant patch gives zeros.
    """
    signed = _cell_histograms(patches, cell)
    unsigned = signed[:, :9] + signed[:, 9:]
    scales = _block_scales(unsigned)
    inner = np.concatenate([signed[..., 1:-1, 1:-1], unsigned[..., 1:-1, 1:-1]], axis=1)
    features = np.zeros((len(signed), CHANNELS, *inner.shape[2:]), dtype=np.float32)
    total, normalised = features[:, :27], np.empty_like(inner)
    for block in range(4):
        np.multiply(inner, scales[:, block : block + 1], out=normalised)
        np.minimum(normalised, np.float32(_TRUNCATION), out=normalised)
        normalised[:, :_SIGNED].sum(axis=1, out=features[:, 27 + block])
        total += normalised
    total *= np.float32(0.5)
    features[:, 27:] *= np.float32(_TEXTURE_SCALE)
    return features
