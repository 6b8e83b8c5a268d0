"""The trackers of roboflow's ``trackers``, and ``arcsort``, over given detections; a program of `Peer`."""

import importlib
from importlib import metadata
from typing import Any

NAMES = {
    "ByteTrack": "ByteTrackTracker",
    "C-BIoU": "CBIoUTracker",
    "SORT": "SORTTracker",
    "OC-SORT": "OCSORTTracker",
    "ARC-SORT": "ARCTracker",
}


def version() -> str:
    """Of the packages."""
    return f"{metadata.version('trackers')}, arcsort {metadata.version('arcsort')}"


def answer(job: dict[str, Any]) -> dict[str, list[list[float]]]:
    """Rows frame, id, x1, y1, x2, y2, score by tracker.

    Args:
        job: ``boxes``, rows of frame, x1, y1, x2, y2, score; ``length``, frames; ``rate``, frames a second.
    """
    return {name: (arc_sort if name == "ARC-SORT" else follow)(attribute, job) for name, attribute in NAMES.items()}


def follow(attribute: str, job: dict[str, Any]) -> list[list[float]]:
    """The rows of one tracker with its defaults, at the frame rate of the video."""
    numpy, supervision = importlib.import_module("numpy"), importlib.import_module("supervision")
    tracker = getattr(importlib.import_module("trackers"), attribute)(frame_rate=job["rate"])
    boxes = numpy.array(job["boxes"], dtype=float).reshape(-1, 6)
    rows = []
    for frame in range(job["length"]):
        here = boxes[boxes[:, 0] == frame]
        found = supervision.Detections(
            xyxy=here[:, 1:5], confidence=here[:, 5], class_id=numpy.zeros(len(here), dtype=int)
        )
        answer = tracker.update(found)
        if answer.tracker_id is None:
            continue
        for box, score, number in zip(answer.xyxy, answer.confidence, answer.tracker_id, strict=True):
            if number >= 0:  # -1 is a detection without a confirmed track
                rows.append([frame, int(number) + 1, *map(float, box), float(score)])
    return rows


def arc_sort(attribute: str, job: dict[str, Any]) -> list[list[float]]:
    """The rows of ARC-SORT as its page recommends it, by boxes alone; it gives no scores."""
    numpy, package = importlib.import_module("numpy"), importlib.import_module("arcsort")
    tracker = getattr(package, attribute).from_preset("sportsmot", use_cmc=False)
    boxes = numpy.array(job["boxes"], dtype=float).reshape(-1, 6)
    rows = []
    for frame in range(job["length"]):
        found = numpy.insert(boxes[boxes[:, 0] == frame, 1:], 5, 0.0, axis=1)
        rows += [[frame, int(number), *map(float, box), 1.0] for *box, number in tracker.update(found)]
    return rows
