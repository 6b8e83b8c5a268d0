"""Files of options for ``--config``."""

from __future__ import annotations

import stat
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from tsuiseki.tracking.errors import RequestError

# Of a file of options; a run.json has a row for each frame of its video.
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
    wrong = f"`config`: expected YAML of options, name: value, in {path}, got"
    try:
        if path.stat().st_size > MOST_BYTES:
            raise RequestError(f"{wrong} a file of {path.stat().st_size} bytes")
        text = path.read_text(encoding="utf-8-sig")
        # Nested aliases stand for billions of values in a few lines.
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, Loader=yaml.SafeLoader)):
            raise RequestError(f"{wrong} aliases; write their values out")
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if repeated := next(_repeated(node), None):
            raise RequestError(f"{wrong} {repeated} twice")
        options = None if node is None else loader.construct_document(node)
    except OSError as error:
        raise RequestError(f"`config`: cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RequestError(f"{wrong} something binary") from error
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        raise RequestError(f"{wrong} something that cannot be read{where}") from error
    if not isinstance(options, dict | None):
        raise RequestError(f"{wrong} no such lines")
    if options is None or not options.keys() >= {"command", "settings", "versions"}:
        return options or {}
    if list(options["command"]) != list(command):
        expected, got = " ".join(command), " ".join(options["command"])
        raise RequestError(f"`config`: expected the record of `{expected}` in {path}, got one of `{got}`")
    # That the run replaced an earlier result is not taken over.
    return {name: value for name, value in options["settings"].items() if name != "overwrite"}


def _repeated(node: yaml.Node | None) -> Iterator[str]:
    """Keys that stand twice in a mapping."""
    if isinstance(node, yaml.MappingNode):
        keys = [key.value for key, _ in node.value]
        yield from (str(key) for number, key in enumerate(keys) if key in keys[:number])
        for _, value in node.value:
            yield from _repeated(value)


def check_regular(name: str, path: Path) -> None:
    """Refuse a device or a pipe, which may never end; raises RequestError."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # no such thing: whoever needs it says so
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        option = f"`{name}`: " if name else ""
        raise RequestError(f"{option}expected a file or a folder, but {path} is a device or a pipe; copy it to a file")
