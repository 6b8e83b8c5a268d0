"""People on one ground keep their scores, boxes of other heights lose what the mixture says, little shows nothing."""

from __future__ import annotations

import re
from math import exp, log, sqrt, tau

import numpy as np
import pytest

from tsuiseki.tracking.features import ground_plane
from tsuiseki.tracking.features.ground_plane import SPREAD, GroundPlane
from tsuiseki.tracking.types import Detections

HEIGHT = 480
HORIZON, SLOPE = 48.0, 0.4  # the first is a tenth of the frame's height, a row of the votes


def standing(rows, taller=None, horizon=HORIZON, slope=SLOPE, scores=0.9):
    """Detections of people with their feet in these rows, on one ground but for what they are ``taller``."""
    rows = np.asarray(rows, dtype=float)
    heights = slope * (rows - horizon) * (1.0 if taller is None else np.asarray(taller))
    left = 40.0 * np.arange(len(rows))
    return Detections(
        np.stack([left, rows - heights, left + heights / 2, rows], axis=1), np.broadcast_to(scores, len(rows)).copy()
    )


def logit(scores):
    return np.log(scores / (1 - scores))


def after(frames, ground=None, height=HEIGHT):
    """The scores of the last of these frames."""
    ground = ground or GroundPlane(10.0)
    for found in frames:
        weighed = ground.weighed(found, height)
    return weighed.scores, ground


ROWS = np.linspace(120, 460, 12)


def test_people_on_one_ground_keep_their_scores():
    given = standing(ROWS, scores=np.linspace(0.31, 0.99, 12))
    scores, ground = after([given] * 5)
    assert ground.holds
    assert ground.used == 5
    np.testing.assert_array_equal(scores, given.scores)
    # Horizons lie a hundredth of the frame apart and logarithms of slopes a twentieth; the next of each fit as well.
    assert ground.line.horizon * HEIGHT == pytest.approx(HORIZON, abs=0.02 * HEIGHT)
    assert ground.line.slope == pytest.approx(SLOPE, rel=0.1)
    assert ground.line.explained == pytest.approx(1.0, abs=0.02)  # the kernel's loss at half a bin and a horizon off


@pytest.mark.parametrize("factor", [0.4, 0.6, 1.5, 2.0])
@pytest.mark.parametrize("score", [0.2, 0.35, 0.9])
def test_a_box_of_another_height_loses_what_the_mixture_says(factor, score):
    ground = GroundPlane(10.0)
    after([standing(ROWS)] * 20, ground)
    # The odd one votes once against twelve in twenty frames.
    scores, _ = after([standing([300.0], [factor], scores=score)], ground)
    p, spread = ground.line.explained, SPREAD
    density = log(10) / (spread * sqrt(tau))

    def mixture(ratio):
        return p * density * exp(-0.5 * (ratio / spread) ** 2) + 1 - p

    # A twentieth of the logarithm and a fiftieth of the frame, here 0.04, are free, and the line may be off by as much.
    free = 0.05 + 0.02 * HEIGHT / (300 - HORIZON)
    least, most = (log(mixture(max(abs(log(factor)) - free + off, 0)) / mixture(0)) for off in (free, -free))
    assert least <= logit(scores)[0] - logit(score) <= most
    assert most < 0


def test_nobody_gains():
    rng = np.random.default_rng(0)
    ground = GroundPlane(10.0)
    for _ in range(30):
        given = standing(rng.uniform(100, 470, 20), rng.lognormal(0, 0.3, 20), scores=rng.uniform(0, 1, 20))
        assert (ground.weighed(given, HEIGHT).scores <= given.scores).all()
    assert ground.used > 20


def test_a_picture_of_twice_the_size_gives_the_same_scores():
    rng = np.random.default_rng(1)
    small, large = GroundPlane(10.0), GroundPlane(10.0)
    for _ in range(10):
        given = standing(rng.uniform(100, 470, 15), rng.lognormal(0, 0.2, 15), scores=rng.uniform(0.1, 0.9, 15))
        one = small.weighed(given, HEIGHT)
        two = large.weighed(Detections(2 * given.boxes, given.scores), 2 * HEIGHT)
        np.testing.assert_allclose(one.scores, two.scores, rtol=1e-12)
    assert small.used > 5


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("nobody", Detections.empty()),
        ("one place", standing([300.0] * 9)),
        ("one row, other heights", standing([300.0] * 9, [1, 1, 1.1, 0.9, 1.05, 0.95, 1, 1, 2.0])),
        ("unsure", standing(ROWS, scores=0.29)),
        ("one height in all rows, as under a ceiling", standing(ROWS, 90.0 / (SLOPE * (ROWS - HORIZON)))),
        ("the higher up the taller", standing(ROWS, (600 - ROWS) / (SLOPE * (ROWS - HORIZON)) * 0.3)),
    ],
)
def test_what_shows_no_ground_is_left_as_it_is(name, frame):
    scores, ground = after([frame] * 50)
    assert not ground.used, name
    np.testing.assert_array_equal(scores, frame.scores)


def test_boxes_of_any_height_are_left_as_they_are():
    rng = np.random.default_rng(2)
    ground = GroundPlane(10.0)
    for _ in range(50):
        ground.weighed(standing(rng.uniform(200, 470, 10), rng.lognormal(0, 0.8, 10)), HEIGHT)
    assert not ground.used


def test_a_few_people_are_not_enough(monkeypatch):
    few = [standing(ROWS[:3])]
    assert not after(few)[1].used
    monkeypatch.setattr(ground_plane, "ENOUGH", 1.0)
    assert after(few)[1].used == 1


def test_a_box_cut_off_by_the_border_may_be_short_but_not_tall():
    ground = GroundPlane(10.0)
    after([standing(ROWS)] * 5, ground)
    half = SLOPE * (HEIGHT - HORIZON) / 2
    found = Detections(
        np.array([[0, HEIGHT - half, 40, HEIGHT], [0, HEIGHT - 5 * half, 99, HEIGHT]]), np.array([0.8, 0.8])
    )
    short, tall = ground.weighed(found, HEIGHT).scores
    assert short == 0.8
    assert tall < 0.7


def test_far_away_where_a_row_is_half_a_height_a_box_may_be_of_any_of_these():
    ground = GroundPlane(10.0)
    after([standing(ROWS)] * 5, ground)
    row = ground.line.horizon * HEIGHT + 0.01 * HEIGHT
    expected = SLOPE * 0.01 * HEIGHT
    twice, tenfold = (Detections(np.array([[9, row - n * expected, 20, row]]), np.array([0.8])) for n in (2, 10))
    assert ground.weighed(twice, HEIGHT).scores == 0.8
    assert ground.weighed(tenfold, HEIGHT).scores < 0.7


def test_who_lies_is_as_long_as_who_stands_is_high():
    ground = GroundPlane(10.0)
    after([standing(ROWS)] * 5, ground)
    length = SLOPE * (300 - HORIZON)
    lying = np.array([[100, 300 - 0.3 * length, 100 + length, 300], [100, 300 - 0.3 * length, 100 + 0.3 * length, 300]])
    scores = ground.weighed(Detections(lying, np.array([0.8, 0.8])), HEIGHT).scores
    assert scores[0] == pytest.approx(0.8, abs=0.01)
    assert scores[1] < 0.5
    cut_off = np.array([[50.0, HEIGHT - 50, 450, HEIGHT - 1]])
    assert ground.weighed(Detections(cut_off, np.array([0.8])), HEIGHT).scores == 0.8
    # They lie on no line by their heights, so they do not vote.
    line = ground.line
    for _ in range(50):
        ground.weighed(Detections(lying[:1], np.array([0.9])), HEIGHT)
    assert (ground.line.horizon, ground.line.slope) == (line.horizon, line.slope)


def test_feet_above_the_horizon_lose_most_and_what_falls_below_the_threshold_is_dropped():
    ground = GroundPlane(10.0, score_threshold=0.3)
    after([standing(ROWS)] * 5, ground)
    window = Detections(np.array([[200.0, 4, 220, 40]]), np.array([0.5]))
    assert len(ground.weighed(window, HEIGHT)) == 0
    assert ground.dropped == 1


def test_a_camera_that_tilts_is_followed():
    ground = GroundPlane(2.0)
    after([standing(ROWS)] * 50, ground)
    # The horizon sinks by 96 rows, and with it everybody.
    rows = ROWS[:-3] + 96
    scores, _ = after([standing(rows, horizon=HORIZON + 96)] * 50, ground)
    np.testing.assert_array_equal(scores, np.full(len(rows), 0.9))
    assert ground.line.horizon * HEIGHT == pytest.approx(HORIZON + 96, abs=0.02 * HEIGHT)


def test_features_go_with_their_boxes():
    ground = GroundPlane(10.0, score_threshold=0.3)
    after([standing(ROWS)] * 5, ground)
    found = standing([200.0, 300.0], [8.0, 1.0], scores=0.31).with_features(np.eye(2))
    kept = ground.weighed(found, HEIGHT)
    assert kept.features.tolist() == [[0, 1]]


def test_a_frame_rate_of_nothing_is_refused():
    with pytest.raises(ValueError, match="frame rate above 0, got 0"):
        GroundPlane(0.0)


def test_the_line_says_what_it_explains():
    _, ground = after([standing(ROWS)] * 5)
    assert re.fullmatch(
        r"people's heights by row: one ground explains (99|100) % of them, used in 5 of 5 frames, 0 boxes of other "
        "heights left out",
        str(ground),
    )
    assert ground.facts().keys() == {"frames", "used", "dropped", "horizon", "slope", "explained"}
