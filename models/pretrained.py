"""torchvision's COCO-trained detectors as person detectors."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import torch
from torch import Tensor
from torchvision.models.detection import SSD300_VGG16_Weights, SSDLite320_MobileNet_V3_Large_Weights

from tsuiseki.models.detector import OneClass, ssd300, ssdlite320

COCO_CLASSES = 90
COCO_PERSON = 1

_BUILDERS = {"ssdlite320": ssdlite320, "ssd300": ssd300}
_WEIGHTS = {
    "ssdlite320": SSDLite320_MobileNet_V3_Large_Weights.COCO_V1,
    "ssd300": SSD300_VGG16_Weights.COCO_V1,
}


def coco_person_detector(
    architecture: Literal["ssdlite320", "ssd300"], state: dict[str, Tensor] | Path | None = None
) -> OneClass:
    """A COCO detector of which only people are left, each with exactly the probability that torchvision gives.

    Args:
        architecture: which of torchvision's detectors.
        state: its state dict, or the file of it; by default torchvision downloads that.

    Raises:
        ConnectionError: the weights are not on this machine and cannot be downloaded.
        ValueError: the state dict is of another network.
    """
    if state is None:
        state = _download(architecture)
    weights: dict[str, Tensor] = (
        torch.load(state, map_location="cpu", weights_only=True) if isinstance(state, Path) else state
    )
    try:
        return OneClass(_BUILDERS[architecture](COCO_CLASSES, weights), kept=COCO_PERSON)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(
            f"expected the state dict of torchvision's COCO-trained {architecture}; {str(error).splitlines()[0]}"
        ) from error


def _download(architecture: Literal["ssdlite320", "ssd300"]) -> dict[str, Tensor]:
    weights = _WEIGHTS[architecture]
    try:
        state: dict[str, Tensor] = weights.get_state_dict(progress=True, check_hash=True)
    except (OSError, RuntimeError) as error:
        raise ConnectionError(
            f"expected to download {weights.url}, got: {error}; "
            "put the file into $TORCH_HOME/hub/checkpoints, or give it with --state"
        ) from error
    return state
