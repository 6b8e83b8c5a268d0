"""The packaging holds together: the package is its folders, data files ship."""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path

import onnx

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
