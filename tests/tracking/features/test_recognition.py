"""Who of a gallery somebody is: closed forms, properties, and calibration on generated people."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.association.gallery import calibration_error, generated, scores
from tsuiseki.datamodules.identity_crops import render_people
from tsuiseki.tracking.features import recognition
from tsuiseki.tracking.features.exported import Appearance, as_describer
from tsuiseki.tracking.features.recognition import DIFFERENT, SAME, SHARE, centred, identity_of, recognise


def row(cosine: float, length: int = 8) -> np.ndarray:
    """A row of unit length with this cosine to the first axis."""
    return np.array([cosine, *np.zeros(length - 2), np.sqrt(1 - cosine**2)])


def density(value: float, mean: float, deviation: float) -> float:
    return float(np.exp(-0.5 * ((value - mean) / deviation) ** 2) / deviation)


@pytest.mark.parametrize("cosine", [-0.5, 0.3, 0.7, 0.95])
def test_the_odds_of_one_person_are_those_of_the_formula(cosine: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """(1) and (2) with one person in view and one in the gallery, at the share before it is learnt."""
    monkeypatch.setattr(recognition, "ROUNDS", 1)
    chance = recognise(row(cosine)[None], np.eye(8)[:1], np.ones((1, 1), bool))[0, 0]
    odds = SHARE / (1 - SHARE) * density(min(cosine, SAME[0]), *SAME) / density(cosine, *DIFFERENT)
    assert chance == pytest.approx(odds / (1 + odds))


def test_the_share_agrees_with_the_probabilities() -> None:
    """A doubtful one is less likely of the gallery where all others are strangers to it."""
    doubtful, far = row(0.45), -np.eye(8)
    apart = np.eye(7, dtype=bool)
    alone = recognise(doubtful[None], np.eye(8)[:7], apart[:1, :1])[0].sum()
    strangers = recognise(np.vstack([doubtful, far[1:7]]), np.eye(8)[:7], apart)[0].sum()
    assert strangers < alone


def test_the_cosine_of_one_person_is_learnt() -> None:
    """Where all of the gallery come with a lower cosine than usual, it says more than where one comes alone."""
    length, cosine = 40, 0.5
    people = np.hstack([cosine * np.eye(12), np.sqrt(1 - cosine**2) * np.eye(12), np.zeros((12, 16))])
    likenesses = np.eye(length)[:12]
    together = recognise(people, likenesses, np.ones((12, 12), bool))
    alone = recognise(people[:1], likenesses, np.ones((1, 1), bool))
    assert together[0, 0] > alone[0, 0]
    assert (together.argmax(axis=1) == np.arange(12)).all()


def test_two_who_are_there_at_once_are_not_both_the_same_person() -> None:
    alike = np.array([row(0.9), row(0.9)])
    apart = recognise(alike, np.eye(8)[:1], np.eye(2, dtype=bool))[:, 0]
    together = recognise(alike, np.eye(8)[:1], np.ones((2, 2), bool))[:, 0]
    assert (apart > 0.8).all()
    assert together.sum() <= 1


@pytest.mark.parametrize("seed", range(5))
def test_probabilities_are_those_of_one_answer_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    features = recognition.unit_rows(rng.normal(size=(6, 8)))
    features[0] = 0.0
    chances = recognise(features, recognition.unit_rows(rng.normal(size=(4, 8))), rng.random((6, 6)) < 0.5)
    assert ((chances >= 0) & (chances <= 1)).all()
    assert (chances.sum(axis=1) <= 1 + 1e-12).all()
    # Of whom nothing is known, all are as likely.
    assert np.ptp(recognise(features[:1], features[1:4], np.ones((1, 1), bool))) < 1e-12


def test_nobody_is_an_answer() -> None:
    assert identity_of(np.array([0.2, 0.3]), ["anna", "ben"]).name == ""
    assert identity_of(np.array([0.2, 0.3]), ["anna", "ben"]).probability == pytest.approx(0.5)
    assert identity_of(np.array([0.2, 0.7]), ["anna", "ben"]) == recognition.Recognition("ben", 0.7)
    assert identity_of(np.empty(0), []) == recognition.Recognition("", 1.0)
    assert recognise(np.eye(3), np.empty((0, 3)), np.eye(3, dtype=bool)).shape == (3, 0)


def test_a_view_of_few_people_takes_the_usual_centre() -> None:
    rng = np.random.default_rng(0)
    rows, usual = rng.normal(size=(3, 8)) + 2, np.full(8, 0.3)
    assert np.allclose(centred(rows, usual), recognition.without(rows, usual))
    many = rng.normal(size=(9, 8)) + 2
    assert np.allclose(recognition.centre_of(many), recognition.unit_rows(many).mean(axis=0))
    assert np.allclose(np.linalg.norm(centred(many), axis=1), 1)
    assert not centred(np.zeros((1, 8)), usual).any()


def test_the_error_of_calibration_is_that_of_bins() -> None:
    assert calibration_error(np.array([0.95, 0.95, 0.15, 0.15]), np.array([1, 1, 0, 0])) == pytest.approx(0.1)
    assert calibration_error(np.array([0.5, 0.5]), np.array([1, 0])) == pytest.approx(0.0)


@pytest.mark.slow
def test_66_3_generated_people_are_recognised_and_the_probabilities_are_right() -> None:
    """Rank 1 of at least .9, and an error of at most .05, at one stranger in twenty and at as many as known people."""
    describer = as_describer("people")
    assert isinstance(describer, Appearance)
    crops = render_people(67, 60, 12)
    places = [generated(describer, crops, 2000 + n, same=True) for n in range(12)]
    for strangers in (0.05, 0.5):
        rank, _, error = scores(places, strangers)
        assert rank >= 0.9
        assert error <= 0.05
