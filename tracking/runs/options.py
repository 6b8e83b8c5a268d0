"""Where the result of a command goes, as its options."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tsuiseki.tracking.options import NO_OPTION, Seed, Shared
from tsuiseki.tracking.output import check_output_folder
from tsuiseki.tracking.runs.run import Run


@dataclass(frozen=True)
class Output(Shared):
    """Where the result goes.

    Attributes:
        out: folder for the results.
        overwrite: replace an earlier result in the folder.
        command: the program's words, for ``run.json``.
        settings: every option with its value, as a file for ``--config`` has them; likewise.
        page: adds the page to a result that has `PageContent`; None for none.
    """

    out: Path
    overwrite: bool = False
    command: Sequence[str] = field(default=("tsuiseki",), metadata=NO_OPTION)
    settings: Mapping[str, Any] = field(default_factory=dict, metadata=NO_OPTION)
    page: Callable[[Any], Any] | None = field(default=None, metadata=NO_OPTION)

    def check(self) -> None:
        """See `Shared.check`."""
        check_output_folder(self.out, self.overwrite)

    def run(self) -> AbstractContextManager[Run]:
        """A run that writes there."""
        return Run(self.out, self.overwrite, self.command, self.settings, self.page).opened()


@dataclass(frozen=True)
class SeededOutput(Seed, Output):
    """Where the result of something random goes."""
