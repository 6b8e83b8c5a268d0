"""What the figures of a benchmark were measured on, and how much memory it took."""

from __future__ import annotations

import platform
import resource
import sys
from importlib.metadata import PackageNotFoundError, version


def machine(*packages: str) -> str:
    """One line that says what the figures were measured on."""
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} not installed")
    return f"{platform.machine()} {platform.system()}, Python {platform.python_version()}, {', '.join(found)}"


def peak_memory() -> float:
    """Most memory this process has held so far, in GB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9
