"""The contract of trackers, on one page.

A tracker of many is fed the detections of one frame after the other, frames without any included:

* ``tracker = Method(settings, seed=0)``. Settings are one frozen dataclass with defaults. All random numbers come
  from ``numpy.random.default_rng(seed)``; a method that draws none takes ``seed`` all the same, so that methods can be
  exchanged. The same input and seed give the same tracks.
* ``update(detections)`` takes the next frame. What it takes is whatever `as_detections` understands, and is never
  written to. An `OnlineTracker` answers with the `Targets` of this very frame, in time that does not grow with the
  length of the video. A tracker with a delay of d frames answers with those of the frame d before, and with None as
  long as there is none, in time and memory that do not grow either; its answers are final. One that decides at the end
  always answers None.
* ``tracks()`` gives the tracks of all frames so far, as they are if the video ends here. It may be asked at any time
  and changes nothing. Of a tracker with a delay it repeats what was answered, and adds the frames that were not.
* ``update(detections, time=seconds)`` also takes the time of the frame, with every frame or with none. Filters then
  step by it: frames may be dropped, and rates change. What counts in frames, such as an age, counts calls.
* ``skip()`` takes a frame without inference, so that no person is missed in it.

Frames count from 0, the first ``update`` or ``skip``. IDs count from 1, live in the tracker, and are never given
twice: two trackers in one process share nothing. An id that was answered stays that target's id, also in ``tracks()``.

What the status of a target says:

* ``tracking``: something in this frame supports its box, a detection or the image.
* ``searching``: nothing does; its box is where it is expected, and its score is 0.
* ``lost``: it is given up in this frame, and its id does not come back. A target that ends is not always announced.

A target is reported from the frame on in which its tracker confirms it. The ``tracks()`` of an online tracker may
begin earlier, with the detections before that.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

from tsuiseki.tracking.interchange import DetectionsLike
from tsuiseki.tracking.types import Detections, Targets, Track


class PeopleTracker(Protocol):
    """Turns the detections of a video into tracks."""

    def update(self, detections: DetectionsLike) -> Targets | None:
        """Take the next frame; the targets of a frame, where one is decided."""

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id."""


class OnlineTracker(PeopleTracker, Protocol):
    """A tracker that answers at once."""

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the next frame; its targets."""

    def skip(self) -> Targets:
        """The detector does not run on the next frame; where its targets are expected."""

    def forget(self) -> None:
        """Drop what is kept for ``tracks()``, which then begins with the next frame that is answered; ids go on.

        A run without end needs this: a tracker that is online or has a delay holds nothing else that grows with the
        video.
        """


def updated(tracker: PeopleTracker, detections: Detections, time: float | None) -> Targets | None:
    """Feed a tracker, which need not know of times where there are none."""
    return tracker.update(detections) if time is None else tracker.update(detections, time=time)  # type: ignore[call-arg]


def skipped(tracker: PeopleTracker) -> Targets | None:
    """Tell a tracker that the detector does not run on the next frame; one without `skip` takes it as empty."""
    skip = getattr(tracker, "skip", None)
    answer: Targets | None = tracker.update(Detections.empty()) if skip is None else skip()
    return answer


def shifted(track: Track, frames: int) -> Track:
    """``track`` as many frames later."""
    return replace(track, frames=track.frames + frames) if frames else track


def run_tracker(detections: Iterable[DetectionsLike], tracker: PeopleTracker) -> list[Track]:
    """The tracks of a whole video.

    Args:
        detections: of each frame in order, frames without any included.
        tracker: it goes on from its earlier frames.
    """
    for frame_detections in detections:
        tracker.update(frame_detections)
    return tracker.tracks()
