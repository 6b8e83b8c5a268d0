"""Archives of npm and PyPI, fetched by npm and pip themselves.

Both read what the user, the project or the company has set: a mirror, its certificate and how to sign in. Nothing here
names a registry.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote

from tsuiseki.tracking.errors import RunError

# Seconds that npm or pip may take for an archive: 150 MB at 2 Mbit/s.
SECONDS = 600.0
# How a package URL begins (ECMA-427).
SCHEME = "pkg:"
# What each registry's own program is called, and its arguments before the package; it writes into the last one.
_NPM = ("pack", "--ignore-scripts", "--loglevel=error", "--pack-destination")
_PIP = ("-m", "pip", "download", "--no-deps", "--only-binary=:all:", "--quiet", "--disable-pip-version-check", "--dest")


def fetch_archive(address: str, file: Path) -> None:
    """Put the archive at a package URL, such as ``pkg:npm/%40scope/name@1.0``, in the place of ``file``.

    Raises:
        RunError: the program of the registry is missing, fails, or takes too long.
    """
    kind, _, package = unquote(address.removeprefix(SCHEME)).partition("/")
    name, _, version = package.rpartition("@")
    with TemporaryDirectory(dir=file.parent) as folder:
        commands: Mapping[str, Sequence[str]] = {
            "npm": (shutil.which("npm") or "npm", *_NPM, folder, f"{name}@{version}"),
            "pypi": (sys.executable, *_PIP, folder, f"{name}=={version}"),
        }
        reason = _failure(commands[kind])
        archives = list(Path(folder).iterdir())
        if reason or len(archives) != 1:
            raise RunError(
                f"{name} {version} of {'PyPI' if kind == 'pypi' else kind}: {reason or 'no archive came'}; set its "
                f"registry for {'pip' if kind == 'pypi' else kind}, or put the archive at {file.with_suffix('.whole')}"
            )
        archives[0].replace(file)


def _failure(command: Sequence[str]) -> str:
    """Run a command; why it failed, in its own words, or nothing."""
    try:
        subprocess.run(command, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=SECONDS)
    except FileNotFoundError:
        return f"{command[0]} is not installed"
    except subprocess.TimeoutExpired:
        return f"not there after {SECONDS:g} s"
    except subprocess.CalledProcessError as error:
        return " ".join((error.stderr or f"exit status {error.returncode}").split())[:300]
    return ""
