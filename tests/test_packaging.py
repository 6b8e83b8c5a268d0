"""The packaging holds together: every package is listed, the type checkers see what runs, data files ship."""

from __future__ import annotations

import importlib.resources
import json
import tomllib
from pathlib import Path

import onnx

from tsuiseki.tracking.onnx import METADATA_KEY

REPOSITORY = Path(__file__).resolve().parent.parent
FOLDERS = ("configs", "datamodules", "models", "tracking", "trainers")


def test_every_package_on_disk_is_listed():
    configuration = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    listed = set(configuration["tool"]["setuptools"]["packages"])
    on_disk = {
        "tsuiseki." + ".".join(path.parent.relative_to(REPOSITORY).parts)
        for folder in FOLDERS
        for path in (REPOSITORY / folder).rglob("__init__.py")
    }
    # The front installs as the top level itself.
    assert listed == on_disk - {"tsuiseki.tracking.front"} | {"tsuiseki"}


def test_type_checkers_see_the_files_that_run():
    for folder in FOLDERS:
        assert (REPOSITORY / ".types" / "tsuiseki" / folder).resolve() == (REPOSITORY / folder).resolve()
    front = REPOSITORY / "tracking" / "front"
    for path in front.iterdir():
        if path.is_file():
            assert (REPOSITORY / ".types" / "tsuiseki" / path.name).resolve() == path.resolve()


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
