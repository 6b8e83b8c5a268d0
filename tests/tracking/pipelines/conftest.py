"""A short generated street, once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsuiseki.datamodules.scenes.street.street import StreetSettings, write_street


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence folder of 16 frames with labels."""
    return write_street(tmp_path_factory.mktemp("street") / "street", StreetSettings(frames=16), seed=100)
