"""Whether a camera stands still, in pictures whose camera is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.types import FloatArray, ImageArray

SIZE = (480, 640)


def place(seed: int = 0) -> FloatArray:
    """A place larger than the picture, with structure of many sizes."""
    rng = np.random.default_rng(seed)
    wide = (SIZE[0] + 200, SIZE[1] + 200)
    layers = [cv2.GaussianBlur(rng.normal(size=wide), (0, 0), s) * s for s in (2.0, 6.0, 20.0)]
    total = np.sum(layers, axis=0)
    return np.asarray(128 + 50 * total / total.std())


def picture(
    of: FloatArray,
    right: float,
    noise: int = 0,
    gain: float = 1.0,
    people: int = 0,
    zoom: float = 1.0,
    roll: float = 0.0,
) -> ImageArray:
    """What a camera turned ``right`` pixels shows, with people ``people`` pixels further right; roll in radians."""
    rng = np.random.default_rng(1000 + noise)
    middle = np.array([SIZE[1], SIZE[0]]) / 2
    turned = zoom * np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    shift = np.column_stack([turned, middle + np.array([right + 100, 100]) - turned @ middle])
    seen = cv2.warpAffine(of, shift, (SIZE[1], SIZE[0]), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    for n in range(3 if people else 0):
        seen[100:340, 80 + 180 * n + people : 150 + 180 * n + people] = 30 + 80 * n
    seen = gain * seen + rng.normal(0, 4, SIZE)
    return np.repeat(np.clip(seen, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def told(pictures: list[ImageArray]) -> list[bool]:
    camera = StandingCamera()
    for number, image in enumerate(pictures):
        camera.add(image)
        assert len(camera) == number + 1
    return [camera.stands_still(number) for number in range(len(camera))]


def test_a_camera_that_stands_still_while_people_walk_together_and_the_light_changes() -> None:
    world = place()
    pictures = [picture(world, 0, n, 1 + 0.02 * n, people=1 + 4 * n) for n in range(30)]
    assert told(pictures) == [False] + [True] * 29


@pytest.mark.parametrize("speed", [0.5, 2.0, 25.0])
def test_a_camera_that_turns(speed: float) -> None:
    world = place(1)
    # A slow turn shows after some frames.
    assert sum(told([picture(world, speed * n, n) for n in range(30)])) <= (2 if speed < 1 else 0)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"zoom": 1.001}, {"zoom": 0.998}, {"roll": 0.001}], ids=str)
def test_a_camera_that_zooms_or_rolls(change: dict[str, float]) -> None:
    """A tenth of a percent, or a twentieth of a degree, a frame."""
    world = place(4)
    pictures = []
    for n in range(40):
        zoom, roll = change.get("zoom", 1.0) ** n, change.get("roll", 0.0) * n
        pictures.append(picture(world, 0, n, zoom=zoom, roll=roll))
    assert sum(told(pictures)) <= 8


def test_a_caption_over_a_dim_place_that_moves_tells_nothing() -> None:
    world = 60 + 0.04 * (place(5) - 128)
    pictures = [picture(world, 4.0 * n, n) for n in range(15)]
    for each in pictures:
        for row in range(4):
            cv2.putText(each, "CAM 4 2026", (10, 30 + 25 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2)
    assert not any(told(pictures))


def test_after_a_turn_it_stands_still_once_some_frames_say_so() -> None:
    world = place(2)
    places = [0.0] * 6 + [3.0, 6.0, 9.0] + [9.0] * 12
    still = told([picture(world, right, n) for n, right in enumerate(places)])
    assert still[1:6] == [True] * 5
    assert not any(still[6:9])
    assert not still[9], "a frame alone says too little"
    assert all(still[14:])


def test_nothing_to_see_and_another_size_say_nothing() -> None:
    blank = np.full((*SIZE, 3), 90, dtype=np.uint8)
    assert not any(told([blank] * 5))
    world = place(3)
    assert told([picture(world, 0), picture(world, 0, 1), picture(world, 0)[:200]])[1:] == [True, False]


def test_frames_that_did_not_come() -> None:
    camera = StandingCamera()
    camera.add(picture(place(), 0))
    assert not camera.stands_still(1)
    assert not camera.stands_still(-1)
