"""Observations of the frames of a drone video: all that the tracker needs, computed before tracking.

An `Observation` holds the detections of a frame, their appearance features and action probabilities, and the camera's
motion. It can be stored on disk (see `observation_cache`). A tracker with other settings then runs without the video.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.motion.camera_motion import CameraMotionSettings
from tsuiseki.tracking.features.motion.camera_path import CameraPath
from tsuiseki.tracking.features.motion.camera_trajectory import CameraStep
from tsuiseki.tracking.features.networks.exported import Describe, Detect
from tsuiseki.tracking.features.networks.streaming import stream
from tsuiseki.tracking.people.bridging import Bridge, BridgingSettings
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Frame, ImageArray


@dataclass(frozen=True)
class Observation:
    """Detections, features and camera motion of one frame.

    Attributes:
        frame: 0-based number.
        detections: people, with appearance features where there is an appearance model. The boxes that a correlation
            filter adds for people whom the detector missed come last.
        actions: ``(S, N, A)`` float32 probabilities by stream; None without action recognition.
        motion: of the camera since the frame before; None where it is not estimated.
    """

    frame: int
    detections: Detections
    actions: FloatArray | None = None
    motion: CameraStep | None = None


@dataclass(frozen=True)
class Observers:
    """The networks and estimators that are applied to the frames.

    Attributes:
        detect: the detector; or given detections, of which entry k belongs to frame k.
        describe: the appearance model; None computes no features.
        recognise: the networks for actions; None recognises none.
        camera: how the camera's motion is estimated; None does not estimate it.
        batch_size: frames in one call of the detector, at least 1.
        bridging: when a correlation filter follows people whom the detector misses; None never does.
    """

    detect: Detect | Sequence[Detections]
    describe: Describe | None = None
    recognise: ActionRecogniser | None = None
    camera: CameraMotionSettings | None = None
    batch_size: int = 4
    bridging: BridgingSettings | None = None

    @property
    def history(self) -> int:
        """Number of frames before the current one that are needed."""
        flow = 0 if self.recognise is None else self.recognise.history
        return max(flow, 0 if self.camera is None else 1, 0 if self.bridging is None else self.bridging.most_frames)


def observe(
    frames: Iterable[Frame], observers: Observers, times: StageTimes | None = None, first: int = 0
) -> Iterator[Observation]:
    """Observations of the frames, one by one. In memory: one batch of frames, and those optical flow looks back to.

    Args:
        frames: consecutive frames; those before ``first`` are only history.
        observers: the networks and estimators.
        times: gets the seconds of the stages ``decode``, ``detect``, ``describe``, ``camera``, ``bridge`` and
            ``actions``.
        first: number of the first frame to observe.
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
                path.add(frame.image, found.boxes)
                motion = path.step(len(path) - 1)
        if bridge is not None:
            with times.measure("bridge"):
                missed = bridge.step(frame.image, found, None if motion is None else motion.similarity)
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
