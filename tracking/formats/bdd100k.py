"""BDD100K's box tracking: a JSON a video, ``labels/box_track_20/val/NAME.json``, also without the folders above.

A file is a list of frames with ``frameIndex`` from 0 and ``labels`` of ``id``, ``category`` and ``box2d`` (x1, y1, x2,
y2, pixels), maybe with ``attributes``. A result on a crowd, or on ``other person``, ``other vehicle`` or ``trailer``,
is neither right nor wrong; one on another class is wrong. Pictures are found in ``images/track/*/NAME``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import NothingLabelledError, compare_with_picture, wanted_numbers
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.formats.rows import read_text
from tsuiseki.tracking.types.frame_range import LAST_FRAME
from tsuiseki.tracking.types.labels import GroundTruth

NAMES = dict(enumerate(("pedestrian", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle")))
# As older files call them.
OLDER = {"person": "pedestrian", "motor": "motorcycle", "bike": "bicycle"}
IGNORED = ("other person", "other vehicle", "trailer")


def is_bdd100k(path: Path) -> bool:
    """Whether a file, or the first JSON under a folder, is of this layout."""
    first = path if path.is_file() else next(iter(label_files(path)), path)
    if first.suffix != ".json" or not first.is_file():
        return False
    with first.open(encoding="utf-8", errors="replace") as file:
        head = file.read(100_000)
    return head.lstrip().startswith("[") and '"frameIndex"' in head and '"labels"' in head


def label_files(folder: Path) -> list[Path]:
    """The files of labels in a folder, by name; in the folders of the data set where there are none."""
    places = ("*.json", "labels/box_track_20/*/*.json", "box_track_20/*/*.json", "labels/*.json")
    return next((found for place in places if (found := sorted(folder.glob(place)))), [])


def images_of(labels: Path) -> tuple[Path, ...]:
    """The pictures of a label file's video where the folders of the data set lie above it; none elsewhere."""
    above = labels.resolve().parents[:5]
    found = (place for folder in above for place in sorted(folder.glob(f"images/track/*/{labels.stem}")))
    return next((images for place in found if (images := list_images(place))), ())


def read_bdd100k(path: str | Path, wanted: int | str | None = None) -> GroundTruth:
    """The labels in the file at ``path``, ordered by frame.

    Args:
        path: of the JSON file.
        wanted: name of the class that counts; by default people: pedestrians.

    Raises:
        RequestError: the file is missing or malformed, has no such class, or none of it is labelled.
    """
    path = Path(path)
    try:
        frames = json.loads(read_text(path, "labels of BDD100K"))
        rows = [(int(f["frameIndex"]), one) for f in frames for one in f.get("labels") or [] if one.get("box2d")]
        numbers = np.array([number for number, _ in rows], dtype=np.int64)
        corners = ("x1", "y1", "x2", "y2")
        boxes = np.array([[float(one["box2d"][k]) for k in corners] for _, one in rows]).reshape(-1, 4)
        kinds = np.array([OLDER.get(one["category"], one["category"]) for _, one in rows], dtype=np.str_)
        ids = np.unique([str(one["id"]) for _, one in rows], return_inverse=True)[1].astype(np.int64) + 1
        visible = np.array([0.5 if _attribute(one, "occluded") else 1.0 for _, one in rows])
        crowd = np.array([_attribute(one, "crowd") for _, one in rows], dtype=np.bool_)
    except (json.JSONDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise RequestError(
            f"{path}: expected a list of frames with frameIndex and labels of id, category and box2d: {error}"
        ) from None
    if len(numbers) and not (numbers.min() >= 0 and numbers.max() < LAST_FRAME):
        raise RequestError(f"{path}: expected frameIndex from 0 to {LAST_FRAME - 1}")
    counted = np.isin(kinds, [NAMES[n] for n in wanted_numbers(wanted, NAMES, (0,), path)]) & ~crowd
    if not counted.any():
        raise NothingLabelledError(f"{path}: no usable box: expected labels of {wanted or NAMES[0]}, got none")
    if bad := np.flatnonzero((boxes[:, 2:] <= boxes[:, :2]).any(axis=1)).tolist():
        raise RequestError(f"{path}: expected x1 < x2 and y1 < y2, got {boxes[bad[0]].tolist()}")
    compare_with_picture(path, boxes)
    people, times = np.unique(np.column_stack([numbers, ids])[counted], axis=0, return_counts=True)
    if (times > 1).any():
        raise RequestError(f"{path}: expected each id once a frame, got one twice in frame {people[times > 1][0][0]}")
    truth = GroundTruth(numbers, ids, boxes, counted, np.isin(kinds, IGNORED) | crowd, visible)
    return truth.select(np.argsort(numbers, kind="stable"))


def _attribute(label: dict[str, Any], name: str) -> bool:
    return bool((label.get("attributes") or {}).get(name, False))
