"""Which class of a detector of others is people: by the user's number, by name, or where COCO has them."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.layout_recognition import COCO

PERSON_NAMES = ("person", "pedestrian", "people", "human", "persons", "pedestrians")


def class_names(metadata: Mapping[str, str]) -> tuple[str, ...] | None:
    """Names of the classes as Ultralytics writes them: the text of a dict from numbers to names."""
    try:
        names = ast.literal_eval(metadata["names"])
    except (KeyError, ValueError, SyntaxError):
        return None
    if isinstance(names, dict) and sorted(names) == list(range(len(names))):
        names = [names[n] for n in range(len(names))]
    return tuple(str(x) for x in names) if isinstance(names, list | tuple) and names else None


def class_of_people(path: Path, names: Sequence[str] | None, count: int | None, asked: int | None) -> int:
    """Number of the class of people among those of objects, from 0.

    Args:
        path: of the file, for messages.
        names: of the classes, where they are known.
        count: of the classes, where it is known.
        asked: what the user says.

    Raises:
        RequestError: there is no such class, or it is not known which.
    """
    if asked is not None:
        if asked < 0 or (count is not None and asked >= count):
            among = "from 0" if count is None else f"from 0 to {count - 1}"
            raise RequestError(f"{path}: expected a class of people {among}, got {asked}")
        return asked
    if names:
        return _named(path, names)
    if count == 1:
        return 0
    if count in COCO:
        return COCO[count]
    which = "an unknown number of" if count is None else str(count)
    raise RequestError(
        f"{path}: {which} classes without names; say which one is people with `detector_options.person` "
        "(COCO: 0 in YOLO, 1 in torchvision and TensorFlow)"
    )


def _named(path: Path, names: Sequence[str]) -> int:
    found = [n for n, name in enumerate(names) if name.strip().lower() in PERSON_NAMES]
    if len(found) == 1:
        return found[0]
    listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    what = "several classes of people" if found else "no class of people"
    raise RequestError(f"{path}: {what} among {listed}; say which one with `detector_options.person`")
