"""Objects of several classes in one video, each class tracked apart from the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import IntArray, Targets, Track


class ByClass:
    """A tracker of its own for every class; ids are unique over all of them.

    Args:
        make: gives a fresh tracker for a class.
        classes: ``(N,)`` the class of each detection of every frame, in the order in which frames and detections come;
            frames after the last of them have no detection.
        wanted: the classes to track; detections of others are passed over.

    Attributes:
        wanted: each once.
        trackers: by class.

    >>> from tsuiseki.tracking.people.sort import Sort
    >>> tracker = ByClass(Sort, [np.array([1, 2])] * 4, [1, 2])
    >>> for _ in range(4):
    ...     people = tracker.update([[0, 0, 20, 50, 0.9], [1, 0, 21, 50, 0.9]])
    >>> len(people), [tracker.class_of(track.id) for track in tracker.tracks()]
    (2, [1, 2])
    """

    def __init__(self, make: Callable[[], PeopleTracker], classes: Sequence[IntArray], wanted: Sequence[int]) -> None:
        self.wanted = tuple(dict.fromkeys(wanted))
        self._classes = classes
        self.trackers = {number: make() for number in self.wanted}
        self._ids: dict[tuple[int, int], int] = {}
        self._frame = 0

    def update(self, detections: DetectionsLike) -> Targets | None:
        """Take the next frame; the targets of all classes, where every class has decided on the same frame."""
        found = as_detections(detections)
        classes = self._classes[self._frame] if self._frame < len(self._classes) else np.empty(0, np.int64)
        if len(found) != len(classes):
            raise ValueError(f"expected {len(classes)} detections in frame {self._frame}, got {len(found)}")
        self._frame += 1
        answers = [self._renumbered(n, t.update(found.select(classes == n))) for n, t in self.trackers.items()]
        known = [answer for answer in answers if answer is not None]
        if len(known) < len(answers) or len({answer.frame for answer in known}) != 1:
            return None
        return Targets(
            known[0].frame,
            *(np.concatenate([getattr(k, name) for k in known]) for name in ("ids", "boxes", "scores", "status")),
        )

    def tracks(self) -> list[Track]:
        """The tracks of all classes, by id."""
        found = [
            replace(track, id=self._id(number, track.id))
            for number, tracker in self.trackers.items()
            for track in tracker.tracks()
        ]
        return sorted(found, key=lambda track: track.id)

    def class_of(self, number: int) -> int:
        """The class of the track that bears an id."""
        return next(key[0] for key, one in self._ids.items() if one == number)

    def _renumbered(self, number: int, targets: Targets | None) -> Targets | None:
        if targets is None:
            return None
        return replace(targets, ids=np.array([self._id(number, one) for one in targets.ids.tolist()], dtype=np.int64))

    def _id(self, number: int, inner: int) -> int:
        """The id over all classes; what was told once stays."""
        return self._ids.setdefault((number, inner), len(self._ids) + 1)
