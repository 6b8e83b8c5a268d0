"""Hooks of MkDocs: equations become MathML, which browsers draw without a script, and doctests become code blocks.

A notebook is a page, with its outputs where `make docs` has executed it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml import converter
from markdown import Extension, Markdown
from markdown.preprocessors import Preprocessor
from mkdocs.structure.files import File
from nbconvert import MarkdownExporter

FENCE = re.compile(r"^```math\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Words of an equation stand upright; commands and names of environments are no words.
WORD = re.compile(r"(\\[a-zA-Z]+(?:\{pmatrix\})?)|([A-Za-z]{2,})")
# Before the fences of code, which have 25.
FIRST = 40


EXECUTED = Path(__file__).resolve().parent.parent / "out" / "notebooks"
# Links to a notebook lead to its page.
NOTEBOOK = re.compile(r"(\]\((?:[\w./-]*/)?notebooks/[\w-]+)\.ipynb(?=[)#])")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The text of a page, with each line of a fence ``math`` as MathML, and with links to pages of notebooks."""
    return NOTEBOOK.sub(r"\1.md", FENCE.sub(lambda fence: _equations(fence.group(1)), markdown))


def on_files(files: Any, config: Any) -> Any:
    """Add a page and its pictures for each notebook, which can be downloaded."""
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        text, pictures = _page_of(Path(notebook.abs_src_path))
        page = notebook.src_uri.removesuffix(".ipynb") + ".md"
        files.append(File.generated(config, page, content=text))
        for name, picture in pictures.items():
            files.append(File.generated(config, f"{Path(page).parent}/{name}", content=picture))
    return files


def _page_of(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, and its pictures by name."""
    notebook, executed = nbformat.read(path, as_version=4), EXECUTED / path.name
    if executed.is_file():
        with_outputs = nbformat.read(executed, as_version=4)
        if [cell.source for cell in with_outputs.cells] == [cell.source for cell in notebook.cells]:
            notebook = with_outputs
    for cell in notebook.cells:
        if cell.cell_type == "code":
            # Progress and warnings go to the other stream, and leave empty lines in this one.
            shown = [output for output in cell.outputs if output.get("name") != "stderr"]
            cell.outputs = [output for output in shown if output.get("text", "something").strip()]
    resources = {"unique_key": path.stem, "output_files_dir": path.stem}
    text, resources = MarkdownExporter().from_notebook_node(notebook, resources)
    return f"{text}\n\n[Download this notebook]({path.name})\n", resources["outputs"]


def on_post_build(config: Any) -> None:
    """Write ``llms.txt``: each page of the manual's order with its first heading, see llmstxt.org."""
    site, docs = Path(config.site_dir), Path(config.docs_dir)
    lines = [f"# {config.site_name}", "", f"> {config.site_description}", ""]
    for entry in config.nav:
        lines += [f"## {next(iter(entry))}", ""] if isinstance(entry, dict) else []
        for page in _pages_in(entry):
            source = docs / page
            heading = (
                re.search(r"^# (.+)$", source.read_text(encoding="utf-8"), re.MULTILINE) if source.exists() else None
            )
            name = heading.group(1) if heading else Path(page).stem.replace("-", " ")
            lines.append(f"- [{name}]({page.removesuffix('.md')}.html)")
        lines.append("")
    (site / "llms.txt").write_text("\n".join(lines), encoding="utf-8")


def _pages_in(entry: Any) -> list[str]:
    """The pages of an entry of the navigation, in order."""
    if isinstance(entry, str):
        return [entry]
    return [page for inner in (entry.values() if isinstance(entry, dict) else entry) for page in _pages_in(inner)]


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
