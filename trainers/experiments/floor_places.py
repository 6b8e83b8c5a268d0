"""Generated places before several cameras: pictures, detector, appearance and all (`reproduce one-floor`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.floor_clip import FloorClipSettings, plan_floor
from tsuiseki.tracking.cameras.multicamera import PlacedTruth, read_placed_truth
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.floor.floor_flow import FloorFlow
from tsuiseki.tracking.floor.foot_points import FootNoise
from tsuiseki.tracking.floor.measured_floor import MeasuredFloor, measured_floor
from tsuiseki.tracking.floor.run import open_floor
from tsuiseki.tracking.floor.tracker import flow_on_one_floor
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import IntArray
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.trainers.experiments.store import Store

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
    for time, place in zip(truth.times[own], truth.places[own], strict=True):
        there = np.flatnonzero(np.abs(found.times - time) < slack)
        apart = np.linalg.norm(found.places[there] - place, axis=1)
        if len(there) and apart.min() <= NEAR:
            result[np.searchsorted(times, time)] = found.ids[there[apart.argmin()]]
    return result
