"""HOG against a plain loop over pixels, and its invariants."""

import numpy as np
import pytest

from tsuiseki.tracking.features.hog import hog


def plain_hog(patch, cell):
    """Felzenszwalb's features pixel by pixel."""
    height, width = patch.shape[:2]
    image = np.pad(patch.reshape(height, width, -1).astype(float), ((1, 1), (1, 1), (0, 0)), mode="edge")
    rows, columns = height // cell, width // cell
    signed = np.zeros((18, rows, columns))
    for y in range(height):
        for x in range(width):
            dx = image[y + 1, x + 2] - image[y + 1, x]
            dy = image[y + 2, x + 1] - image[y, x + 1]
            k = int(np.argmax(dx**2 + dy**2))
            size = np.hypot(dx[k], dy[k])
            bin_ = round(np.arctan2(dy[k], dx[k]) / (2 * np.pi / 18)) % 18
            py, px = (y + 0.5) / cell - 0.5, (x + 0.5) / cell - 0.5
            y0, x0 = int(np.floor(py)), int(np.floor(px))
            for yy, wy in ((y0, 1 - py + y0), (y0 + 1, py - y0)):
                for xx, wx in ((x0, 1 - px + x0), (x0 + 1, px - x0)):
                    if 0 <= yy < rows and 0 <= xx < columns:
                        signed[bin_, yy, xx] += size * wy * wx
    unsigned = signed[:9] + signed[9:]
    energy = (unsigned**2).sum(axis=0)
    result = np.zeros((31, rows - 2, columns - 2))
    for y in range(1, rows - 1):
        for x in range(1, columns - 1):
            both = np.concatenate([signed[:, y, x], unsigned[:, y, x]])
            for n, (a, b) in enumerate(((y, x), (y - 1, x), (y, x - 1), (y - 1, x - 1))):
                cut = np.minimum(both / np.sqrt(energy[a : a + 2, b : b + 2].sum() + 1e-4), 0.2)
                result[:27, y - 1, x - 1] += 0.5 * cut
                result[27 + n, y - 1, x - 1] = cut[:18].sum() / np.sqrt(18)
    return result


@pytest.mark.parametrize("shape", [(16, 20, 3), (20, 16)])
def test_equals_a_loop_over_pixels(shape):
    patches = np.random.default_rng(0).integers(0, 256, (2, *shape), dtype=np.uint8)
    found = hog(patches, 4)
    for patch, features in zip(patches, found, strict=True):
        # float32 sums of some hundred votes
        np.testing.assert_allclose(features, plain_hog(patch, 4), atol=2e-5)


def test_a_constant_patch_has_no_gradients():
    assert not hog(np.full((1, 24, 24, 3), 77, dtype=np.uint8)).any()


def test_contrast_does_not_matter():
    patch = np.random.default_rng(1).integers(0, 120, (1, 32, 32, 3), dtype=np.uint8)
    np.testing.assert_allclose(hog(patch), hog(2 * patch), atol=1e-4)


@pytest.mark.parametrize("shape", [(16, 20, 3), (20, 16)])
def test_patches_do_not_touch_each_other(shape):
    patches = np.random.default_rng(2).integers(0, 256, (3, *shape), dtype=np.uint8)
    np.testing.assert_array_equal(hog(patches), np.concatenate([hog(one[None]) for one in patches]))
