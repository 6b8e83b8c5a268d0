"""The packaging holds together: the package is its folders, data files ship."""

from __future__ import annotations

import datetime
import importlib.resources
import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType

import onnx
import pytest
import yaml
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


PYPROJECT, CHANGES = '[project]\nname = "x"\nversion = "0.1.0"\n', "# Changelog\n\n## 0.2.0 (unreleased)\n\n- new\n"


@pytest.mark.parametrize(
    ("version", "changed", "reason"),
    [
        ("0.2.0", "", ""),
        ("two", "", "expected a version such as 1.2.3, got 'two'"),
        ("v0.2.0", "", "expected the version as 0.2.0, got v0.2.0"),
        ("0.3.0", "", "expected a section '## 0.3.0 (unreleased)' in CHANGELOG.md"),
        ("0.2.0", " M tracking/onnx.py\n", "expected a clean working tree, got\n M tracking/onnx.py"),
    ],
)
def test_what_cannot_be_released_is_said(version, changed, reason):
    said = script("release").refusal(version, "0.1.0", CHANGES, changed)
    assert said.startswith(reason) if reason else said == ""


def test_an_older_or_a_released_version_is_refused():
    release = script("release")
    assert release.refusal("0.2.0", "0.3.0", CHANGES, "") == "expected a version from 0.3.0 on, got 0.2.0"
    dated = release.with_date(CHANGES, "0.2.0", datetime.date(2026, 1, 31))
    assert "## 0.2.0 (2026-01-31)\n" in dated
    assert "was it released?" in release.refusal("0.2.0", "0.1.0", dated, "")


def test_a_release_is_one_command(tmp_path):
    """Version, changelog, checks, wheel, bill of materials, commit and tag in this order; a failure changes nothing."""
    release, files = script("release"), [tmp_path / "pyproject.toml", tmp_path / "CHANGELOG.md"]

    def write():
        for path, text in zip(files, (PYPROJECT, CHANGES), strict=True):
            path.write_text(text)

    def fail(words):
        if "cyclonedx_py" in words:
            raise OSError("no tool")

    write()
    with pytest.raises(OSError, match="no tool"):
        release.release("0.2.0", files, tmp_path / "dist", fail)
    assert [path.read_text() for path in files] == [PYPROJECT, CHANGES]
    calls = []
    release.release("0.2.0", files, tmp_path / "dist", lambda words: calls.append(" ".join(words)))
    assert 'version = "0.2.0"' in files[0].read_text()
    assert f"## 0.2.0 ({datetime.date.today():%Y-%m-%d})" in files[1].read_text()
    steps = (".ci/run", "-m build", "-m venv", "tsuiseki-0.2.0-py3-none-any.whl", "cyclonedx_py environment",
             "git commit", "git tag --annotate v0.2.0")  # fmt: skip
    assert [step in call for step, call in zip(steps, calls, strict=True)] == [True] * len(steps)
    assert str(tmp_path / "dist/tsuiseki-0.2.0.cdx.json") in calls[4]


def test_a_tag_is_published_by_a_trusted_publisher():
    flow = yaml.safe_load((REPOSITORY / ".github/workflows/release.yml").read_text())
    assert flow[True] == {"push": {"tags": ["v*"]}}, "YAML reads `on` as true"
    publish = flow["jobs"]["publish"]
    assert publish["permissions"] == {"id-token": "write"}
    assert publish["needs"] == "build"
    assert publish["steps"][-1]["uses"].startswith("pypa/gh-action-pypi-publish@")
    assert "secrets." not in (REPOSITORY / ".github/workflows/release.yml").read_text()
    assert "release.build" in "".join(step.get("run", "") for step in flow["jobs"]["build"]["steps"])
