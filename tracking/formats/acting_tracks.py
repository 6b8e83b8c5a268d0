"""``tracks.json``: people with their places and actions, frame by frame.

``{"version": 1, "actions": [name, …], "tracks": [{"id": …, "frames": […], "boxes": [[x, y, w, h], …], "scores": […],
"observed": […], "single": [[p, …], …], "multi": [[p, …], …]}, …]}``. Frames count from 1 and boxes are 1-based
x, y, width, height, as in MOTChallenge text; probabilities are in the order of the actions: of the frame alone
(``single``) and of the window around it (``multi``).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import whole
from tsuiseki.tracking.geometry import corners_from_xywh, xywh_from_corners
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import ActingTrack

# Of the file; others are refused.
VERSION = 1
# From 0-based x, y, width, height to 1-based ones, pixels.
ONE_BASED = np.array([1.0, 1.0, 0.0, 0.0])


def write_acting_tracks(path: Path, people: Sequence[ActingTrack], names: Sequence[str]) -> None:
    """Write ``people`` with the actions ``names``."""
    tracks = []
    for person in people:
        track = person.track
        boxes = xywh_from_corners(track.boxes) + ONE_BASED
        values: dict[str, Any] = {
            "id": track.id,
            "frames": (track.frames + 1).tolist(),
            "boxes": boxes.round(2).tolist(),
            "scores": track.scores.round(4).tolist(),
            "observed": track.observed.tolist(),
        }
        if person.single is not None and person.multi is not None:
            values |= {"single": person.single.round(4).tolist(), "multi": person.multi.round(4).tolist()}
        tracks.append(json.dumps(values, separators=(",", ":")))
    head = json.dumps({"version": VERSION, "actions": list(names)})
    path.write_text(head[:-1] + ', "tracks": [\n' + ",\n".join(tracks) + "\n]}\n", encoding="utf-8")


def read_acting_tracks(path: Path, needed: bool = True) -> tuple[list[ActingTrack], tuple[str, ...]]:
    """What `write_acting_tracks` wrote, and the names of the actions.

    Raises:
        RequestError: the file is missing, no such file, or says nothing of actions although they are ``needed``.
    """
    with refusing(f"{path}: expected tracks.json of `tsuiseki track drone`, got ", repr):
        values = read_json(path, "tracks.json of `tsuiseki track drone`")
        names = tuple(str(name) for name in values["actions"])
        if values["version"] != VERSION:
            raise ValueError(f"version {values['version']}")
        people = [_person(entry, len(names)) for entry in values["tracks"]]
    if not names and needed:
        raise RequestError(f"{path} says nothing of actions; track with `method` flow-saf or flow-maf")
    return people, names


def _person(entry: dict[str, Any], actions: int) -> ActingTrack:
    boxes = corners_from_xywh(np.asarray(entry["boxes"], dtype=np.float64).reshape(-1, 4) - ONE_BASED)
    frames = np.asarray(entry["frames"], dtype=np.int64) - 1
    if frames.min(initial=0) < 0:
        raise ValueError(f"frame {frames.min() + 1}, where frames count from 1")
    observed = np.asarray(entry["observed"], dtype=np.bool_)
    identity = whole(str(entry["id"]))
    if identity is None:
        raise ValueError(f"id {entry['id']!r}, which is no whole number")
    track = Track(identity, frames, boxes, np.asarray(entry["scores"]), observed)
    if "single" not in entry:
        return ActingTrack(track)
    single, multi = (np.asarray(entry[name], dtype=np.float64) for name in ("single", "multi"))
    for values in (single, multi):
        if values.shape != (len(track), actions):
            raise ValueError(f"probabilities of shape {values.shape} in track {track.id}")
    return ActingTrack(track, single, multi)


HANDSHAKING = "Handshaking"
HUGGING = "Hugging"
READING = "Reading"
DRINKING = "Drinking"
PUSHING = "Pushing/Pulling"
CARRYING = "Carrying"
CALLING = "Calling"
RUNNING = "Running"
WALKING = "Walking"
LYING = "Lying"
SITTING = "Sitting"
STANDING = "Standing"

# In the order of thesis Table 5.1: between people, with objects, and neither; at most one of the last kind at a time.
WITH_PEOPLE = (HANDSHAKING, HUGGING)
WITH_OBJECTS = (READING, DRINKING, PUSHING, CARRYING, CALLING)
POSTURES = (RUNNING, WALKING, LYING, SITTING, STANDING)
OKUTAMA_ACTIONS = WITH_PEOPLE + WITH_OBJECTS + POSTURES
