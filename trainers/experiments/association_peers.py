"""Runs the trackers of roboflow's ``trackers`` over given detections, in an environment of its own.

    python peer_program.py < job.json > result.json

A job is ``{"boxes": [[frame, x1, y1, x2, y2, score], …], "length": frames, "rate": frames a second}``; the result is
``{"version": …, "tracks": {tracker: [[frame, id, x1, y1, x2, y2, score], …]}}``. Nothing of Tsuiseki is imported here.
"""

import importlib
import json
import sys
import warnings
from importlib import metadata

NAMES = {
    "ByteTrack": "ByteTrackTracker",
    "C-BIoU": "CBIoUTracker",
    "SORT": "SORTTracker",
    "OC-SORT": "OCSORTTracker",
}


def main() -> None:
    """Answer one job."""
    warnings.filterwarnings("ignore")
    version = metadata.version("trackers")
    if sys.argv[1:] == ["--version"]:
        print(version)
        return
    job = json.load(sys.stdin)
    tracks = {name: follow(attribute, job) for name, attribute in NAMES.items()}
    json.dump({"version": version, "tracks": tracks}, sys.stdout)


def follow(attribute: str, job: dict) -> list:  # type: ignore[type-arg]
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
            if number >= 0:  # -1 is a detection of nobody whom the tracker believes in yet
                rows.append([frame, int(number) + 1, *map(float, box), float(score)])
    return rows


if __name__ == "__main__":
    main()
