"""Random changes of a labelled image: geometry, colour, blur, noise, compression, holes. No torch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.geometry import areas, clip_boxes
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray


@dataclass(frozen=True)
class Example:
    """An image to learn from.

    Attributes:
        image: ``(H, W, 3)`` uint8 RGB.
        boxes: ``(N, 4)`` pixels.
        ignored: ``(N,)`` neither an example nor a counter-example.
        classes: ``(N,)`` from 1; None where all boxes are of one class.
    """

    image: ImageArray
    boxes: FloatArray
    ignored: BoolArray
    classes: IntArray | None = None


@dataclass(frozen=True)
class Augmentation:
    """How strongly examples are changed; chances are in [0, 1].

    Attributes:
        scale: smallest and largest enlargement relative to the image fitted into the input.
        aspect: largest relative change of the width, the height changing the other way.
        rotation: largest angle, degrees.
        shear: largest horizontal shear, a tangent.
        flip: chance of mirroring left and right.
        colour: strength of the changes of brightness, contrast, gamma, hue, saturation and cast; 1 is strong.
        grey: chance of dropping colour.
        blur: chance of a Gaussian or motion blur.
        noise: chance of sensor noise.
        compression: chance of JPEG artefacts.
        holes: largest number of rectangles painted over.
        smallest: boxes lower than this many input pixels are ignored.
    """

    scale: tuple[float, float] = (0.6, 1.8)
    aspect: float = 0.12
    rotation: float = 4.0
    shear: float = 0.06
    flip: float = 0.5
    colour: float = 1.0
    grey: float = 0.08
    blur: float = 0.25
    noise: float = 0.35
    compression: float = 0.35
    holes: int = 5
    smallest: float = 12.0


def augment(
    rng: np.random.Generator,
    example: Example,
    size: tuple[int, int],
    settings: Augmentation,
    fill: ImageArray,
) -> Example:
    """``example`` changed at random, in an image of ``size`` (height, width).

    Args:
        rng: draws every change.
        example: what to change.
        size: of the result.
        settings: how strongly.
        fill: ``(H, W, 3)`` uint8 of ``size``, seen where the example does not reach.
    """
    example = _warp(rng, example, size, settings, fill)
    example = _paint_holes(rng, example, settings.holes)
    image = recolour(rng, example.image, settings.colour * rng.uniform(0.1, 1.0), settings.grey)
    if rng.random() < settings.blur:
        image = _blur(rng, image)
    if rng.random() < settings.noise:
        image = _add_noise(rng, image)
    if rng.random() < settings.compression:
        image = compressed(image, int(rng.integers(25, 90)))
    too_small = example.boxes[:, 3] - example.boxes[:, 1] < settings.smallest
    return replace(example, image=image, ignored=example.ignored | too_small)


def random_affine(
    rng: np.random.Generator,
    source: tuple[int, int],
    size: tuple[int, int],
    settings: Augmentation,
) -> FloatArray:
    """``(2, 3)`` map from pixels of an image of ``source`` (height, width) into an input of ``size``."""
    scale = min(size[0] / source[0], size[1] / source[1]) * np.exp(rng.uniform(*np.log(settings.scale)))
    aspect = np.exp(rng.uniform(-settings.aspect, settings.aspect) / 2)
    mirror = -1.0 if rng.random() < settings.flip else 1.0
    angle = np.deg2rad(rng.uniform(-settings.rotation, settings.rotation))
    shear = rng.uniform(-settings.shear, settings.shear)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = turn @ np.array([[1.0, shear], [0.0, 1.0]]) @ np.diag([mirror * scale * aspect, scale / aspect])
    # The middle goes where the enlarged image still covers the input, or, if it is smaller, lies inside it.
    half, half_source = np.array([size[1], size[0]]) / 2, np.array([source[1], source[0]]) / 2
    slack = np.abs(half - scale * half_source)
    shift = rng.uniform(-slack, slack)
    return np.column_stack([linear, half + shift - linear @ half_source])


def transform_boxes(boxes: FloatArray, affine: FloatArray) -> FloatArray:
    """Boxes ``(N, 4)`` about the ellipses that ``affine`` ``(2, 3)`` makes of those inscribed in ``boxes``.

    The corners' bounding box would swell a tall box with every degree of rotation; people do not fill the corners.
    """
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 @ affine[:, :2].T + affine[:, 2]
    half = np.sqrt(((boxes[:, 2:] - boxes[:, :2]) / 2) ** 2 @ (affine[:, :2] ** 2).T)
    return np.concatenate([middle - half, middle + half], axis=1)


def recolour(rng: np.random.Generator, image: ImageArray, strength: float, grey: float) -> ImageArray:
    """``image`` under another light and camera: saturation, hue, cast, contrast, brightness and gamma."""
    luminance = np.tile([0.299, 0.587, 0.114], (3, 1))
    saturation = 0.0 if rng.random() < grey else np.exp(rng.normal(0, 0.35 * strength))
    mixing = saturation * np.eye(3) + (1 - saturation) * luminance
    mixing = mixing @ _hue_rotation(rng.normal(0, 0.25 * strength))
    gain = np.exp(rng.normal(0, 0.22 * strength)) * np.exp(rng.normal(0, 0.08 * strength, 3))
    offset = rng.normal(0, 14 * strength)
    matrix = np.column_stack([gain[:, None] * mixing, np.full(3, offset)])
    changed = np.asarray(cv2.transform(image, matrix), dtype=np.uint8)
    gamma = np.exp(rng.normal(0, 0.2 * strength))
    table = np.clip(255 * (np.arange(256) / 255) ** gamma, 0, 255).astype(np.uint8)
    return np.asarray(cv2.LUT(changed, table), dtype=np.uint8)


def texture(rng: np.random.Generator, size: tuple[int, int]) -> ImageArray:
    """``size + (3,)`` uint8 of smooth colour noise at several scales, with edges: a background of nothing."""
    total: NDArray[np.float32] = np.zeros((*size, 3), dtype=np.float32)
    for cells in rng.choice([2, 3, 5, 9, 17, 40, 90], size=3, replace=False):
        coarse = rng.normal(size=(cells, cells, 3)).astype(np.float32)
        order = cv2.INTER_NEAREST if rng.random() < 0.25 else cv2.INTER_CUBIC
        total += cv2.resize(coarse, size[::-1], interpolation=order) * np.float32(rng.uniform(8, 40))
    common = total.mean(axis=2, keepdims=True)
    chroma = np.float32(rng.uniform(0, 0.8))
    level = rng.uniform(40, 210, 3) * 0.4 + rng.uniform(40, 210) * 0.6
    return np.asarray(np.clip(level + common + chroma * (total - common), 0, 255), dtype=np.uint8)


def _warp(
    rng: np.random.Generator,
    example: Example,
    size: tuple[int, int],
    settings: Augmentation,
    fill: ImageArray,
) -> Example:
    affine = random_affine(rng, (example.image.shape[0], example.image.shape[1]), size, settings)
    source = example.image
    shrink = np.sqrt(abs(np.linalg.det(affine[:, :2])))
    if shrink < 0.7:
        source = np.asarray(cv2.GaussianBlur(source, (0, 0), 0.35 / shrink), dtype=np.uint8)
    image = fill.copy()
    cv2.warpAffine(
        source, _of_pixel_centres(affine), size[::-1], image, cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
    )
    boxes = transform_boxes(example.boxes, affine)
    inside = clip_boxes(boxes, size[1], size[0])
    share = areas(inside) / areas(boxes)
    visible = share > 0.02
    classes = None if example.classes is None else example.classes[visible]
    return Example(image, inside[visible], (example.ignored | (share < 0.3))[visible], classes)


def _of_pixel_centres(affine: FloatArray) -> FloatArray:
    """OpenCV counts from the centre of the first pixel, boxes from its corner."""
    shifted = affine.copy()
    shifted[:, 2] += affine[:, :2].sum(axis=1) / 2 - 0.5
    return shifted


def _paint_holes(rng: np.random.Generator, example: Example, max_holes: int) -> Example:
    """Rectangles and bars painted over; a box covered by most of one becomes ignored."""
    image = example.image.copy()
    ignored = example.ignored.copy()
    height, width = image.shape[:2]
    for _ in range(rng.integers(0, max_holes + 1)):
        if len(example.boxes) and rng.random() < 0.6:
            box = example.boxes[rng.integers(len(example.boxes))]
            sides = box[2:] - box[:2]
            middle = box[:2] + sides * rng.uniform(0, 1, 2)
            extent = sides * (rng.uniform(0.1, 0.8, 2) if rng.random() < 0.6 else [rng.uniform(0.1, 0.3), 4.0])
        else:
            middle = rng.uniform(0, [width, height])
            extent = rng.uniform(0.01, 0.15, 2) * [width, height]
        hole = np.concatenate([middle - extent / 2, middle + extent / 2])
        x1, y1, x2, y2 = clip_boxes(hole, width, height).astype(int)
        image[y1:y2, x1:x2] = (
            rng.integers(0, 256, 3) if rng.random() < 0.7 else rng.integers(0, 256, (y2 - y1, x2 - x1, 3))
        )
        shared = np.clip(
            np.minimum(example.boxes[:, 2:], hole[2:]) - np.maximum(example.boxes[:, :2], hole[:2]), 0, None
        ).prod(axis=1)
        ignored |= shared > 0.6 * areas(example.boxes)
    return replace(example, image=image, ignored=ignored)


def _hue_rotation(angle: float) -> FloatArray:
    """``(3, 3)`` rotation of colours about the grey axis (Rodrigues)."""
    cosine, sine = np.cos(angle), np.sin(angle) / np.sqrt(3)
    cross = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    return np.asarray(cosine * np.eye(3) + (1 - cosine) / 3 + sine * cross)


def _blur(rng: np.random.Generator, image: ImageArray) -> ImageArray:
    if rng.random() < 0.6:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6)), dtype=np.uint8)
    length = int(rng.integers(3, 8))
    return np.asarray(cv2.filter2D(image, -1, motion_kernel(rng, length)), dtype=np.uint8)


def motion_kernel(rng: np.random.Generator, length: int) -> NDArray[np.float32]:
    """``(length, length)`` weights, 1 in all, of a straight motion in a random direction."""
    kernel = np.zeros((length, length), dtype=np.float32)
    direction = np.array([np.cos(angle := rng.uniform(0, np.pi)), np.sin(angle)]) * (length - 1) / 2
    ends = np.round((length - 1) / 2 + np.stack([-direction, direction])).astype(int)
    cv2.line(kernel, ends[0].tolist(), ends[1].tolist(), 1.0)
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def _add_noise(rng: np.random.Generator, image: ImageArray) -> ImageArray:
    channels = 1 if rng.random() < 0.5 else 3
    noise = rng.standard_normal((*image.shape[:2], channels), dtype=np.float32) * np.float32(rng.uniform(1, 10))
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def compressed(image: ImageArray, quality: int) -> ImageArray:
    """``image`` after a JPEG of this ``quality``."""
    _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), dtype=np.uint8)
