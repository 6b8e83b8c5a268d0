"""OSPA, GOSPA and OSPA(2) against values that can be worked out by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.point_distances import (
    PointTracks,
    evaluate_points,
    gospa,
    identity_switches,
    ospa,
    ospa2,
)

EMPTY = np.empty((0, 2))


def brute_ospa(a, b, c, p):
    if len(a) > len(b):
        a, b = b, a
    if len(b) == 0:
        return 0.0
    distances = np.minimum(np.linalg.norm(a[:, None] - b[None], axis=2), c) ** p
    best = min(
        sum(distances[i, j] for i, j in enumerate(order)) for order in itertools.permutations(range(len(b)), len(a))
    )
    return ((best + c**p * (len(b) - len(a))) / len(b)) ** (1 / p)


@pytest.mark.parametrize("p", [1.0, 2.0])
@pytest.mark.parametrize("sizes", [(0, 0), (0, 3), (1, 1), (2, 4), (4, 3)])
def test_ospa_equals_the_best_of_all_assignments(p, sizes):
    rng = np.random.default_rng(sum(sizes))
    a, b = (rng.uniform(0, 150, (n, 2)) for n in sizes)
    found = ospa(a, b, 100.0, p)
    assert found.distance == pytest.approx(brute_ospa(a, b, 100.0, p))
    assert found.distance**p == pytest.approx(found.localisation**p + found.cardinality**p)
    assert found.distance == pytest.approx(ospa(b, a, 100.0, p).distance)


def test_gospa_has_its_parts():
    truth, found = np.array([[0.0, 0.0], [50.0, 0.0], [500.0, 0.0]]), np.array([[3.0, 4.0], [50.0, 0.0], [900.0, 0.0]])
    score = gospa(truth, found, 100.0, 2.0)
    assert (score.localisation, score.missed, score.false, score.assigned) == pytest.approx((25.0, 5000.0, 5000.0, 2))
    assert score.distance == pytest.approx(np.sqrt(10025.0))


@pytest.mark.parametrize("bad", [{"c": 0.0}, {"c": np.nan}, {"p": 0.5}])
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(ValueError, match="cut-off above 0"):
        ospa(EMPTY, EMPTY, **{"c": 1.0, "p": 1.0, **bad})


def test_nan_points_are_refused():
    with pytest.raises(ValueError, match="finite points"):
        gospa(np.array([[np.nan, 0.0]]), EMPTY, 1.0, 1.0)


def line(identity, frames, y):
    return [(frame, identity, 10.0 * frame, y) for frame in frames]


def as_tracks(rows):
    rows = np.array(rows, dtype=float)
    return PointTracks(rows[:, 0], rows[:, 1], rows[:, 2:])


def test_a_swap_of_identities_costs_in_ospa2_and_counts_as_two_switches():
    truth = as_tracks(line(1, range(10), 0.0) + line(2, range(10), 30.0))
    swapped = as_tracks(
        line(1, range(5), 0.0) + line(2, range(5, 10), 0.0) + line(2, range(5), 30.0) + line(1, range(5, 10), 30.0)
    )
    assert identity_switches(truth, truth, 100.0) == 0
    assert identity_switches(truth, swapped, 100.0) == 2
    assert ospa2(truth, truth, 9, 10, 100.0, 1.0).distance == 0.0
    assert ospa2(truth, swapped, 9, 10, 100.0, 1.0).distance == pytest.approx(15.0)  # half the time 30 away
    scores = evaluate_points(truth, swapped, 10, 100.0)
    assert (scores.ospa1, scores.cardinality_error, scores.switches) == (0.0, 0.0, 2)


def test_a_track_that_is_half_missed_costs_the_cut_off_there():
    truth, found = as_tracks(line(1, range(10), 0.0)), as_tracks(line(7, range(5), 0.0))
    assert ospa2(truth, found, 9, 10, 100.0, 1.0).distance == pytest.approx(50.0)


def test_an_evaluation_without_truth_is_an_error():
    nothing = PointTracks(np.empty(0), np.empty(0), EMPTY)
    with pytest.raises(ValueError, match="at least one frame"):
        evaluate_points(nothing, nothing, 5, 100.0)
    assert evaluate_points(as_tracks(line(1, range(3), 0.0)), nothing, 3, 100.0).ospa1 == 100.0


def test_an_id_twice_in_a_frame_is_refused():
    with pytest.raises(ValueError, match="at most once"):
        as_tracks([(0, 1, 0, 0), (0, 1, 5, 5)])
