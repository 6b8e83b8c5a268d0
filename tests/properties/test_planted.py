"""Planted faults are caught: that of each property, and three in each of twelve rooms."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.properties.faults import BY_FILE, of_file
from tests.properties.planted import REPOSITORY, Fault, complaint, plant
from tests.properties.room_faults import ROOMS

HERE = Path(__file__).resolve().parent


def properties() -> Iterator[str]:
    """The names of all properties, as pytest has them without their parameters."""
    for path in sorted(HERE.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            given = isinstance(node, ast.FunctionDef) and any("given" in ast.dump(d) for d in node.decorator_list)
            if isinstance(node, ast.FunctionDef) and given:
                yield f"tests/properties/{path.name}::{node.name}"


def test_each_property_has_a_fault_that_it_must_catch() -> None:
    assert {fault.test.split("[")[0] for name in BY_FILE for fault in of_file(name)} == {*properties()}


def test_three_faults_are_planted_in_each_of_twelve_rooms() -> None:
    assert len(ROOMS) >= 12
    assert min(map(len, ROOMS.values())) >= 3


def test_the_text_that_a_fault_changes_stands_once() -> None:
    faults = [fault for part in (*map(of_file, BY_FILE), *ROOMS.values()) for fault in part]
    assert [str(f) for f in faults if (REPOSITORY / f.file).read_text(encoding="utf-8").count(f.old) != 1] == []


def test_a_fault_is_in_the_copy_alone(tmp_path: Path) -> None:
    fault = Fault("tracking/errors.py", "class RequestError", "class OtherError", "")
    plant(fault, tmp_path)
    assert "class OtherError" in (tmp_path / "tsuiseki/tracking/errors.py").read_text()
    assert "class RequestError" in (HERE.parent.parent / fault.file).read_text()
    with pytest.raises(ValueError, match=r"expected 'no such text' once in tracking/errors.py, found it 0 times"):
        plant(Fault(fault.file, "no such text", "", ""), tmp_path / "another")


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_FILE)
def test_properties_catch_their_faults(name: str) -> None:
    assert [f"{fault}: {said}" for fault in of_file(name) if (said := complaint(fault))] == []


@pytest.mark.slow
@pytest.mark.parametrize("room", ROOMS)
def test_tests_catch_faults_in_a_room(room: str) -> None:
    assert [f"{fault}: {said}" for fault in ROOMS[room] if (said := complaint(fault))] == []
