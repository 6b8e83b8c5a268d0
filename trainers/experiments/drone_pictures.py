"""Pictures like thesis Figs. 5.7 and 5.9: a person whose id changes in one result, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.tracking.action_report import captions_of
from tsuiseki.tracking.evaluation.coverage import coverage
from tsuiseki.tracking.formats.acting_tracks import ActingTrack
from tsuiseki.tracking.formats.mot import list_images
from tsuiseki.tracking.render import Overlay, draw_label
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray
from tsuiseki.trainers.experiments.drone_clips import Clip
from tsuiseki.trainers.experiments.drone_rows import Costs, track_all

SHOWN, SIDE, THRESHOLD = 4, 240, 0.4


@dataclass(frozen=True)
class Switch:
    """A change of id.

    Attributes:
        clip: number of the clip.
        person: of the ground truth.
        frame: 0-based, the first with the new id.
    """

    clip: int
    person: int
    frame: int


def draw_pictures(
    clips: Sequence[Clip],
    results: Sequence[Sequence[Sequence[ActingTrack]]],
    costs: Costs,
    out: Path,
    *,
    compensate: bool,
) -> None:
    """``prevented.png``: switches of the flow that the alternation prevents. ``remaining.png``: one that it does not.

    Args:
        clips: that were tracked.
        results: people of every clip by iteration of the alternation.
        costs: of the flow to compare with.
        out: folder for the pictures.
        compensate: whether the camera's motion is taken out of the places.
    """
    flow = track_all(clips, "flow", costs, compensate=compensate)
    rows = {
        "flow": flow,
        "flow-saf, iteration 1": results[0],
        "flow-maf, one-sided, iteration 6": results[min(5, len(results) - 1)],
    }
    last = results[min(5, len(results) - 1)]
    prevented = sorted(_switches(clips, flow) - _switches(clips, last), key=lambda s: (s.clip, s.frame))
    remaining = sorted(_switches(clips, last) & _switches(clips, flow), key=lambda s: (s.clip, s.frame))
    for name, found in (("prevented", prevented), ("remaining", remaining)):
        if found:
            picture = _strip(clips[found[0].clip], found[0], {k: r[found[0].clip] for k, r in rows.items()})
            cv2.imwrite(str(out / f"{name}.png"), picture[:, :, ::-1])


def _switches(clips: Sequence[Clip], people: Sequence[Sequence[ActingTrack]]) -> set[Switch]:
    """All changes of id: from one id to another, misses between passed over."""
    found = set()
    for number, (clip, acting) in enumerate(zip(clips, people, strict=True)):
        for person in coverage(clip.truth, [one.track for one in acting]):
            seen = np.flatnonzero(person.track_ids > 0)
            ids = person.track_ids[seen]
            for k in np.flatnonzero(np.diff(ids) != 0).tolist():
                found.add(Switch(number, person.id, int(person.frames[seen[k + 1]])))
    return found


def _strip(clip: Clip, switch: Switch, rows: dict[str, Sequence[ActingTrack]]) -> ImageArray:
    """A row a result, a column a frame, around the person of the switch."""
    images = list_images(clip.folder / "img1")
    first = int(np.clip(switch.frame - SHOWN // 2, 0, len(images) - SHOWN))
    truth = clip.truth.select(clip.truth.ids == switch.person)
    lines = []
    for name, people in rows.items():
        overlay = Overlay([p.track for p in people], 30.0, captions_of(people, clip.labels.names, THRESHOLD), 0.0)
        cells = []
        for frame in range(first, first + SHOWN):
            nearest = int(np.argmin(np.abs(truth.frames - frame)))
            drawn = overlay.draw(Frame(frame, frame / 30, read_image(images[frame])))
            cells.append(_cell(drawn, truth.boxes[nearest]))
        line = np.concatenate(cells, axis=1)
        draw_label(line, name, (0, 17), (40, 40, 40))
        lines.append(line)
    return np.concatenate(lines, axis=0)


def _cell(image: ImageArray, box: FloatArray) -> ImageArray:
    """The surroundings of a box, ``(SIDE, SIDE, 3)``."""
    centre = (box[:2] + box[2:]) / 2
    limit = np.array(image.shape[1::-1]) - SIDE
    x, y = np.clip(centre - SIDE / 2, 0, np.maximum(limit, 0)).astype(int).tolist()
    cell = image[y : y + SIDE, x : x + SIDE]
    return np.asarray(cv2.copyMakeBorder(cell, 0, 2, 0, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)))
