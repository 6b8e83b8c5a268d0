"""What is known of a run at this moment: an observer that keeps the newest of each camera.

One picture a camera is kept, and only as long as it is the newest.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tsuiseki.tracking.counts.online import Counter
from tsuiseki.tracking.counts.scene import Scene
from tsuiseki.tracking.counts.scene_drawing import texts_of
from tsuiseki.tracking.events.event import public_name
from tsuiseki.tracking.monitor.pictures import PictureMaker
from tsuiseki.tracking.types import Frame, ImageArray, Targets
from tsuiseki.tracking.types.live import CameraOutage, CameraState, LiveEvent, PeopleInFrame

# Seconds over which frames a second are measured.
RECENT = 5.0
# Seconds without a frame, of a camera that gives pictures, after which a run has stalled.
STALLED = 60.0


@dataclass
class _View:
    """The newest of one camera.

    Attributes:
        state: what the camera has given so far.
        frame: the newest whose people are certain; None before the first.
        people: in it.
        taken: when it came, seconds since 1970; of a recording since its beginning.
        answered: when its people were certain, seconds of a clock that never falls.
        counter: of lines and zones; None without a scene.
        away: seconds without a picture, of outages that are over.
        since: when the latest frames were answered.
    """

    state: CameraState
    counter: Counter | None
    frame: Frame | None = None
    people: Targets = field(default_factory=lambda: Targets.empty(0))
    taken: float = 0.0
    answered: float = 0.0
    away: float = 0.0
    since: deque[float] = field(default_factory=deque)


class Board:
    """An observer of a run that can be asked for what happens now, from any thread.

    Args:
        name: of the run.
        scene: lines and zones to count in; None for none.
        cameras: what each has given; or their names, and it is counted here.
        recorded: the run is of recordings, whose frames came long ago.
        pictures: draws and hides people.
        waiting: how many events wait for their receiver.
    """

    def __init__(
        self,
        name: str,
        scene: Scene | None = None,
        cameras: Sequence[CameraState] | Sequence[str] = (),
        recorded: bool = False,
        pictures: PictureMaker | None = None,
        waiting: Callable[[], int] = lambda: 0,
    ) -> None:
        self.name, self._scene, self._recorded, self.waiting = name, scene, recorded, waiting
        self.pictures = pictures or PictureMaker(scene=scene)
        self.started, self._start = time.time(), time.monotonic()
        self._lock = threading.Lock()
        self._counted_here = not any(isinstance(camera, CameraState) for camera in cameras)
        states = [camera if isinstance(camera, CameraState) else CameraState(camera) for camera in cameras]
        self._views = [self._view(state) for state in states]

    def __call__(self, happening: LiveEvent) -> None:
        with self._lock:
            if isinstance(happening, CameraOutage):
                self._outage(happening)
            elif isinstance(happening, PeopleInFrame):
                self._show(happening.camera, happening.name, happening.frame, happening.people, happening.time)
            else:
                for camera, (frame, boxes) in enumerate(zip(happening.frames, happening.boxes, strict=True)):
                    if frame is not None and boxes is not None:
                        self._show(camera, f"camera {camera + 1}", frame, boxes, happening.time)

    def close(self) -> None:
        """The run ends: no picture is kept."""
        with self._lock:
            for view in self._views:
                view.frame = None

    def picture(self, camera: int) -> ImageArray | None:
        """The newest picture of a camera with its people drawn or hidden, ``(H, W, 3)`` uint8 RGB; None for none."""
        with self._lock:
            view = self._views[camera] if camera < len(self._views) else None
            if view is None or view.frame is None:
                return None
            frame, people, counter = view.frame, view.people, view.counter
            counts = {} if counter is None else texts_of(counter.counts, counter.occupancy)
        return self.pictures.picture(camera, frame, people, counts)

    def cameras(self) -> list[dict[str, Any]]:
        """What is known of each camera."""
        now = time.monotonic()
        with self._lock:
            return [self._about(view, now) for view in self._views]

    def health(self) -> dict[str, Any]:
        """How the run is: ``ok``, ``degraded`` where a camera is away, ``waiting`` before the first picture, or
        ``stalled`` where frames do not come through any more.
        """
        cameras = self.cameras()
        idle = time.monotonic() - max([self._start, *(view.answered for view in self._views)])
        there = [camera for camera in cameras if not camera["away"]]
        status = "ok" if len(there) == len(cameras) else "degraded"
        status = status if any(camera["frames"] for camera in cameras) else "waiting"
        if idle > STALLED and (there or not cameras):
            status = "stalled"
        return {
            "status": status,
            "seconds": round(time.monotonic() - self._start, 1),
            "memory": memory(),
            "events_waiting": self.waiting(),
            "cameras": cameras,
        }

    def _view(self, state: CameraState) -> _View:
        return _View(state, None if self._scene is None else Counter(self._scene))

    def _of(self, camera: int, name: str) -> _View:
        while camera >= len(self._views):
            self._views.append(self._view(CameraState(name)))
        return self._views[camera]

    def _outage(self, outage: CameraOutage) -> None:
        view = self._of(outage.camera, outage.name)
        view.away += outage.seconds or 0.0
        if self._counted_here:
            view.state.away = outage.seconds is None
            view.state.outages += outage.seconds is None

    def _show(self, camera: int, name: str, frame: Frame, people: Targets, taken: float) -> None:
        view, now = self._of(camera, name), time.monotonic()
        view.frame, view.people, view.taken, view.answered = frame, people, taken, now
        view.since.append(now)
        while view.since[0] < now - RECENT:
            view.since.popleft()
        self.pictures.note(camera, frame, people)
        if view.counter is not None:
            view.counter.update(people)
        if self._counted_here:
            view.state.frames += 1
            view.state.last, view.state.away = taken, False

    def _about(self, view: _View, now: float) -> dict[str, Any]:
        state, recent = view.state, [moment for moment in view.since if moment > now - RECENT]
        present = view.people.status != "lost"
        about: dict[str, Any] = {
            "name": public_name(state.name),
            "away": state.away,
            "frames": state.frames,
            "dropped": state.dropped,
            "outages": state.outages,
            "away_seconds": round(view.away, 3),
            "rate": round((len(recent) - 1) / (recent[-1] - recent[0]), 2) if len(recent) > 1 else 0.0,
            "delay": None if self._recorded or view.frame is None else round(self._delay(view, now), 3),
            "frame": 0 if view.frame is None else view.frame.index + 1,
            "seconds": 0.0 if view.frame is None else round(view.frame.time, 3),
            "people": int(present.sum()),
        }
        if view.counter is not None:
            zones = view.counter.occupancy
            about["lines"] = {name: ways for name, ways in view.counter.counts.items() if name not in zones}
            about["zones"] = {name: {"people": n, **view.counter.counts[name]} for name, n in zones.items()}
        return about

    def _delay(self, view: _View, now: float) -> float:
        """Seconds from when the newest frame came to when its people were certain."""
        return max(0.0, time.time() - (now - view.answered) - view.taken)


def memory() -> int:
    """Bytes of this process that lie in memory; where the system does not tell, the most that ever did."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most
