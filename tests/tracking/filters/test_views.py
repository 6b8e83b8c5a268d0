"""Covered views: the mixture and its update against Bayes' rule written out."""

import numpy as np
import pytest

from tsuiseki.tracking.filters.resampling import Covering, open_after, weigh_views


def test_weights_and_update_are_bayes_rule():
    ratios = np.array([[2.0, -1.0], [0.5, -30.0]])
    before = np.array([0.9, 0.4])
    expected = np.log(before * np.exp(ratios) + 1 - before)
    np.testing.assert_allclose(weigh_views(ratios, before), expected)
    weights = np.array([0.25, 0.75])
    share = before * np.exp(ratios) / (before * np.exp(ratios) + 1 - before)
    np.testing.assert_allclose(open_after(ratios, before, weights), weights @ share)


def test_a_view_that_speaks_against_every_particle_weighs_them_alike():
    ratios = np.array([[-40.0], [-80.0], [-60.0]])
    np.testing.assert_allclose(weigh_views(ratios, np.array([0.9])), np.log(0.1), atol=1e-12)
    assert open_after(ratios, np.array([0.9]), np.full(3, 1 / 3))[0] < 1e-15


def test_prediction_is_a_markov_chain_within_its_floor():
    covering = Covering(covers=0.5, opens=1.5, floor=0.02)
    once = covering.predict(np.array([0.1, 0.9]), 0.6)
    twice = covering.predict(covering.predict(np.array([0.1, 0.9]), 0.2), 0.4)
    np.testing.assert_allclose(once, twice)
    np.testing.assert_allclose(covering.predict(np.array([0.1, 0.9]), 1e3), 0.75)
    assert covering.predict(np.array([0.0, 1.0]), 0.0) == pytest.approx([0.02, 0.98])
