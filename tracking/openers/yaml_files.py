"""YAML, bounded: see the head of the folder. Tags make plain values only, aliases no more of them than the bound."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.text import DEEPEST, LARGEST_WHOLE, check_depth, read_text, refusing

# Bytes of a file: 20,000 sources of a batch; its parser takes seconds for them.
MOST_BYTES = 2_000_000
# Values, those that aliases stand for included.
MOST_VALUES = 1_000_000
# Characters of a whole number: 64 bits in base 2, with sign and underscores.
LONGEST_WHOLE = 100


def read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file of ``what``, None of an empty one; raises RequestError, see `read_text`, `yaml_of`."""
    return yaml_of(read_text(path, what, MOST_BYTES), str(path), what)


def yaml_of(text: str, where: str, what: str) -> Any:
    """The content of a text; ``where`` and ``what`` are for messages.

    Raises:
        RequestError: it is no YAML of plain values, too deep, has a key twice in a mapping, aliases that stand for too
            much, or a whole number beyond 64 bits.
    """
    wrong = f"{where}: expected {what}, got"
    try:
        with refusing(f"{wrong} something else than YAML"):
            loader = _BoundedLoader(text)
            content = loader.get_single_data()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark is not None else ""
        said = str(error) if isinstance(error, _Unbounded) else "something that is no YAML of plain values"
        raise RequestError(f"{wrong} {said}{line}") from error
    check_depth(content, where)
    return content


class _Unbounded(yaml.MarkedYAMLError):
    """More than the bounds allow."""

    def __init__(self, said: str, mark: yaml.Mark | None) -> None:
        super().__init__(problem=said, problem_mark=mark)
        self.said = said

    def __str__(self) -> str:
        return self.said


class _BoundedLoader(yaml.SafeLoader):
    """Plain values within the bounds; raises `yaml.YAMLError`."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._count = 0
        # What an anchor stands for: a number of values; None while it is being read.
        self._values: dict[str, int | None] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        mark = event.start_mark
        if isinstance(event, yaml.AliasEvent):
            values = self._values.get(str(event.anchor), 1)
            if values is None:
                raise _Unbounded("an alias of what it stands in", mark)
            self._count += values
        self._depth, self._count = self._depth + 1, self._count + 1
        if self._depth > DEEPEST:
            raise _Unbounded(f"more than {DEEPEST} lists and mappings in each other", mark)
        if self._count > MOST_VALUES:
            raise _Unbounded(f"more than {MOST_VALUES} values, with those of aliases", mark)
        anchor, start = getattr(event, "anchor", None), self._count
        if anchor is not None and not isinstance(event, yaml.AliasEvent):
            self._values[anchor] = None
        node = super().compose_node(parent, index)
        if anchor is not None and not isinstance(event, yaml.AliasEvent):
            self._values[anchor] = self._count - start + 1
        self._depth -= 1
        return node

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        node = super().compose_scalar_node(anchor)
        if not node.value.isascii():
            try:
                node.value.encode()
            except UnicodeEncodeError as error:
                raise _Unbounded("half a character", node.start_mark) from error
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node = super().compose_mapping_node(anchor)
        names = set()
        for key, _ in node.value:
            name = (key.tag, key.value) if isinstance(key, yaml.ScalarNode) else (key.tag, id(key))
            if name in names:
                raise _Unbounded(f"{str(key.value)[:60]} twice", key.start_mark)
            names.add(name)
        return node

    def construct_whole(self, node: yaml.ScalarNode) -> int:
        """The number of a node within 64 bits."""
        if len(node.value) <= LONGEST_WHOLE:
            value = int(self.construct_yaml_int(node))
            if abs(value) <= LARGEST_WHOLE:
                return value
        raise _Unbounded(f"a whole number beyond 64 bits, {node.value[:20]}...", node.start_mark)


_BoundedLoader.add_constructor("tag:yaml.org,2002:int", _BoundedLoader.construct_whole)
