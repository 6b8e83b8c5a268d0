"""Whether a camera stands still: told in a crowd, in a turn, and not told where there is nothing to see."""

from __future__ import annotations

import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.types import ImageArray
from tsuiseki.trainers.adapt.foreground import motion_of

PICTURES = range(0, 108, 12)


def crowded(frame: int, share: float = 0.75) -> ImageArray:
    """Something else before most of the view in every picture."""
    image = street.view()
    rng = np.random.default_rng(frame)
    height, width = image.shape[0] // 12, image.shape[1] // 8
    for row, column in np.argwhere(rng.random((12, 8)) < share):
        y, x = row * height, column * width
        image[y : y + height, x : x + width] = rng.integers(0, 256, 3)
        image[y + 2 : y + 5, x + 3 : x + 9] = rng.integers(0, 256, 3)
    return image


def test_a_camera_that_stands_still() -> None:
    assert motion_of([street.picture(f) for f in PICTURES]) == ("still", None)


def test_a_crowd_hides_most_of_the_view() -> None:
    assert motion_of([crowded(f) for f in PICTURES]) == ("still", None)
    assert motion_of([np.roll(crowded(f), 3 * f, axis=1) for f in PICTURES])[0] == "moves"


@pytest.mark.parametrize("step", [1, 3])
def test_a_camera_that_moves(step: int) -> None:
    assert motion_of([street.picture(f, moved=f // step) for f in PICTURES])[0] == "moves"


@pytest.mark.parametrize("turn", [3, 5, 7])
def test_a_camera_that_turns_once(turn: int) -> None:
    pictures = [street.picture(f, moved=0 if n < turn else 60) for n, f in enumerate(PICTURES)]
    assert motion_of(pictures) == ("moves", turn)


def test_nothing_to_see() -> None:
    grey = np.full((120, 160, 3), 128, np.uint8)
    assert motion_of([grey] * 9) == ("unknown", None)
    rng = np.random.default_rng(0)
    noisy = [np.clip(128 + rng.normal(0, 2, grey.shape), 0, 255).astype(np.uint8) for _ in range(9)]
    assert motion_of(noisy) == ("unknown", None)
    # Some dark pictures do not hide that the others stand still.
    assert motion_of([grey] * 3 + [street.picture(f) for f in PICTURES][:6])[0] == "still"
