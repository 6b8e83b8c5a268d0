"""The models that ship with the toolkit: small ONNX files and tables, learnt from generated and free pictures."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.errors import RequestError, hint_at
from tsuiseki.tracking.weights.catalogue import find_model

FOLDER = Path(__file__).resolve().parent
# The detector of people that is taken where none is given.
PEOPLE_DETECTOR = "detector_people"
# The one that `adapt` teaches where none is given: it learns more of one place (docs/methods/adapt.md).
LEARNING_DETECTOR = "detector_figures"
# The detector of people under a drone that is taken where none is given.
DRONE_DETECTOR = "detector_drone_larger"


def shipped(name: str) -> Path:
    """The file of a shipped model.

    Args:
        name: of the file, without its ending: ``detector_street``, ``appearance_people``, …; see `shipped_names`.

    Raises:
        RequestError: this installation ships no such model.

    >>> shipped("detector_street").name
    'detector_street.onnx'
    """
    for suffix in (".onnx", ".json"):
        path = FOLDER / f"{name}{suffix}"
        if path.is_file():
            return path
    raise RequestError(f"this installation ships no model {name!r}; {hint_at(name, shipped_names())}")


def shipped_or_file(kind: str, model: str | Path) -> Path:
    """A file as it is given; a bare word stands for the shipped or downloaded model of that name.

    Args:
        kind: what the shipped models' names begin with: ``detector``, …
        model: a path, the rest of such a name, or that of a model of the catalogue.

    Raises:
        RequestError: a bare word that names neither a file nor a model of this kind, or one that is not downloaded.

    >>> shipped_or_file("detector", "street").name, shipped_or_file("detector", "own/best.onnx").name
    ('detector_street.onnx', 'best.onnx')
    """
    path = Path(model)
    if path.suffix or len(path.parts) != 1 or path.is_file():
        return path
    names = [name.removeprefix(f"{kind}_") for name in shipped_names() if name.startswith(f"{kind}_")]
    if path.name not in names and (entry := find_model(path.name, kind)):
        return entry.checked()
    if path.name not in names:
        raise RequestError(
            f"{kind}: expected an ONNX file or one of the shipped {', '.join(names)}, got {model}; `tsuiseki models "
            "list` shows what can be downloaded"
        )
    return shipped(f"{kind}_{path.name}")


def shipped_names() -> list[str]:
    """Of the files beside this one, without their endings, sorted."""
    return sorted(path.stem for path in FOLDER.iterdir() if path.suffix in (".onnx", ".json"))
