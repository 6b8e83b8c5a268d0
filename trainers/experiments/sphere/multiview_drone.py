"""A drone in space from measured pixels (`reproduce multiview-drone`): the 3D filter beside triangulation."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from tsuiseki.datamodules.readers.multiview_drone import DroneFlight, read_drone_flight
from tsuiseki.tracking.cameras.moving_target import TimedCamera
from tsuiseki.tracking.cameras.triangulation import triangulate
from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.sphere.flights import (
    AGITATIONS,
    CAMERA_COUNTS,
    INFLATIONS,
    FlightScores,
    Trial,
    calibrate_flight,
    chosen,
    half_of,
    score_course,
    surveyed_errors,
    try_noise,
)
from tsuiseki.trainers.experiments.sphere.look_ahead import LookAhead, look_ahead, look_ahead_table
from tsuiseki.trainers.experiments.sphere.multiview_filter import FlightSettings, track_points
from tsuiseki.trainers.experiments.study import Bench, Outcome, Table


def reproduce(bench: Bench, data: Path = Path("../shared/data/stereo/multiview-drone-3"), seed: int = 0) -> Outcome:
    """The 3D filter on measured pixels of a flying drone (six cameras, RTK), beside triangulation frame by frame.

    DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        data: folder of the data set multiview-drone-3, with the folder calibration beside it.
        seed: of all random numbers.

    Raises:
        RequestError: the data set is not there.
    """
    if seed < 0:
        raise RequestError(f"`seed`: expected a whole number from 0, got {seed}")
    flight = read_drone_flight(data)
    cameras = calibrate_flight(flight, bench.watch)
    scores, trials = [], {}
    ahead: list[LookAhead] = []
    for count in CAMERA_COUNTS:
        used = cameras[:count]
        noises = list(itertools.product(AGITATIONS, INFLATIONS))
        watched = bench.watch.over(noises, f"{count} cameras, choosing on the first half", len(noises))
        trials[count] = [
            trial for noise in watched for trial in bench.store.recall(try_noise, flight, used, seed, *noise)
        ]
        best = chosen(trials[count]).settings
        scored, rows = bench.store.recall(second_half, flight, used, best, seed)
        scores.append(scored)
        ahead += rows
    values = {
        "scores": [asdict(s) for s in scores],
        "look_ahead": [asdict(row) for row in ahead],
        "trials": {str(count): [asdict(t) for t in tried] for count, tried in trials.items()},
    }
    tables = [_score_table(scores), _camera_table(cameras), _choice_table(trials), look_ahead_table(ahead)]
    return Outcome(values, tables, notes=_survey(data, cameras))


def second_half(
    flight: DroneFlight, cameras: Sequence[TimedCamera], settings: FlightSettings, seed: int
) -> tuple[FlightScores, list[LookAhead]]:
    """One run of the filter over the second half of the flight: its scores, and what each look-ahead is worth."""
    times, pixels, truth = half_of(flight, cameras, first=False)
    triangulated, _ = triangulate([c.camera for c in cameras], pixels)
    course = track_points(cameras, times, pixels, triangulated, settings, np.random.default_rng((seed, len(cameras))))
    scores = score_course(len(cameras), course, settings.lag, triangulated, truth)
    return scores, look_ahead(flight, cameras, course, triangulated, truth)


def _survey(data: Path, cameras: Sequence[TimedCamera]) -> list[str]:
    """How far the cameras are from where a survey found them, which nothing else uses."""
    survey = data / "camera-locations" / "campos.txt"
    if not survey.is_file():
        return []
    # The file lists the cameras in another order than the rest of the data set.
    away = surveyed_errors(cameras, np.loadtxt(survey)[[0, 4, 2, 1, 3, 5]])
    return [f"Distance to the surveyed camera positions (a check only): {', '.join(f'{v:.2f}' for v in away)} m"]


def _score_table(scores: Sequence[FlightScores]) -> Table:
    columns = (
        "cameras", "moments", "median, m: filter", "triangulation", "95 %, m: filter", "triangulation",
        "rms acceleration, m/s²: filter", "triangulation", "one camera only: moments", "median, m", "95 %, m",
    )  # fmt: skip
    rows = [
        (
            f"{s.cameras}", f"{s.moments}", f"{s.filter_median:.4f}", f"{s.triangulation_median:.4f}",
            f"{s.filter_tail:.3f}", f"{s.triangulation_tail:.3f}", f"{s.filter_acceleration:.1f}",
            f"{s.triangulation_acceleration:.1f}", f"{s.alone}", f"{s.alone_median:.2f}", f"{s.alone_tail:.2f}",
        )
        for s in scores
    ]  # fmt: skip
    return Table("On the second half of the flight", columns, rows)


def _camera_table(cameras: Sequence[TimedCamera]) -> Table:
    rows = [
        (f"{k}", f"{np.median(c.residuals):.2f} px", f"{c.offset:.3f}", f"{1 / c.period:.3f}")
        for k, c in enumerate(cameras)
    ]
    return Table("", ("camera", "fitted pixels, median error", "time of frame 0, s", "frames/s"), rows)


def _choice_table(trials: Mapping[int, Sequence[Trial]]) -> Table:
    columns = (
        "cameras", "agitation, m/s", "inflation", "lag, s", "median there, m: filter", "triangulation",
        "rms acceleration there, m/s²: filter", "triangulation", "the evidence's choice: agitation", "inflation",
    )  # fmt: skip
    rows = []
    for count, tried in trials.items():
        best = chosen(tried)
        likely = max(tried, key=lambda t: t.log_evidence).settings
        s, f = best.settings, best.scores
        rows.append(
            (
                f"{count}", f"{s.agitation:g}", f"{s.inflation:g}", f"{s.lag:g}", f"{f.filter_median:.4f}",
                f"{f.triangulation_median:.4f}", f"{f.filter_acceleration:.1f}", f"{f.triangulation_acceleration:.1f}",
                f"{likely.agitation:g}", f"{likely.inflation:g}",
            )
        )  # fmt: skip
    return Table("Chosen on the first half", columns, rows)
