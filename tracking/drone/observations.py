"""Observations of the frames of a drone video: all that the tracker needs, computed before tracking.

An `Observation` holds the detections of a frame, their appearance features and action probabilities, and the camera's
motion. Observations can be stored on disk, so that a second run with other settings of the tracker takes seconds.

An entry of the store holds the observations of `CHUNK` frames and a checksum. Its name is a digest of the video, the
models and their settings. It is written to a temporary file that is then renamed. An entry that cannot be read, or
whose checksum is wrong, is computed again with a warning.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
import zlib
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import Describe, Detect
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.onnx import weight_files
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Frame, ImageArray
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.image_folder import ImageFolder


@dataclass(frozen=True)
class Observation:
    """Detections, features and camera motion of one frame.

    Attributes:
        frame: 0-based number.
        detections: people, with appearance features where there is an appearance model.
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
        camera: whether the camera's motion is estimated.
        batch_size: frames in one call of the detector, at least 1.
    """

    detect: Detect | Sequence[Detections]
    describe: Describe | None = None
    recognise: ActionRecogniser | None = None
    camera: bool = False
    batch_size: int = 4

    @property
    def history(self) -> int:
        """Number of frames before the current one that are needed."""
        flow = 0 if self.recognise is None else self.recognise.history
        return max(flow, 1 if self.camera else 0)


def observe(
    frames: Iterable[Frame], observers: Observers, times: StageTimes | None = None, first: int = 0
) -> Iterator[Observation]:
    """Observations of the frames, one by one. In memory: one batch of frames, and those that optical flow needs.

    Args:
        frames: consecutive frames; those before ``first`` are only history.
        observers: the networks and estimators.
        times: gets the seconds of the stages ``decode``, ``detect``, ``describe``, ``camera`` and ``actions``.
        first: number of the first frame to observe.
    """
    times = times or StageTimes()
    path = CameraPath() if observers.camera else None
    history = 0 if observers.recognise is None else observers.recognise.history
    images: deque[ImageArray] = deque(maxlen=history + 1)
    for frame, detections in stream(frames, observers.detect, observers.describe, observers.batch_size, times):
        images.append(frame.image)
        motion = None
        if path is not None:
            with times.measure("camera"):
                path.add(frame.image, detections.boxes)
                motion = path.step(len(path) - 1)
        if frame.index < first:
            continue
        actions = None
        if observers.recognise is not None:
            with times.measure("actions"):
                actions = observers.recognise.recognise(list(images), detections.boxes)
        yield Observation(frame.index, detections, actions, motion)


# Frames of an entry of the store.
CHUNK = 100
# Of the entries: another one is computed anew.
VERSION = 4
# What an entry's file begins with.
MAGIC = b"tsuiseki observations 1\n"


def _digest(key: Any) -> str:
    """A name for plain values: the same for the same values, whatever their order."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:32]


def file_digest(path: Path) -> str:
    """A digest of what is in a file; of an ONNX file, in those that hold its weights, too."""
    digest = hashlib.sha256(path.read_bytes())
    for file in weight_files(path):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:32]


def _write(path: Path, observations: list[Observation]) -> None:
    names = {number: name for o in observations for number, name in o.detections.names.items()}
    arrays: dict[str, np.ndarray[Any, Any]] = {
        "frames": np.array([o.frame for o in observations]),
        "counts": np.array([len(o.detections) for o in observations]),
        "boxes": np.concatenate([np.empty((0, 4)), *(o.detections.boxes for o in observations)]),
        "scores": np.concatenate([np.empty(0), *(o.detections.scores for o in observations)]),
        "origin": np.concatenate([np.empty((0, 2), np.int64), *(o.detections.origin for o in observations)]),
        "class_numbers": np.array([*names], dtype=np.int64),
        "class_names": np.array([*names.values()], dtype=np.str_),
        "has_motion": np.array([o.motion is not None for o in observations]),
        "motion": np.array([np.eye(3)[:2] if o.motion is None else o.motion.similarity for o in observations]),
        "deviation": np.array([0.0 if o.motion is None else o.motion.deviation for o in observations]),
    }
    features = [o.detections.features for o in observations]
    if all(part is not None for part in features):
        arrays["features"] = np.concatenate([part for part in features if part is not None])
    actions = [o.actions for o in observations]
    if all(part is not None for part in actions):
        arrays["actions"] = np.concatenate([part for part in actions if part is not None], axis=1)
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays)
    body = content.getvalue()
    with whole_file(path) as file:
        file.write(MAGIC + zlib.crc32(body).to_bytes(4, "big") + body)


def _read(path: Path, first: int, last: int) -> list[Observation] | None:
    """The entry at ``path``; None where there is none, or none that can be trusted."""
    if not path.exists():
        return None
    try:
        content = path.read_bytes()
        head, body = content[: len(MAGIC) + 4], content[len(MAGIC) + 4 :]
        if head != MAGIC + zlib.crc32(body).to_bytes(4, "big"):
            raise ValueError("its checksum is wrong")
        observations = _observations(read_arrays(path, "observations", io.BytesIO(body)))
        if [o.frame for o in observations] != list(range(first, last + 1)):
            raise ValueError("it holds other frames")
        return observations
    except (OSError, ValueError, KeyError, EOFError) as error:
        print(f"tsuiseki: warning: {path} is no usable cache entry ({error}); made anew", file=sys.stderr)
        return None


def _observations(arrays: Mapping[str, np.ndarray[Any, Any]]) -> list[Observation]:
    cuts = np.cumsum(arrays["counts"])[:-1]
    count = len(arrays["frames"])
    boxes, scores, origin = (np.split(arrays[name], cuts) for name in ("boxes", "scores", "origin"))
    names = dict(zip(arrays["class_numbers"].tolist(), arrays["class_names"].tolist(), strict=True))
    has_classes = bool((arrays["origin"][:, 1] >= 0).any())
    features = np.split(arrays["features"], cuts) if "features" in arrays else [None] * count
    actions = np.split(arrays["actions"], cuts, axis=1) if "actions" in arrays else [None] * count
    return [
        Observation(
            int(arrays["frames"][n]),
            Detections(
                boxes[n],
                scores[n],
                features[n],
                classes=origin[n][:, 1] if has_classes else None,
                sources=origin[n][:, 0],
                names=names,
            ),
            actions[n],
            CameraStep(arrays["motion"][n], float(arrays["deviation"][n])) if arrays["has_motion"][n] else None,
        )
        for n in range(count)
    ]


def video_observations(
    source: Source,
    observers: Observers,
    keys: Sequence[Mapping[str, Any]],
    cache: Path | None = None,
    times: StageTimes | None = None,
) -> Iterator[Observation]:
    """Observations of every frame, in order: detections, appearance features, action probabilities, camera motion.

    Args:
        source: a video that can be played again.
        observers: the detector, the networks and the estimate of the camera motion.
        keys: plain values that identify the observers: models and settings; then those of others whose observations
            include all that these give. Where the cache holds theirs and not these, theirs are read.
        cache: folder of the stored observations; None stores nothing.
        times: gets the seconds of every stage.

    Raises:
        RequestError: there is a cache, but the length of the video is not known.
    """
    if cache is None:
        yield from observe(source.frames(), observers, times)
        return
    if source.length is None:
        raise RequestError("`cache`: expected a video of known length, such as a folder of images; leave `cache` out")
    frame_range = source.frames_wanted.within(source.length)
    assert frame_range.last is not None
    files = source.images if isinstance(source, ImageFolder) else (Path(source.address),)
    # By name, size and time of change: quick, whatever their number.
    facts = [(path.name, (status := path.stat()).st_size, status.st_mtime_ns) for path in files]
    keys = [{**key, "video": _digest(facts), "start": frame_range.first} for key in keys]
    for first in range(frame_range.first, frame_range.last + 1, CHUNK):
        last = min(first + CHUNK - 1, frame_range.last)
        part = {"first": first, "last": last, "version": VERSION}
        paths = [cache / f"{_digest({**key, **part})}.npz" for key in keys]
        observations = next((read for path in paths if (read := _read(path, first, last)) is not None), None)
        if observations is None:
            # The frames before the first one are history for the optical flow.
            start = max(first - observers.history, frame_range.first)
            again = replace(source, frames_wanted=FrameRange(start, last)).frames()
            observations = list(observe(again, observers, times, first))
            _write(paths[0], observations)
        yield from observations
