"""Frames a second of the online trackers on given detections, against a peer in the same run.

    python -m benchmarks.association.online [--frames 5500] [--people 7] [--repeat 5] [--sequence FOLDER ...]

The peers are those of roboflow's ``trackers``; ``pip install trackers`` brings them, and without it only our own
trackers are timed. The detections are those of walking people, or of MOTChallenge folders given with ``--sequence``
(one after the other until there are enough frames). Trackers take turns, repeatedly, and the best turn of each counts:
in CPU time of the process, so that a busy machine matters less. Use one thread: ``OMP_NUM_THREADS=1``.
"""

from __future__ import annotations

import argparse
import itertools
import time
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.machine import machine
from benchmarks.walkers import walking_people
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.sort import DeepSort, Sort
from tsuiseki.tracking.types import Detections


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5500)
    parser.add_argument("--people", type=int, default=7)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--sequence", nargs="*", default=[])
    settings = parser.parse_args()
    video = _given(settings.sequence, settings.frames) or walking_people(settings.frames, settings.people)
    turns: dict[str, Callable[[], float]] = {
        "tsuiseki SORT": lambda: _time_ours(Sort(), video),
        "tsuiseki DeepSORT, no features": lambda: _time_ours(DeepSort(), video),
        "tsuiseki ByteTrack": lambda: _time_ours(ByteTrack(), video),
        "tsuiseki OC-SORT": lambda: _time_ours(OcSort(), video),
    }
    peers = _peers(video)
    turns |= peers
    best = dict.fromkeys(turns, float("inf"))
    for _ in range(settings.repeat):
        for name, turn in turns.items():
            best[name] = min(best[name], turn())
    print(machine("numpy", "scipy", "trackers", "supervision"))
    print(f"{len(video)} frames, {sum(map(len, video)) / len(video):.1f} detections a frame, best of {settings.repeat}")
    print(f"{'tracker':32s}{'frames/s':>10s}{'times SORT':>12s}")
    for name, seconds in best.items():
        print(f"{name:32s}{len(video) / seconds:10.0f}{best['tsuiseki SORT'] / seconds:12.2f}")
    if not peers:
        print("no peer in this run: pip install trackers")


def _given(folders: list[str], frames: int) -> list[Detections]:
    """As many frames of given detections, the sequences repeated as often as needed."""
    video: list[Detections] = []
    for folder in folders:
        for sequence in find_sequences(folder):
            video += read_detections(sequence.detections_path, score_range=(-float("inf"), float("inf")))
    return list(itertools.islice(itertools.cycle(video), frames)) if video else []


def _time_ours(tracker: PeopleTracker, video: list[Detections]) -> float:
    start = time.process_time()
    for found in video:
        tracker.update(found)
    return time.process_time() - start


def _peers(video: list[Detections]) -> dict[str, Callable[[], float]]:
    """Times the peers on the same detections, in their own type made beforehand; none where they are not installed."""
    try:
        import supervision
        from trackers import ByteTrackTracker, OCSORTTracker, SORTTracker
    except ImportError:
        return {}
    theirs = [supervision.Detections(xyxy=found.boxes, confidence=found.scores) for found in video]
    warnings.filterwarnings("ignore")

    def turn(make: Callable[[], Any]) -> float:
        tracker = make()
        start = time.process_time()
        for found in theirs:
            tracker.update(found)
        return time.process_time() - start

    makers = {"SORT": SORTTracker, "ByteTrack": ByteTrackTracker, "OC-SORT": OCSORTTracker}
    return {f"roboflow trackers {name}": partial(turn, make) for name, make in makers.items()}


if __name__ == "__main__":
    main()
