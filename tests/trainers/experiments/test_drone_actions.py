"""Clips that are scored in chapter 5 are none that something was learnt from."""

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.drone_actions import scored_plans, second_plans


@pytest.mark.parametrize("size", [(3, 2, 300), (5, 10, 600)])
def test_the_clips_of_the_tables_are_new(size: tuple[int, int, int]) -> None:
    seeds, clips, _ = size
    assert len(scored_plans(*size)) == seeds * clips
    assert len(second_plans(*size[1:])) == clips


def test_a_clip_that_something_was_learnt_from_is_refused() -> None:
    with pytest.raises(RequestError, match="got seed 20000"):
        scored_plans(171, 1, 10)
    with pytest.raises(RequestError, match="got seed 20000"):
        second_plans(11001, 10)
