"""A tracker of a person with a second witness: an appearance network, which learns nothing from the video.

A correlation filter that slides onto the background learns it, and its response stays high. An appearance network does
not slide along. It compares the features of the box with those of the first box: their cosine is the likeness. Where
the likeness falls far below its running median, the status is ``lost``, whatever the tracker reports.

The combined tracker also searches. As soon as the likeness is low, particles are drawn at the maxima of all filters,
moved and weighed as in a search. The network then describes the heaviest places. The one most like the first box is
the target, if its likeness is high enough and above that of the box, and its place and size are near. Otherwise the
filter goes on as before.

The network describes people. It counts only where the likeness has been high, and the first box is as upright as a
person.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.tracker import SingleTracker, TargetState, box_centre
from tsuiseki.tracking.single.witness import Describe, unit_features
from tsuiseki.tracking.types import FloatArray, ImageArray

MEMORY, HEARD = 15, 0.6
"""Likenesses of the running median, and its value from which on the network counts."""
EXPECTED = 0.9
"""Prior likeness of the target, so that a box that is lost at once is not taken for it."""
STRANGE_SHARE, LOST_SHARE = 0.6, 0.4
"""Shares of the running median under which a likeness is strange, and under which the target counts as lost. A
half hidden target is strange, too."""
STRANGE_TRIALS = 2
"""Strange likenesses in a row from which on the target is searched elsewhere."""
CANDIDATES, BETTER, ALIKE = 4, 0.1, 0.85
"""Places that the network describes then, by how much their likeness must exceed that of the box, and the share of the
running median from which on a place may be the target."""
FURTHEST, PACE, LARGER = 6.0, 0.5, 1.5
"""Bounds of such a place from where the target was last usual: sides of the box away, at most and a frame since; factor
on the size, up or down."""


@dataclass(frozen=True)
class RecognitionSettings:
    """Constants.

    Attributes:
        upright: height over width of the first box from which on the target may be a person, and the network is asked.
        every: frames from one inference of the network to the next.
        trusted: weight of `EXPECTED`, in inferences.
        lost_inferences: likenesses below `LOST_SHARE` in a row from which on the status is ``lost``.
    """

    upright: float = 1.8
    every: int = 3
    trusted: int = 3
    lost_inferences: int = 2


class Recognised:
    """A tracker whose status is also lost where the box is no longer like the first one.

    Args:
        tracker: that follows; only a `Combined` is led to another place.
        describe: appearance features of boxes.
        settings: when the network runs, and which likenesses it takes for the target.

    Attributes:
        asked: whether the first box is upright enough for a person.
        repeated_detections: how often the network has led to another place.
    """

    def __init__(self, tracker: SingleTracker, describe: Describe, settings: RecognitionSettings | None = None) -> None:
        self.settings = settings or RecognitionSettings()
        self._tracker, self._describe = tracker, describe

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        self._tracker.start(image, box)
        width, height = (np.asarray(box)[2:] - np.asarray(box)[:2]).tolist()
        self.asked = height >= self.settings.upright * width
        if self.asked:
            self._first = self._features(image, np.asarray(box)[None])[0]
        self._usual, self._usual_frame = np.asarray(box, dtype=np.float64), 0
        self._likenesses = deque([EXPECTED] * self.settings.trusted, maxlen=MEMORY)
        self._frame = self._strange = self._lost = self.repeated_detections = 0

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        found = self._tracker.follow(image)
        if not self.asked:
            return found
        self._frame += 1
        if self._frame % self.settings.every == 0:
            likeness = self._compare(image, found.box)
            heard = median(self._likenesses) >= HEARD
            if heard and self._strange >= STRANGE_TRIALS and isinstance(self._tracker, Combined):
                self._find_again(self._tracker, image, likeness)
                found = self._tracker.state()
        lost = self._lost >= self.settings.lost_inferences and median(self._likenesses) >= HEARD
        return replace(found, status="lost") if lost else found

    def _compare(self, image: ImageArray, box: FloatArray) -> float:
        """Likeness of what the box ``(4,)`` of a frame shows, counted as strange, lost or usual."""
        likeness = float(self._likeness(image, box[None])[0])
        usual = median(self._likenesses)
        if likeness < STRANGE_SHARE * usual:
            self._strange += 1
        else:
            self._strange = 0
            self._likenesses.append(likeness)
            self._usual, self._usual_frame = box, self._frame
        self._lost = self._lost + 1 if likeness < LOST_SHARE * usual else 0
        return likeness

    def _find_again(self, tracker: Combined, image: ImageArray, likeness: float) -> None:
        """Go to the place most like the first box, if its likeness is high enough."""
        places = [there for there in tracker.heaviest_places(image, CANDIDATES) if self._near(tracker.box(there))]
        if not places:
            return
        likenesses = self._likeness(image, np.array([tracker.box(there) for there in places]))
        best = int(np.argmax(likenesses))
        if likenesses[best] >= max(likeness + BETTER, ALIKE * median(self._likenesses)):
            tracker.go_on_at(places[best])
            self.repeated_detections += 1
            self._strange = self._lost = 0  # the box counts as the target for now

    def _near(self, box: FloatArray) -> bool:
        """Whether the target can be at ``box`` ``(4,)``, by its place and size."""
        sides, before = box[2:] - box[:2], self._usual[2:] - self._usual[:2]
        away = np.abs(box_centre(box) - box_centre(self._usual)) / before
        far = min(FURTHEST, 1 + PACE * (self._frame - self._usual_frame))
        return bool((away <= far).all() and (np.abs(np.log(sides / before)) <= np.log(LARGER)).all())

    def _likeness(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` cosines of what ``boxes`` ``(N, 4)`` show and of the first box, in [-1, 1]."""
        return np.asarray(self._features(image, boxes) @ self._first)

    def _features(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        return unit_features(self._describe, image, boxes)
