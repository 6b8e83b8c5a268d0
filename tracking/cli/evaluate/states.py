"""`tsuiseki evaluate states`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Comparison, Stretch


def states(given: Comparison, stretch: Stretch, distance: float = 20.0) -> None:
    """Score bodies that were followed against their exact states: errors of position and heading, success, identity.

    A body is found in a frame where an estimate that its tracker believes lies within --distance of it.

    Args:
        truth: states.csv with the columns frame,id, a position a,b or x,y, and for the heading theta or points at both
            ends of the body (head_x,head_y and abdomen_x,abdomen_y); or the folder that holds it.
        results: of the same kind, such as folders of tsuiseki track deformable; several are compared.
        distance: pixels within which a body is found.
    """
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.evaluation.state_table import state_table
    from tsuiseki.tracking.evaluation.states import evaluate_state_files

    if not distance > 0:
        raise RequestError(f"`distance`: expected pixels above 0, got {distance:g}")
    scores = evaluate_state_files(given.truth, given.named(), distance, stretch.range)
    given.report(state_table(scores), {name: one.values() for name, one in scores.items()})
