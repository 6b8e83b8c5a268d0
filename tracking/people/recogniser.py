"""Who the people of a gallery are, frame by frame, while they are followed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.features.exported import AppearanceLike, as_describer
from tsuiseki.tracking.features.gallery import Gallery, opened_gallery
from tsuiseki.tracking.features.recognition import centre_of, identity_of, recognise, unit_rows, without
from tsuiseki.tracking.types import FloatArray, Frame, Targets

SHIPPED = "people"
# Seconds from one picture of somebody to the next: those in between look the same.
BETWEEN = 0.4
# Pictures of somebody: more change the mean little.
PICTURES = 12
# People of a camera that are kept in mind, the last ones seen.
LATEST = 500


@dataclass
class _Look:
    """What is known of how somebody looks: the sum of ``count`` rows, the last at ``time`` seconds."""

    total: FloatArray
    count: int
    time: float


class Recogniser:
    """Gives targets their identities.

    Args:
        gallery: a `Gallery` or its folder.
        appearance: what describes people, as of `track_people`; by default the shipped network.

    Raises:
        RequestError: there is no gallery, or it is of another network.
    """

    def __init__(self, gallery: str | Path | Gallery, appearance: AppearanceLike | None = None) -> None:
        self.describer = as_describer(SHIPPED if appearance is None else appearance)
        self.gallery = opened_gallery(gallery, self.describer)
        self._cameras: dict[int, dict[int, _Look]] = {}

    def recognised(self, steps: Iterable[tuple[Frame, Targets]]) -> Iterator[tuple[Frame, Targets]]:
        """The same frames, in which each person who was ever seen well has an identity."""
        for frame, targets in steps:
            yield frame, self.update(frame, targets)

    def update(self, frame: Frame, targets: Targets) -> Targets:
        """The targets of the next frame of a camera with their identities."""
        looks = self._cameras.setdefault(frame.camera, {})
        self._describe(frame, targets, looks)
        seen = [number for number in targets.ids.tolist() if number in looks]
        if not seen:
            return targets
        means = unit_rows(np.array([look.total for look in looks.values()]))
        centre = centre_of(means, self.gallery.centre())
        rows = without(means, centre)[[list(looks).index(number) for number in seen]]
        chances = recognise(rows, self.gallery.rows(centre), np.ones((len(seen), len(seen)), dtype=bool))
        names = list(self.gallery.people)
        identities = {number: identity_of(row, names) for number, row in zip(seen, chances, strict=True)}
        return replace(targets, identities=identities)

    def _describe(self, frame: Frame, targets: Targets, looks: dict[int, _Look]) -> None:
        """Take a picture of those whose last one is some time ago."""
        due = [row for row, number in enumerate(targets.ids.tolist()) if _is_due(looks.get(number), frame.time)]
        due = [row for row in due if targets.status[row] == "tracking"]
        if not due:
            return
        rows = self.describer.describe(frame.image, targets.boxes[due])
        for number, row in zip(targets.ids[due].tolist(), rows, strict=True):
            if np.isfinite(row).all() and row.any():
                look = looks.pop(number, None) or _Look(np.zeros_like(row), 0, frame.time)
                looks[number] = _Look(look.total + row, look.count + 1, frame.time)
        for number in list(looks)[:-LATEST]:
            del looks[number]


def _is_due(look: _Look | None, time: float) -> bool:
    return look is None or (look.count < PICTURES and time >= look.time + BETWEEN)
