"""A tracker of a person with a second witness: an appearance network, which has learnt nothing from the video.

A correlation filter that slides onto the background learns it, and is as sure of it as of the target. A network that
tells people apart and is never taught from the video does not slide along: what it says of the box is compared with
what it said of the first box. Where the likeness falls far below what it was, the status is ``lost``, whatever the
tracker says. Of the combined tracker, particles are drawn at the maxima of all filters all around as soon as the box
looks strange, moved and weighed as in a search, and the network looks at the heaviest places. The one most like the
first frame's box is the target, if it is like enough, more so than the box, and not too far or of another size.
Otherwise the filter goes on as if nothing had been said.

The network knows people: where the likeness has never been high it is not heard, and where the first box is not as
upright as a person it is not asked.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from tsuiseki.tracking.single.combined import Combined
from tsuiseki.tracking.single.tracker import SingleTracker, TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

Describe = Callable[[ImageArray, FloatArray], FloatArray]
"""Appearance features ``(N, D)`` of boxes ``(N, 4)`` in an image."""
MEMORY, HEARD = 15, 0.6
"""Share of the running median of likenesses, and its value from which on the network is heard."""
EXPECTED = 0.9
"""Likeness of the target before any look, so that a box that is lost at once is not taken for it."""
STRANGE_SHARE, LOST_SHARE = 0.6, 0.4
"""Shares of the running median under which a likeness is strange, and under which the target counts as lost: who is
half hidden looks strange, too."""
STRANGE_LOOKS = 2
"""Strange likenesses in a row from which on the target is looked for elsewhere."""
CANDIDATES, BETTER, ALIKE = 4, 0.1, 0.85
"""Places that the network looks at then, how much more alike than the box such a place must be, and the share of the
running median from which on it may be the target."""
FURTHEST, PACE, LARGER = 6.0, 0.5, 1.5
"""Bounds of such a place from where the target was last usual: sides of the box away, at most and a frame since; factor
on the size, up or down."""


@dataclass(frozen=True)
class RecognitionSettings:
    """Constants.

    Attributes:
        upright: height over width of the first box from which on the target may be a person, and the network is asked.
        every: frames between two looks.
        trusted: looks that `EXPECTED` counts for.
        lost_inferences: likenesses below `LOST_SHARE` in a row from which on the status is ``lost``.
    """

    upright: float = 1.8
    every: int = 3
    trusted: int = 3
    lost_inferences: int = 2


class Recognised:
    """A tracker whose status also says lost where the box no longer looks like the first one.

    Args:
        tracker: that follows; only a `Combined` is led to another place.
        describe: appearance features of boxes.
        settings: when the network looks, and what it takes for the target.

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
            if heard and self._strange >= STRANGE_LOOKS and isinstance(self._tracker, Combined):
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
        """Go to the place that looks most like the first box, if that is alike enough."""
        places = [there for there in tracker.heaviest_places(image, CANDIDATES) if self._near(tracker.box(there))]
        if not places:
            return
        likenesses = self._likeness(image, np.array([tracker.box(there) for there in places]))
        best = int(np.argmax(likenesses))
        if likenesses[best] >= max(likeness + BETTER, ALIKE * median(self._likenesses)):
            tracker.go_on_at(places[best])
            self.repeated_detections += 1
            self._strange = self._lost = 0  # the box counts as the target until it looks otherwise

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
        found = np.asarray(self._describe(image, boxes), dtype=np.float64)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))
