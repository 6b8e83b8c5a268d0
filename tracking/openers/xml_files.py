"""XML, bounded: see the head of the folder. It may define no entities."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, XMLParser

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.text import DEEPEST, read_text


def read_xml(path: Path, what: str) -> Element:
    """The root of an XML file of ``what``; raises RequestError, see `read_text` and `xml_of`."""
    return xml_of(read_text(path, what), str(path), what)


def xml_of(text: str, where: str, what: str) -> Element:
    """The root of a text; ``where`` and ``what`` are for messages.

    Raises:
        RequestError: it is no XML, defines entities, or is too deep.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RequestError(f"{where}: expected {what}, which defines no entities")
    try:
        # The text was decoded before, whatever encoding its first line names.
        parser = XMLParser(encoding="utf-8")
        parser.feed(text.encode())
        root: Element = parser.close()
    except (ParseError, UnicodeEncodeError) as error:
        raise RequestError(f"{where}: expected {what}, got a broken one: {error}") from error
    level = [root]
    for _ in range(DEEPEST):
        level = [*chain.from_iterable(level)]
        if not level:
            return root
    raise RequestError(f"{where}: expected {what}, up to {DEEPEST} elements in each other, got more")
