"""torchvision's COCO-trained detectors as person detectors."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import torch
from torch import Tensor
from torchvision.models.detection import SSD300_VGG16_Weights, SSDLite320_MobileNet_V3_Large_Weights

from tsuiseki.models.detector import Detector, OneClass
from tsuiseki.models.ssd import ssd300, ssdlite320

CocoArchitecture = Literal["ssdlite320", "ssd300"]
COCO_CLASSES = 90
COCO_PERSON = 1

_BUILDERS = {"ssdlite320": ssdlite320, "ssd300": ssd300}
_WEIGHTS = {
    "ssdlite320": SSDLite320_MobileNet_V3_Large_Weights.COCO_V1,
    "ssd300": SSD300_VGG16_Weights.COCO_V1,
}


def coco_person_detector(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None = None) -> OneClass:
    """A COCO detector of which only people are left, each with exactly the probability that torchvision gives.

    Args:
        architecture: which of torchvision's detectors.
        state: its state dict, or the file of it; by default torchvision downloads that.

    Raises:
        ConnectionError: the weights are not on this machine and cannot be downloaded.
        ValueError: the state dict is of another network.
    """
    return OneClass(_coco_detector(architecture, state), kept=COCO_PERSON)


def coco_start(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None = None) -> Detector:
    """A person detector to train on: everything of the COCO detector, of its class heads background and person.

    The arguments and errors are those of `coco_person_detector`.
    """
    many = _coco_detector(architecture, state)
    one = _BUILDERS[architecture](1)
    own = one.state_dict()
    for name, values in many.state_dict().items():
        if values.shape == own[name].shape:
            own[name] = values
        else:
            rows = values.unflatten(0, (-1, COCO_CLASSES + 1))[:, [0, COCO_PERSON]]
            own[name] = rows.flatten(0, 1)
    one.load_state_dict(own)
    return one


def _coco_detector(architecture: CocoArchitecture, state: dict[str, Tensor] | Path | None) -> Detector:
    if state is None:
        state = _download(architecture)
    weights: dict[str, Tensor] = (
        torch.load(state, map_location="cpu", weights_only=True) if isinstance(state, Path) else state
    )
    try:
        return _BUILDERS[architecture](COCO_CLASSES, weights)
    except (RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(
            f"expected the state dict of torchvision's COCO-trained {architecture}; {str(error).splitlines()[0]}"
        ) from error


def _download(architecture: CocoArchitecture) -> dict[str, Tensor]:
    weights = _WEIGHTS[architecture]
    try:
        state: dict[str, Tensor] = weights.get_state_dict(progress=True, check_hash=True)
    except (OSError, RuntimeError) as error:
        raise ConnectionError(
            f"expected to download {weights.url}, got: {error}; "
            "put the file into $TORCH_HOME/hub/checkpoints, or give it with --state"
        ) from error
    return state
