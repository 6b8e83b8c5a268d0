"""Crops of people: MARS's ``bbox_train/0001/0001C1T0001F001.jpg``, Market-1501's ``query/0002_c1s1_000451_03.jpg``.

MARS's names say the person (four digits), the camera, the tracklet and the frame within it. ``0000`` are distractors:
crops of various others, wrong answers to every query. ``00-1`` is junk: crops that are neither right nor wrong.
Each query tracklet is evaluated against the gallery of the other cameras' tracklets and the distractors; junk
is removed, and so are tracklets of the query's person from the query's own camera.

Market-1501's names say the person, the camera and the sequence, the frame, and the box; 0 and -1 are as in MARS.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.errors import RequestError

_NAME = re.compile(r"(\d{4}|00-1)C(\d)T(\d{4})F(\d{3,4})\.jpg")
# Number that stands for various others, wrong answers to every query.
DISTRACTORS = 0
# Number that stands for crops that are neither right nor wrong.
JUNK = -1


@dataclass(frozen=True)
class PersonCrop:
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


def read_mars(folder: str | Path) -> list[PersonCrop]:
    """The crops of ``bbox_train`` or ``bbox_test``, or of the ``bbox_train`` in ``folder``, by name, without junk.

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
        if person != JUNK:
            crops.append(PersonCrop(path, person, int(match[2]), int(match[3]), int(match[4])))
    if not crops:
        raise RequestError(f"expected crops of MARS in {part}, such as 0001/0001C1T0001F001.jpg, found none")
    return crops


TRAIN = "bounding_box_train"
QUERY = "query"
GALLERY = "bounding_box_test"
_MARKET = re.compile(r"(-1|\d+)_c(\d+)s?(\d*)_(\d+)_.*\.(?:jpg|png)", re.IGNORECASE)


def is_market(folder: Path) -> bool:
    """Whether ``folder`` has the layout."""
    return (folder / TRAIN).is_dir() or (folder / QUERY).is_dir()


def read_market(folder: Path, part: str) -> list[PersonCrop]:
    """The crops of a part, by name; a sequence of a camera is their tracklet.

    Raises:
        RequestError: there is no crop.
    """
    matches = [(path, _MARKET.fullmatch(path.name)) for path in sorted((folder / part).glob("*.*"))]
    crops = [PersonCrop(p, int(m[1]), int(m[2]), int(m[3] or 1), int(m[4])) for p, m in matches if m is not None]
    if not crops:
        raise RequestError(
            f"expected crops of Market-1501 in {folder / part}, such as 0002_c1s1_000451_03.jpg, found none"
        )
    return crops
