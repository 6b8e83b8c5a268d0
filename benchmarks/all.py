"""One table of a release: CPU time of our methods beside their peers, in the same run.

    python -m benchmarks.all [--json] [--small] [--repeat 3] [--record]

A peer that is not installed is named as absent; ``pip install ortools trackers supervision stonesoup arcsort
opencv-contrib-python-headless`` brings all of them. Ours and the peer take turns on the same input, and the best turn
of each counts, in seconds of the processor. ``--small`` takes inputs of a second or two. ``--record`` writes the table
into docs/results/speed.md. Use one thread: ``OMP_NUM_THREADS=1``. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import cv2
import numpy as np

from benchmarks.machine import machine, peak_memory
from benchmarks.papers import records
from benchmarks.papers.tables import Table
from benchmarks.walkers import walking_people
from tsuiseki.tracking.association.flow_window import FlowWindow
from tsuiseki.tracking.association.inference_times import InferenceTimes
from tsuiseki.tracking.association.network_flow import FlowGraph
from tsuiseki.tracking.association.sliding_flow import solve_in_windows
from tsuiseki.tracking.features.optical_flow import tv_l1
from tsuiseki.tracking.filters.resampling import systematic
from tsuiseki.tracking.geometry import suppress
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowInput, FlowSettings
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.report.overlay import Overlay, write_drawn
from tsuiseki.tracking.types import Detections, FloatArray, Frame, ImageArray

PACKAGES = ("numpy", "scipy", "ortools", "trackers", "supervision", "stonesoup", "arcsort", "opencv-python-headless")
FRAME_RATE = 30.0
Turn: TypeAlias = Callable[[], object]


@dataclass(frozen=True)
class Pair:
    """A task, with what does it.

    Attributes:
        task: its name, with the size of the input.
        ours: does it once.
        peer: name of who does the same.
        theirs: makes what does it once.
    """

    task: str
    ours: Turn
    peer: str
    theirs: Callable[[], Turn]


@dataclass(frozen=True)
class Row:
    """CPU seconds of a task; None where the peer is absent."""

    task: str
    ours: float
    peer: str
    theirs: float | None


def main() -> None:
    """Measure, and print the table or its JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--record", action="store_true")
    settings = parser.parse_args()
    warnings.filterwarnings("ignore")
    cv2.setNumThreads(1)
    rows = [measured(pair, settings.repeat) for pair in pairs(settings.small)]
    about = machine(*PACKAGES)
    if settings.record:
        (records.RECORDS / "speed.json").write_text(recorded(rows, settings.repeat, about), encoding="utf-8")
        records.refresh_pages()
    if settings.json:
        print(json.dumps({"machine": about, "memory": peak_memory(), "rows": [vars(row) for row in rows]}, indent=1))
    else:
        print(f"{about}\n{table(rows)}\npeak memory {peak_memory():.2f} GB")


def pairs(small: bool) -> Iterator[Pair]:
    """The tasks of the table, one input at a time in memory."""
    yield from _of_walkers(small)
    yield from _of_arrays(small)
    yield _of_pictures(20 if small else 200)


def _of_walkers(small: bool) -> Iterator[Pair]:
    """Tracks of people who walk about, and the flow that they are."""
    frames, people = (100, 5) if small else (524, 46)
    video, size = walking_people(frames, people), f"{frames} frames x {people}"
    trackers = (("SORT", Sort, "SORTTracker"), ("ByteTrack", ByteTrack, "ByteTrackTracker"))
    for name, tracker, peer in (*trackers, ("OC-SORT", OcSort, "OCSORTTracker")):
        theirs = partial(_roboflow, peer, video)
        yield Pair(f"{name}, {size}", partial(_follow, tracker, video), f"trackers {name}", theirs)
    flow = partial(run_tracker, video)
    yield Pair(
        f"flow, {size}",
        lambda: flow(FlowTracker(frame_rate=FRAME_RATE)),
        "trackers ByteTrack",
        partial(_roboflow, "ByteTrackTracker", video),
    )
    yield Pair(
        f"flow against ARC-SORT, {size}",
        lambda: flow(FlowTracker(frame_rate=FRAME_RATE)),
        "ARC-SORT",
        partial(_arc_sort, video),
    )
    graph = _network(video)
    links = f"{len(graph)} detections, {len(graph.tail)} links"
    yield Pair(f"min-cost flow, {links}", partial(solve_in_windows, graph), "OR-tools", lambda: _or_tools(graph))


def _of_arrays(small: bool) -> Iterator[Pair]:
    """What trackers and filters are made of, on random boxes, weights and pictures."""
    rng = np.random.default_rng(0)
    count = 200 if small else 2000
    corner = rng.uniform(0, 1000, (count, 2))
    boxes, scores = np.hstack([corner, corner + rng.uniform(20, 100, (count, 2))]), rng.random(count)
    yield Pair(
        f"suppression, {count} boxes",
        partial(suppress, boxes, scores, 0.5),
        "supervision",
        lambda: _supervision(np.column_stack([boxes, scores])),
    )
    weights = rng.random(10_000 if small else 1_000_000)
    weights /= weights.sum()
    yield Pair(
        f"systematic resampling, {len(weights)}",
        lambda: systematic(weights, len(weights), np.random.default_rng(0)),
        "Stone Soup",
        lambda: _stone_soup(weights),
    )
    width, height = (160, 120) if small else (640, 480)
    first = np.asarray(cv2.GaussianBlur(rng.integers(0, 256, (height, width)).astype(np.uint8), (0, 0), 3), np.uint8)
    second = np.roll(first, 2, axis=1)
    yield Pair(
        f"TV-L1, {width}x{height}",
        partial(tv_l1, first, second),
        "OpenCV contrib DualTVL1",
        lambda: _dual_tv_l1(first, second),
    )


def _of_pictures(count: int) -> Pair:
    """Drawing people into a video, beside detecting and tracking whom it shows."""
    rng, size = np.random.default_rng(0), (360, 480, 3)
    still = cv2.GaussianBlur(rng.integers(0, 256, size).astype(np.uint8), (0, 0), 5)
    pictures = [np.asarray(cv2.add(still, rng.integers(0, 6, size).astype(np.uint8)), np.uint8) for _ in range(count)]
    frames = [Frame(number, number / FRAME_RATE, picture) for number, picture in enumerate(pictures)]
    overlay = Overlay(run_tracker(walking_people(count, 8), Sort()), FRAME_RATE)

    def drawn() -> None:
        with TemporaryDirectory() as folder:
            write_drawn(Path(folder) / "overlay.webm", frames, FRAME_RATE, overlay.draw)

    track = partial(track_people, pictures, frame_rate=FRAME_RATE, threads=1)
    return Pair(f"overlay, {count} frames of 480x360", drawn, "track_people on them", lambda: track)


def measured(pair: Pair, repeat: int) -> Row:
    """The best of several turns of both."""
    try:
        theirs = pair.theirs()
    except ImportError:
        theirs = None
    ours, peer = float("inf"), float("inf")
    for _ in range(repeat):
        ours = min(ours, _seconds(pair.ours))
        peer = peer if theirs is None else min(peer, _seconds(theirs))
    return Row(pair.task, ours, pair.peer, None if theirs is None else peer)


def table(rows: list[Row]) -> str:
    """The rows as text, with how many times as long the peer takes."""
    lines = [f"{'task':52s}{'ours, s':>10s}  {'peer':26s}{'peer, s':>10s}{'ratio':>8s}"]
    for row in rows:
        theirs = f"{'absent':>10s}" if row.theirs is None else f"{row.theirs:10.3f}{row.theirs / row.ours:8.2f}"
        lines.append(f"{row.task:52s}{row.ours:10.3f}  {row.peer:26s}{theirs}")
    return "\n".join(lines)


def recorded(rows: list[Row], repeat: int, about: str) -> str:
    """The data file of the page."""
    cells = [
        (row.task, f"{row.ours:.2g}", row.peer, "absent" if row.theirs is None else f"{row.theirs / row.ours:.2g}")
        for row in rows
    ]
    heads = ("task", "CPU [s]", "peer", "its time, of ours")
    return records.record(
        ["--repeat", str(repeat), "--record"],
        {"repeat": repeat},
        [Table("Speed", heads, cells)],
        [about],
        "benchmarks.all",
    )


def _seconds(turn: Turn) -> float:
    start = time.process_time()
    turn()
    return time.process_time() - start


def _follow(make: Callable[[], Any], video: list[Detections]) -> None:
    tracker = make()
    for detections in video:
        tracker.update(detections)


def _network(video: list[Detections]) -> FlowGraph:
    """The network of the first round."""
    settings = FlowSettings()
    flow_input = FlowInput(settings.input, InferenceTimes(FRAME_RATE), None)
    rows, scores, _ = flow_input.rows(video)
    window = FlowWindow(settings.costs, FRAME_RATE, None)
    window.add(rows)
    return window.graph(flow_input.costs(scores))


def _roboflow(name: str, video: list[Detections]) -> Turn:
    import supervision
    import trackers

    theirs = [supervision.Detections(xyxy=entry.boxes, confidence=entry.scores) for entry in video]

    def turn() -> None:
        tracker = getattr(trackers, name)()
        for entry in theirs:
            tracker.update(entry)

    return turn


def _arc_sort(video: list[Detections]) -> Turn:
    import arcsort

    # Its rows end with a class.
    theirs = [np.column_stack([entry.boxes, entry.scores, np.zeros(len(entry))]) for entry in video]

    def turn() -> None:
        tracker = arcsort.ARCTracker.from_preset("sportsmot", use_cmc=False)
        for entry in theirs:
            tracker.update(entry)

    return turn


def _or_tools(graph: FlowGraph) -> Turn:
    """Its solver once the arcs are in."""
    from benchmarks.association.flow import network_of

    solve: Turn = network_of(graph).solve
    return solve


def _supervision(predictions: FloatArray) -> Turn:
    from supervision.detection.utils.iou_and_nms import box_non_max_suppression

    return partial(box_non_max_suppression, predictions, 0.5)


def _stone_soup(weights: FloatArray) -> Turn:
    from stonesoup.resampler.particle import SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.state import ParticleState

    particles = ParticleState(StateVectors(np.zeros((1, len(weights)))), weight=weights)
    return lambda: SystematicResampler().resample(particles)


def _dual_tv_l1(first: ImageArray, second: ImageArray) -> Turn:
    if not hasattr(cv2, "optflow"):
        raise ImportError("expected OpenCV with its contrib modules")
    return partial(cv2.optflow.createOptFlow_DualTVL1().calc, first, second, None)


if __name__ == "__main__":
    main()
