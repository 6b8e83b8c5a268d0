"""`tsuiseki evaluate single`: boxes of one target against labels, by the rules of the OTB benchmark."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.cli.evaluate import _check_plot, _result_names, _write_json


def single(
    truth: Path,
    results: list[Path],
    attributes: Path | None = None,
    names: list[str] | None = None,
    by: Literal["sequence", "attribute"] = "sequence",
    published_precision: bool = False,
    json: Path | None = None,
    plot: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score a tracker of one target: area under the success curve, precision, curves, by sequence and attribute.

    Args:
        truth: a sequence folder (OTB, VOT, UAV123), a folder of them, or a folder of label files NAME.txt.
        results: a folder with NAME.txt, NAME.json or NAME/boxes.txt for each sequence NAME, one file for a single
            sequence, or a folder of tracker_benchmark's score files (ALL.json and others); several are compared.
        attributes: a list like OTB's tb_50.txt, or a folder of tracker_benchmark's score files; only the sequences in
            it are scored.
        names: of the results in the table, separated by commas; by default their files' or folders'.
        by: what the rows of the table are.
        published_precision: count boxes that start outside the image as tracker_benchmark's published curves do.
        json: write all scores and curves to this file.
        plot: write the curves to this file (PNG, SVG or PDF).
        overwrite: replace existing files.
    """
    from tsuiseki.tracking.evaluation.single_table import compare, single_table, single_values
    from tsuiseki.tracking.evaluation.table import show
    from tsuiseki.tracking.formats.single import find_single_sequences
    from tsuiseki.tracking.output import check_output_file, output_file
    from tsuiseki.tracking.report.single_plots import save_curves

    shown = _result_names(results, names)
    for path in (json, plot):
        if path is not None:
            check_output_file(path, overwrite)
    _check_plot(plot)
    sequences = find_single_sequences(truth, attributes)
    compared = {name: compare(sequences, path, published_precision) for name, path in zip(shown, results, strict=True)}
    show(single_table(compared, by))
    for name, result in compared.items():
        for sequence, scores in result.sequences.items():
            if scores.note:
                print(f"{name}, {sequence}: {scores.note}", file=sys.stderr)
        if result.missing:
            print(f"{name}: no result for {', '.join(result.missing)}; left out of its means", file=sys.stderr)
    if json is not None:
        _write_json(json, single_values(compared), overwrite)
    if plot is not None:
        with output_file(plot, overwrite) as work:
            save_curves({name: result.groups for name, result in compared.items()}, work)
