"""The openers: what they give of a good file, and one line for a file made to break them."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.openers.json_files import json_of, read_json
from tsuiseki.tracking.openers.text import read_text
from tsuiseki.tracking.openers.xml_files import read_xml, xml_of
from tsuiseki.tracking.openers.yaml_files import read_yaml, yaml_of

ALIASES = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))


# Each stands in the next.
CHAIN = "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}]\n" for n in range(1, 90))
pytestmark = pytest.mark.timeout(60)


def refused(opener: Callable[[str, str, str], Any], text: str) -> str:
    """The one line with which a text is refused."""
    with pytest.raises(RequestError) as error:
        opener(text, "FILE", "things")
    assert "\n" not in str(error.value)
    return str(error.value)


def test_yaml_gives_plain_values_and_aliases_within_the_bound():
    text = "a: &a {x: 1, y: [2.5, true, null]}\nb: *a\nc: {<<: *a, x: 3}\nd: 2024-01-02\n"
    values = yaml_of(text, "FILE", "things")
    assert values["a"] == values["b"] == {"x": 1, "y": [2.5, True, None]}
    assert values["c"] == {"x": 3, "y": [2.5, True, None]}
    assert yaml_of("", "FILE", "things") is None


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[" * 20_000, "more than 64 lists and mappings in each other"),
        ("{a: " * 20_000, "more than 64 lists and mappings in each other"),
        ("- " * 20_000, "more than 64 lists and mappings in each other"),
        ("lines: 1\nzones: 2\n'lines': 3", "got lines twice, line 3"),
        ("a: {b: {c: 1, c: 2}}", "got c twice, line 1"),
        ("a: " + "9" * 5000, "a whole number beyond 64 bits"),
        ("a: 0x" + "f" * 40, "a whole number beyond 64 bits"),
        ("a: 1" + ":00" * 2000, "a whole number beyond 64 bits"),
        (ALIASES, "more than 1000000 values, with those of aliases"),
        ("&a [*a]", "an alias of what it stands in"),
        (CHAIN, "up to 64 lists and mappings in each other"),
        ("a: 2024-13-45", "something else than YAML"),
        ("a: !!int ''", "something else than YAML"),
        ("a: !!timestamp x", "something else than YAML"),
        ('a: "\\uD800"', "half a character"),
        ("!!python/object/apply:os.system [ls]", "no YAML of plain values"),
        ("a\n---\nb", "no YAML of plain values"),
    ],
)  # fmt: skip
def test_crafted_yaml_is_refused_in_a_line(text: str, line: str):
    assert line in refused(yaml_of, text)


def test_json_gives_values_and_takes_brackets_in_words():
    text = '{"a": ["' + "[{" * 500 + '", 18446744073709551616, 1e400], "b": "\\ud83d\\ude00"}'
    values = json_of(text, "FILE", "things")
    assert values == {"a": ["[{" * 500, 2**64, float("inf")], "b": "\N{GRINNING FACE}"}


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[" * 20_000, "got no JSON"),
        ("[" * 70 + "]" * 70, "up to 64 lists and mappings in each other"),
        ("[[]," * 70 + "1" + "]" * 70, "up to 64 lists and mappings in each other"),
        ('{"a": {"b": 1,\n"b": 2}}', "got 'b' twice"),
        ("[" + "9" * 5000 + "]", "a whole number beyond 64 bits"),
        ("[18446744073709551617]", "a whole number beyond 64 bits"),
        ('["\\ud800"]', "got no JSON"),
        ('{"a": 1,\n"b": }', "got no JSON from line 2 on"),
    ],
)
def test_crafted_json_is_refused_in_a_line(text: str, line: str):
    assert line in refused(json_of, text)


def test_xml_is_read_in_the_encoding_of_the_file_whatever_it_says(tmp_path: Path):
    path = tmp_path / "a.xml"
    path.write_text("<?xml version='1.0' encoding='utf-8'?><a b='\u00e9'><c>1</c></a>", encoding="utf-16")
    root = read_xml(path, "things")
    assert (root.tag, root.get("b"), root.findtext("c")) == ("a", "\u00e9", "1")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("<a>" * 5000 + "</a>" * 5000, "up to 64 elements in each other"),
        ("<a>" * 5000, "got a broken one"),
        ("<a b='1' b='2'/>", "got a broken one"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "defines no entities"),
        ("", "got a broken one"),
    ],
)
def test_crafted_xml_is_refused_in_a_line(text: str, line: str):
    assert line in refused(xml_of, text)


def archive(path: Path, **arrays: Any) -> Path:
    np.savez_compressed(path, **arrays)
    return path


def test_arrays_come_back_as_they_were_written(tmp_path: Path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(["x", "yz"]), "c": np.array(7), "d": np.empty((0, 4))}
    values = read_arrays(archive(tmp_path / "a.npz", **arrays), "things")
    assert values.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(values[name], array)
        assert values[name].dtype == array.dtype


def header(shape: str, descr: str = "'<f8'") -> bytes:
    content = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(content).to_bytes(2, "little") + content.encode()


@pytest.mark.parametrize(
    "content",
    [
        header("(1000000000000,)") + b"\0" * 80,
        header("(-1, -10)") + b"\0" * 80,
        header("(10,)", "'|O'") + b"\0" * 80,
        header("(10,") + b"\0" * 80,
        header("(10,)", "[" * 50) + b"\0" * 80,
        b"no array",
        b"",
    ],
)
def test_an_array_that_is_not_what_it_says_is_refused_in_a_line(content: bytes, tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
        file.writestr("a.npy", content)
    with pytest.raises(RequestError, match=r"a\.npz: expected things, got something else"):
        read_arrays(tmp_path / "a.npz", "things")


def test_an_archive_whose_header_has_a_long_other_name_is_refused_in_a_short_line(tmp_path: Path):
    content = bytearray(archive(tmp_path / "a.npz", a=np.zeros(5000)).read_bytes())
    content[26:28] = (200).to_bytes(2, "little")  # length of the name in the member's own header
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(RequestError, match="File name in directory") as refused:
        read_arrays(tmp_path / "a.npz", "things")
    assert len(str(refused.value)) < 400 + len(str(tmp_path))


def test_pickled_objects_in_an_archive_are_not_loaded(tmp_path: Path):
    class Harm:
        def __reduce__(self) -> Any:
            return Path.touch, (tmp_path / "harm",)

    np.savez(tmp_path / "a.npz", a=np.array([Harm()], dtype=object))
    with pytest.raises(RequestError, match="no plain array"):
        read_arrays(tmp_path / "a.npz", "things")
    assert not (tmp_path / "harm").exists()


def test_an_archive_that_unpacks_to_more_than_the_bound_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tsuiseki.tracking.openers.arrays.MOST_BYTES", 10_000)
    path = archive(tmp_path / "a.npz", a=np.zeros(10_000))
    assert path.stat().st_size < 1000
    with pytest.raises(RequestError, match="over 10000 bytes"):
        read_arrays(path, "things")


def test_an_archive_with_a_name_twice_is_refused(tmp_path: Path):
    content = io.BytesIO()
    np.save(content, np.zeros(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
        file.writestr("a.npy", content.getvalue())
        with pytest.warns(UserWarning, match="Duplicate"):
            file.writestr("a.npy", content.getvalue())
    with pytest.raises(RequestError, match="a name twice"):
        read_arrays(tmp_path / "a.npz", "things")


@pytest.mark.parametrize("opener", [read_text, read_json, read_yaml, read_xml, read_arrays])
def test_a_file_that_is_not_there_is_named(opener: Callable[[Path, str], Any], tmp_path: Path):
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(RequestError, match=f"expected things at {path}, found no such file"):
            opener(path, "things")


def test_a_file_beyond_the_bound_is_not_read_to_its_end(tmp_path: Path):
    path = tmp_path / "long.yaml"
    with path.open("wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(RequestError, match=r"long\.yaml: expected things of up to 2000000 bytes, got a longer file"):
        read_yaml(path, "things")
