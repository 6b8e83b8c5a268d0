"""What readers of tables with named columns share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError


def finite_number(path: Path, line: int, name: str, text: str | None) -> float:
    """The number in column ``name`` of a line, counted from 1.

    Raises:
        RequestError: ``text`` is missing, no number, or not finite.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise RequestError(f"{path}:{line}: expected a finite number in column {name}, got {text!r}")
    return value
