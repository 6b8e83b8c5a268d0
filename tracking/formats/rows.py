"""Rows of text as trackers, annotators and spreadsheets write them, one reader for all.

Cells are separated by commas, semicolons, tabs or spaces, as in the first row of numbers, and may stand in double
quotes. Blank lines, lines that begin with # or %, and separators at a line's end are passed over. A comma within a
number is a decimal one where it does not separate cells. The text is UTF-8 or UTF-16, or else Latin-1.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.openers.json_files import read_json
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import LAST_FRAME

SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "spaces"}
COMMENT = ("#", "%")
# By the name of a column the number of the first frame in it.
FIRST_FRAME = {"frame": 1, "frame_idx": 0}
# Largest whole number of 64 bits.
LARGEST_ID = 2**63 - 1
_EMPTY = '\t,;" \ufeff'
_END_OF_LINE = re.compile(r"\r+\n|\r")
_NUMBER = re.compile(r"[\s\"]*([-+.\d]|nan\b|inf\b)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)")


@dataclass(frozen=True)
class Rows:
    """The rows of a text.

    Attributes:
        path: of the file.
        cells: of each row, without spaces and quotes about them, up to the last that is not empty.
        lines: of each row in the file, from 1.
        texts: of each row, as it stands in the file.
        separator: the name of what separates cells.
        comment: the last comment before the first row.
    """

    path: Path
    cells: list[list[str]]
    lines: list[int]
    texts: list[str]
    separator: str
    comment: str = ""

    def error(self, row: int, expected: str) -> RequestError:
        """Row number ``row``, from 0, is not as ``expected``."""
        return RequestError(
            f"{self.path}:{self.lines[row]}: expected {expected}, separated by {self.separator}, got "
            f"{self.texts[row][:80]}"
        )

    def numbers(self, columns: str, which: Sequence[int] = ()) -> FloatArray:
        """``(N, C)`` the cells as numbers.

        Args:
            columns: names of all, separated by commas.
            which: columns to read, from 0; by default all, and no row may have more.

        Raises:
            RequestError: a cell is none, or a row has another number of them.
        """
        count = len(which) or columns.count(",") + 1
        values = np.empty((len(self.cells), count))
        for k, cells in enumerate(self.cells):
            try:
                values[k] = np.array([cells[n] for n in which] or cells, dtype=np.float64).reshape(count)
            except (ValueError, IndexError):
                raise self.error(k, columns) from None
        return values

    def whole_numbers(self, name: str, column: int, first: int = -LARGEST_ID, last: int = LARGEST_ID) -> IntArray:
        """``(N,)`` the cells of a column as whole numbers; raises RequestError, see `whole_number`."""
        rows = zip(self.lines, self.cells, strict=True)
        values = [whole_number(self.path, line, name, cells[column], first, last) for line, cells in rows]
        return np.array(values, dtype=np.int64)

    def refuse(self, *cases: tuple[BoolArray, str]) -> None:
        """Raise RequestError for the first row of the first case that has one: which rows, and what they should be."""
        for bad, expected in cases:
            if bad.any():
                raise self.error(int(np.argmax(bad)), expected)

    def without_heading(self, columns: int) -> Rows:
        """The rows below the first, where that is of words and names ``columns`` or has rows below it."""
        first = self.cells[0] if self.cells else [""]
        if not first[0] or any(map(_NUMBER.match, first)) or (len(self.cells) == 1 and len(first) < columns):
            return self
        line = self.texts[0][:60]
        warnings.warn(f"{self.path}: the first line, {line!r}, is a heading and left out", InputWarning, stacklevel=4)
        return Rows(self.path, self.cells[1:], self.lines[1:], self.texts[1:], self.separator)


def read_rows(path: Path, what: str) -> Rows:
    """The rows of a file; raises RequestError, see `read_text`."""
    return rows_of(read_text(path, what), path)


def rows_of(text: str, path: Path) -> Rows:
    """The rows of a text that stands at ``path``; raises RequestError where a cell never ends."""
    if "\r" in text:
        text = _END_OF_LINE.sub("\n", text)
    filled = [(n, line) for n, line in enumerate(text.split("\n"), start=1) if line.strip(_EMPTY)]
    content = [(n, line) for n, line in filled if not line.lstrip(_EMPTY).startswith(COMMENT)]
    lines, texts = [n for n, _ in content], [line.strip(" \ufeff") for _, line in content]
    separator = _separator(texts)
    try:
        cells = _cells(texts, separator)
    except csv.Error as error:
        raise RequestError(f"{path}: expected rows of cells, got something else ({error})") from error
    if separator != "," and "," in text:
        _mend_decimal_commas(path, cells)
    comment = next((line for n, line in filled[::-1] if content and n < content[0][0]), "")
    return Rows(path, cells, lines, texts, SEPARATORS[separator], comment.strip("".join(COMMENT) + _EMPTY))


def _separator(lines: Sequence[str]) -> str:
    """What separates the cells of the first row of numbers as of the heading, or else of either; by default commas."""
    numbers = next((line for line in lines if _NUMBER.match(line)), "")
    bare = [re.sub(r"\s*([,;])\s*", r"\1", re.sub(r'"[^"]*"', "q", line)) for line in (numbers, *lines[:1])]
    inside, heading = ([sign for sign in SEPARATORS if sign in line] for line in (bare[0], bare[-1]))
    # A name in a cell may have a sign that separates cells elsewhere.
    return next((sign for sign in inside if sign in heading), [*inside, *heading, ","][0])


def _cells(texts: Sequence[str], separator: str) -> list[list[str]]:
    """The cells of each text, without the empty ones at its end."""
    rows = []
    for text in texts:
        here = separator if separator in text else _separator([text])
        bare = text.rstrip(f"{here}\t ")
        if '"' in text:
            row = next(csv.reader([bare], delimiter=here, skipinitialspace=True))
        else:
            row = bare.split(None if here == " " else here)
        rows.append([cell.strip() for cell in row] if " " in bare else row)
    return rows


def _mend_decimal_commas(path: Path, cells: list[list[str]]) -> None:
    example = ""
    for row in cells:
        for k, cell in enumerate(row):
            if "," in cell and (match := _DECIMAL_COMMA.fullmatch(cell)):
                example, row[k] = example or cell, f"{match[1]}.{match[2]}"
    if example:
        mended = example.replace(",", ".")
        warnings.warn(f"{path}: decimal commas, such as {example}, are read as {mended}", InputWarning, stacklevel=4)


@dataclass(frozen=True)
class NamedRows:
    """The rows of a text whose first row names the columns.

    Attributes:
        path: of the file.
        names: of the columns.
        rows: line and cells by name of each row; a cell that is missing is empty.
        separator: the name of what separates cells.
    """

    path: Path
    names: list[str]
    rows: list[tuple[int, dict[str, str]]]
    separator: str

    def need(self, columns: Sequence[str]) -> None:
        """Refuse the file where one of the columns is missing; raises RequestError where it is."""
        missing = [column for column in columns if column not in self.names]
        if missing:
            raise RequestError(
                f"{self.path}: expected the columns {','.join(columns)} in its first line, found no {missing[0]} among "
                f"{','.join(self.names)[:80] or 'none'}, separated by {self.separator}"
            )

    def numbers(self, names: Sequence[str]) -> FloatArray:
        """``(N, C)`` finite numbers in columns; raises RequestError, see `finite_number`."""
        rows = [[finite_number(self.path, line, name, row.get(name)) for name in names] for line, row in self.rows]
        return np.array(rows, dtype=np.float64).reshape(-1, len(names))

    def whole_numbers(self, name: str, first: int = -LARGEST_ID, last: int = LARGEST_ID) -> IntArray:
        """``(N,)`` whole numbers of a column; raises RequestError, see `whole_number`."""
        rows = [whole_number(self.path, line, name, row.get(name), first, last) for line, row in self.rows]
        return np.array(rows, dtype=np.int64)

    def frames(self) -> IntArray:
        """``(N,)`` frames from 0: those in the column ``frame`` count from 1, in ``frame_idx`` from 0.

        Raises:
            RequestError: there is neither column or both, or a cell is no such number.
        """
        columns = [name for name in FIRST_FRAME if name in self.names]
        if len(columns) != 1:
            got = "got both" if columns else f"found no frame among {','.join(self.names)[:80]}"
            raise RequestError(f"{self.path}: expected a column frame (from 1) or frame_idx (from 0), {got}")
        (name,) = columns
        zero = next((line for line, row in self.rows if whole(row.get(name, "")) == 0), None)
        if zero is not None and FIRST_FRAME[name] > 0:
            raise RequestError(
                f"{self.path}:{zero}: expected a whole number from 1 to {LAST_FRAME} in column frame, got '0'; name "
                "the column frame_idx in the files whose frames count from 0"
            )
        return self.whole_numbers(name, FIRST_FRAME[name], LAST_FRAME) - FIRST_FRAME[name]


def column_names(path: Path, what: str) -> list[str]:
    """The names in a file's heading; raises RequestError, see `read_text`."""
    return _headed(read_rows(path, what))[0]


def _headed(rows: Rows) -> tuple[list[str], int]:
    """The names of the columns, which may be a comment, and the number of the first row below."""
    if rows.comment and rows.cells and _NUMBER.match(rows.cells[0][0]):
        return _cells([rows.comment], _separator([rows.comment]))[0], 0
    return (rows.cells[0], 1) if rows.cells else ([], 0)


def read_named_rows(path: Path, what: str, columns: Sequence[str] = ()) -> NamedRows:
    """The rows of a file with a heading, which may be a comment, or in capitals where ``columns`` are not.

    Raises:
        RequestError: see `read_text`; a column is missing, or a row has more cells than the heading.
    """
    rows = read_rows(path, what)
    names, first = _headed(rows)
    cells, lines = rows.cells[first:], rows.lines[first:]
    if not set(columns) <= set(names) and set(columns) <= {name.lower() for name in names}:
        names = [name.lower() for name in names]
    table = NamedRows(path, names, [], rows.separator)
    table.need(columns)
    for line, row in zip(lines, cells, strict=True):
        if len(row) > len(names) and names:
            raise RequestError(
                f"{path}:{line}: expected {len(names)} cells separated by {rows.separator}, as in the heading, got "
                f"{len(row)}"
            )
        table.rows.append((line, {**dict.fromkeys(names, ""), **dict(zip(names, row, strict=False))}))
    return table


def repeated(*columns: IntArray | FloatArray) -> int | None:
    """The first row whose numbers all stand together in an earlier row; None where there is none.

    >>> repeated(np.array([0, 1, 0]), np.array([7, 7, 7]))
    2
    """
    _, first = np.unique(np.column_stack(columns), axis=0, return_index=True)
    again = np.setdiff1d(np.arange(len(columns[0])), first)
    return int(again[0]) if len(again) else None


def write_csv(path: Path, heading: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    """Write rows below a heading."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(heading)
        writer.writerows(rows)


def write_columns(path: Path, columns: Mapping[str, NDArray[Any]], form: str = ".9g", **forms: str) -> None:
    """Write columns below their names: floats in a format, or in that of their column; booleans as 0 and 1."""
    texts = []
    for name, column in columns.items():
        values = (column.astype(np.int64) if column.dtype == np.bool_ else column).tolist()
        texts.append([format(v, forms.get(name, form)) for v in values] if column.dtype.kind == "f" else values)
    write_csv(path, columns, zip(*texts, strict=True))


# A time in nanoseconds since 1970 is below 1e19.
LARGEST = 1e20


def finite_number(path: Path, line: int, name: str, text: str | None) -> float:
    """The number in column ``name`` of a line, counted from 1.

    Raises:
        RequestError: ``text`` is missing, no number, not finite, or beyond what is measured.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or abs(value) > LARGEST:
        raise RequestError(f"{path}:{line}: expected a finite number in column {name}, got {text!r:.60}")
    return value


def whole_number(
    path: Path, line: int, name: str, text: str | None, first: int = -LARGEST_ID, last: int = LARGEST_ID
) -> int:
    """The whole number from ``first`` to ``last`` in column ``name`` of a line, exactly; 7.0 and 7e0 are 7.

    Raises:
        RequestError: ``text`` is missing, a word, a fraction, or outside the range.
    """
    value = whole(text or "")
    if value is None or not first <= value <= last:
        reach = "of 64 bits" if first == -LARGEST_ID else f"from {first} to {last}"
        raise RequestError(f"{path}:{line}: expected a whole number {reach} in column {name}, got {text!r:.60}")
    return value


def whole(text: str) -> int | None:
    """The whole number of 64 bits that a text stands for, exactly; None where it stands for none.

    >>> [whole(text) for text in ("9007199254740993", "7.0", "-1", "7.5", "a", "1e999999999")]
    [9007199254740993, 7, -1, None, None, None]
    """
    try:
        value = Decimal(text)
    except InvalidOperation:
        return None
    fits = value.is_finite() and -LARGEST_ID <= value <= LARGEST_ID and value == value.to_integral_value()
    return int(value) if fits else None


def read_learnt(path: Path, command: str, form: str) -> dict[str, Any]:
    """The values in a file that ``tsuiseki COMMAND`` made; its ``format`` says name and version of the ``form``.

    Raises:
        RequestError: there is no file, or it is of another kind.
    """
    if not path.exists():
        raise RequestError(f"found no {path}; make it with tsuiseki {command}")
    values = read_json(path, f"a file of tsuiseki {command}")
    if not isinstance(values, dict) or values.get("format") != form:
        raise RequestError(f"{path}: expected a file of tsuiseki {command} ({form}), got something else")
    return values
