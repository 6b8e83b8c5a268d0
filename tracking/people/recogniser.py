"""Who the people of a gallery are, frame by frame, while they are followed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.features.exported import AppearanceLike, usual_describer
from tsuiseki.tracking.features.gallery import Gallery, opened_gallery
from tsuiseki.tracking.features.recognition import centre_of, identity_of, recognise, unit_rows, without
from tsuiseki.tracking.types import FloatArray, Frame, Recognition, Targets

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


@dataclass
class _InView:
    """How those looked who were seen, by id, and who those in view are."""

    looks: dict[int, _Look] = field(default_factory=dict)
    identities: dict[int, Recognition] = field(default_factory=dict)


class Recogniser:
    """Gives targets their identities.

    Args:
        gallery: a `Gallery` or its folder.
        appearance: what describes people, as of `track_people`; by default the shipped network.

    Raises:
        RequestError: there is no gallery, or it is of another network.
    """

    def __init__(self, gallery: str | Path | Gallery, appearance: AppearanceLike | None = None) -> None:
        self.describer = usual_describer(appearance)
        self.gallery = opened_gallery(gallery, self.describer)
        self._centre = self.gallery.centre()
        # Nothing of the view enters where the gallery has a centre.
        self._rows = None if self._centre is None else self.gallery.rows()
        self._cameras: dict[int, _InView] = {}

    def recognised(self, steps: Iterable[tuple[Frame, Targets]]) -> Iterator[tuple[Frame, Targets]]:
        """The same frames, in which each person who was ever seen well has an identity."""
        for frame, targets in steps:
            yield frame, self.update(frame, targets)

    def update(self, frame: Frame, targets: Targets) -> Targets:
        """The targets of the next frame of a camera with their identities."""
        camera = self._cameras.setdefault(frame.camera, _InView())
        described = self._describe(frame, targets, camera.looks)
        seen = [number for number in targets.ids.tolist() if number in camera.looks]
        # The same people with the same pictures are who they were in the frame before.
        if described or seen != list(camera.identities):
            camera.identities = self._identities(seen, camera.looks)
        return replace(targets, identities=camera.identities)

    def _identities(self, seen: list[int], looks: dict[int, _Look]) -> dict[int, Recognition]:
        """Who those in view are, by what is known of all who were."""
        if not seen:
            return {}
        means = unit_rows(np.array([look.total for look in looks.values()]))
        centre = centre_of(means, self._centre)
        row_of = {number: row for row, number in enumerate(looks)}
        rows = without(means, centre)[[row_of[number] for number in seen]]
        likenesses = self.gallery.rows(centre) if self._rows is None else self._rows
        chances = recognise(rows, likenesses, np.ones((len(seen), len(seen)), dtype=bool))
        names = list(self.gallery.people)
        return {number: identity_of(row, names) for number, row in zip(seen, chances, strict=True)}

    def _describe(self, frame: Frame, targets: Targets, looks: dict[int, _Look]) -> bool:
        """Take a picture of those whose last one is some time ago; whether there was any."""
        due = [row for row, number in enumerate(targets.ids.tolist()) if _is_due(looks.get(number), frame.time)]
        due = [row for row in due if targets.status[row] == "tracking"]
        if not due:
            return False
        rows = self.describer.describe(frame.image, targets.boxes[due])
        for number, row in zip(targets.ids[due].tolist(), rows, strict=True):
            if np.isfinite(row).all() and row.any():
                look = looks.pop(number, None) or _Look(np.zeros_like(row), 0, frame.time)
                looks[number] = _Look(look.total + row, look.count + 1, frame.time)
        for number in list(looks)[:-LATEST]:
            del looks[number]
        return True


def _is_due(look: _Look | None, time: float) -> bool:
    return look is None or (look.count < PICTURES and time >= look.time + BETWEEN)
