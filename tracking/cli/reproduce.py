"""`tsuiseki reproduce`: runs a paper's experiment, prints its tables, and writes tables, plots and numbers."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from tsuiseki.tracking.cli.extra import needs_train_extra
from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.trainers.experiments.experiment import Outcome, Table

T = TypeVar("T")
CACHE = Path("out/cache/experiments")
# How the options that every experiment has are documented.
COMMON = """
    out: folder for results.json, tables.md, plots, pictures and run.json.
    cache: folder that keeps what was computed, so that an experiment that was stopped goes on where it was; what other
        arguments, data or code made is never taken.
    overwrite: replace an earlier result.
"""


def run(name: str, module: str, words: Sequence[str]) -> int:
    """The experiment in ``tsuiseki.trainers.experiments.MODULE`` with the options in ``words``."""
    from tsuiseki.tracking.cli.parser import parse
    from tsuiseki.tracking.output import check_output_folder

    with needs_train_extra():
        experiment = importlib.import_module(f"tsuiseki.trainers.experiments.{module}").reproduce
    try:
        options = parse(f"tsuiseki reproduce {name}", with_common_options(name, experiment), (), words)
    except SystemExit as done:
        return int(done.code or 0)
    out, cache, overwrite = (options.pop(common) for common in ("out", "cache", "overwrite"))
    check_output_folder(out, overwrite)
    outcome = _outcome(experiment, cache, options)
    if outcome.finished:
        _write(outcome, out, overwrite, name, options)
        for table in outcome.tables:
            show(table)
    print("\n".join([*outcome.notes, *([f"results: {out}"] if outcome.finished else [])]))
    return 0


def with_common_options(name: str, experiment: Callable[..., Any]) -> Callable[..., Any]:
    """A function with the options of an experiment and those of every experiment, for the parser."""

    def command(**_: Any) -> None:
        """For the parser, which reads only the signature and the text that are set below."""

    own = [p for p in inspect.signature(experiment, eval_str=True).parameters.values() if p.name != "bench"]
    common = (("out", Path(f"out/{name}"), Path), ("cache", CACHE, Path), ("overwrite", False, bool))
    added = [inspect.Parameter(n, inspect.Parameter.KEYWORD_ONLY, default=d, annotation=k) for n, d, k in common]
    every = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own] + added
    command.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in every}
    head, _, arguments = (inspect.getdoc(experiment) or "").partition("Args:")
    lines = [line for line in arguments.partition("\n\n")[0].splitlines() if not line.startswith("    bench:")]
    command.__doc__ = "\n".join([f"{head}Args:", *lines[1:], *COMMON.splitlines()[1:]])
    return command


def _outcome(experiment: Callable[..., Outcome], cache: Path, options: Mapping[str, Any]) -> Outcome:
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.trainers.experiments.experiment import Bench, Watch
    from tsuiseki.trainers.experiments.store import Store

    class Terminal(Watch):
        def over(self, items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
            return progress(items, what, total)

        def say(self, line: str) -> None:
            print(line, file=sys.stderr, flush=True)

    try:
        return experiment(Bench(Store(cache), Terminal()), **options)
    except KeyboardInterrupt:
        print(f"what was computed is kept in {cache}: run the same command again to go on", file=sys.stderr)
        raise
    except RequestError as error:
        argument, colon, rest = str(error).partition(":")
        # The library speaks of arguments, the command line of options.
        raise RequestError(f"--{argument.replace('_', '-')}{colon}{rest}") if argument in options else error from None


def _write(outcome: Outcome, out: Path, overwrite: bool, name: str, options: Mapping[str, Any]) -> None:
    import json

    from tsuiseki.tracking.output import RunRecord, output_folder

    with output_folder(out, overwrite) as work:
        (work / "results.json").write_text(json.dumps(outcome.values, indent=1) + "\n", encoding="utf-8")
        text = "\n\n".join([*(table.markdown() for table in outcome.tables), *outcome.notes])
        (work / "tables.md").write_text(text.strip() + "\n", encoding="utf-8")
        for plot, figure in outcome.plots.items():
            figure.savefig(work / f"{plot}.png", facecolor="white")
        for file, content in outcome.files.items():
            (work / file).write_bytes(content if isinstance(content, bytes) else content.encode())
        seed = int(options.get("seed", 0))
        RunRecord(["tsuiseki", "reproduce", name], options, seed).write(work)


def show(table: Table) -> None:
    """Print a table; nothing where it has no row."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table as Shown

    if not table.rows:
        return
    shown = Shown(title=table.title or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for number, heading in enumerate(table.columns):
        shown.add_column(heading, justify="right" if number else "left")
    for row in table.rows:
        shown.add_row(*row)
    Console(width=max(160, Console().width)).print(shown)


phd = partial(run, "phd", "finite_sets.phd")
phd_equalisation = partial(run, "phd-equalisation", "finite_sets.equalisation")
multi_correlation_filter = partial(run, "multi-correlation-filter", "single.multi_correlation_filter")
stereo_sphere = partial(run, "stereo-sphere", "sphere.stereo_sphere")
multiview_drone = partial(run, "multiview-drone", "sphere.multiview_drone")
pca_particle_filter = partial(run, "pca-particle-filter", "goldfish.pca_particle_filter")
association = partial(run, "association", "association.association")
omnidirectional = partial(run, "omnidirectional", "fisheye.omnidirectional")
drone_action_features = partial(run, "drone-action-features", "drone.action_features")
