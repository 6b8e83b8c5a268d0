"""How networks of other projects take their pictures, and what the user says where their files do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, NonNegativeInt, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.fields import Commas
from tsuiseki.tracking.types import ImageArray

LayoutName = Literal[
    "yolov8",
    "yolov8-rows",
    "yolov5",
    "yolov6",
    "yolox",
    "yolox-decoded",
    "yolo-suppressed",
    "rtdetr-joined",
    "detr",
    "corners",
    "torchvision",
    "tensorflow",
    "mmdeploy",
    "tensorrt",
    "yolov7",
    "yolo-nas",
    "yolo-nas-rows",
    "paddle",
    "nanodet",
    "nanodet-g",
    "fastestdet",
    "ssd",
    "blazepose",
    "openvino",
    "obb",
    "obb-suppressed",
]
ScoreKind = Literal["probabilities", "sigmoid", "softmax"]
Resize = Literal["letterbox", "stretch", "as-is"]
Colour = Literal["RGB", "BGR"]
PixelRange = Literal["unit", "bytes"]
# Mean of ImageNet's channels, RGB in [0, 1].
IMAGENET_MEAN = (0.485, 0.456, 0.406)
# Their standard deviation.
IMAGENET_STD = (0.229, 0.224, 0.225)


# Of an input, pixels.
InputSide = Annotated[int, Field(ge=1, le=100_000)]


def _no_name_twice(names: tuple[str, ...]) -> tuple[str, ...]:
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"`detector_options.classes`: expected each name once, got {twice[0]!r} twice")
    return names


@pydantic_dataclass(frozen=True, config=SETTINGS)
class DetectorOptions:
    """What a detector of others cannot tell by itself; None leaves it to the file and its layout.

    Attributes:
        layout: name of the outputs' layout, where several fit.
        classes: names of the classes in order; people are recognised by name.
        person: number of the class of people, as the network's outputs count it.
        scores: what the class values are: ``probabilities``, or logits of a ``sigmoid`` a class or, in layouts detr and
            corners, of one ``softmax`` with a class for no object.
        height: of the input, pixels, where the file leaves it open.
        width: of the input, pixels, where the file leaves it open.
        resize: how pictures are fitted into the input.
        colour: order of the channels.
        pixels: ``unit`` for values in [0, 1], ``bytes`` for values in [0, 255].
        mean: subtracted from the channels after that.
        std: divides them after that.
    """

    layout: LayoutName | None = None
    classes: Commas[Annotated[tuple[str, ...], AfterValidator(_no_name_twice)] | None] = None
    person: NonNegativeInt | None = None
    scores: ScoreKind | None = None
    height: InputSide | None = None
    width: InputSide | None = None
    resize: Resize | None = None
    colour: Colour | None = None
    pixels: PixelRange | None = None
    mean: Commas[tuple[float, float, float] | None] = None
    std: Commas[tuple[PositiveFloat, PositiveFloat, PositiveFloat] | None] = None


@pydantic_dataclass(frozen=True, config=SETTINGS)
class AppearanceOptions:
    """What an appearance network of others wants its crops to be; by default as torchvision's classifiers do.

    Attributes:
        height: of the input, pixels, where the file leaves it open.
        width: of the input, pixels, where the file leaves it open.
        colour: order of the channels.
        pixels: ``unit`` for values in [0, 1], ``bytes`` for values in [0, 255].
        mean: subtracted from the channels after that.
        std: divides them after that.
    """

    height: InputSide | None = None
    width: InputSide | None = None
    colour: Colour = "RGB"
    pixels: PixelRange = "unit"
    mean: Commas[tuple[float, float, float]] = IMAGENET_MEAN
    std: Commas[tuple[PositiveFloat, PositiveFloat, PositiveFloat]] = IMAGENET_STD


@dataclass(frozen=True)
class ImageInput:
    """How a picture becomes the input of a network.

    Attributes:
        resize: ``letterbox`` keeps the aspect ratio and fills the right and lower rest with ``fill``; ``stretch`` does
            not keep it; ``as-is`` leaves the picture at its size, for networks that take any.
        colour: order of the channels.
        pixels: ``unit`` for values in [0, 1], ``bytes`` for values in [0, 255].
        mean: subtracted from the channels after that.
        std: divides them after that.
        fill: grey level of 255 beside the picture.
        raw_nhwc: the network takes bytes, channels last, and normalises them itself; ``mean``, ``std`` and ``pixels``
            say nothing then.
    """

    resize: Resize = "letterbox"
    colour: Colour = "RGB"
    pixels: PixelRange = "unit"
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    fill: int = 114
    raw_nhwc: bool = False

    def __str__(self) -> str:
        """In words, such as ``letterbox, RGB, [0, 1]``."""
        if self.raw_nhwc:
            return f"{self.resize}, {self.colour}, bytes"
        values = "[0, 1]" if self.pixels == "unit" else "[0, 255]"
        plain = (self.mean, self.std) == ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
        usual = (self.mean, self.std) == (IMAGENET_MEAN, IMAGENET_STD)
        by = "" if plain else ", normalised as ImageNet" if usual else f", mean {self.mean}, std {self.std}"
        return f"{self.resize}, {self.colour}, {values}{by}"

    def fit(self, image: ImageArray, size: tuple[int, int]) -> tuple[ImageArray, tuple[float, float]]:
        """``(H, W, 3)`` uint8 RGB at ``size`` (height, width), and the scales from its pixels in x and y."""
        from tsuiseki.tracking.preprocessing import letterbox, stretched

        if self.resize == "as-is":
            return image, (1.0, 1.0)
        # Loads OpenCV, which these settings do without.

        if self.resize == "stretch":
            return stretched(image, *size)
        return letterbox(image, *size, (self.fill,) * 3)

    def normalise(self, images: NDArray[np.uint8], dtype: np.dtype[Any]) -> NDArray[Any]:
        """``(N, H, W, 3)`` uint8 RGB to what the network takes: ``(N, 3, H, W)`` of ``dtype``, or, raw, as it is.

        A network that takes bytes normalises them itself.
        """
        from tsuiseki.tracking.preprocessing import standardised

        if self.colour == "BGR":
            images = images[..., ::-1]
        if self.raw_nhwc:
            return np.ascontiguousarray(images)
        if dtype == np.uint8:
            return np.ascontiguousarray(images.transpose(0, 3, 1, 2))

        largest = 255.0 if self.pixels == "unit" else 1.0
        return standardised(np.ascontiguousarray(images), largest, self.mean, self.std).astype(dtype, copy=False)


IMAGENET = ImageInput("stretch", mean=IMAGENET_MEAN, std=IMAGENET_STD)
# The mean as Caffe's descendants have it: of bytes, blue first.
BYTES_MEAN = (103.53, 116.28, 123.675)
# The standard deviation likewise.
BYTES_STD = (57.375, 57.12, 58.395)
