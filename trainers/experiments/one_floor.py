"""People on one floor through several cameras: labels of WILDTRACK and Shelf, and generated places with pictures."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from scipy.spatial.distance import cdist

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.room_clip import FloorClipSettings, plan_floor
from tsuiseki.tracking.cameras.multicamera import (
    FloorFolder,
    PlacedTruth,
    StandingPeople,
    read_floor_folder,
    read_placed_truth,
)
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.floor.floor_flow import FloorFlow
from tsuiseki.tracking.floor.foot_points import FootNoise
from tsuiseki.tracking.floor.measured_floor import CameraFeed, MeasuredFloor, measured_floor
from tsuiseki.tracking.floor.run import open_floor
from tsuiseki.tracking.floor.tracker import flow_on_one_floor
from tsuiseki.tracking.formats.world_tables import FloorPositions
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.people.tracker import run_tracker
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.trainers.experiments import study
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Bench, Column, Curve, Outcome, Study, Table, tabulated

MISSED, FALSE, NOISE = 0.3, 2.0, 0.05
"""Share of the labels' boxes, false ones a view and frame, and deviation of an edge of the height."""
RECALL, PRECISION, DEVIATION = 0.95, 0.94, 0.2
"""Of detections on the floor as MVDet's on this data; metres."""
NEAREST, SIDE = 1.0, 1.5
"""Metres within which the baseline groups detections, and the side of the squares that SORT follows."""
SHELF_NEAR = 0.3
PUBLISHED = (
    ("MCBLT, from pictures", "95.6", ""),
    ("MVTrajecter, from pictures", "", "94.3"),
)
Method: TypeAlias = Literal["flow", "nearest and SORT", "floor detections"]


@dataclass(frozen=True)
class FollowedBy:
    """What is compared.

    Attributes:
        folder: of WILDTRACK.
        cameras: which of them.
        method: how they are followed.
    """

    folder: Path
    cameras: tuple[int, ...]
    method: Method = "flow"


def reproduce(
    bench: Bench, data: Path = Path("../shared/data"), seeds: int = 5, seed: int = 200, places: int = 5
) -> Outcome:
    """People on one floor: all cameras together, fewer, and nearest-neighbour grouping with SORT.

    DIR gets results.json, tables.md and cameras.png.

    Args:
        bench: where it works.
        data: folder that holds multicamera/wildtrack and multicamera/shelf.
        seeds: draws of misses, false alarms and noise.
        seed: of the first. Settings were chosen with the seeds 100 and 101.
        places: generated ones with pictures, from ``seed`` on; 201 and 204 chose the weight of appearance.
    """
    study.at_least_one(seeds=seeds)
    folder = data / "multicamera/wildtrack"
    every = tuple(range(len(read_floor_folder(folder).cameras)))
    rows = {f"{count} cameras": FollowedBy(folder, every[:count]) for count in every[2:]}
    rows["all cameras"] = FollowedBy(folder, every)
    rows |= {f"camera {k + 1} alone": FollowedBy(folder, (k,)) for k in every}
    rows |= {
        "nearest grouping, SORT": FollowedBy(folder, every, "nearest and SORT"),
        "detections on the floor alone": FollowedBy(folder, (), "floor detections"),
    }
    units = list(range(seed, seed + seeds))
    found = Study(rows, units, measure, "runs").run(bench)
    columns = [
        Column("IDF1", "idf1", ".1f", 100, study.with_interval),
        Column("MOTA", "mota", ".1f", 100, study.with_interval),
        Column("HOTA", "hota", ".1f", 100, study.with_interval),
        *(Column(name, key, ".1f", 100) for name, key in (("MODA", "moda"), ("MODP", "modp"))),
        Column("switches", "switches", ".0f"),
        Column("ms a moment", "milliseconds", ".0f", show=study.median_only),
    ]
    shelf = bench.store.recall(shelf_scores, data / "multicamera/shelf")
    tables = [
        tabulated(found, columns, title="WILDTRACK, 360 frames, labels with simulated errors"),
        Table("Published on WILDTRACK's last 40 frames, which are not used here", ("", "IDF1", "MOTA"), PUBLISHED),
        Table(
            "Shelf, given keypoints",
            ("person", "frames", f"within {SHELF_NEAR:g} m, %", "ids"),
            [(name, str(n), f"{100 * near:.1f}", str(ids)) for name, n, near, ids in shelf],
        ),
    ]
    if places:
        drawn = Study({"generated places": bench.store}, range(seed, seed + places), measure_place, "places").run(bench)
        tables.append(_of_places(drawn))
    counts = list(every[1:])
    names = [f"{count + 1} cameras" if count < every[-1] else "all cameras" for count in counts]
    lines = [
        Curve(label, [c + 1 for c in counts], [100 * float(np.mean([r[key] for r in found[n]])) for n in names])
        for label, key in (("IDF1", "idf1"), ("MOTA", "mota"))
    ]
    note = (
        f"Boxes: {MISSED:.0%} missed, {FALSE:g} false a view and frame, edges off by {NOISE:.0%} of the height. Seeds "
        f"{units[0]} to {units[-1]}; [a, b] is the 95 % interval over them. The published values are from pictures, "
        "with appearance; here are labels' boxes with errors, and no appearance."
    )
    values = {"wildtrack": dict(found), "shelf": shelf}
    return Outcome(values, tables, {"cameras": study.curves({"WILDTRACK": lines}, ("cameras",), "%")}, notes=[note])


def _of_places(found: Mapping[str, Sequence[dict[str, float]]]) -> Table:
    columns = [
        Column(name, key, ".1f", 100, study.with_interval)
        for name, key in (
            ("IDF1", "idf1"), ("MOTA", "mota"), ("IDF1, mean of each camera alone", "idf1_alone"),
            ("MOTA, mean of each alone", "mota_alone"), ("gain of IDF1", "gain"), ("ids kept, %", "kept"),
        )
    ]  # fmt: skip
    title = f"Generated places with pictures: {CAMERAS} cameras, {PEOPLE} people, {FRAMES} frames"
    return tabulated(found, [*columns, Column("changes of view", "changes", ".0f")], title=title)


def measure(row: FollowedBy, seed: int) -> dict[str, float]:
    """Scores of a row on one draw, and milliseconds of processor time a moment."""
    known = read_floor_folder(row.folder)
    rng = np.random.default_rng(seed)
    floor, length = known.cameras[0].floor, len(known.people[0])
    if row.method == "floor detections":
        measured = measured_floor([], [floor_detections(known, rng)], floor, FootNoise(), None)
    else:
        boxes = simulated(known, rng)
        feeds = [CameraFeed(known.cameras[k], np.arange(length) / 2.0, boxes[k]) for k in row.cameras]
        measured = measured_floor(feeds, [], floor, FootNoise(), None)
    begin = time.process_time()
    found = (
        _by_sort(measured) if row.method == "nearest and SORT" else as_placed(flow_on_one_floor(measured, FloorFlow()))
    )
    spent = 1000 * (time.process_time() - begin) / length
    return {**asdict(evaluate_on_floor(known.truth, found)), "milliseconds": spent}


def simulated(known: FloorFolder, rng: np.random.Generator) -> list[list[StandingPeople]]:
    """The labels' boxes of every camera with misses, noise and false alarms as large as people of that view."""
    result = []
    for placed, found in zip(known.cameras, known.people, strict=True):
        every = np.concatenate([each.detections.boxes for each in found])
        size, own = np.array([placed.camera.width, placed.camera.height]), []
        for each in found:
            boxes = each.detections.boxes
            boxes = boxes[rng.random(len(boxes)) >= MISSED]
            boxes = boxes + NOISE * (boxes[:, 3:] - boxes[:, 1:2]) * rng.standard_normal(boxes.shape)
            like = every[rng.integers(len(every), size=rng.poisson(FALSE))]
            half, centre = (like[:, 2:] - like[:, :2]) / 2, rng.random((len(like), 2)) * size
            boxes = np.concatenate([boxes, np.concatenate([centre - half, centre + half], axis=1)])
            boxes = boxes[(boxes[:, 2:] > boxes[:, :2]).all(axis=1)]
            own.append(StandingPeople.of(Detections(boxes, np.ones(len(boxes)))))
        result.append(own)
    return result


def floor_detections(known: FloorFolder, rng: np.random.Generator) -> FloorPositions:
    """Detections on the floor, as a multi-view detector gives them."""
    truth, floor = known.truth, known.cameras[0].floor
    assert floor is not None
    hit = rng.random(len(truth.times)) < RECALL
    moments = np.unique(truth.times)
    false = rng.poisson(hit.sum() * (1 / PRECISION - 1))
    noise = DEVIATION / np.sqrt(2) * rng.standard_normal((int(hit.sum()), 2))
    times = np.concatenate([truth.times[hit], rng.choice(moments, false)])
    places = np.concatenate([truth.places[hit] + noise, rng.uniform(floor[:2], floor[2:], (false, 2))])
    order = np.argsort(times, kind="stable")
    count = len(times)
    return FloorPositions(
        Path("floor detections"), times[order], places[order], np.full(count, DEVIATION), np.full(count, -1)
    )


def _by_sort(measured: MeasuredFloor) -> PlacedTruth:
    """The baseline: each detection joins the nearest group without its camera; groups of two or more go to SORT."""
    points, frames = measured.points, []
    for moment in range(len(measured.moments)):
        own = np.flatnonzero(points.moment == moment)
        means = _nearest_groups(points.places[own], points.sensor[own])
        boxes = np.concatenate([means - SIDE / 2, means + SIDE / 2], axis=1)
        frames.append(Detections(boxes, np.ones(len(boxes))))
    tracks = run_tracker(frames, Sort())
    people = [(t.frames, np.full(len(t), t.id), (t.boxes[:, :2] + t.boxes[:, 2:]) / 2) for t in tracks]
    frames_of, ids, places = (np.concatenate(column) for column in zip(*people, strict=True))
    return PlacedTruth(measured.times[frames_of], ids, places)


def _nearest_groups(places: FloatArray, sensor: IntArray) -> FloatArray:
    """``(G, 2)`` means of groups of at least two sensors."""
    groups: list[list[int]] = []
    for k in range(len(places)):
        means = np.array([places[group].mean(axis=0) for group in groups]).reshape(-1, 2)
        away = cdist(places[k : k + 1], means)[0] if groups else np.empty(0)
        away[[sensor[k] in sensor[group] for group in groups]] = np.inf
        if len(away) and away.min() < NEAREST:
            groups[int(away.argmin())].append(k)
        else:
            groups.append([k])
    return np.array([places[group].mean(axis=0) for group in groups if len(group) > 1]).reshape(-1, 2)


def shelf_scores(folder: Path) -> list[tuple[str, int, float, int]]:
    """Of each labelled person: name, frames, the share with a track near, and how many ids were nearest."""
    known = read_floor_folder(folder)
    length = len(known.people[0])
    rate = known.cameras[0].frame_rate or 1.0
    feeds = [
        CameraFeed(one, np.arange(length) / rate, found) for one, found in zip(known.cameras, known.people, strict=True)
    ]
    found = as_placed(flow_on_one_floor(measured_floor(feeds, [], None, FootNoise(), None), FloorFlow()))
    rows = []
    for who in np.unique(known.truth.ids):
        own = known.truth.ids == who
        near, ids = 0, set()
        for moment, place in zip(known.truth.times[own], known.truth.places[own], strict=True):
            here = np.flatnonzero(np.abs(found.times - moment) < 0.5 / rate)
            away = np.linalg.norm(found.places[here] - place, axis=1)
            if len(away) and away.min() < SHELF_NEAR:
                near += 1
                ids.add(int(found.ids[here[away.argmin()]]))
        rows.append((str(who), int(own.sum()), near / int(own.sum()), len(ids)))
    return rows


FRAMES, PEOPLE, CAMERAS = 100, 8, 4
NEAR, APART = 1.0, 1.0
"""Metres within which a track is on a person, and seconds after a person leaves a view within which another counts."""


def measure_place(store: Store, seed: int) -> dict[str, float]:
    """IDF1 and MOTA of all cameras together, their means over the cameras alone, and changes of view with the id kept.

    Args:
        store: keeps the clips.
        seed: of the place, its cameras, and the people.
    """
    folder = store.made("clip", _write_place, seed)
    return store.recall(_scores, folder)


def _write_place(folder: Path, seed: int) -> Path:
    return write_clip(folder, plan_floor(FloorClipSettings(frames=FRAMES, people=PEOPLE, cameras=CAMERAS), seed))


def _scores(folder: Path) -> dict[str, float]:
    truth, views = read_placed_truth(folder), sorted(folder.glob("camera?"))
    whole = open_floor([str(view) for view in views], folder / "cameras.yaml", None, ()).measured(StageTimes())
    together = _followed(whole)
    plan = whole.feeds[0].placed.floor
    alone = [
        evaluate_on_floor(truth, _followed(measured_floor([feed], [], plan, FootNoise(), None))) for feed in whole.feeds
    ]
    scores, (kept, changes) = evaluate_on_floor(truth, together), kept_ids(truth, together, _in_view(views, truth))
    return {
        "idf1": scores.idf1,
        "mota": scores.mota,
        "idf1_alone": float(np.mean([one.idf1 for one in alone])),
        "mota_alone": float(np.mean([one.mota for one in alone])),
        "gain": scores.idf1 - float(np.mean([one.idf1 for one in alone])),
        "changes": changes,
        "kept": kept / max(changes, 1),
    }


def _followed(measured: MeasuredFloor) -> PlacedTruth:
    return as_placed(flow_on_one_floor(measured, FloorFlow()))


def as_placed(people: list[PersonOnFloor]) -> PlacedTruth:
    """The rows of tracks."""
    times, places = [one.times for one in people], [one.positions for one in people]
    ids = [np.full(len(one), one.id) for one in people]
    return PlacedTruth(
        np.concatenate([np.empty(0), *times]),
        np.concatenate([np.empty(0, np.int64), *ids]),
        np.concatenate([np.empty((0, 2)), *places]),
    )


def _in_view(views: list[Path], truth: PlacedTruth) -> dict[int, np.ndarray]:
    """``(T, C)`` of each person: in which camera's labels the person is at each moment."""
    count = len(np.unique(truth.times))
    found = {int(who): np.zeros((count, len(views)), dtype=np.bool_) for who in np.unique(truth.ids)}
    for camera, view in enumerate(views):
        rows = np.loadtxt(view / "gt" / "world.csv", delimiter=",", skiprows=1, ndmin=2)
        for frame, who in rows[:, :2].astype(int):
            found[who][frame - 1, camera] = True
    return found


def kept_ids(truth: PlacedTruth, found: PlacedTruth, in_view: dict[int, np.ndarray]) -> tuple[int, int]:
    """Changes of view in which the person bears one id before and after, and all changes.

    A change is a frame in which a person leaves a camera's view, and within `APART` seconds is in that of another. The
    id before is that of the nearest track within `NEAR` metres in the last frame in the view; after, likewise in the
    first frame in another view that the person was not in before, or a second later where all were entered before.
    """
    times = np.unique(truth.times)
    wait = round(APART / float(np.median(np.diff(times))))
    ids = {who: _ids_of(truth, found, who, times) for who in in_view}
    kept = changes = 0
    for who, visible in in_view.items():
        for frame, camera in np.argwhere(visible[:-1] & ~visible[1:]).tolist():
            later = visible[frame + 1 : frame + 1 + wait].copy()
            later[:, camera] = False
            if not later.any():
                continue
            entered = np.flatnonzero((later & ~visible[frame]).any(axis=1))
            after = frame + 1 + (int(entered[0]) if len(entered) else len(later) - 1)
            changes += 1
            kept += ids[who][frame] >= 0 and ids[who][frame] == ids[who][after]
    return kept, changes


def _ids_of(truth: PlacedTruth, found: PlacedTruth, who: int, times: np.ndarray) -> IntArray:
    """``(T,)`` id of the nearest track within `NEAR` of a person at each moment, -1 for none."""
    result = np.full(len(times), -1)
    slack = 0.5 * float(np.median(np.diff(times)))
    own = truth.ids == who
    for moment, place in zip(truth.times[own], truth.places[own], strict=True):
        there = np.flatnonzero(np.abs(found.times - moment) < slack)
        apart = np.linalg.norm(found.places[there] - place, axis=1)
        if len(there) and apart.min() <= NEAR:
            result[np.searchsorted(times, moment)] = found.ids[there[apart.argmin()]]
    return result
