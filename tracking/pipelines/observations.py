"""All that networks and images say about the frames of a video from a drone, before any tracking.

All that a tracker needs of a frame is in one `Observation`, so that it can be kept on disk and trackers with other
settings run on it without the video (see `observation_cache`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.camera_motion import CameraMotionSettings, CameraPath
from tsuiseki.tracking.features.networks import Describe, Detect
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.bridging import Bridge, BridgingSettings
from tsuiseki.tracking.types import Detections, FloatArray, Frame, ImageArray


@dataclass(frozen=True)
class Observation:
    """What was seen in one frame.

    Attributes:
        frame: 0-based number.
        detections: people, with appearance features where something describes them; last those whom the detector missed
            and a correlation filter found, where there are any.
        actions: ``(S, N, A)`` float32 probabilities by stream; None where nothing recognises actions.
        motion: ``(2, 3)`` similarity of the camera: where pixels of the frame before lie in this one. None at the
            start, or where it is not estimated.
    """

    frame: int
    detections: Detections
    actions: FloatArray | None = None
    motion: FloatArray | None = None


@dataclass(frozen=True)
class Observers:
    """What looks at the frames.

    Attributes:
        detect: finds people, or their given detections, one entry a frame number.
        describe: describes their looks.
        recognise: recognises their actions.
        camera: how the camera's motion is estimated; None does without.
        batch_size: frames of one call of the detector.
        bridging: when a correlation filter follows people whom the detector misses; None never.
    """

    detect: Detect | Sequence[Detections]
    describe: Describe | None = None
    recognise: ActionRecogniser | None = None
    camera: CameraMotionSettings | None = None
    batch_size: int = 4
    bridging: BridgingSettings | None = None

    @property
    def history(self) -> int:
        """Frames before the current one that are looked at."""
        flow = 0 if self.recognise is None else self.recognise.history
        return max(flow, 0 if self.camera is None else 1, 0 if self.bridging is None else self.bridging.longest)


def observe(
    frames: Iterable[Frame], observers: Observers, times: StageTimes | None = None, first: int = 0
) -> Iterator[Observation]:
    """Look at every frame in turn; held are a batch of frames and as many as the flow needs.

    Args:
        frames: consecutive; those before ``first`` only serve as history.
        observers: what looks at them.
        times: gets the seconds of the stages ``decode``, ``detect``, ``describe``, ``camera``, ``bridge`` and
            ``actions``.
        first: number of the first frame to say something about.
    """
    times = times or StageTimes()
    path = None if observers.camera is None else CameraPath(observers.camera)
    bridge = None if observers.bridging is None else Bridge(observers.bridging)
    kept = 0 if observers.recognise is None else observers.recognise.history
    before: deque[ImageArray] = deque(maxlen=kept + 1)
    for frame, found in stream(frames, observers.detect, observers.describe, observers.batch_size, times):
        before.append(frame.image)
        motion = None
        if path is not None:
            with times.measure("camera"):
                motion = _step(path, frame.image, found.boxes)
        if bridge is not None:
            with times.measure("bridge"):
                missed = bridge.step(frame.image, found, motion)
            if observers.describe is not None and len(missed):
                with times.measure("describe"):
                    missed = missed.with_features(observers.describe.describe(frame.image, missed.boxes))
            found = _joined(found, missed)
        if frame.index < first:
            continue
        actions = None
        if observers.recognise is not None:
            with times.measure("actions"):
                actions = observers.recognise.recognise(list(before), found.boxes)
        yield Observation(frame.index, found, actions, motion)


def _joined(found: Detections, missed: Detections) -> Detections:
    """``found`` and, after them, ``missed``."""
    if not len(missed):
        return found
    features = None if found.features is None or missed.features is None else [found.features, missed.features]
    return Detections(
        np.concatenate([found.boxes, missed.boxes]),
        np.concatenate([found.scores, missed.scores]),
        None if features is None else np.concatenate(features),
    )


def _step(path: CameraPath, image: ImageArray, people: FloatArray) -> FloatArray | None:
    """``(2, 3)`` from the frame before to ``image``, the next of ``path``; None for the first."""
    path.add(image, people)
    if len(path.transforms) < 2:
        return None
    earlier, now = (np.vstack([transform, [0, 0, 1]]) for transform in path.transforms[-2:])
    step = np.linalg.solve(now, earlier)[:2]
    # A camera that stood still is told from one that moved by less than rounding.
    return np.eye(3)[:2] if np.array_equal(earlier, now) else np.asarray(step)
