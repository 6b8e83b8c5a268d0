"""Hooks of MkDocs: equations become MathML, which browsers draw without a script, and doctests become code blocks."""

from __future__ import annotations

import re
from typing import Any

from latex2mathml import converter
from markdown import Extension, Markdown
from markdown.preprocessors import Preprocessor

FENCE = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Words of an equation stand upright; commands and names of environments are no words.
WORD = re.compile(r"(\\[a-zA-Z]+(?:\{pmatrix\})?)|([A-Za-z]{2,})")
# Before the fences of code, which have 25.
FIRST = 40


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The text of a page, with each line of a fence ``math`` as MathML."""
    return FENCE.sub(lambda fence: _equations(fence.group(1)), markdown)


def on_config(config: Any) -> Any:
    """Add doctests to what Markdown knows, for docstrings."""
    config.markdown_extensions.append(Doctests())
    return config


def _equations(lines: str) -> str:
    upright = WORD.sub(lambda word: word.group(1) or rf"\mathrm{{{word.group(2)}}}", lines)
    drawn = [converter.convert(line, display="block") for line in upright.splitlines() if line.strip()]
    return '<div class="equations">' + "".join(drawn) + "</div>"


class Doctests(Extension):
    """Paragraphs that begin with ``>>>`` are code."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802 (the library's name)
        md.preprocessors.register(DoctestLines(md), "doctests", FIRST)


class DoctestLines(Preprocessor):
    """Puts fences around doctests."""

    def run(self, lines: list[str]) -> list[str]:
        fenced: list[str] = []
        inside = code = False
        for line in lines:
            if line.startswith("```"):
                code = not code
            if not inside and not code and line.startswith(">>> "):
                fenced.append("```pycon")
                inside = True
            elif inside and not line.strip():
                fenced.append("```")
                inside = False
            fenced.append(line)
        return [*fenced, "```"] if inside else fenced
