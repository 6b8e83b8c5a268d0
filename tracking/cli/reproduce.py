"""`tsuiseki reproduce`: runs a paper's experiment, prints its tables, and writes tables, plots and numbers."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from tsuiseki.tracking.cli.options import Output
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import Interrupted, signal_of

if TYPE_CHECKING:
    from tsuiseki.trainers.experiments.study import Outcome

T = TypeVar("T")


@dataclass(frozen=True)
class Reproduction(Output):
    """Where an experiment computes, and where its result goes.

    Attributes:
        out: folder for results.json, tables.md, plots, pictures and run.json.
        cache: folder that keeps what was computed, so that an experiment that was stopped goes on where it was; what
            other arguments, data or code made is never taken.
    """

    cache: Path = Path("out/cache/experiments")


def reproduction(name: str, experiment: Callable[..., Outcome]) -> Callable[..., int]:
    """The command for an experiment: its own options, and those that every experiment has."""

    def command(output: Reproduction, **options: Any) -> int:
        with output.run() as run:
            with run.times.measure("experiment"):
                outcome = _outcome(experiment, output.cache, options)
            for file, write in outcome.parts():
                run.write(file, write)
            tables = [table.text() for table in outcome.tables if table.rows]
            run.done("\n".join([*tables, *outcome.notes, f"results: {output.out}"]))
        return run.status

    bench, *own = inspect.signature(experiment, eval_str=True).parameters.values()
    output = bench.replace(name="output", annotation=Reproduction, default=Reproduction(Path("out") / name))
    every = [p.replace(kind=p.KEYWORD_ONLY) for p in (*own, output)]
    command.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined]
    command.__doc__ = inspect.getdoc(experiment)
    return command


def _outcome(experiment: Callable[..., Outcome], cache: Path, options: Mapping[str, Any]) -> Outcome:
    from tsuiseki.trainers.experiments.store import Store
    from tsuiseki.trainers.experiments.study import Bench, Watch

    class Terminal(Watch):
        def over(self, items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
            return progress(items, what, total)

        def say(self, line: str) -> None:
            print(line, file=sys.stderr, flush=True)

    try:
        return experiment(Bench(Store(cache), Terminal()), **options)
    except KeyboardInterrupt as error:
        kept = f"what was computed is kept in {cache}: run the same command again to go on"
        raise Interrupted(signal_of(error), kept) from error
