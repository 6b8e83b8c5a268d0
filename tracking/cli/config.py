"""Files of options for ``--config``."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.openers.yaml_files import read_yaml


def named_config(path: str | Path) -> Path:
    """A file of options as it is given; a bare word names one that ships, such as ``detector_mot``.

    Raises:
        RequestError: none of that name ships.
    """
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.exists():
        return path
    shipped = Path(str(resources.files("tsuiseki.configs")))
    if (file := shipped / f"{path}.yaml").is_file():
        return file
    names = ", ".join(sorted(file.stem for file in shipped.glob("*.yaml")))
    raise RequestError(f"`config`: expected a YAML file or one of {names}; got {path}")


def read_config(path: Path, command: Sequence[str]) -> dict[str, Any]:
    """The options in a file: YAML, what ``--print-config`` prints, or the ``run.json`` of an earlier run.

    A ``run.json`` must be of the same ``command``, the program's words.

    Raises:
        RequestError: there is no such file, it is no YAML of options, or the record of another command.
    """
    path = named_config(path)
    check_regular("config", path)
    # A run.json has a row for each frame of its video.
    what, read = "YAML of options, name: value", read_json if path.suffix.lower() == ".json" else read_yaml
    try:
        options = read(path, what)
    except RequestError as error:
        raise RequestError(f"`config`: {error}") from error
    if not isinstance(options, dict | None):
        raise RequestError(f"`config`: {path}: expected {what}, got no such lines")
    if options is None or not options.keys() >= {"command", "settings", "versions"}:
        return options or {}
    with refusing(f"{path}: expected the record of a run, got something else"):
        words, settings = [*map(str, options["command"])], dict(options["settings"])
    if words != list(command):
        expected, got = " ".join(command), " ".join(words)
        raise RequestError(f"`config`: expected the record of `{expected}` in {path}, got one of `{got}`")
    # That the run replaced an earlier result is not taken over.
    return {name: value for name, value in settings.items() if name != "overwrite"}


def check_regular(name: str, path: Path) -> None:
    """Refuse a device or a pipe, which may never end; raises RequestError."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # no such thing: whoever needs it says so
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        option = f"`{name}`: " if name else ""
        raise RequestError(f"{option}expected a file or a folder, but {path} is a device or a pipe; copy it to a file")
