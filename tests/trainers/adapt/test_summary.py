"""What the report of an adaptation shows."""

from __future__ import annotations

from tsuiseki.trainers.adapt.summary import spread_best


def test_pictures_that_differ_most_are_some_time_apart() -> None:
    """Neighbours of a picture show the same again, however much they differ."""
    values = dict.fromkeys(range(40), 0) | {10: 9, 11: 8, 12: 7, 30: 6, 20: 5}
    assert spread_best(values, 4, 5) == [0, 10, 20, 30]
    assert spread_best({3: 1}, 4, 5) == [3]
    assert spread_best({}, 4, 5) == []
