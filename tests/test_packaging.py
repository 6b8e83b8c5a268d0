"""The packaging holds together: the package is its folders, data files ship."""

from __future__ import annotations

import importlib.resources
import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType

import onnx
import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tsuiseki.tracking.onnx import METADATA_KEY

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDERS = ("configs", "datamodules", "models", "tracking", "trainers")


def test_the_package_is_its_folders():
    """`src/tsuiseki` links to the folders at the top, so that installers, editors and type checkers see one tree."""
    for folder in FOLDERS:
        assert (REPOSITORY / "src" / "tsuiseki" / folder).resolve() == REPOSITORY / folder


def test_configurations_are_package_data():
    names = {entry.name for entry in importlib.resources.files("tsuiseki.configs").iterdir()}
    assert {path.name for path in (REPOSITORY / "configs").glob("*.yaml")} <= names
    assert any(name.endswith(".yaml") for name in names)


def test_shipped_models_stay_small_and_carry_a_card():
    models = list((REPOSITORY / "tracking" / "weights").glob("*.onnx"))
    assert models
    assert sum(path.stat().st_size for path in models) <= 40 * 2**20
    for path in models:
        card = json.loads({p.key: p.value for p in onnx.load(path).metadata_props}[METADATA_KEY])
        assert card["training_data"], path.name


def script(name: str) -> ModuleType:
    """A script of `.ci`."""
    found = importlib.util.spec_from_file_location(name, REPOSITORY / ".ci" / f"{name}.py")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def locked() -> dict[str, Version]:
    """The versions of requirements.lock by name."""
    rows = [line for line in (REPOSITORY / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
    matches = [re.fullmatch(r"([\w.-]+)==(\S+) --hash=sha256:[0-9a-f]{64}", row) for row in rows]
    assert len(rows) > 100
    assert None not in matches
    return {match[1].replace("_", "-"): Version(match[2]) for match in matches}


def test_the_lowest_versions_are_those_that_were_built_for_numpy_2_and_that_the_demo_runs_with():
    floors = script("lowest").floors(["train", "hdf5", "tables"])
    assert (floors["h5py"], floors["pandas"], floors["numpy"]) == ("3.11", "2.2.2", "2.0")
    assert Version(floors["cyclopts"]) >= Version("5.5.2")
    assert (floors["jsonargparse"], floors["torch"]) == ("4.49", "2.8")


@pytest.mark.parametrize("version", ["2.6.2", "2.6.3"])
def test_the_compromised_releases_of_lightning_are_left_out(version):
    (lightning,) = [Requirement(line) for line in script("lock").needed() if line.startswith("lightning")]
    assert not lightning.specifier.contains(version)
    assert lightning.specifier.contains("2.6.1")
    assert lightning.specifier.contains("2.6.6")


def test_the_lock_file_is_of_this_pyproject(locked):
    lock = script("lock")
    assert lock.digest() in lock.LOCK.read_text(), "give `make lock`"
    for line in lock.needed():
        requirement = Requirement(line)
        version = locked[requirement.name.lower().replace("_", "-")]
        assert requirement.specifier.contains(version), line


def test_the_lock_file_names_no_registry_and_brings_one_opencv(locked):
    assert "://" not in script("lock").LOCK.read_text()
    assert [name for name in locked if name.startswith("opencv")] == ["opencv-python-headless"]


def test_the_audit_passes_with_a_reason_where_it_cannot_be_done(monkeypatch, capsys):
    audit = script("audit")
    monkeypatch.setattr(audit.importlib.util, "find_spec", lambda _: None)
    assert audit.main() == 0
    assert "skipped, pip-audit cannot be installed here" in capsys.readouterr().out
    unreached = audit.subprocess.CompletedProcess([], 1, "", "requests.exceptions.ConnectionError: no route")
    nothing = "".join(f"package {n} could not be audited\n" for n in range(1000))
    unknown = audit.subprocess.CompletedProcess([], 0, nothing, "No known vulnerabilities found")
    hole = audit.subprocess.CompletedProcess([], 1, "package 1.0 PYSEC-1", "Found 1 known vulnerability")
    monkeypatch.setattr(audit.importlib.util, "find_spec", lambda name: name)
    for done, status, words in (
        (unreached, 0, "out of reach"),
        (unknown, 0, "out of reach"),
        (hole, 1, "PYSEC-1"),
    ):
        monkeypatch.setattr(audit.subprocess, "run", lambda *_, done=done, **__: done)
        assert audit.main() == status
        assert words in capsys.readouterr().out
