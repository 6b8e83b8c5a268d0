"""`tsuiseki forget`: delete results that may not be kept any longer."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.output import BUSY, RUN_FILE, hold, listed_files, remove_if_empty
from tsuiseki.tracking.privacy import PRIVACY, Days, last_day, today


def forget(results: list[Path], *, older_than: Days | None = None) -> int:
    """Delete results that may not be kept any longer, by the record of privacy in their run.json.

    All files that run.json lists go, and run.json last. Other files stay, and so do videos written elsewhere.

    Args:
        results: folders of results, or folders that hold such folders.
        older_than: days after the run to keep a result, in place of those of its record; then results without a
            record go, too, by the date of their run.json.
    """
    folders = [folder for path in results for folder in _results_in(path)]
    due = [folder for folder in folders if _last_day(folder, older_than) < today()]
    for folder in due:
        _delete(folder)
        print(f"deleted: {folder}")
    print(f"{len(due)} of {len(folders)} results deleted")
    return 0


def _results_in(path: Path) -> list[Path]:
    """The folder of a result, or those below a folder; raises RequestError where there is none."""
    folders = [path] if (path / RUN_FILE).is_file() else sorted(file.parent for file in path.rglob(RUN_FILE))
    if not folders:
        raise RequestError(f"expected results in {path}, found no {RUN_FILE}")
    return folders


def _last_day(folder: Path, older_than: int | None) -> date:
    """The last day on which a result may be kept; for ever without a record of privacy.

    Raises:
        RequestError: its record is broken.
    """
    path = folder / RUN_FILE
    record: dict[str, Any] = read_json(path, "the record of a run").get("facts", {}).get(PRIVACY, {})
    if not record:
        made = datetime.fromtimestamp(path.stat().st_mtime, UTC).date()
        return date.max if older_than is None else last_day(made, older_than)
    try:
        made = date.fromisoformat(record["made"])
        return last_day(made, int(record["retention"]) if older_than is None else older_than)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RequestError(f"{path}: {PRIVACY}: expected made and retention, got {record!r:.100}") from error


def _delete(folder: Path) -> None:
    """Delete the files of a result; its run.json goes last, so that what was cut short is found again."""
    with ExitStack() as stack:
        hold(folder, BUSY.format(folder), stack)
        for name in sorted(listed_files(folder) - {RUN_FILE}):
            (folder / name).unlink(missing_ok=True)
        (folder / RUN_FILE).unlink()
        for inner in sorted((path for path in folder.rglob("*") if path.is_dir()), reverse=True):
            remove_if_empty(inner)
        remove_if_empty(folder)
