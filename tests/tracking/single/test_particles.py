"""The thesis's particles: each decision that the text leaves open is held here."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.point_motion import PlaneWalk
from tsuiseki.tracking.single.kcf_particle import PRINTED
from tsuiseki.tracking.single.particles import (
    SMALLEST_LIKELIHOOD,
    Confidence,
    SearchView,
    best_by_filter,
    densest,
    dispersion,
    draw_particles,
    jump_prior,
    step_deviation,
)
from tsuiseki.tracking.single.search_windows import ResponseMaps

PEAKS = np.array([[10.0, 10.0], [200.0, 50.0], [60.0, 150.0]])
DEVIATION = np.array([2.0, 3.0])


def draw(past_share, weights=(1.0, 3.0), count=20000):
    rng = np.random.default_rng(0)
    return draw_particles(PEAKS, np.array(weights), past_share, count, DEVIATION, rng)


def test_the_divisor_divides_variances():
    np.testing.assert_allclose(step_deviation(np.array([30.0, 120.0])), [3.0, 6.0])


def test_particles_lie_about_their_maximum_with_the_covariance_of_the_motion():
    particles = draw(0.0)
    number = particles[:, 2].astype(int)
    np.testing.assert_allclose(np.bincount(number) / len(number), 1 / 3, atol=0.015)  # 4 standard errors
    offset = particles[:, :2] - PEAKS[number]
    np.testing.assert_allclose(offset.mean(axis=0), 0, atol=0.1)
    np.testing.assert_allclose(offset.std(axis=0), DEVIATION, rtol=0.03)


@pytest.mark.parametrize("past_share", [0.25, 0.5, 1.0])
def test_a_share_of_the_filters_comes_from_the_past(past_share):
    number = draw(past_share)[:, 2].astype(int)
    assert (number >= 3).mean() == pytest.approx(past_share, abs=0.015)
    # drawn by weight 1 : 3
    assert (number == 4).sum() / (number >= 3).sum() == pytest.approx(0.75, abs=0.03)


def test_without_a_past_every_filter_is_a_hypothesis():
    assert draw(1.0, weights=())[:, 2].max() <= 2


def test_the_walk_keeps_filter_numbers():
    particles = draw(0.5)
    moved = PlaneWalk(DEVIATION)(particles, 1.0, np.random.default_rng(1))
    assert (moved[:, 2] == particles[:, 2]).all()
    np.testing.assert_allclose((moved - particles)[:, :2].std(axis=0), DEVIATION, rtol=0.03)


def test_dispersion_by_hand():
    particles = np.array([[0, 0, 0], [4, 0, 0], [0, 0, 1.0]])
    weights = np.array([0.5, 0.25, 0.25])
    # x: mean 1, variance 3, over 2; filters: 1 - (0.75^2 + 0.25^2)
    assert dispersion(particles, weights, np.array([2.0, 5.0])) == pytest.approx(3 / 2 + 0.375)


def test_dispersion_falls_as_particles_agree():
    """With the particles' own covariance as C it would be 2 for both."""
    cloud = draw(0.0, count=500)
    cloud[:, 2] = 0
    narrow = cloud * [0.1, 0.1, 1]
    weights = np.full(500, 1 / 500)
    assert dispersion(narrow, weights, DEVIATION**2) == pytest.approx(0.01 * dispersion(cloud, weights, DEVIATION**2))


def test_names_of_filters_do_not_matter():
    particles = draw(0.5, count=100)
    renamed = particles.copy()
    renamed[:, 2] = np.array([7, 0, 30, 2, 11])[particles[:, 2].astype(int)]
    weights = np.full(100, 0.01)
    assert dispersion(particles, weights, DEVIATION**2) == pytest.approx(dispersion(renamed, weights, DEVIATION**2))


def test_each_filter_learns_from_its_heaviest_particle():
    particles = np.array([[1, 1, 4], [2, 2, 0], [3, 3, 4], [5, 5, 0.0]])
    used, places = best_by_filter(particles, np.array([0.1, 0.4, 0.2, 0.3]))
    assert used.tolist() == [0, 4]
    assert places.tolist() == [[2, 2], [3, 3]]


def test_a_place_counts_by_the_particles_around_it():
    rng = np.random.default_rng(0)
    group = np.column_stack([rng.normal(50, 0.5, (40, 2)), np.zeros(40)])
    alone = np.array([[10.0, 10.0, 1.0]])
    weights = np.append(np.full(40, 0.8 / 40), 0.2)  # ten times as heavy as each of the others
    particles = np.concatenate([group, alone])
    weights[7] = 0.04
    assert densest(particles, weights, np.array([2.0, 2.0])) == 7


def test_near_maxima_are_drawn_more_often():
    shares = jump_prior(np.array([[0.0, 0], [20, 0], [0, 80]]), np.zeros(2), np.array([20.0, 40.0]))
    # 1, 1 / 2 and 1 / 5, normalised
    np.testing.assert_allclose(shares, np.array([10, 5, 2]) / 17)
    particles = draw_particles(PEAKS, np.empty(0), 0.0, 20000, DEVIATION, np.random.default_rng(0), shares)
    np.testing.assert_allclose(np.bincount(particles[:, 2].astype(int)) / 20000, shares, atol=0.015)


def test_likelihood_mixes_response_and_the_best_overlap_with_an_object():
    """Equations (3.4) and (3.6) by hand; a negative response counts as none."""
    maps = ResponseMaps(np.full((1, 2, 4, 4), 0.5, dtype=np.float32), np.zeros((1, 2)), cell=100.0)
    maps.maps[0, 1] = -0.2
    image, known = np.zeros((4, 4, 3), dtype=np.uint8), Confidence(PRINTED)
    particles = np.array([[1, 1, 0], [1, 1, 1], [11, 11, 0.0]])
    proposals = np.array([[0, 0, 2, 1], [1, 1, 3, 3.0]])
    found = SearchView(maps, image, proposals).log_likelihood(particles, np.array([2.0, 2.0]), known)
    np.testing.assert_allclose(np.exp(found) - SMALLEST_LIKELIHOOD, [0.5, 0.35, 0.15])
    none = SearchView(maps, image, None).log_likelihood(particles, np.array([2.0, 2.0]), known)
    np.testing.assert_allclose(np.exp(none) - SMALLEST_LIKELIHOOD, [0.15, 0, 0.15], atol=1e-12)
