"""Goldfish in a tank from above, with exact states and silhouettes: the scenes of section 5."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.body_clip import (
    SceneFrame,
    check_clip,
    larger_noise,
    paint,
    seen_by_camera,
    write_body_clip,
)
from tsuiseki.datamodules.scenes.fish.drawing import Drawn, FishLook, Float32, draw_fish, random_look, within
from tsuiseki.datamodules.scenes.fish.motion import Swimming, swim
from tsuiseki.datamodules.scenes.fish.water import gravel, make_ripples
from tsuiseki.tracking.types import FloatArray

MOST_FISH = 5
FIELDS = ("a", "b", "theta", "phi")
# Where the glass stands, from the image's border; pixels.
PANE = 24
SHADOW = (11, 15)
SHADOW_BLUR = 4.0


@dataclass(frozen=True)
class GoldfishSettings:
    """A clip.

    Attributes:
        frames: length.
        width: of the images, pixels.
        height: of the images, pixels.
        frame_rate: a second.
        fish: how many, 1 to 5; nearer ones (later ids) cover farther ones.
        length: of the ellipse of a fish, pixels.
        body_width: of that ellipse.
        tail: length of the tail.
        size_spread: each fish is larger or smaller by up to this share.
        swimming: how the fish behave.
        ripples: strength of the moving light, as a share of the brightness.
        glints: share of the surface that mirrors the lamp.
        reflections: strength of the fish's mirror images in the glass, in [0, 1].
        shadows: darkness of the fish's shadows on the floor, in [0, 1].
        pebbles: stones of the fish's colour on the floor.
        noise: of the camera, grey levels.
    """

    frames: int = 150
    width: int = 640
    height: int = 480
    frame_rate: float = 15.0
    fish: int = 2
    length: float = 56.0
    body_width: float = 24.0
    tail: float = 32.0
    size_spread: float = 0.06
    swimming: Swimming = field(default_factory=Swimming)
    ripples: float = 0.16
    glints: float = 0.004
    reflections: float = 0.3
    shadows: float = 0.35
    pebbles: int = 6
    noise: float = 4.0

    def __post_init__(self) -> None:
        check_clip(("fish", "fish"), self.fish, MOST_FISH, self.length, self)


def plan_goldfish(settings: GoldfishSettings, rng: np.random.Generator) -> FloatArray:
    """Exact states ``(frames, fish, 4)``: a, b, theta, phi."""
    extent = (settings.width, settings.height)
    ways = [swim(settings.frames, settings.frame_rate, extent, settings.swimming, rng) for _ in range(settings.fish)]
    return np.stack(ways, axis=1)


def goldfish_frames(settings: GoldfishSettings, seed: int) -> Iterator[SceneFrame]:
    """The frames of a clip, the same for one seed."""
    plan, stage = np.random.default_rng(seed).spawn(2)
    states = plan_goldfish(settings, plan)
    looks = _looks(settings, stage)
    floor = gravel(settings.width, settings.height, settings.pebbles, stage)
    ripples = make_ripples(settings.width, settings.height, settings.ripples, settings.glints, stage)
    grain = larger_noise(settings.height, settings.width, settings.noise, stage)
    for frame in range(settings.frames):
        drawn = [draw_fish(look, state) for look, state in zip(looks, states[frame], strict=True)]
        image = _picture(settings, floor, drawn, looks, states[frame], ripples.at(frame / settings.frame_rate))
        yield seen_by_camera(image, states[frame], drawn, grain, stage)


def write_goldfish(
    folder: Path,
    settings: GoldfishSettings,
    seed: int,
    overwrite: bool = False,
    watch: Callable[[Iterator[SceneFrame]], Iterable[SceneFrame]] = iter,
) -> Path:
    """Writes a clip, as :func:`~tsuiseki.datamodules.scenes.body_clip.write_body_clip` says.

    Raises:
        RequestError: ``folder`` is a file, or holds files while ``overwrite`` is False.
    """
    return write_body_clip(folder, watch(goldfish_frames(settings, seed)), FIELDS, settings.frame_rate, overwrite)


def _looks(settings: GoldfishSettings, rng: np.random.Generator) -> list[FishLook]:
    scales = rng.uniform(1 - settings.size_spread, 1 + settings.size_spread, settings.fish)
    return [
        random_look(scale * settings.length, scale * settings.body_width, scale * settings.tail, rng)
        for scale in scales.tolist()
    ]


def _picture(
    settings: GoldfishSettings,
    floor: Float32,
    drawn: list[Drawn],
    looks: list[FishLook],
    states: FloatArray,
    light: tuple[Float32, Float32],
) -> Float32:
    """The image ``(H, W, 3)`` in [0, 255] without the camera's noise."""
    brightness, glints = light
    image = floor.copy()
    for fish in drawn:
        _shade(image, fish, settings.shadows)
    for look, state in zip(looks, states, strict=True):
        _mirror(image, settings, look, state)
    for fish in drawn:
        paint(image, fish)
    image *= cv2.merge([brightness] * 3)
    glinting = glints > 0
    image[glinting] += glints[glinting, None] * (250.0 - image[glinting])
    return image


def _shade(image: Float32, fish: Drawn, darkness: float) -> None:
    """The fish's blurred shadow on the floor, to its lower right."""
    if not darkness:
        return
    soft = cv2.GaussianBlur(fish.opacity, (0, 0), SHADOW_BLUR)
    shadow = Drawn(fish.left + SHADOW[0], fish.top + SHADOW[1], fish.colour, np.asarray(soft, np.float32))
    part, own = within(image.shape[:2], shadow)
    image[part] *= 1 - darkness * soft[own][..., None]


def _mirror(image: Float32, settings: GoldfishSettings, look: FishLook, state: FloatArray) -> None:
    """Mirror images of a fish in the four panes, seen only in the strip beyond each."""
    if not settings.reflections:
        return
    width, height = settings.width, settings.height
    for axis, place, extent in (
        (0, PANE, width),
        (0, width - PANE, width),
        (1, PANE, height),
        (1, height - PANE, height),
    ):
        if abs(state[axis] - place) > look.length / 2 + look.tail + 2 * PANE:
            continue
        turned = state.copy()
        turned[axis] = 2 * place - state[axis]
        turned[2] = np.pi * (1 - axis) - state[2]
        turned[3] = -state[3]
        image_of = draw_fish(look, turned)
        part, own = within(image.shape[:2], image_of)
        strip = np.arange(extent) < place if place == PANE else np.arange(extent) >= place
        seen = strip[part[1 - axis]]
        seen = seen[None, :] if axis == 0 else seen[:, None]
        cover = (settings.reflections * image_of.opacity[own] * seen)[..., None]
        image[part] = (1 - cover) * image[part] + cover * 0.85 * image_of.colour[own]
