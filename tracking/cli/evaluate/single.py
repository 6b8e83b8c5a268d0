"""`tsuiseki evaluate single`: by the rules of the OTB benchmark."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.cli.evaluate.options import PlottedComparison


def single(
    given: PlottedComparison,
    attributes: Path | None = None,
    by: Literal["sequence", "attribute"] = "sequence",
    published_precision: bool = False,
) -> None:
    """Score a tracker of one target: area under the success curve, precision, curves, by sequence and attribute.

    Args:
        truth: a sequence folder (OTB, VOT, UAV123), a folder of them, or a folder of label files NAME.txt.
        results: a folder with NAME.txt, NAME.json or NAME/boxes.txt for each sequence NAME, one file for a single
            sequence, or a folder of tracker_benchmark's score files (ALL.json and others); several are compared.
        attributes: a list like OTB's tb_50.txt, or a folder of tracker_benchmark's score files; only the sequences in
            it are scored.
        by: what the rows of the table are.
        published_precision: count boxes that start outside the image as tracker_benchmark's published curves do.
        json: write all scores and curves to this file.
        plot: write the curves to this file (PNG, SVG or PDF).
    """
    from tsuiseki.tracking.evaluation.single_table import compare, single_table, single_values
    from tsuiseki.tracking.formats.single import find_single_sequences
    from tsuiseki.tracking.report.single_plots import save_curves

    sequences = find_single_sequences(given.truth, attributes)
    compared = {name: compare(sequences, path, published_precision) for name, path in given.named().items()}
    given.report(single_table(compared, by), single_values(compared))
    for name, result in compared.items():
        for sequence, scores in result.sequences.items():
            if scores.note:
                print(f"{name}, {sequence}: {scores.note}", file=sys.stderr)
        if result.missing:
            print(f"{name}: no result for {', '.join(result.missing)}; left out of its means", file=sys.stderr)
    given.draw(lambda path: save_curves({name: r.groups for name, r in compared.items()}, path))
