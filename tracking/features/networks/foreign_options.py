"""What the user says about networks of other projects, where their files do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

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
]
ScoreKind = Literal["probabilities", "sigmoid", "softmax"]
Resize = Literal["letterbox", "stretch", "as-is"]
Colour = Literal["RGB", "BGR"]
PixelRange = Literal["unit", "bytes"]
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class DetectorOptions:
    """What a detector of others cannot tell by itself; None leaves it to the file and its layout.

    Attributes:
        layout: of the outputs, where several fit.
        classes: their names in order; people are found by name.
        person: number of the class of people, as the network's outputs count it.
        scores: what the class values of layouts detr and corners are: ``probabilities``, or logits of a ``sigmoid`` a
            class or of one ``softmax`` with a class for no object.
        height: of the input, pixels, where the file leaves it open.
        width: likewise.
        resize: how pictures are fitted into the input.
        colour: order of the channels.
        pixels: ``unit`` for values in [0, 1], ``bytes`` for values in [0, 255].
        mean: subtracted from the channels after that.
        std: divides them after that.
    """

    layout: LayoutName | None = None
    classes: tuple[str, ...] | None = None
    person: int | None = None
    scores: ScoreKind | None = None
    height: int | None = None
    width: int | None = None
    resize: Resize | None = None
    colour: Colour | None = None
    pixels: PixelRange | None = None
    mean: tuple[float, float, float] | None = None
    std: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class AppearanceOptions:
    """What an appearance network of others wants its crops to be; by default as torchvision's classifiers do.

    Attributes:
        height: of the input, pixels, where the file leaves it open.
        width: likewise.
        colour: order of the channels.
        pixels: ``unit`` for values in [0, 1], ``bytes`` for values in [0, 255].
        mean: subtracted from the channels after that.
        std: divides them after that.
    """

    height: int | None = None
    width: int | None = None
    colour: Colour = "RGB"
    pixels: PixelRange = "unit"
    mean: tuple[float, float, float] = IMAGENET_MEAN
    std: tuple[float, float, float] = IMAGENET_STD
