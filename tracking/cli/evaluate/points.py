"""`tsuiseki evaluate points`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Comparison, Stretch


def points(given: Comparison, stretch: Stretch, cutoff: float = 100.0, window: int = 10) -> None:
    """Score tracked points: OSPA, OSPA(2), GOSPA and its parts, number of targets, changed identities.

    Means are over all frames from the first on; where labels or results begin later, give --frames.

    Args:
        truth: points as CSV with the columns frame,id,x,y, or MOTChallenge text, whose boxes count by their centres.
        results: of the same kinds; several are compared.
        cutoff: distance from which a point counts as missed, in the unit of the files.
        window: frames of OSPA(2).
    """
    from dataclasses import asdict

    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.evaluation.point_files import evaluate_point_files
    from tsuiseki.tracking.evaluation.point_table import point_table

    if not cutoff > 0:
        raise RequestError(f"`cutoff`: expected a distance above 0, got {cutoff:g}")
    if window < 1:
        raise RequestError(f"`window`: expected 1 frame or more, got {window}")
    scores = evaluate_point_files(given.truth, given.named(), cutoff, window, stretch.range)
    given.report(point_table(scores), {name: asdict(one) for name, one in scores.items()})
