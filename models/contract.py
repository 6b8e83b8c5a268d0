"""What a network of one's own must have to be trained, exported and followed as those of this folder are.

Boxes are x1, y1, x2, y2 in pixels of the input. Pictures are RGB, normalised as the network's card says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from torch import Tensor


@dataclass(frozen=True)
class NetworkCard:
    """What a network takes; its exported file says the same.

    Attributes:
        name: for people to read.
        input_height: of the pictures that it takes, pixels.
        input_width: likewise.
        class_names: of what a detector detects, without the background, as the labels call them.
        resize: how an image becomes the input of a detector: ``letterbox`` keeps the aspect ratio and pads right and
            below with the mean, ``stretch`` does not.
        mean: subtracted from the channels after scaling them to [0, 1]; by default that of ImageNet.
        std: divides the channels after that.
        settings: plain values that only this kind of network has.

    Raises:
        ValueError: a side below 1, no class names, or a deviation of 0.
    """

    name: str
    input_height: int
    input_width: int
    class_names: tuple[str, ...] = ("person",)
    resize: Literal["letterbox", "stretch"] = "letterbox"
    mean: tuple[float, ...] = (0.485, 0.456, 0.406)
    std: tuple[float, ...] = (0.229, 0.224, 0.225)
    settings: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if min(self.input_height, self.input_width) < 1:
            raise ValueError(f"expected sides of 1 pixel or more, got {self.input_height}x{self.input_width}")
        if isinstance(self.class_names, str) or not self.class_names:
            raise ValueError(f"`class_names`: expected a tuple of names, got {self.class_names!r}")
        if self.resize not in ("letterbox", "stretch"):
            raise ValueError(f"`resize`: expected letterbox or stretch, got {self.resize!r}")
        if (len(self.mean), len(self.std)) != (3, 3) or 0 in self.std:
            raise ValueError(f"expected a mean and a deviation above 0 of 3 channels, got {self.mean} and {self.std}")


class DetectorNetwork(Protocol):
    """A module that `Detector(network=…)` takes. B images, N boxes of each, C classes; N is always the same."""

    @property
    def card(self) -> NetworkCard:
        """What it takes, and the names of its C classes."""

    def forward(self, images: Tensor) -> Any:
        """Outputs of any form, the same in training and evaluation.

        Args:
            images: ``(B, 3, H, W)`` float32, normalised; for any B.
        """

    def decode(self, outputs: Any) -> tuple[Tensor, Tensor]:
        """Boxes and scores, which are not suppressed yet; in operations that ONNX has, for a B that is open.

        Args:
            outputs: of `forward`.

        Returns:
            boxes ``(B, N, 4)`` in pixels of the input, and scores ``(B, N, C)`` in [0, 1].
        """

    def loss(self, outputs: Any, boxes: Tensor, labels: Tensor) -> Mapping[str, Tensor]:
        """Terms by name, scalars, whose sum is minimised; of images without a box, too.

        Args:
            outputs: of `forward`.
            boxes: ``(B, M, 4)`` float32 labelled boxes in pixels of the input, padded to M.
            labels: ``(B, M)`` int64 class of each from 1 on; -1 where a box is neither right nor wrong, 0 for padding.
        """


class ActionClassifier(Protocol):
    """A module that `Action(network=…)` takes for a stream. B crops of people, A actions."""

    @property
    def card(self) -> NetworkCard:
        """What it takes, a square; its class names are those of the A actions."""

    def forward(self, images: Tensor) -> Tensor:
        """``(B, A)`` logits; a person may do several things at once.

        Args:
            images: ``(B, C, S, S)`` float32, normalised, for any B: 3 colours, or 2 of optical flow.
        """


class LinkCosts(Protocol):
    """A module that `Association(network=…)` takes: by how much each of P links costs more or less."""

    def forward(self, features: Tensor) -> Tensor:
        """``(P,)`` changes of costs, which are then bounded smoothly; 0 leaves the tracker's own cost.

        Args:
            features: ``(P, 25)`` float32, standardised; for any P. `tsuiseki.tracking.association.evidence` names them.
        """


class AppearanceTrunk(Protocol):
    """A module that `Appearance(network=…)` takes. B crops of people, features of length D."""

    @property
    def card(self) -> NetworkCard:
        """What it takes; crops are stretched to it."""

    def forward(self, images: Tensor) -> Tensor:
        """``(B, D)`` features of unit length; close for crops of one person.

        Args:
            images: ``(B, 3, H, W)`` float32, normalised; for any B.
        """
