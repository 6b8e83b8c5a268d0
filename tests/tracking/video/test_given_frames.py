"""Images in a list, in an array or as they come are a video."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import Frame
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.source import open_source

IMAGES = [np.full((24, 32, 3), number, np.uint8) for number in range(5)]


@pytest.mark.parametrize("of", [list, tuple, np.array, iter])
def test_images_are_a_video(of: Callable[[Any], Any]) -> None:
    source = open_source(of(IMAGES), FrameRange(1, 3), 10.0)
    once = of is iter
    assert (source.live, source.length, source.size) == (once, None if once else 5, None if once else (32, 24))
    assert not source.endless
    seen = list(source.frames())
    assert [(frame.index, frame.time, int(frame.image[0, 0, 0])) for frame in seen] == [
        (1, 0.1, 1),
        (2, 0.2, 2),
        (3, 0.3, 3),
    ]
    assert once or len(list(source.frames())) == 3


def test_frames_keep_their_times() -> None:
    source = open_source([Frame(7, 0.5 * number**2, image) for number, image in enumerate(IMAGES)])
    assert [(frame.index, frame.time) for frame in source.frames()] == [(0, 0), (1, 0.5), (2, 2), (3, 4.5), (4, 8)]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "expected images, got none"),
        (["a.png"], "image 0 is of str"),
        ([IMAGES[0][..., 0]], r"image 0 is of shape \(24, 32\) uint8"),
        ([IMAGES[0] / 255], "float64"),
        (IMAGES[0], "expected a video file, or images"),
        ({"a": IMAGES}, "got dict"),
    ],
)
def test_what_is_no_image_is_said(given: Any, said: str) -> None:
    with pytest.raises(RequestError, match=said):
        open_source(given)


def test_what_does_not_fit_is_said() -> None:
    with pytest.raises(RequestError, match="frames within 1-5"):
        open_source(IMAGES, FrameRange(0, 9))
    with pytest.raises(RunError, match="32x24 throughout, got another size in image 1"):
        list(open_source([IMAGES[0], IMAGES[1][:20]]).frames())
