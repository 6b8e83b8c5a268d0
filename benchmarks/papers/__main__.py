"""The tables and figures of a paper: paper and here, plus the plots.

From a checkout with the extras train and dev:

    python -m benchmarks.papers NAME [options]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter

from benchmarks.papers import records
from benchmarks.papers.store import Store
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.output import output_folder

EXPERIMENTS = {
    "multi-correlation-filter": ("single_target:reproduce", "correlation filters selected by a particle filter"),
    "phd": ("finite_sets:reproduce", "finite-set filters on the standard scenarios"),
    "phd-unseen": ("finite_sets:unseen", "a sensor's measurements on new scenarios, with peers"),
    "phd-equalisation": ("finite_sets:equalisation", "equal likelihoods keep the weak target"),
    "blobs": ("finite_sets:blobs", "coloured objects, beside components and SORT"),
    "pca-particle-filter": ("goldfish:reproduce", "how many particles a goldfish needs"),
    "drone-action-features": ("drone_actions:reproduce", "tracks and actions from a drone improve each other"),
    "drone-heights": ("drone_heights:reproduce", "the flow beside the literal chain from three heights"),
    "omnidirectional": ("fisheye:reproduce", "people under ceiling fisheye cameras"),
    "stereo-sphere": ("sphere:reproduce", "a ball in space from two cameras"),
    "sphere-points": ("sphere:points", "a thrown ball from its measured pixels"),
    "association": ("association:reproduce", "people and cars linked on given detections, with peers"),
    "end-to-end": ("end_to_end:reproduce", "costs learnt through the flow"),
    "corrections": ("corrections:reproduce", "a simulated annotator who reviews results"),
    "answers": ("answers:reproduce", "counts and stays on generated streets and labelled video, with peers"),
    "one-floor": ("one_floor:reproduce", "people on one floor through several cameras, on WILDTRACK and Shelf"),
}
"""Place and summary of the experiments; a module is imported when its experiment is chosen."""

app = App(
    name="python -m benchmarks.papers",
    help=__doc__,
    version_flags=(),
    default_parameter=Parameter(consume_multiple=True, negative=()),
)
app.meta.suppress_keyboard_interrupt = False
for title, (place, summary) in EXPERIMENTS.items():
    app.command(f"benchmarks.papers.{place}", name=title, help=summary)


@app.meta.default
def run(
    *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    out: Path | None = None,
    overwrite: bool = False,
    cache: Path = Path("out/cache/experiments"),
    record: str | None = None,
) -> None:
    """Run an experiment, print its tables and write its files.

    Args:
        words: name and options of the experiment.
        out: folder for results.json, tables.md, tables.json, plots and pictures; by default out/NAME.
        overwrite: replace an earlier result in the folder.
        cache: folder that keeps what was computed, so that an experiment that was stopped goes on where it was.
        record: write tables.json to docs/results/tables/RECORD.json, too, and its tables into the pages.
    """
    if not words:
        app.meta.help_print()
        return
    experiment, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
    bound.apply_defaults()
    folder = out or Path("out") / words[0]
    with output_folder(folder, overwrite) as work:
        outcome = experiment(*bound.args, **bound.kwargs, store=Store(cache))
        outcome.write(work)
        text = records.record(words, bound.arguments, outcome.tables, outcome.notes)
        (work / "tables.json").write_text(text, encoding="utf-8")
    if record:
        (records.RECORDS / f"{record}.json").write_text(text, encoding="utf-8")
        records.refresh_pages()
    print(outcome.text(), f"results: {folder}", sep="\n")


def main(words: Sequence[str] | None = None) -> int:
    """Exit status: 0 done, 1 the run failed, 2 the request was wrong, 130 interrupted."""
    try:
        app.meta(words, exit_on_error=False, print_error=False, result_action="return_value")
    except (CycloptsError, RequestError) as error:
        print(f"papers: {error}", file=sys.stderr)
        return 2
    except RunError as error:
        print(f"papers: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("papers: interrupted; run the same command again to go on", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
