"""What becomes of a step that fails: the run that made it decides whether those before it are the result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any


@contextmanager
def reported_to(steps: Iterable[Any]) -> Iterator[None]:
    """Within the ``with`` block an error goes to where ``steps`` come from.

    Where these are of a run that has finished some, such as `Run.steps`, they end there, and a loop over them ends with
    them. Elsewhere the error goes on.
    """
    try:
        yield
    except Exception as error:
        throw = getattr(steps, "throw", None)
        if throw is None:
            raise
        with suppress(StopIteration):
            throw(error)
