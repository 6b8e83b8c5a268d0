"""Files for ``--config``: YAML of options, what ``--print-config`` prints, or the ``run.json`` of an earlier run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from tsuiseki.tracking.cli.sensible import check_regular
from tsuiseki.tracking.errors import RequestError

MOST_BYTES = 1_000_000


def config_text(path: Path, command: Sequence[str]) -> str:
    """The options in a file as YAML text, for the parser.

    Args:
        path: of the file.
        command: the program's words; a ``run.json`` must be of the same command.

    Raises:
        RequestError: there is no such file, it is no YAML of options, or the record of another command.
    """
    text = _text(path)
    try:
        # Nested aliases stand for billions of values in a few lines.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise RequestError(f"`config`: expected YAML of options in {path}, got aliases; write their values out")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise RequestError(
            f"`config`: expected YAML of options in {path}, got something that cannot be read{where}"
        ) from error
    if node is None:
        return "{}"
    if not isinstance(node, yaml.MappingNode):
        raise RequestError(f"`config`: expected YAML of options, name: value, in {path}, got no such lines")
    if {key.value for key, _ in node.value} >= {"command", "settings", "versions"}:
        return json.dumps(_settings(path, yaml.safe_load(text), command))
    return text


def _text(path: Path) -> str:
    check_regular("config", path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RequestError(
                f"`config`: expected YAML of options in {path}, got a file of {path.stat().st_size} bytes"
            )
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"`config`: expected YAML of options in {path}, got something binary") from error
    except OSError as error:
        raise RequestError(f"`config`: cannot read {path}: {error.strerror}") from error


def _settings(path: Path, record: dict[str, Any], command: Sequence[str]) -> dict[str, Any]:
    """The settings of a ``run.json``; that the run replaced an earlier result is not taken over."""
    if list(record["command"]) != list(command):
        wanted, got = " ".join(command), " ".join(record["command"])
        raise RequestError(f"`config`: expected the record of `{wanted}` in {path}, got one of `{got}`")
    return {name: value for name, value in record["settings"].items() if name != "overwrite"}
