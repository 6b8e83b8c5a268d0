"""MARS: crops of people followed through several cameras, ``bbox_train/0001/0001C1T0001F001.jpg``.

A name says the person (four digits), the camera, the tracklet and the frame within it. ``0000`` are distractors:
crops of nobody in particular, wrong answers to every query. ``00-1`` is junk: crops that are neither right nor wrong.

How it is evaluated: each query tracklet against the gallery of the other cameras' tracklets and the distractors; junk
is removed, and so are tracklets of the query's person from the query's own camera.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError

_NAME = re.compile(r"(\d{4}|00-1)C(\d)T(\d{4})F(\d{3,4})\.jpg")
DISTRACTORS, JUNK = 0, -1


@dataclass(frozen=True)
class MarsCrop:
    """One crop.

    Attributes:
        path: of the image.
        person: `DISTRACTORS`, `JUNK` or a number from 1.
        camera: from 1.
        tracklet: of this person, from 1.
        frame: within the tracklet, from 1.
    """

    path: Path
    person: int
    camera: int
    tracklet: int
    frame: int


def is_mars(folder: Path) -> bool:
    """Whether ``folder`` has the layout, or is ``bbox_train`` or ``bbox_test`` of it."""
    if (folder / "bbox_train").is_dir():
        return True
    return folder.is_dir() and any(_NAME.fullmatch(p.name) for p in folder.glob("*/*C*T*F*.jpg"))


def read_mars(folder: str | Path, keep_junk: bool = False) -> list[MarsCrop]:
    """The crops of ``bbox_train`` or ``bbox_test``, or of the ``bbox_train`` in ``folder``, by name.

    Args:
        folder: of the data set or of one part of it.
        keep_junk: junk crops too.

    Raises:
        RequestError: there is no crop, or a name does not say what it shows.
    """
    folder = Path(folder)
    part = folder / "bbox_train" if (folder / "bbox_train").is_dir() else folder
    crops = []
    for path in sorted(part.glob("*/*.jpg")):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise RequestError(
                f"{path}: expected a name of MARS such as 0001C1T0001F001.jpg; rename or remove the file"
            )
        person = JUNK if match[1] == "00-1" else int(match[1])
        if path.parent.name != match[1]:
            raise RequestError(f"{path}: expected crops of person {path.parent.name} here, got one of {match[1]}")
        if person != JUNK or keep_junk:
            crops.append(MarsCrop(path, person, int(match[2]), int(match[3]), int(match[4])))
    if not crops:
        raise RequestError(f"expected crops of MARS in {part}, such as 0001/0001C1T0001F001.jpg, found none")
    return crops
