"""The exported models of a run: those that the user names, or those that ship with the toolkit."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking import weights
from tsuiseki.tracking.errors import RequestError

SHIPPED = {
    "detector": "detector_street.onnx",
    "appearance": "appearance_people.onnx",
    "affinity": "affinity_people.onnx",
}
DRONE = {
    "detector_drone": "detector_drone.onnx",
    "action_rgb_local": "action_drone_rgb_local.onnx",
    "action_rgb_global": "action_drone_rgb_global.onnx",
    "action_flow_local": "action_drone_flow_local.onnx",
    "action_flow_global": "action_drone_flow_global.onnx",
    "affinity_drone": "affinity_drone.onnx",
    "affinity_drone_saf": "affinity_drone_saf.onnx",
    "affinity_drone_maf": "affinity_drone_maf.onnx",
    "affinity_drone_sided": "affinity_drone_sided.onnx",
}

# Where a model is given with an option of another name than its kind.
OPTIONS = {
    "detector_drone": "detector",
    "affinity_drone": "affinity",
    "affinity_drone_saf": "affinity",
    "affinity_drone_maf": "affinity-multi",
    "affinity_drone_sided": "affinity-multi",
    **{kind: "actions" for kind in DRONE if kind.startswith("action_")},
}


def shipped(kind: str) -> Path:
    """Where the shipped model of ``kind`` lies.

    Raises:
        RequestError: this installation has none.
    """
    name = (SHIPPED | DRONE)[kind]
    try:
        return weights.shipped(Path(name).stem)
    except RequestError as error:
        message = f"this installation ships no {name}; give a model with --{OPTIONS.get(kind, kind)}"
        raise RequestError(message) from error


def chosen(kind: str, given: Path | None) -> Path | None:
    """The model to use: ``given``, the shipped one where nothing is given, none where ``none`` is."""
    if given is None:
        return shipped(kind)
    return None if str(given) == "none" else given
