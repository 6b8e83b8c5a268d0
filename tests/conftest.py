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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Whatever asks for the real data is an integration test."""
    for item in items:
        if "data_folder" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.integration)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """On CI a run of everything fails when the real data is there and a test that needs it did not run."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    folder = Path(os.environ.get("TSUISEKI_DATA", REPOSITORY.parent / "shared" / "data"))
    if not os.environ.get("CI") or not folder.is_dir() or reporter is None or session.config.args_source.name == "ARGS":
        return
    skipped = [r.nodeid for r in reporter.stats.get("skipped", []) if "integration" in r.keywords]
    passed = [r.nodeid for r in reporter.stats.get("passed", []) if "integration" in r.keywords]
    if skipped or not passed:
        reporter.write_line(
            f"real data is at {folder}, but integration tests did not run: {skipped or 'none found'}", red=True
        )
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
