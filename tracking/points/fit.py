"""The model of a sensor and its targets by maximum likelihood, from what the sensor measured: ``track points --fit``.

Noise of motion and sensor, detection, clutter and births maximise the log evidence of the filter, Eq. (11) of the
finite-sets paper. The filter has the motions as the model names them, without the calm one that the tracker adds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace

from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting, Range, fit_settings, fitted_text
from tsuiseki.tracking.points.observed import births_a_second
from tsuiseki.tracking.points.settings import SetMethod
from tsuiseki.tracking.points.tracker import MeasurementTracker
from tsuiseki.tracking.types.measurements import Scan
from tsuiseki.tracking.types.sensing_model import SensingModel

# A setting is sought up to so many times from where it starts, both ways.
FARTHEST = 10.0
# Bounds of the probability of detection.
DETECTION = 0.05, 0.999


def fit_model(
    model: SensingModel,
    scans: Sequence[Scan],
    method: SetMethod = "labelled",
    particles: int = 1000,
    seed: int = 0,
    begins: Callable[[], object] = lambda: None,
) -> tuple[SensingModel, dict[str, FittedSetting]]:
    """The most likely model of a recording, with intervals of 95 % of what was fitted.

    What is 0 in the model stays so, and the sensor's deviation where measurements have errors of their own. Several
    deviations, motions or places of birth keep their ratios; the first, or the sum of rates, stands for them.

    Args:
        model: where the search begins, with a region.
        scans: in order of time.
        method: of the filter.
        particles: of each target.
        seed: of the particles.
        begins: called at the beginning of each run of the filter.
    """
    values = _values(model)
    if any(scan.covariances is not None for scan in scans):
        del values["sensor.deviation"]
    ranges = {name: Range.about(value, FARTHEST) for name, value in values.items() if value > 0}
    low, high = DETECTION
    ranges["detection"] = Range(min(max(model.detection, 2 * low), 0.99), low, high, probability=True)

    def log_evidence(settings: Mapping[str, float]) -> float:
        begins()
        tracker = MeasurementTracker(with_settings(model, settings), method, particles, seed, calm=False)
        for scan in scans:
            tracker.update(scan)
        return tracker.log_evidence

    fitted = fit_settings(log_evidence, ranges, seed)
    return with_settings(model, {name: setting.value for name, setting in fitted.items()}), fitted


def _values(model: SensingModel) -> dict[str, float]:
    """The positive settings that are fitted."""
    return {
        "sensor.deviation": model.sensor.deviation[0],
        "motion.acceleration": model.motions[0].acceleration,
        "motion.turn": model.motions[0].turn if model.motions[0].model == "coordinated-turn" else 0.0,
        "clutter": model.clutter,
        "births.rate": births_a_second(model),
    }


def with_settings(model: SensingModel, settings: Mapping[str, float]) -> SensingModel:
    """The model with some of the settings that `fit_model` fits."""
    values = _values(model)
    times = {name: settings[name] / value if name in settings else 1.0 for name, value in values.items()}
    acceleration, turn, rate = times["motion.acceleration"], times["motion.turn"], times["births.rate"]
    return replace(
        model,
        sensor=replace(model.sensor, deviation=tuple(times["sensor.deviation"] * d for d in model.sensor.deviation)),
        motions=tuple(
            replace(m, acceleration=acceleration * m.acceleration, turn=turn * m.turn) for m in model.motions
        ),
        detection=settings.get("detection", model.detection),
        clutter=times["clutter"] * model.clutter,
        births=replace(
            model.births,
            rate=rate * model.births.rate,
            places=tuple(replace(place, rate=rate * place.rate) for place in model.births.places),
        ),
    )


def model_text(model: SensingModel, fitted: Mapping[str, FittedSetting]) -> str:
    """The model as YAML for ``--model``, beneath what was fitted and its intervals as comments."""
    content = {("motion" if name == "motions" else name): _plain(value) for name, value in asdict(model).items()}
    return fitted_text(fitted, content)


def _plain(value: object) -> object:
    """With lists, since YAML knows no tuples."""
    if isinstance(value, Mapping):
        return {name: _plain(of_name) for name, of_name in value.items()}
    return [_plain(of_row) for of_row in value] if isinstance(value, tuple | list) else value
