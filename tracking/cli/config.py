"""Files for ``--config``: YAML of options, what ``--print-config`` prints, or the ``run.json`` of an earlier run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import yaml

from tsuiseki.tracking.cli.sensible import check_regular
from tsuiseki.tracking.errors import RequestError

MOST_BYTES = 1_000_000


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
    names = ", ".join(sorted(one.stem for one in shipped.glob("*.yaml")))
    raise RequestError(f"`config`: expected a YAML file or one of {names}; got {path}")


def config_text(path: Path, command: Sequence[str]) -> str:
    """The options in a file as YAML text, for the parser.

    Args:
        path: of the file.
        command: the program's words; a ``run.json`` must be of the same command.

    Raises:
        RequestError: there is no such file, it is no YAML of options, or the record of another command.
    """
    path = named_config(path)
    check_regular("config", path)
    wrong = f"`config`: expected YAML of options, name: value, in {path}, got"
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RequestError(f"{wrong} a file of {path.stat().st_size} bytes")
        text = path.read_text(encoding="utf-8-sig")
        # Nested aliases stand for billions of values in a few lines.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise RequestError(f"{wrong} aliases; write their values out")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except OSError as error:
        raise RequestError(f"`config`: cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RequestError(f"{wrong} something binary") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise RequestError(f"{wrong} something that cannot be read{where}") from error
    if node is None:
        return "{}"
    if not isinstance(node, yaml.MappingNode):
        raise RequestError(f"{wrong} no such lines")
    if not {key.value for key, _ in node.value} >= {"command", "settings", "versions"}:
        return text
    record = yaml.safe_load(text)
    if list(record["command"]) != list(command):
        wanted, got = " ".join(command), " ".join(record["command"])
        raise RequestError(f"`config`: expected the record of `{wanted}` in {path}, got one of `{got}`")
    # That the run replaced an earlier result is not taken over.
    return json.dumps({name: value for name, value in record["settings"].items() if name != "overwrite"})
