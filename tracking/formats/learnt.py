"""JSON files of what was learnt: the head that all of them share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError


def read_learnt(path: Path, command: str, form: str) -> dict[str, Any]:
    """The values in a file that ``tsuiseki COMMAND`` made.

    Args:
        path: of the file.
        command: that makes such files, for the message.
        form: name and version of the format, the file's ``format``.

    Raises:
        RequestError: there is no file, or it is of another kind.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RequestError(f"found no {path}; make it with tsuiseki {command}") from error
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: expected a file of tsuiseki {command}, got something else") from error
    if not isinstance(values, dict) or values.get("format") != form:
        raise RequestError(f"{path}: expected a file of tsuiseki {command} ({form}), got something else")
    return values
