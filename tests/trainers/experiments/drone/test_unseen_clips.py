"""What is scored in chapter 5 is nothing that was learnt from."""

import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.trainers.experiments.drone.action_features import Plan, check_unseen


@pytest.mark.parametrize("plan", [Plan(), Plan(5, 10, 600)])
def test_the_clips_of_the_tables_are_new(plan: Plan) -> None:
    check_unseen(plan)


@pytest.mark.parametrize(("plan", "seed"), [(Plan(171, 1, 10), 20000), (Plan(1, 11001, 10), 9000 + 11000)])
def test_a_clip_that_something_was_learnt_from_is_refused(plan: Plan, seed: int) -> None:
    with pytest.raises(RequestError, match=f"got seed {seed}"):
        check_unseen(plan)
