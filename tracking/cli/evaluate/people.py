"""`tsuiseki evaluate people`."""

from __future__ import annotations

from tsuiseki.tracking.cli.evaluate.options import Labels, PlottedComparison


def people(given: PlottedComparison, labels: Labels) -> None:
    """Score tracked people against ground truth: HOTA, DetA, AssA, MOTA, MOTP, IDF1, switches, errors.

    Args:
        truth: a MOTChallenge gt.txt, a sequence folder, or a folder of sequences; a label file or the
            folder of Okutama-Action, VisDrone-MOT or KITTI tracking; the folder of Drone-Action; the JSON of CEPDOF, of
            whose rotated boxes the upright ones about them are taken, images in the order of their names.
        results: MOTChallenge text files, or folders that hold NAME.txt or NAME/tracks.txt for each sequence NAME
            (for a single sequence also tracks.txt); several are compared.
    """
    from tsuiseki.tracking.evaluation.multi import evaluate_sequences
    from tsuiseki.tracking.evaluation.pairs import match_results
    from tsuiseki.tracking.evaluation.table import people_table, people_values
    from tsuiseki.tracking.evaluation.truths import read_truths
    from tsuiseki.tracking.report.plots import save_comparison

    truths = read_truths(given.truth, labels.range, labels.protocol, labels.size)
    scores = {name: evaluate_sequences(match_results(truths, result)) for name, result in given.named().items()}
    given.report(people_table(scores), people_values(scores))
    given.draw(lambda path: save_comparison(scores, path))
