"""Market-1501: crops of people before six cameras, ``bounding_box_train/0002_c1s1_000451_03.jpg``.

A name says the person, the camera and the sequence, the frame, and the box. Person 0 are distractors and -1 junk, as in
`tracking.formats.mars`.
"""

from __future__ import annotations

import re
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mars import MarsCrop

TRAIN, QUERY, GALLERY = "bounding_box_train", "query", "bounding_box_test"
_NAME = re.compile(r"(-1|\d+)_c(\d+)s?(\d*)_(\d+)_.*\.(?:jpg|png)", re.IGNORECASE)


def is_market(folder: Path) -> bool:
    """Whether ``folder`` has the layout."""
    return (folder / TRAIN).is_dir() or (folder / QUERY).is_dir()


def read_market(folder: Path, part: str) -> list[MarsCrop]:
    """The crops of a part, by name; a sequence of a camera is their tracklet.

    Raises:
        RequestError: there is no crop.
    """
    matches = [(path, _NAME.fullmatch(path.name)) for path in sorted((folder / part).glob("*.*"))]
    crops = [MarsCrop(p, int(m[1]), int(m[2]), int(m[3] or 1), int(m[4])) for p, m in matches if m is not None]
    if not crops:
        raise RequestError(
            f"expected crops of Market-1501 in {folder / part}, such as 0002_c1s1_000451_03.jpg, found none"
        )
    return crops
