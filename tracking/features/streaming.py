"""Networks over a stream of frames: batch by batch, on one core or several batches at a time on several.

A network that shares one picture among several cores waits for the slowest at every layer. Whole batches side by side
do not wait for each other, so each session runs on one thread (``threads=1``) and `stream` works on several batches.
The result is the same with any number of workers: batches are cut and networks run as with one.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeAlias

from tsuiseki.tracking.features.exported import ChoosingDetect, Describe, Detect
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame, ImageArray
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames

_Rows: TypeAlias = list[tuple[Frame, Detections]]


def stream(
    frames: Iterable[Frame],
    detect: Detect | Sequence[Detections],
    describe: Describe | None = None,
    batch_size: int = 4,
    times: StageTimes | None = None,
    workers: int = 1,
    inferred: InferenceFrames = ALL_INFERRED,
) -> Iterator[tuple[Frame, Detections]]:
    """Frames with the people detected in them, in order.

    Args:
        frames: the video.
        detect: finds people, or their given detections, one entry a frame number.
        describe: adds appearance features, where given.
        batch_size: frames of one inference call.
        times: gets the seconds of the stages ``decode``, ``detect`` and ``describe``.
        workers: batches that are worked on at a time; with more than one, ``detect`` and ``describe`` are called from
            several threads, and as many batches are decoded ahead: at most ``2 * workers * batch_size`` frames are
            held.
        inferred: frames that ``detect`` runs on, the others come without detections.
    """
    times = times or StageTimes()
    batches = _batches(frames, batch_size, times)
    if workers == 1:
        for batch in batches:
            yield from _detected(batch, _ready(detect, batch, times, 1, inferred), describe, times, inferred)
        return
    waiting: deque[Future[_Rows]] = deque()
    with ThreadPoolExecutor(workers, "tsuiseki") as pool:
        try:
            for batch in batches:
                ready = _ready(detect, batch, times, workers, inferred)
                waiting.append(pool.submit(_detected, batch, ready, describe, times, inferred))
                # What is finished, such as the first batch, is not kept waiting for what is behind it.
                while waiting and (len(waiting) >= 2 * workers or waiting[0].done()):
                    yield from waiting.popleft().result()
            while waiting:
                yield from waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _batches(frames: Iterable[Frame], size: int, times: StageTimes) -> Iterator[list[Frame]]:
    iterator = iter(frames)
    while True:
        with times.measure("decode"):
            batch = list(itertools.islice(iterator, size))
        if not batch:
            return
        yield batch


def _ready(
    detect: Detect | Sequence[Detections],
    batch: list[Frame],
    times: StageTimes,
    workers: int,
    inferred: InferenceFrames,
) -> Detect | Sequence[Detections]:
    """The detector for ``batch``; one that chooses its tiles does so here, in the order of the frames."""
    images = _images(batch, inferred)
    if not isinstance(detect, ChoosingDetect) or not images:
        return detect
    with times.measure("detect"):
        return detect.prepared(images, workers)


def _images(batch: list[Frame], inferred: InferenceFrames) -> list[ImageArray]:
    """Those that a detector runs on."""
    return [frame.image for frame in batch if inferred.at(frame.index)]


def _detected(
    batch: list[Frame],
    detect: Detect | Sequence[Detections],
    describe: Describe | None,
    times: StageTimes,
    inferred: InferenceFrames,
) -> _Rows:
    with times.measure("detect"):
        if isinstance(detect, Sequence):
            detections = [detect[f.index] if f.index < len(detect) else Detections.empty() for f in batch]
        else:
            images = _images(batch, inferred)
            answers = iter(detect.detect(images) if images else ())
            detections = [next(answers) if inferred.at(f.index) else Detections.empty() for f in batch]
    if describe is not None:
        with times.measure("describe"):
            pairs = zip(batch, detections, strict=True)
            detections = [d.with_features(describe.describe(f.image, d.boxes)) for f, d in pairs]
    return list(zip(batch, detections, strict=True))
