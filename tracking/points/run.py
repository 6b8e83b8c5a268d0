"""`tsuiseki track points`: several targets from the measurements of a sensor."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from tsuiseki.tracking.cli.options import SeededOutput
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.points.measurement_tracker import Lag, MeasurementMethod


def points(
    file: Path,
    /,
    model: Path,
    output: SeededOutput,
    method: MeasurementMethod = "labelled",
    particles: int = 1000,
    period: float = 1.0,
    shortest: int = 3,
    lag: Lag = 0,
) -> int:
    """Track an unknown number of targets from a sensor's measurements, such as a radar's or a lidar's.

    DIR gets tracks.csv (time, id, position, velocity, covariance, probability of existence), tracks.png and run.json.

    Args:
        file: CSV with the columns time (seconds, which need not be even) or frame, and the sensor's: x,y or x,y,z or
            bearing,range or bearing,elevation,range; with sd_x,… or cov_x_x,… where errors differ. A row with a time
            alone says that nothing was measured then.
        model: YAML with the keys sensor, motion, detection, survival, clutter, region, births (docs/methods/points.md).
        method: labelled multi-Bernoulli filter, or phd.
        particles: of each target.
        period: seconds from one frame to the next, where the file has frames.
        shortest: tracks of fewer scans are left out.
        lag: 1 judges each scan with the next one, too, which places targets better and ends them in time (labelled
            only).
        seed: of the particles.
    """
    from tsuiseki.tracking.cli.run import count
    from tsuiseki.tracking.formats.measurements import read_scans, read_sensing_model, write_sensed_tracks
    from tsuiseki.tracking.points.measurement_model import positions_of
    from tsuiseki.tracking.points.measurement_tracker import MeasurementTracker
    from tsuiseki.tracking.points.measurement_tracking import with_region
    from tsuiseki.tracking.points.page import tracks_figure

    if not period > 0 or shortest < 1:
        raise RequestError(f"expected a `period` above 0 and `shortest` from 1, got {period:g} and {shortest}")
    chosen = read_sensing_model(model)
    scans = read_scans(file, chosen.sensor.columns, period)
    chosen = with_region(chosen, scans)
    tracker = MeasurementTracker(chosen, method, particles, output.seed, lag)
    with output.run() as run:
        run.facts["region"] = [list(pair) for pair in chosen.region]
        for scan in run.steps(scans, total=len(scans)):
            with run.times.measure("track"):
                tracker.update(scan)
        every = tracker.tracks()
        tracks = [track for track in every if len(track) >= shortest]
        numbers = Counter(int(scan) for track in every for scan in track.scans)
        done = scans[: run.count]
        run.columns = {
            "frame": list(range(1, run.count + 1)),
            "time": [scan.time for scan in done],
            "measurements": [len(scan.measurements) for scan in done],
            "targets": [numbers[scan] for scan in range(run.count)],
        }
        run.write("tracks.csv", lambda path: write_sensed_tracks(path, tracks, chosen.sensor.dimensions))
        figure = tracks_figure(tracks, [positions_of(chosen, scan.measurements) for scan in done])
        run.draw("tracks.png", lambda path: figure.savefig(path, facecolor="white"))
        run.done(f"{count(len(tracks), 'target', 'targets')} in {run.count} scans: {output.out / 'tracks.csv'}")
    return run.status
