"""People on one floor through several cameras: labels of WILDTRACK and Shelf, and generated places with pictures."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from cyclopts.types import NonNegativeInt, PositiveInt
from matplotlib.figure import Figure

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.plots import Curve, curves
from benchmarks.papers.store import Cached, write_planned
from benchmarks.papers.tables import Column, Table, median_only, tabulated, with_interval
from tsuiseki.datamodules.scenes.room_clip import FloorClipSettings, RoomClip
from tsuiseki.tracking.cameras.multicamera import (
    FloorFolder,
    PlacedTruth,
    StandingPeople,
    read_floor_folder,
    read_placed_truth,
)
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.floor.measured_floor import CameraFeed, MeasuredFloor, measured_floor
from tsuiseki.tracking.floor.run import open_floor
from tsuiseki.tracking.floor.tracker import flow_on_one_floor
from tsuiseki.tracking.formats.world_tables import FloorPositions
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, IntArray

MISSED, FALSE, NOISE = 0.3, 2.0, 0.05
"""Share of the labels' boxes, false ones a view and frame, and deviation of an edge of the height."""
RECALL, PRECISION, DEVIATION = 0.95, 0.94, 0.2
"""Of detections on the floor as MVDet's on this data; metres."""
NEAREST, SIDE = 1.0, 1.5
"""Metres within which the baseline groups detections, and the side of the squares that SORT follows."""
SHELF_NEAR = 0.3
PUBLISHED = (("MCBLT, from pictures", "95.6", ""), ("MVTrajecter, from pictures", "", "94.3"))
Method: TypeAlias = Literal["flow", "nearest and SORT", "floor detections"]


def reproduce(
    *,
    store: Cached,
    data: Path = Path("../shared/data"),
    seeds: PositiveInt = 5,
    seed: NonNegativeInt = 200,
    places: NonNegativeInt = 5,
) -> Outcome:
    """People on one floor: all cameras together, fewer, and nearest-neighbour grouping with SORT.

    DIR gets results.json, tables.md and cameras.png.

    Args:
        store: of what was computed.
        data: folder that holds multicamera/wildtrack and multicamera/shelf.
        seeds: draws of misses, false alarms and noise.
        seed: of the first. Settings were chosen with the seeds 100 and 101.
        places: generated ones with pictures, from ``seed`` on; 201 and 204 chose the weight of appearance.
    """
    folder = data / "multicamera/wildtrack"
    all_cameras = tuple(range(len(read_floor_folder(folder).cameras)))
    counts = range(2, len(all_cameras) + 1)
    names = [*(f"{count} cameras" for count in counts[:-1]), "all cameras"]
    rows = {name: partial(measure, folder, all_cameras[:n], "flow") for n, name in zip(counts, names, strict=True)}
    rows |= {f"camera {k + 1} alone": partial(measure, folder, (k,), "flow") for k in all_cameras}
    rows |= {
        "nearest grouping, SORT": partial(measure, folder, all_cameras, "nearest and SORT"),
        "detections on the floor alone": partial(measure, folder, (), "floor detections"),
    }
    units = list(range(seed, seed + seeds))
    measured = store.study(rows, units)
    columns = [
        *(Column(name, name.lower(), ".1f", 100, with_interval) for name in ("IDF1", "MOTA", "HOTA")),
        *(Column(name, name.lower(), ".1f", 100) for name in ("MODA", "MODP")),
        Column("switches", "switches", ".0f"),
        Column("ms a moment", "milliseconds", ".0f", show=median_only),
    ]
    shelf = store.recall(shelf_scores, data / "multicamera/shelf")
    tables = [
        tabulated(measured, columns, title="WILDTRACK, 360 frames, labels with simulated errors"),
        Table("Published on WILDTRACK's last 40 frames, which are not used here", ("", "IDF1", "MOTA"), PUBLISHED),
        Table(
            "Shelf, given keypoints",
            ("person", "frames", f"within {SHELF_NEAR:g} m, %", "ids"),
            [(name, str(n), f"{100 * near:.1f}", str(ids)) for name, n, near, ids in shelf],
        ),
    ]
    settings = FloorClipSettings(frames=FRAMES, people=PEOPLE, cameras=CAMERAS)
    clips = [store.made("clip", write_planned, RoomClip, settings, seed + n) for n in range(places)]
    if places:
        tables.append(_of_places(store.study({"generated places": place_scores}, clips, "places")))
    note = (
        f"Boxes: {MISSED:.0%} missed, {FALSE:g} false a view and frame, edges off by {NOISE:.0%} of the height. Seeds "
        f"{units[0]} to {units[-1]}; [a, b] is the 95 % interval over them. The published values are from pictures, "
        "with appearance; here are labels' boxes with errors, and no appearance."
    )
    plots = {"cameras": _plot(measured, counts, names)}
    return Outcome({"wildtrack": measured, "shelf": shelf}, tables, plots, notes=[note])


def _plot(measured: Mapping[str, Sequence[Mapping[str, float]]], counts: Sequence[int], names: Sequence[str]) -> Figure:
    """IDF1 and MOTA against the number of cameras."""
    lines = [
        Curve(key.upper(), counts, [100 * float(np.mean([run[key] for run in measured[name]])) for name in names])
        for key in ("idf1", "mota")
    ]
    return curves({"WILDTRACK": lines}, ("cameras",), "%")


def _of_places(measured: Mapping[str, Sequence[dict[str, float]]]) -> Table:
    named = {
        "IDF1": "idf1", "MOTA": "mota", "IDF1, mean of each camera alone": "idf1_alone",
        "MOTA, mean of each alone": "mota_alone", "gain of IDF1": "gain", "ids kept, %": "kept",
    }  # fmt: skip
    columns = [Column(name, key, ".1f", 100, with_interval) for name, key in named.items()]
    title = f"Generated places with pictures: {CAMERAS} cameras, {PEOPLE} people, {FRAMES} frames"
    return tabulated(measured, [*columns, Column("changes of view", "changes", ".0f")], title=title)


def measure(folder: Path, cameras: Sequence[int], method: Method, seed: int) -> dict[str, float]:
    """Scores on one draw, and milliseconds of processor time a moment.

    Args:
        folder: of WILDTRACK.
        cameras: which of them.
        method: how people are followed.
        seed: of the draw.
    """
    recording, rng = read_floor_folder(folder), np.random.default_rng(seed)
    floor, length = recording.cameras[0].floor, len(recording.people[0])
    positions = [floor_detections(recording, rng)] if method == "floor detections" else []
    boxes = simulated(recording, rng) if cameras else []
    feeds = [CameraFeed(recording.cameras[k], np.arange(length) / 2.0, boxes[k]) for k in cameras]
    measured = measured_floor(feeds, positions, floor)
    begin = time.process_time()
    people = _by_sort(measured) if method == "nearest and SORT" else _followed(measured)
    spent = 1000 * (time.process_time() - begin) / length
    return {**asdict(evaluate_on_floor(recording.truth, people)), "milliseconds": spent}


def simulated(recording: FloorFolder, rng: np.random.Generator) -> list[list[StandingPeople]]:
    """The labels' boxes of every camera with misses, noise and false alarms as large as people of that view."""
    result = []
    for placed, people in zip(recording.cameras, recording.people, strict=True):
        labelled_boxes = np.concatenate([standing.detections.boxes for standing in people])
        size, view = np.array([placed.camera.width, placed.camera.height]), []
        for standing in people:
            boxes = standing.detections.boxes
            boxes = boxes[rng.random(len(boxes)) >= MISSED]
            boxes = boxes + NOISE * (boxes[:, 3:] - boxes[:, 1:2]) * rng.standard_normal(boxes.shape)
            like = labelled_boxes[rng.integers(len(labelled_boxes), size=rng.poisson(FALSE))]
            half, centre = (like[:, 2:] - like[:, :2]) / 2, rng.random((len(like), 2)) * size
            boxes = np.concatenate([boxes, np.concatenate([centre - half, centre + half], axis=1)])
            boxes = boxes[(boxes[:, 2:] > boxes[:, :2]).all(axis=1)]
            view.append(StandingPeople.of(Detections(boxes, np.ones(len(boxes)))))
        result.append(view)
    return result


def floor_detections(recording: FloorFolder, rng: np.random.Generator) -> FloorPositions:
    """Detections on the floor, as a multi-view detector gives them."""
    truth, floor = recording.truth, recording.cameras[0].floor
    assert floor is not None
    hit = rng.random(len(truth.times)) < RECALL
    moments = np.unique(truth.times)
    false = rng.poisson(hit.sum() * (1 / PRECISION - 1))
    noise = DEVIATION / np.sqrt(2) * rng.standard_normal((int(hit.sum()), 2))
    times = np.concatenate([truth.times[hit], rng.choice(moments, false)])
    places = np.concatenate([truth.places[hit] + noise, rng.uniform(floor[:2], floor[2:], (false, 2))])
    order = np.argsort(times, kind="stable")
    deviations_and_ids = np.full(len(times), DEVIATION), np.full(len(times), -1)
    return FloorPositions(Path("floor detections"), times[order], places[order], *deviations_and_ids)


def _by_sort(measured: MeasuredFloor) -> PlacedTruth:
    """The baseline: each detection joins the nearest group without its camera; groups of two or more go to SORT."""
    points, frames = measured.points, []
    for moment in range(len(measured.moments)):
        groups: list[list[int]] = []
        for k in np.flatnonzero(points.moment == moment).tolist():
            means = np.array([points.places[group].mean(axis=0) for group in groups]).reshape(-1, 2)
            away = np.linalg.norm(means - points.places[k], axis=1)
            away[[points.sensor[k] in points.sensor[group] for group in groups]] = np.inf
            if len(away) and away.min() < NEAREST:
                groups[int(away.argmin())].append(k)
            else:
                groups.append([k])
        means = np.array([points.places[group].mean(axis=0) for group in groups if len(group) > 1]).reshape(-1, 2)
        frames.append(Detections(np.concatenate([means - SIDE / 2, means + SIDE / 2], axis=1), np.ones(len(means))))
    tracks = run_tracker(frames, Sort())
    people = [(t.frames, np.full(len(t), t.id), centres(t.boxes)) for t in tracks]
    frames_of, ids, places = (np.concatenate(column) for column in zip(*people, strict=True))
    return PlacedTruth(measured.times[frames_of], ids, places)


def shelf_scores(folder: Path) -> list[tuple[str, int, float, int]]:
    """Of each labelled person: name, frames, the share with a track near, and how many ids were nearest."""
    recording = read_floor_folder(folder)
    rate = recording.cameras[0].frame_rate or 1.0
    moments = np.arange(len(recording.people[0])) / rate
    feeds = [CameraFeed(*fields) for fields in zip(recording.cameras, repeat(moments), recording.people, strict=False)]
    people = _followed(measured_floor(feeds, []))
    rows = []
    for who in np.unique(recording.truth.ids):
        ids = nearest_ids(recording.truth, people, who, 0.5 / rate, SHELF_NEAR)
        rows.append((str(who), len(ids), float(np.mean(ids >= 0)), len(np.unique(ids[ids >= 0]))))
    return rows


def nearest_ids(truth: PlacedTruth, tracks: PlacedTruth, who: int, seconds: float, metres: float) -> IntArray:
    """``(T,)`` id of the nearest track within so many seconds and metres of each label of a person, -1 for none."""
    rows, result = truth.ids == who, list[int]()
    for moment, place in zip(truth.times[rows], truth.places[rows], strict=True):
        there = np.flatnonzero(np.abs(tracks.times - moment) < seconds)
        apart = np.linalg.norm(tracks.places[there] - place, axis=1)
        near = len(there) > 0 and apart.min() <= metres
        result.append(int(tracks.ids[there[apart.argmin()]]) if near else -1)
    return np.array(result, dtype=np.int64)


FRAMES, PEOPLE, CAMERAS = 100, 8, 4
NEAR, APART = 1.0, 1.0
"""Metres within which a track is on a person, and seconds after a person leaves a view within which another counts."""


def place_scores(folder: Path) -> dict[str, float]:
    """IDF1 and MOTA of all cameras together, means over each alone, and changes of view with the id kept."""
    truth, views = read_placed_truth(folder), sorted(folder.glob("camera?"))
    floor = open_floor([str(view) for view in views], folder / "cameras.yaml", None, ()).measured(StageTimes())
    together = _followed(floor)
    plan = floor.feeds[0].placed.floor
    alone = [evaluate_on_floor(truth, _followed(measured_floor([feed], [], plan))) for feed in floor.feeds]
    moments = len(np.unique(truth.times))
    in_view = {int(who): np.zeros((moments, len(views)), dtype=np.bool_) for who in np.unique(truth.ids)}
    for camera, view in enumerate(views):
        rows = np.loadtxt(view / "gt" / "world.csv", delimiter=",", skiprows=1, ndmin=2)
        for frame, who in rows[:, :2].astype(int):
            in_view[who][frame - 1, camera] = True
    ids_kept, changes = kept_ids(truth, together, in_view)
    scores = evaluate_on_floor(truth, together)
    idf1, mota = np.mean([(camera.idf1, camera.mota) for camera in alone], axis=0).tolist()
    return {
        "idf1": scores.idf1, "mota": scores.mota, "idf1_alone": idf1, "mota_alone": mota, "gain": scores.idf1 - idf1,
        "changes": changes, "kept": ids_kept / max(changes, 1),
    }  # fmt: skip


def _followed(measured: MeasuredFloor) -> PlacedTruth:
    """The rows of the tracks of the flow."""
    people = flow_on_one_floor(measured)
    return PlacedTruth(
        np.concatenate([np.empty(0), *(person.times for person in people)]),
        np.concatenate([np.empty(0, np.int64), *(np.full(len(person), person.id) for person in people)]),
        np.concatenate([np.empty((0, 2)), *(person.positions for person in people)]),
    )


def kept_ids(truth: PlacedTruth, tracks: PlacedTruth, in_view: dict[int, np.ndarray]) -> tuple[int, int]:
    """Changes of view in which the person bears one id before and after, and all changes.

    ``in_view`` is ``(T, C)`` of each person: in which camera's labels the person is at each moment.

    A change is a frame in which a person leaves a camera's view, and within `APART` seconds is in that of another. The
    id before is that of the nearest track within `NEAR` metres in the last frame in the view; after, likewise in the
    first frame in another view that the person was not in before, or a second later where all were entered before.
    """
    times = np.unique(truth.times)
    step = float(np.median(np.diff(times)))
    wait, same, changes = round(APART / step), 0, 0
    for who, visible in in_view.items():
        ids = np.full(len(times), -1)
        ids[np.searchsorted(times, truth.times[truth.ids == who])] = nearest_ids(truth, tracks, who, 0.5 * step, NEAR)
        for frame, camera in np.argwhere(visible[:-1] & ~visible[1:]).tolist():
            later = visible[frame + 1 : frame + 1 + wait].copy()
            later[:, camera] = False
            if not later.any():
                continue
            entered = np.flatnonzero((later & ~visible[frame]).any(axis=1))
            entry = frame + 1 + (int(entered[0]) if len(entered) else len(later) - 1)
            changes += 1
            same += ids[frame] >= 0 and ids[frame] == ids[entry]
    return same, changes
