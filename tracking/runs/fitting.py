"""Settings that are fitted before a run: the progress of the fit, and its answer in the result."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TypeVar

from tsuiseki.tracking.filters.maximum_likelihood import FittedSetting
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.runs.run import Run

T = TypeVar("T")


def fitted_first(fit: Callable[[Callable[[], object]], T]) -> T:
    """What ``fit`` gives, which calls its argument at the beginning of each try; their number is shown."""
    tries = progress(itertools.count(), "fitting")
    answer = fit(lambda: next(tries))
    tries.close()
    return answer


def write_fitted(run: Run, fitted: Mapping[str, FittedSetting], file: str, text: str) -> None:
    """Note the fitted settings in ``run.json``, and write ``text`` into a file; nothing without any."""
    if fitted:
        run.facts["fitted"] = {name: asdict(setting) for name, setting in fitted.items()}
        run.write(file, lambda path: path.write_text(text, encoding="utf-8"))
