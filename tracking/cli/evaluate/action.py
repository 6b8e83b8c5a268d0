"""`tsuiseki evaluate action`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Comparison, Labels


def action(given: Comparison, labels: Labels, threshold: float = 0.4, multiple_actions: bool = False) -> None:
    """Score what people were said to do: F1 at a threshold, and average precision, for every action.

    A row is a labelled person in a frame, or a tracked box on nobody. An action is called where its probability is
    above the threshold; F1 = 2 TP / (2 TP + FP + FN) over all rows. "single" are the probabilities of single frames,
    "multi" those averaged over the window along the track. With tracks given to `track drone --tracks`, only
    recognition is scored; with tracks of its own, misses and false tracks count, too.

    Args:
        truth: a MOTChallenge sequence folder with gt/actions.txt (Okutama-Action's rows), or a folder of such; a label
            file or the folder of Okutama-Action; the folder of Drone-Action.
        results: tracks.json of tsuiseki track drone, or folders that hold NAME/tracks.json for each clip NAME (for a
            single clip also tracks.json); several are compared.
        threshold: an action is called where its probability is above, from 0 to 1.
        multiple_actions: in the folder of Okutama-Action, score against MultiActionLabels, which have all actions of
            a person, instead of SingleActionTrackingLabels, which have one.
    """
    from tsuiseki.tracking.errors import RequestError
    from tsuiseki.tracking.evaluation.action.action import evaluate_actions
    from tsuiseki.tracking.evaluation.action.action_pairs import match_actions, read_labelled_actions
    from tsuiseki.tracking.evaluation.action.action_table import action_table, action_values

    if not 0 <= threshold <= 1:
        raise RequestError(f"`threshold`: expected a number from 0 to 1, got {threshold:g}")
    truths = read_labelled_actions(given.truth, labels.protocol, labels.size, multiple_actions, labels.range)
    scores = {}
    for name, result in given.named().items():
        rows = match_actions(truths, result)
        for kind in ("single", "multi"):
            values = getattr(rows, kind)
            scores[f"{name} {kind}"] = evaluate_actions(truths[0].names, values, rows.truth, threshold)
    given.report(action_table(scores), action_values(scores))
