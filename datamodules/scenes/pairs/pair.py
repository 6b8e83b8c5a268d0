"""A target in a template picture, and the same target some frames later in a search picture, with its exact box.

Between both the target turns, grows, bends, changes its light and its background; other things, some of the same kind,
are about, before and behind it; the camera blurs, coarsens, compresses, and leaves the scene. The pictures are cut out
as a tracker cuts them: a target of w x h with p = (w + h) / 2 has a square of side sqrt((w + p)(h + p)) about it in the
template; the search picture shows twice as much about where the target was (SiamFC, Bertinetto et al., 2016, 3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np

from tsuiseki.datamodules.augmentation import compressed, motion_kernel
from tsuiseki.datamodules.scenes.pairs.looks import Look, Silhouette, Wardrobe, outlined
from tsuiseki.datamodules.scenes.render.photographs import OPAQUE
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.types import FloatArray, ImageArray

# Chance that the search picture does not show the target.
ABSENT = 0.08
# Least share of a target that stays in sight of whatever covers it.
LEAST_VISIBLE = 0.35
# Largest distance of a target's middle from that of the search picture, as a share of its side.
_FARTHEST = 0.4
# Chance that another thing is of the target's kind.
_ALIKE = 0.35
# Chance that the picture goes on beyond the frame, where a tracker fills in the mean colour.
_OUTSIDE = 0.15


# Factors of width and height of a box, and its shift in sides.
Habit: TypeAlias = tuple[FloatArray, FloatArray]


class TargetPair(NamedTuple):
    """Of one target.

    Attributes:
        template: ``(T, T, 3)`` uint8 RGB.
        search: ``(S, S, 3)`` uint8 RGB.
        box: ``(4,)`` float32 x1, y1, x2, y2 of the whole target in the search picture, covered parts included; it may
            reach out of it. Zeros where it is not there.
        present: whether it is.
    """

    template: ImageArray
    search: ImageArray
    box: Float32
    present: bool


@dataclass(frozen=True)
class Placement:
    """A cut-out on its way into a picture.

    Attributes:
        thing: the cut-out.
        matrix: ``(2, 2)`` turns and stretches it, about its middle.
    """

    thing: Silhouette
    matrix: FloatArray

    def extent(self) -> FloatArray:
        """``(4,)`` x1, y1, x2, y2 of what is opaque, about the middle of the cut-out."""
        points = self.thing.outline @ self.matrix.T
        return np.concatenate([points.min(axis=0), points.max(axis=0)])


def draw_pair(rng: np.random.Generator, wardrobe: Wardrobe, template_side: int, search_side: int) -> TargetPair:
    """One pair of pictures, all of it drawn by ``rng``."""
    look, camera = wardrobe.look(rng), _Camera(rng)
    before, after = _views(rng, look)
    # People draw their boxes a little wider or narrower than the silhouette, but alike in all frames.
    habit = np.exp(rng.normal(0, 0.05, 2)), rng.normal(0, 0.02, 2)
    ground = wardrobe.texture(rng)
    place, zoom = rng.random(2), float(np.exp(rng.uniform(-0.7, 0.9)))
    first = _scaled(before, template_side, habit, 1.0)
    template = _background(rng, ground, template_side, place, zoom)
    middle = template_side / 2 - centres(_box(first, np.zeros(2), habit)) + rng.normal(0, 0.7, 2)
    _others(rng, template, wardrobe, look, first, middle, int(rng.integers(0, 3)))
    _lay(template, first, middle)
    growth, shift = _change(rng, search_side)
    later = _scaled(after, template_side, habit, growth)
    ground = ground if rng.random() < 0.75 else wardrobe.texture(rng)
    search = _background(rng, ground, search_side, place + rng.normal(0, 0.05, 2), zoom / growth)
    middle = search_side / 2 + shift - centres(_box(later, np.zeros(2), habit))
    _others(rng, search, wardrobe, look, later, middle, int(rng.integers(0, 5)))
    present = bool(rng.random() >= ABSENT)
    if present:
        covered = _lay(search, later, middle)
        _others(rng, search, wardrobe, look, later, middle, int(rng.choice(3, p=(0.6, 0.3, 0.1))), covered)
    box = _box(later, middle, habit) if present else np.zeros(4)
    filmed, shown = (_filmed(rng, picture, camera) for picture in (template, search))
    return TargetPair(filmed, _beyond(rng, shown, box, present), box.astype(np.float32), present)


def _views(rng: np.random.Generator, look: Look) -> tuple[Placement, Placement]:
    """The target before and after some frames, turned and stretched anyhow, and then a little more."""
    first, second = (look[int(rng.integers(len(look)))] for _ in range(2))
    base = _turned(rng, 0.25, 0.2)
    second = _bent(rng, second) if rng.random() < 0.5 else second
    return Placement(first, base), Placement(second, _turned(rng, 0.3, 0.13) @ base)


def _change(rng: np.random.Generator, side: int) -> tuple[float, FloatArray]:
    """How many times as large the target is as the tracker takes it for, and how far from the middle, pixels."""
    growth = float(np.exp(np.clip(rng.normal(0, 0.2), -0.5, 0.5)))
    # Most targets move little; some, or the camera, jump.
    reach = 0.1 * side if rng.random() < 0.6 else 0.2 * side
    return growth, np.clip(rng.normal(0, reach, 2), -_FARTHEST * side, _FARTHEST * side)


def _turned(rng: np.random.Generator, turn: float, stretch: float) -> FloatArray:
    """``(2, 2)`` of a turn, a stretch and a shear, now and then a large turn."""
    angle = rng.normal(0, turn * (3 if rng.random() < 0.1 else 1))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    ratio = rng.normal(0, stretch)
    stretched = np.array([[np.exp(ratio / 2), rng.normal(0, 0.5 * stretch)], [0, np.exp(-ratio / 2)]])
    return np.asarray(rotation @ stretched)


def _bent(rng: np.random.Generator, thing: Silhouette) -> Silhouette:
    """A cut-out whose parts have moved a little."""
    height, width = thing.pixels.shape[:2]
    moves = (rng.normal(0, 0.05, (4, 4, 2)) * (width, height)).astype(np.float32)
    fields = cv2.resize(moves, (width, height), interpolation=cv2.INTER_CUBIC)
    x = np.arange(width, dtype=np.float32)[None] + fields[..., 0]
    y = np.arange(height, dtype=np.float32)[:, None] + fields[..., 1]
    bent = np.asarray(cv2.remap(thing.pixels, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT), dtype=np.uint8)
    return outlined(bent) if (bent[..., 3] >= OPAQUE).any() else thing


def _box(thing: Placement, middle: FloatArray, habit: Habit) -> FloatArray:
    """``(4,)`` the box as its drawer has the habit to draw it."""
    extent = thing.extent()
    half, centre = (extent[2:] - extent[:2]) / 2, centres(extent)
    centre = middle + centre + habit[1] * 2 * half
    return np.concatenate([centre - half * habit[0], centre + half * habit[0]])


def _scaled(thing: Placement, template_side: int, habit: Habit, growth: float) -> Placement:
    """The thing in the size that a tracker shows it in, ``growth`` times as large."""
    box = _box(thing, np.zeros(2), habit)
    wide, high = box[2:] - box[:2]
    pad = (wide + high) / 2
    scale = growth * template_side / np.sqrt((wide + pad) * (high + pad))
    return replace(thing, matrix=thing.matrix * scale)


def _background(rng: np.random.Generator, texture: ImageArray, side: int, place: FloatArray, zoom: float) -> Float32:
    """``(side, side, 3)`` of a texture about a place, a share of its sides, each of its pixels ``zoom`` wide."""
    at = place * np.array(texture.shape[1::-1])
    turn = rng.normal(0, 0.05)
    matrix = zoom * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    affine = np.hstack([matrix, (side / 2 - matrix @ at)[:, None]])
    return cv2.warpAffine(
        texture, affine, (side, side), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    ).astype(np.float32)


def _lay(canvas: Float32, thing: Placement, middle: FloatArray, covered: Float32 | None = None) -> Float32 | None:
    """Lay a thing over ``canvas``, in place.

    Returns:
        ``(H, W)`` its opacity; or with ``covered``, that of a target, what is left of it. None where the thing would
        hide too much of the target, and is not laid.
    """
    height, width = canvas.shape[:2]
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(thing.thing.pixels.shape[1::-1]) / 2
    reach = corners @ thing.matrix.T + middle
    x1, y1 = np.maximum(np.floor(reach.min(axis=0)).astype(int), 0)
    x2, y2 = np.minimum(np.ceil(reach.max(axis=0)).astype(int), (width, height))
    left = np.zeros((height, width), dtype=np.float32) if covered is None else covered
    if x2 <= x1 or y2 <= y1:
        return left
    # Pixels are squares: the middle of the first one is at one half.
    own = np.array(thing.thing.pixels.shape[1::-1]) / 2 - 0.5
    affine = np.hstack([thing.matrix, (middle - 0.5 - thing.matrix @ own - (x1, y1))[:, None]])
    shrinks = np.abs(np.linalg.det(thing.matrix)) < 0.3
    pixels = cv2.GaussianBlur(thing.thing.pixels, (3, 3), 0) if shrinks else thing.thing.pixels
    part = cv2.warpAffine(pixels, affine, (int(x2 - x1), int(y2 - y1)), flags=cv2.INTER_LINEAR).astype(np.float32)
    there, opacity = canvas[y1:y2, x1:x2], part[..., 3:] / 255
    if covered is None:
        left[y1:y2, x1:x2] = opacity[..., 0]
    else:
        rest = covered[y1:y2, x1:x2] * (1 - opacity[..., 0])
        if covered.sum() - covered[y1:y2, x1:x2].sum() + rest.sum() < LEAST_VISIBLE * covered.sum():
            return None
        covered[y1:y2, x1:x2] = rest
    there *= 1 - opacity
    there += part[..., :3]
    return left


def _others(
    rng: np.random.Generator,
    canvas: Float32,
    wardrobe: Wardrobe,
    look: Look,
    target: Placement,
    middle: FloatArray,
    count: int,
    covered: Float32 | None = None,
) -> None:
    """Lay other things about the target, some of them of its kind; before it with ``covered``, its opacity."""
    extent = target.extent()
    size = float(np.sqrt(np.prod(extent[2:] - extent[:2])))
    for _ in range(count):
        alike = rng.random() < _ALIKE
        other = wardrobe.alike(rng, look) if alike else wardrobe.look(rng)
        thing = Placement(other[int(rng.integers(len(other)))], _turned(rng, 0.3, 0.2))
        wide, high = thing.extent()[2:] - thing.extent()[:2]
        scale = size * np.exp(rng.normal(0, 0.2 if alike else 0.5)) / np.sqrt(wide * high)
        thing = replace(thing, matrix=thing.matrix * scale)
        away = rng.normal(0, 1, 2)
        far = rng.uniform(0.5, 1.0) if covered is not None else rng.uniform(0.6, 2.2)
        _lay(canvas, thing, middle + away / np.linalg.norm(away) * far * size, covered)


class _Camera:
    """What both pictures of a pair share: colours, noise, compression and fineness, drawn at random."""

    def __init__(self, rng: np.random.Generator) -> None:
        grey = rng.random() < 0.08
        saturation = 0.0 if grey else float(np.clip(rng.normal(0.65, 0.3), 0, 1.3))
        self.colour = np.diag(np.exp(rng.normal(0, 0.08, 3) + rng.normal(0, 0.2))) @ (
            np.full((3, 3), (1 - saturation) / 3) + saturation * np.eye(3)
        )
        self.contrast = float(np.exp(rng.normal(-0.1, 0.25)))
        self.noise = float(rng.uniform(0, 10)) if rng.random() < 0.5 else 0.0
        self.quality = int(rng.integers(30, 95)) if rng.random() < 0.35 else 0
        # How many pixels of the picture one of the camera's pixels covers; most targets are small.
        self.coarse = float(np.exp(rng.uniform(0, np.log(7)))) if rng.random() < 0.6 else 1.0


def _filmed(rng: np.random.Generator, picture: Float32, camera: _Camera) -> ImageArray:
    """What the camera makes of a picture, in light that differs a little from picture to picture."""
    side = picture.shape[0]
    small = max(16, round(side / camera.coarse))
    picture = _blurred(rng, picture)
    if small < side:
        picture = np.asarray(cv2.resize(picture, (small, small), interpolation=cv2.INTER_AREA), dtype=np.float32)
    gain = camera.contrast * np.exp(rng.normal(0, 0.15))
    mix = np.diag(np.exp(rng.normal(0, 0.04, 3))) @ camera.colour * gain
    lift = 128 * (1 - gain) + rng.normal(0, 18)
    levels = np.hstack([mix, np.full((3, 1), lift)]).astype(np.float32)
    picture = np.asarray(cv2.transform(picture, levels), dtype=np.float32)
    if rng.random() < 0.25:
        light = np.exp(rng.normal(0, 0.3, (2, 2))).astype(np.float32)
        picture = picture * cv2.resize(light, (small, small), interpolation=cv2.INTER_LINEAR)[..., None]
    if camera.noise:
        picture = picture + np.float32(camera.noise) * rng.standard_normal(picture.shape, dtype=np.float32)
    image = np.clip(picture, 0, 255).astype(np.uint8)
    if camera.quality:
        image = compressed(image, camera.quality)
    return np.asarray(cv2.resize(image, (side, side), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _blurred(rng: np.random.Generator, picture: Float32) -> Float32:
    """A picture, often out of focus or moved while it was taken."""
    kind = rng.random()
    if kind < 0.25:
        kernel = motion_kernel(rng, int(rng.integers(3, 12)))
        return np.asarray(cv2.filter2D(picture, -1, kernel), dtype=np.float32)
    if kind < 0.5:
        return np.asarray(cv2.GaussianBlur(picture, (0, 0), float(rng.uniform(0.4, 2.5))), dtype=np.float32)
    return picture


def _beyond(rng: np.random.Generator, search: ImageArray, box: FloatArray, present: bool) -> ImageArray:
    """The search picture, now and then with the mean colour where the frame ends; the target's middle stays in it."""
    if rng.random() >= _OUTSIDE:
        return search
    side = search.shape[0]
    edge = int(rng.integers(round(0.1 * side), round(0.5 * side)))
    horizontal, last = rng.random() < 0.5, rng.random() < 0.5
    if present:
        along = float(centres(box)[0 if horizontal else 1])
        edge = min(edge, int((side - along if last else along) - 2))
    if edge < 1:
        return search
    out = search.copy()
    part = (
        out[:, -edge:] if horizontal and last else out[:, :edge] if horizontal else out[-edge:] if last else out[:edge]
    )
    part[:] = search.reshape(-1, 3).mean(axis=0)
    return out
