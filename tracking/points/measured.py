"""Targets from the measurements of a sensor: `track_measurements`, and `tsuiseki track points`."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import PositiveFloat, PositiveInt

from tsuiseki.tracking.errors import InputWarning, RequestError, a_path
from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting
from tsuiseki.tracking.formats.measurement_tables import (
    read_scans,
    read_sensing_model,
    sensing_model,
    write_sensed_tracks,
)
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.people.detections import network_detections
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.points.fit import fit_model, model_text
from tsuiseki.tracking.points.observed import positions_of, region_of
from tsuiseki.tracking.points.run import extent_of
from tsuiseki.tracking.points.settings import Lag, SetMethod
from tsuiseki.tracking.points.tracker import MeasurementTracker
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.fitting import fitted_first, write_fitted
from tsuiseki.tracking.runs.following import count
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.measurements import Scan, SensedTargets, SensedTrack
from tsuiseki.tracking.types.sensing_model import SensingModel
from tsuiseki.tracking.video.source import open_source

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Share of the measurements outside the region that is worth a note.
MANY = 0.2


def track_measurements(
    measured: str | Path | Sequence[Scan],
    model: str | Path | Mapping[str, Any] | SensingModel,
    *,
    method: SetMethod = "labelled",
    particles: int = 1000,
    shortest: int = 1,
    period: float = 1.0,
    seed: int = 0,
    lag: Lag = 0,
) -> Result[SensedTrack]:
    """Targets behind the measurements of a sensor, each with an id, at every scan.

    Args:
        measured: a CSV of measurements (`tracking.formats.measurement_tables`), or scans in order of time.
        model: of sensor, targets and clutter: a YAML file, what stands in one, or `SensingModel`.
        method: labelled multi-Bernoulli filter, or phd.
        particles: number of particles of each target.
        shortest: tracks of fewer scans are left out.
        period: seconds from one frame to the next, for a CSV with frames instead of times.
        output.seed: of the particles.
        lag: 1 lets each scan be judged with the next one, too (labelled only).

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    chosen = as_model(model)
    scans = read_scans(Path(measured), chosen.sensor.columns, period) if isinstance(measured, str | Path) else measured
    tracker = MeasurementTracker(with_region(chosen, scans), method, particles, seed, lag)
    return sensed_result(tracker, scans, shortest, StageTimes(), {"method": method, "seed": seed})


def follow_measurements(
    scans: Iterable[Scan],
    model: str | Path | Mapping[str, Any] | SensingModel,
    *,
    method: SetMethod = "labelled",
    particles: int = 1000,
    seed: int = 0,
    lag: Lag = 0,
) -> Iterator[SensedTargets]:
    """The targets of each scan, while the scans come, with a lag of 1 a scan later; see `track_measurements`.

    The model needs a region.
    """
    tracker = MeasurementTracker(as_model(model), method, particles, seed, lag)
    for scan in scans:
        targets = tracker.update(scan)
        tracker.forget()
        if targets is not None:
            yield targets
    last = tracker.finish()
    if last is not None:
        yield last


def as_model(model: str | Path | Mapping[str, Any] | SensingModel) -> SensingModel:
    """The model of a YAML file, of what stands in one, or as it is."""
    if isinstance(model, SensingModel):
        return model
    return sensing_model(model) if isinstance(model, Mapping) else read_sensing_model(a_path(model, "model"))


def with_region(model: SensingModel, scans: Sequence[Scan]) -> SensingModel:
    """The model with the region where the measurements lie, if it has none of its own; warns of others outside."""
    if wrong := [type(scan).__name__ for scan in scans if not isinstance(scan, Scan)]:
        raise RequestError(f"`measured`: expected a path, or scans, got {wrong[0]}")
    if not model.region:
        return replace(model, region=region_of(scans))
    measurements = np.concatenate([np.empty((0, len(model.region))), *(scan.measurements for scan in scans)])
    low, high = np.array(model.region).T
    outside = int(((measurements < low) | (measurements > high)).any(axis=1).sum())
    if outside > MANY * len(measurements):
        line = f"{outside} of {len(measurements)} measurements lie outside the model's region; is it in their units?"
        warnings.warn(line, InputWarning, stacklevel=3)
    return model


def sensed_result(
    tracker: MeasurementTracker, steps: Iterable[Scan], shortest: int, times: StageTimes, settings: Mapping[str, Any]
) -> Result[SensedTrack]:
    """The result of a run of a fresh tracker over scans in order of time, without tracks of fewer than ``shortest``."""
    model, done = tracker.model, list[Scan]()
    for scan in steps:
        with reported_to(steps), times.measure("track"):
            tracker.update(scan)
            done.append(scan)
    all_tracks = tracker.tracks()
    tracks = [track for track in all_tracks if len(track) >= shortest]
    numbers = Counter(int(scan) for track in all_tracks for scan in track.scans)

    def draw(path: Path, _: Path) -> None:
        figure = tracks_figure(tracks, [positions_of(model, scan.measurements) for scan in done])
        figure.savefig(path, facecolor="white")

    return Result(
        tracks,
        settings=settings,
        facts={"region": [list(pair) for pair in model.region], "log_evidence": tracker.log_evidence},
        seconds=times.seconds,
        frames={
            "frame": list(range(len(done))),
            "time": [scan.time for scan in done],
            "measurements": [len(scan.measurements) for scan in done],
            "targets": [numbers[scan] for scan in range(len(done))],
        },
        files={
            "tracks.csv": lambda path, _: write_sensed_tracks(path, tracks, model.sensor.dimensions),
            "tracks.png": draw,
        },
    )


def tracks_figure(tracks: Sequence[SensedTrack], measured: Sequence[FloatArray]) -> Figure:
    """The tracks seen from above, each with its id at its end, over all measurements as dots; 3D also from the side.

    Args:
        tracks: D is 2 or 3.
        measured: positions ``(M, D)`` of each scan's measurements.
    """
    from matplotlib.figure import Figure

    positions = np.concatenate(measured)
    panels = [(0, 1)] if positions.shape[1] == 2 else [(0, 1), (0, 2)]
    figure = Figure(figsize=(6.4 * len(panels), 6), dpi=110, layout="constrained")
    for place, (a, b) in enumerate(panels, start=1):
        axes = figure.add_subplot(1, len(panels), place)
        axes.plot(positions[:, a], positions[:, b], ".", markersize=1.5, color="0.75", label="measured")
        for number, track in enumerate(tracks):
            colour = COLOURS[number % len(COLOURS)]
            axes.plot(track.positions[:, a], track.positions[:, b], color=colour, linewidth=1.6)
            axes.text(track.positions[-1, a], track.positions[-1, b], str(track.id), color=colour, fontsize=8)
        axes.set(xlabel="xyz"[a], ylabel="xyz"[b])
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
    return figure


def detected_scans(video: Path, model: SensingModel, detector: Path) -> tuple[SensingModel, list[Scan]]:
    """The centres of what a network detects in each frame of a video, in pixels; the picture is the model's region.

    Raises:
        RequestError: the sensor measures no x and y; or the video or the network cannot be used.
    """
    if tuple(model.sensor.columns) != ("x", "y"):
        raise RequestError(f"expected a sensor of x,y with `detector`, got one of {','.join(model.sensor.columns)}")
    source = open_source(str(video))
    detections = network_detections(source, FindingOptions(detector=detector))
    steps = progress(detections, "detecting", source.frames_expected)
    scans = [Scan(n / source.frame_rate, centres(boxed.boxes)) for n, boxed in steps]
    return model if model.region else replace(model, region=tuple((0.0, side) for side in extent_of(source))), scans


def points(
    file: Path,
    *,
    model: Path,
    output: SeededOutput,
    method: SetMethod = "labelled",
    particles: PositiveInt = 1000,
    period: PositiveFloat = 1.0,
    shortest: PositiveInt = 3,
    lag: Lag = 0,
    detector: Path | None = None,
    fit: bool = False,
) -> int:
    """Track an unknown number of targets from a sensor's measurements, such as a radar's or a lidar's.

    DIR gets tracks.csv (time, id, position, velocity, covariance, probability of existence), tracks.png and run.json.

    Args:
        file: CSV with the columns time (seconds, which need not be even) or frame, and the sensor's: x,y or x,y,z or
            bearing,range or bearing,elevation,range; with sd_x,… or cov_x_x,… where errors differ. A row with a time
            alone says that nothing was measured then.
        model: YAML with the keys sensor, motion, detection, survival, clutter, region, births (docs/methods/points.md).
        method: labelled multi-Bernoulli filter, or phd.
        particles: number of particles of each target.
        period: seconds from one frame to the next, where the file has frames.
        shortest: tracks of fewer scans are left out.
        lag: 1 judges each scan with the next one, too, which places targets better and ends them in time (labelled
            only).
        detector: network whose boxes in the video FILE are measured, by their centres in pixels; ONNX, or the name of a
            shipped or downloaded one.
        fit: first fit the noise of sensor and motion, detection, clutter and births of the model to FILE by maximum
            likelihood, with intervals; DIR also gets model.yaml. It takes as long as some 160 runs.
        output.seed: of the particles.
    """
    chosen = read_sensing_model(model)
    if detector is None:
        scans = read_scans(file, chosen.sensor.columns, period)
    else:
        chosen, scans = detected_scans(file, chosen, detector)
    chosen, fitted = with_region(chosen, scans), dict[str, FittedSetting]()
    if fit:
        chosen, fitted = fitted_first(partial(fit_model, chosen, scans, method, particles, output.seed))
    tracker = MeasurementTracker(chosen, method, particles, output.seed, lag)
    with output.run() as run:
        steps = run.steps(scans, total=len(scans))
        result = sensed_result(tracker, steps, shortest, run.times, output.settings)
        write_fitted(run, fitted, "model.yaml", model_text(chosen, fitted))
        run.save(result)
        run.done(f"{count(len(result), 'target', 'targets')} in {run.count} scans: {output.out / 'tracks.csv'}")
    return run.status
