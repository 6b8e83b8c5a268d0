"""Shared fixtures: where the real data is, and small inputs that many tests need."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real data; skips the test where there is none."""
    folder = Path(os.environ.get("TSUISEKI_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}; set TSUISEKI_DATA to the folder that holds mot/, sot/, ...")
    return folder
