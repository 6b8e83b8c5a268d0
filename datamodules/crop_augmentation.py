"""What a camera, a detector and a crowd do to the crop of a person, drawn at random.

A batch is seen through one camera: its colours, contrast, sharpness and resolution are drawn once for all, so that
people are told apart by what differs between them and not by the light. What changes from frame to frame (box,
direction, small changes of light, things in front) is drawn for every crop.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.identity_crops import put_before, put_on_ground
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray

Float32Array = NDArray[np.float32]


@dataclass(frozen=True)
class CropAugmentation:
    """How strongly crops are changed; zeros change nothing.

    Attributes:
        flip: chance of a mirror image.
        shift: standard deviation of the box's centre, in box sizes.
        stretch: standard deviation of the logarithm of the box's width and height.
        camera_colour: strength of what the whole batch shares: tint, saturation, gamma and contrast.
        view_colour: strength of the same from crop to crop.
        lowest_height: crops are brought down to between this and the full input height, in pixels.
        blur: chance that a crop is blurred.
        noise: largest standard deviation of the sensor noise, grey levels.
        jpeg: chance that a crop is compressed.
        occlude: chance that a piece of another crop or a plain patch covers a part.
    """

    flip: float = 0.5
    shift: float = 0.05
    stretch: float = 0.07
    camera_colour: float = 1.0
    view_colour: float = 0.25
    lowest_height: int = 28
    blur: float = 0.4
    noise: float = 6.0
    jpeg: float = 0.5
    occlude: float = 0.4


@dataclass(frozen=True)
class CropCamera:
    """What all crops of a batch share.

    Attributes:
        colour: ``(3, 3)`` mixes the channels.
        gamma: exponent of the levels.
        contrast: slope around ``pivot``; above 1 the darks drown and the lights burn out.
        pivot: level in [0, 1] that the contrast keeps.
        height: typical height of a person, pixels.
        sharpness: amount of the sharpening that consumer cameras do.
    """

    colour: Float32Array
    gamma: float
    contrast: float
    pivot: float
    height: float
    sharpness: float


def draw_camera(rng: np.random.Generator, settings: CropAugmentation, full_height: int) -> CropCamera:
    """One camera for a batch of crops."""
    lowest = min(settings.lowest_height, full_height)
    return CropCamera(
        _draw_colour(rng, settings.camera_colour),
        float(np.exp(rng.normal(0, 0.2 * settings.camera_colour))),
        float(np.exp(rng.normal(0.0, 0.15) * settings.camera_colour)),
        float(rng.uniform(0.3, 0.6)),
        float(np.exp(rng.uniform(np.log(lowest), np.log(full_height)))),
        float(rng.uniform(0, 1)) * min(settings.camera_colour, 1),
    )


def augment_crop(
    rng: np.random.Generator,
    settings: CropAugmentation,
    camera: CropCamera,
    image: ImageArray,
    box: FloatArray,
    cover: ImageArray,
    size: tuple[int, int],
) -> ImageArray:
    """``(H, W, 3)`` training crop of ``size`` H, W.

    Args:
        rng: the source of all chance.
        settings: how strongly to change.
        camera: of the batch.
        image: ``(h, w, 3)`` view with a margin, or an RGBA cut-out ``(h, w, 4)``, which gets a random ground.
        box: ``(4,)`` the person's box in it.
        cover: another view, to cover parts with or to stand behind.
        size: of the network's input.
    """
    if image.shape[2] == 4:
        behind = cover if cover.shape[2] == 4 and rng.random() < settings.occlude else None
        image, box = put_on_ground(rng, image, behind)
    box = _jitter(rng, settings, box)
    height = int(np.clip(camera.height * np.exp(rng.normal(0, 0.15)), min(settings.lowest_height, size[0]), size[0]))
    width = max(4, round(height * size[1] / size[0]))
    small = crop_boxes(image, box[None], height, width)[0]
    if rng.random() < settings.flip:
        small = np.ascontiguousarray(small[:, ::-1])
    if rng.random() < settings.occlude:
        small = _occlude(rng, small, cover)
    levels = _recolour(rng, settings.view_colour, camera, small)
    if rng.random() < settings.blur:
        levels = _blurred(levels, float(rng.uniform(0.3, 0.015 * height + 0.3)))
    if camera.sharpness > 0:
        levels = levels + camera.sharpness * (levels - _blurred(levels, 1.0))
    noise = rng.standard_normal(levels.shape, dtype=np.float32) * np.float32(rng.uniform(0, settings.noise))
    small = np.clip(levels * 255 + noise, 0, 255).astype(np.uint8)
    if rng.random() < settings.jpeg:
        small = _compress(small, int(rng.integers(30, 90)))
    return np.asarray(cv2.resize(small, (size[1], size[0]), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _jitter(rng: np.random.Generator, settings: CropAugmentation, box: FloatArray) -> FloatArray:
    size = box[2:] - box[:2]
    middle = (box[:2] + box[2:]) / 2 + rng.normal(0, settings.shift, 2) * size
    half = size / 2 * np.exp(rng.normal(0, settings.stretch, 2))
    return np.concatenate([middle - half, middle + half])


def _draw_colour(rng: np.random.Generator, strength: float) -> Float32Array:
    """``(3, 3)`` of a tint and a saturation; the identity at strength 0."""
    tint = np.diag(np.exp(rng.normal(0, 0.12 * strength, 3) + rng.normal(0, 0.1 * strength)))
    grey = np.full((3, 3), 1 / 3)
    saturation = np.exp(rng.normal(0, 0.3 * strength))
    return np.asarray(tint @ (grey + saturation * (np.eye(3) - grey)), dtype=np.float32)


def _recolour(rng: np.random.Generator, strength: float, camera: CropCamera, image: ImageArray) -> Float32Array:
    """Levels around [0, 1]."""
    levels = image.astype(np.float32) / 255 @ (_draw_colour(rng, strength) @ camera.colour).T
    levels = np.clip(levels, 0, 1) ** (camera.gamma * np.exp(rng.normal(0, 0.25 * strength)))
    levels = (levels - camera.pivot) * camera.contrast + camera.pivot + rng.normal(0, 0.06 * strength)
    return np.asarray(np.clip(levels, 0, 1), dtype=np.float32)


def _occlude(rng: np.random.Generator, image: ImageArray, cover: ImageArray) -> ImageArray:
    """``image`` with a part of it behind a cut-out person, behind a piece of ``cover`` or behind one colour."""
    if cover.shape[2] == 4 and rng.random() < 0.6:
        return put_before(rng, image, cover)
    image = image.copy()
    height, width = image.shape[:2]
    h, w = max(1, int(height * rng.uniform(0.1, 0.6))), max(1, int(width * rng.uniform(0.15, 0.7)))
    # Half of the time from a side, as another walker comes in; else anywhere, as a sign or a bag.
    x = int(rng.choice([0, width - w])) if rng.random() < 0.5 else int(rng.integers(0, width - w + 1))
    y = int(rng.integers(0, height - h + 1))
    if rng.random() < 0.5:
        y0, x0 = rng.uniform(0, 0.5, 2) * cover.shape[:2]
        piece = cover[int(y0) : int(y0) + cover.shape[0] // 2 + 1, int(x0) : int(x0) + cover.shape[1] // 2 + 1]
        image[y : y + h, x : x + w] = cv2.resize(piece[..., :3], (w, h), interpolation=cv2.INTER_AREA)
    else:
        image[y : y + h, x : x + w] = rng.integers(0, 256, 3)
    return image


def _blurred(levels: Float32Array, sigma: float) -> Float32Array:
    return np.asarray(cv2.GaussianBlur(levels, (0, 0), sigma), dtype=np.float32)


def _compress(image: ImageArray, quality: int) -> ImageArray:
    _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), dtype=np.uint8)
