"""A sensor's measurements through a finite-set filter, in one call."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tsuiseki.tracking.formats.measurements import read_scans, read_sensing_model, sensing_model
from tsuiseki.tracking.points.measurement_model import region_of
from tsuiseki.tracking.points.measurement_tracker import Lag, MeasurementMethod, MeasurementTracker
from tsuiseki.tracking.types.measurements import Scan, SensedTargets, SensedTrack, SensingModel


def track_measurements(
    measured: str | Path | Sequence[Scan],
    model: str | Path | Mapping[str, Any] | SensingModel,
    *,
    method: MeasurementMethod = "labelled",
    particles: int = 1000,
    shortest: int = 1,
    period: float = 1.0,
    seed: int = 0,
    lag: Lag = 0,
) -> list[SensedTrack]:
    """Targets behind the measurements of a sensor, each with an id, at every scan.

    Args:
        measured: a CSV of measurements (`tracking.formats.sensors.measurements`), or scans in order of time.
        model: of sensor, targets and clutter: a YAML file, what stands in one, or `SensingModel`.
        method: labelled multi-Bernoulli filter, or phd.
        particles: of each target.
        shortest: tracks of fewer scans are left out.
        period: seconds from one frame to the next, for a CSV with frames instead of times.
        seed: of the particles.
        lag: 1 lets each scan be judged with the next one, too (labelled only).

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    chosen = as_model(model)
    scans = read_scans(Path(measured), chosen.sensor.columns, period) if isinstance(measured, str | Path) else measured
    tracker = MeasurementTracker(with_region(chosen, scans), method, particles, seed, lag)
    for scan in scans:
        tracker.update(scan)
    return tracker.tracks(shortest)


def follow_measurements(
    scans: Iterable[Scan],
    model: str | Path | Mapping[str, Any] | SensingModel,
    *,
    method: MeasurementMethod = "labelled",
    particles: int = 1000,
    seed: int = 0,
    lag: Lag = 0,
) -> Iterator[SensedTargets]:
    """The targets of each scan, while the scans come, with a lag of 1 a scan later; see `track_measurements`.

    The model needs a region.
    """
    tracker = MeasurementTracker(as_model(model), method, particles, seed, lag)
    for scan in scans:
        found = tracker.update(scan)
        tracker.forget()
        if found is not None:
            yield found
    last = tracker.finish()
    if last is not None:
        yield last


def as_model(model: str | Path | Mapping[str, Any] | SensingModel) -> SensingModel:
    """The model of a YAML file, of what stands in one, or as it is."""
    if isinstance(model, SensingModel):
        return model
    return sensing_model(model) if isinstance(model, Mapping) else read_sensing_model(Path(model))


def with_region(model: SensingModel, scans: Sequence[Scan]) -> SensingModel:
    """The model with the region where the measurements lie, if it has none of its own."""
    return model if model.region else replace(model, region=region_of(scans))
