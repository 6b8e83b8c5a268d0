"""JSON, bounded: see the head of the folder."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.text import DEEPEST, LARGEST_WHOLE, MOST_BYTES, check_depth, read_text, refusing

# Any whole number beyond LARGEST_WHOLE has as many digits.
_LONG_NUMBER = re.compile(r"\d{20}")
# Half of a character beyond 16 bits, which needs its other half.
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
# Bytes of a text between its brackets.
_NO_BRACKETS = bytes(sorted({*range(256)} - {*b"[]{}"}))


def read_json(path: Path, what: str, most: int = MOST_BYTES) -> Any:
    """The content of a JSON file of ``what``; raises RequestError, see `read_text` and `json_of`."""
    return json_of(read_text(path, what, most), str(path), what)


def json_of(text: str | bytes, where: str, what: str) -> Any:
    """The content of a text; ``where`` and ``what`` are for messages.

    Raises:
        RequestError: it is no JSON, too deep, has a name twice in an object, a whole number beyond 64 bits, or half a
            character.
    """
    wrong = f"{where}: expected {what}, got"

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        content = dict(pairs)
        if len(content) != len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise RequestError(f"{wrong} {twice[:60]!r} twice; leave one out")
        return content

    def whole(digits: str) -> int:
        if len(digits) > len(str(LARGEST_WHOLE)) + 1 or abs(int(digits)) > LARGEST_WHOLE:
            raise RequestError(f"{wrong} a whole number beyond 64 bits, {digits[:20]}...")
        return int(digits)

    with refusing(f"{wrong} no JSON", _place):
        text = text.decode() if isinstance(text, bytes) else text
        content = json.loads(
            text, object_pairs_hook=mapping, parse_int=whole if _LONG_NUMBER.search(text) is not None else None
        )
        if _SURROGATE.search(text) is not None:
            json.dumps(content, ensure_ascii=False).encode()
    if _may_be_deep(text):
        check_depth(content, where)
    return content


def _place(error: Exception) -> str:
    """Where a text is no JSON, if it is known."""
    return f" from line {error.lineno} on" if isinstance(error, json.JSONDecodeError) and error.lineno > 1 else ""


def _may_be_deep(text: str) -> bool:
    """Whether brackets, those in strings included, may lie deeper than `DEEPEST`."""
    brackets = text.encode("utf-8", "replace").translate(None, _NO_BRACKETS)
    # Each turn takes away the innermost level at least.
    for _ in range(DEEPEST):
        if not brackets:
            return False
        brackets = brackets.replace(b"[]", b"").replace(b"{}", b"")
    return bool(brackets)
