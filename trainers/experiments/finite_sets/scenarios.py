"""Scenarios of several point targets in clutter: those on disk, and generated ones of any size."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.points import PointTracks
from tsuiseki.tracking.filters.base import Births
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths, newborn
from tsuiseki.tracking.filters.finite_sets.models import (
    GaussianSensor,
    PointModel,
    bearing_range,
    cartesian,
    from_bearing_range,
)
from tsuiseki.tracking.filters.motion.points import constant_velocity, coordinated_turn
from tsuiseki.tracking.types import FloatArray

REQUIRED = ("kind", "T", "K", "P_S", "P_D", "region", "clutter_rates", "runs", "sigma_v")
OF_KIND = {"linear": ("sigma_e",), "ct": ("sigma_turn", "sigma_bearing", "sigma_range")}
ARRAYS = ("truth", "z", "z_run", "z_clut", "z_k")


@dataclass(frozen=True)
class PointScenario:
    """Truth and measurements of a scenario.

    Attributes:
        name: of its file, without what all of them share.
        settings: what its json says.
        truth: ``(K, T, D)`` states, NaN while a target is absent.
        measurements: by run and index of the clutter rate, one ``(M, Z)`` array a step.
    """

    name: str
    settings: dict[str, Any]
    truth: FloatArray
    measurements: dict[tuple[int, int], list[FloatArray]]

    def true_tracks(self) -> PointTracks:
        """Positions of the targets."""
        frames, targets = np.nonzero(~np.isnan(self.truth[:, :, 0]))
        return PointTracks(frames, targets + 1, self.truth[frames, targets][:, [0, 2]])


def read_scenario(path: Path) -> PointScenario:
    """The scenario whose settings are in ``path`` (json) and whose data is beside it (npz).

    Raises:
        RequestError: a file, a setting or an array is missing, or the kind is unknown.
    """
    data_path = path.with_suffix(".npz")
    for needed in (path, data_path):
        if not needed.is_file():
            raise RequestError(f"expected a scenario file at {needed}, found none; give its folder as `data`")
    try:
        settings = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RequestError(f"{path}: expected JSON, got {error}") from error
    kind = settings.get("kind", "")
    if kind not in OF_KIND:
        raise RequestError(f"{path}: expected a scenario of kind {' or '.join(OF_KIND)}, got {kind!r}")
    missing = [name for name in (*REQUIRED, *OF_KIND[kind]) if name not in settings]
    if missing:
        raise RequestError(f"{path}: expected the setting {missing[0]}, found none")
    try:
        with np.load(data_path, allow_pickle=False) as data:
            truth, z, run, clutter, step = (data[name] for name in ARRAYS)
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise RequestError(f"{data_path}: expected a NumPy archive, got a broken file") from error
    except KeyError as error:
        raise RequestError(f"{data_path}: expected the arrays {', '.join(ARRAYS)}, got no {error}") from error
    cells = {
        (r, c): [z[(run == r) & (clutter == c) & (step == k)] for k in range(settings["K"])]
        for r in range(settings["runs"])
        for c in range(len(settings["clutter_rates"]))
    }
    return PointScenario(path.stem.removeprefix("phd_scenario_"), settings, truth, cells)


def scenario_sensor(settings: dict[str, Any]) -> GaussianSensor:
    """The sensor of a scenario of kind ``linear`` or ``ct``."""
    if settings["kind"] == "linear":
        return GaussianSensor(cartesian, np.full(2, settings["sigma_e"]))
    return GaussianSensor(bearing_range, np.array([settings["sigma_bearing"], settings["sigma_range"]]), (0,))


def scenario_model(settings: dict[str, Any], clutter_rate: float) -> PointModel:
    """The model that the scenario was made with: its motion, sensor, probabilities and clutter density."""
    volume = float(np.prod([high - low for low, high in settings["region"]]))
    sensor = scenario_sensor(settings)
    if settings["kind"] == "linear":
        motion = constant_velocity(settings["sigma_v"])
    else:
        motion = coordinated_turn(settings["sigma_v"], settings["sigma_turn"])
    return PointModel(motion, sensor, settings["P_S"], settings["P_D"], clutter_rate / volume, settings["T"])


BIRTHS_ANYWHERE = 0.1
"""Expected births a step where a scenario names no places."""


def scenario_births(settings: dict[str, Any], count: int) -> Births[FloatArray]:
    """The scenario's places of birth; where it names none, births anywhere, driven by the measurements."""
    if "birth_m" in settings:
        masses, means = (
            np.asarray(settings["birth_w"], dtype=np.float64),
            np.asarray(settings["birth_m"], dtype=np.float64),
        )
        spread = np.asarray(settings["birth_sd"], dtype=np.float64)
        return MixtureBirths(masses, means, spread, count, scenario_sensor(settings))
    return anywhere_births(settings, BIRTHS_ANYWHERE, count=count // 5)


def printed_births(settings: dict[str, Any], density: int) -> Births[FloatArray]:
    """The same with as many particles as (50) gives: ``density`` times the expected number of births, wherever."""
    births = scenario_births(settings, density)
    if isinstance(births, MixtureBirths):
        return replace(births, count=max(round(density * float(np.mean(births.masses))), 1), sensor=None)
    if isinstance(births, MeasurementBirths):
        return replace(births, limit=max(round(density * BIRTHS_ANYWHERE), 1))
    return births


def anywhere_births(settings: dict[str, Any], expected: float, count: int) -> MeasurementBirths:
    """Births anywhere in the measured region, ``expected`` a step, whatever the scenario says of places."""
    volume = float(np.prod([high - low for low, high in settings["region"]]))
    speed = float(settings.get("birth_speed", 15.0))
    if settings["kind"] == "linear":
        complete, columns = newborn(lambda places: places, 2, speed), 4
    else:
        complete, columns = newborn(from_bearing_range, 2, speed, turn=0.05), 5
    return MeasurementBirths(expected / volume, scenario_sensor(settings), complete, columns, count)


def generated_scenario(targets: int, clutter: float, steps: int, seed: int) -> tuple[dict[str, Any], list[FloatArray]]:
    """A linear scenario with a constant number of targets in a region that grows with them; its settings and
    measurements.

    The region has a fixed area a target, so that more targets mean more of the same and not more confusion.
    """
    rng = np.random.default_rng(seed)
    side = 500.0 * np.sqrt(targets)
    settings = {
        "kind": "linear", "T": 1.0, "K": steps, "sigma_v": 5.0, "sigma_e": 10.0, "P_S": 0.99, "P_D": 0.98,
        "region": [[-side, side], [-side, side]],
    }  # fmt: skip
    states = np.stack(
        [rng.uniform(-side, side, targets), rng.normal(0, 5, targets), rng.uniform(-side, side, targets),
         rng.normal(0, 5, targets)], axis=1,
    )  # fmt: skip
    settings |= {"birth_m": states, "birth_w": np.full(targets, 0.03), "birth_sd": np.full(4, 10.0)}
    measurements = []
    for _ in range(steps):
        states = states + np.stack([states[:, 1], np.zeros(targets), states[:, 3], np.zeros(targets)], axis=1)
        seen = states[rng.random(targets) < 0.98][:, [0, 2]]
        false = rng.uniform(-side, side, (rng.poisson(clutter), 2))
        measurements.append(np.concatenate([seen + 10.0 * rng.standard_normal(seen.shape), false]))
    return settings, measurements
