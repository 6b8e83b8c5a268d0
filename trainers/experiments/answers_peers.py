"""supervision's LineZone and PolygonZone over tracks, and over its ByteTrack's; a program of `Peer`."""

import importlib
from importlib import metadata
from itertools import pairwise
from typing import Any


def version() -> str:
    """Of the package, and of the one with ByteTrack."""
    return f"{metadata.version('supervision')}, trackers {metadata.version('trackers')}"


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Crossings by line, to the right and back; people in the zone in each frame; mean seconds there.

    Args:
        job: ``rows`` of frame, id, x1, y1, x2, y2, score; ``track``, whether ids are to be found by ByteTrack;
            ``lines``, two ends each; ``zone``, corners; ``length``, frames; ``rate``, frames a second; ``corners``,
            whether all corners of a box must cross, as is its default, or the middle of the lower edge.
    """
    numpy, supervision = importlib.import_module("numpy"), importlib.import_module("supervision")
    rows = numpy.array(job["rows"], dtype=float).reshape(-1, 7)
    tracker = importlib.import_module("trackers").ByteTrackTracker(frame_rate=job["rate"]) if job["track"] else None
    anchors = {} if job["corners"] else {"triggering_anchors": [supervision.Position.BOTTOM_CENTER]}
    lines = [_line(supervision, ends, anchors) for ends in job["lines"]]
    zone = supervision.PolygonZone(polygon=numpy.array(job["zone"]).round().astype(int))
    occupancy, seconds = [], dict[int, int]()
    edges = numpy.searchsorted(rows[:, 0], numpy.arange(job["length"] + 1))
    for first, last in pairwise(edges):
        here = rows[first:last]
        found = supervision.Detections(
            xyxy=here[:, 2:6], confidence=here[:, 6], tracker_id=here[:, 1].astype(int),
            class_id=numpy.zeros(len(here), dtype=int),
        )  # fmt: skip
        if tracker is not None:
            found.tracker_id = None
            found = tracker.update(found)
            found = found[found.tracker_id >= 0] if found.tracker_id is not None else found[:0]
        for line in lines:
            line.trigger(found)
        within = zone.trigger(found)
        occupancy.append(int(within.sum()))
        for number in found.tracker_id[within].tolist() if len(found) else ():
            seconds[number] = seconds.get(number, 0) + 1
    right = _right_is_in(supervision, numpy, job["lines"][0], anchors)
    counts = [[line.in_count, line.out_count][:: 1 if right else -1] for line in lines]
    dwell = sum(seconds.values()) / len(seconds) / job["rate"] if seconds else 0.0
    return {"crossings": counts, "occupancy": occupancy, "dwell": dwell}


def _line(supervision: Any, ends: Any, anchors: Any) -> Any:
    points = [supervision.Point(*map(float, end)) for end in ends]
    return supervision.LineZone(start=points[0], end=points[1], **anchors)


def _right_is_in(supervision: Any, numpy: Any, ends: Any, anchors: Any) -> bool:
    """Whether going to the right of a line, as one looks along it, is what the package calls in."""
    line, (start, end) = _line(supervision, ends, anchors), numpy.array(ends, dtype=float)
    way = (end - start) / numpy.hypot(*(end - start))
    for side in (-50, 50):
        x, y = 0.5 * (start + end) + side * numpy.array([-way[1], way[0]])
        box = numpy.array([[x - 1, y - 2, x + 1, y]])
        line.trigger(supervision.Detections(xyxy=box, tracker_id=numpy.array([1])))
    return bool(line.in_count)
