"""Tests stand where the code they test stands."""

from __future__ import annotations

from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
MIRRORED = ("benchmarks", "datamodules", "models", "tracking", "trainers")


@pytest.mark.parametrize("name", MIRRORED)
def test_folders_of_tests_are_folders_of_the_code(name):
    folders = {path.parent.relative_to(TESTS) for path in (TESTS / name).rglob("test_*.py")}
    assert folders, f"no test in tests/{name}"
    missing = sorted(str(folder) for folder in folders if not (TESTS.parent / folder).is_dir())
    assert not missing, f"tests in {missing} mirror no folder"


def test_what_lies_beside_the_folders_of_tracking_tests_a_module_there():
    modules = {path.stem for path in (TESTS.parent / "tracking").glob("*.py")}
    loose = sorted(path.name for path in (TESTS / "tracking").glob("test_*.py") if path.stem[5:] not in modules)
    assert not loose, f"{loose} belong in a folder of tests/tracking"
