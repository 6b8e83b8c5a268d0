"""What compared results are called in a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tsuiseki.tracking.errors import RequestError

# What results of different runs are called alike tells nothing apart.
USUAL_NAMES = ("tracks.txt", "tracks.json", "det.txt", "gt.txt", "states.csv")


def result_names(results: Sequence[Path], names: Sequence[str] | None = None) -> list[str]:
    """One name a result: the given ones, or the ends of their paths, as short as tells them apart.

    Raises:
        RequestError: as many names as results are wanted, all different; or a result stands twice.
    """
    if names is not None:
        if len(names) != len(results) or len(set(names)) != len(names):
            raise RequestError(f"`names`: expected {len(results)} different names, one a result, got {','.join(names)}")
        return list(names)
    parts = [_telling_parts(path.resolve()) for path in results]
    if len(set(parts)) != len(parts):
        raise RequestError("expected different results to compare, got one twice")
    depths = range(1, max(map(len, parts)) + 1)
    candidates = (["/".join(path[-depth:]) for path in parts] for depth in depths)
    return next(shown for shown in candidates if len(set(shown)) == len(shown))


def _telling_parts(path: Path) -> tuple[str, ...]:
    """The parts of ``path`` without what all results are called."""
    if path.is_file():
        path = path.parent if path.name in USUAL_NAMES else path.with_suffix("")
    return path.parts
