"""The exported models of a run: those that the user names, or those that ship with the toolkit."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from tsuiseki.tracking.errors import RequestError

SHIPPED = {
    "detector": "detector_street.onnx",
    "appearance": "appearance_people.onnx",
    "affinity": "affinity_people.onnx",
}


def shipped(kind: str) -> Path:
    """Where the shipped model of ``kind`` lies.

    Raises:
        RequestError: this installation has none.
    """
    path = Path(str(resources.files("tsuiseki.tracking") / "weights" / SHIPPED[kind]))
    if not path.is_file():
        raise RequestError(f"this installation ships no {SHIPPED[kind]}; give a model with --{kind}")
    return path


def chosen(kind: str, given: Path | None) -> Path | None:
    """The model to use: ``given``, the shipped one where nothing is given, none where ``none`` is."""
    if given is None:
        return shipped(kind)
    return None if str(given) == "none" else given
