"""Make a release of a version: `make release VERSION=1.2.3`. Nothing leaves this computer.

1. The working tree is clean, the version is new, and the changelog has a section for it.
2. pyproject.toml gets the version, the changelog the date.
3. `.ci/run` passes.
4. Wheel and source archive come to lie in dist/, and beside them the bill of materials (CycloneDX) of an environment in
   which the wheel alone is installed, by cyclonedx-py.
5. A commit and a tag; pushed, the tag starts .github/workflows/release.yml, which publishes.

What fails before the commit leaves both files as they were.
"""

from __future__ import annotations

import datetime
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

from packaging.version import InvalidVersion, Version

REPOSITORY = Path(__file__).resolve().parent.parent
VERSION_LINE = re.compile(r'^version = "(.+)"$', re.MULTILINE)
Run = Callable[[Sequence[str]], object]


def refusal(version: str, current: str, changelog: str, changed: str) -> str:
    """Why no release can be made; empty where one can.

    Args:
        version: wanted.
        current: of pyproject.toml.
        changelog: its text.
        changed: what `git status --porcelain` prints.
    """
    try:
        number = Version(version)
    except InvalidVersion:
        return f"expected a version such as 1.2.3, got {version!r}"
    if str(number) != version:
        return f"expected the version as {number}, got {version}"
    heading = re.search(rf"^## {re.escape(version)}(?: \((.*)\))?$", changelog, re.MULTILINE)
    if heading is None:
        return f"expected a section '## {version} (unreleased)' in CHANGELOG.md, found none; write it first"
    if heading[1] != "unreleased":
        return f"expected '## {version} (unreleased)' in CHANGELOG.md, got '{heading[0]}'; was it released?"
    if number < Version(current):
        return f"expected a version from {current} on, got {version}"
    return f"expected a clean working tree, got\n{changed.rstrip()}" if changed.strip() else ""


def with_version(pyproject: str, version: str) -> str:
    """The text of pyproject.toml with this version."""
    return VERSION_LINE.sub(f'version = "{version}"', pyproject, count=1)


def with_date(changelog: str, version: str, date: datetime.date) -> str:
    """The text of the changelog with the date of this version."""
    return changelog.replace(f"## {version} (unreleased)", f"## {version} ({date:%Y-%m-%d})", 1)


def call(words: Sequence[str]) -> None:
    """Run a command in the repository; raises CalledProcessError where it fails."""
    subprocess.run(words, cwd=REPOSITORY, check=True)


def build(dist: Path, version: str, run: Run = call) -> None:
    """Wheel, source archive and bill of materials into the folder ``dist``."""
    run([sys.executable, "-m", "build", "--outdir", str(dist), str(REPOSITORY)])
    with tempfile.TemporaryDirectory() as folder:
        python = f"{folder}/bin/python"
        run([sys.executable, "-m", "venv", folder])
        run([python, "-m", "pip", "install", "--quiet", str(dist / f"tsuiseki-{version}-py3-none-any.whl")])
        bill = ["--output-format", "JSON", "--output-file", str(dist / f"tsuiseki-{version}.cdx.json")]
        run([sys.executable, "-m", "cyclonedx_py", "environment", "--output-reproducible", *bill, python])


def release(version: str, files: Sequence[Path], dist: Path, run: Run = call) -> None:
    """Steps 2 to 5; ``files`` are pyproject.toml and the changelog."""
    before = [path.read_text(encoding="utf-8") for path in files]
    try:
        files[0].write_text(with_version(before[0], version), encoding="utf-8")
        files[1].write_text(with_date(before[1], version, datetime.date.today()), encoding="utf-8")
        run([str(REPOSITORY / ".ci" / "run")])
        build(dist, version, run)
    except BaseException:
        for path, text in zip(files, before, strict=True):
            path.write_text(text, encoding="utf-8")
        raise
    run(["git", "commit", "--quiet", "--message", f"release: {version}", *map(str, files)])
    run(["git", "tag", "--annotate", f"v{version}", "--message", f"Tsuiseki {version}"])


def main(words: Sequence[str]) -> int:
    """The exit status; 2 where no release can be made."""
    version, files = " ".join(words), [REPOSITORY / "pyproject.toml", REPOSITORY / "CHANGELOG.md"]
    current = tomllib.loads(files[0].read_text(encoding="utf-8"))["project"]["version"]
    status = ["git", "status", "--porcelain"]
    changed = subprocess.run(status, cwd=REPOSITORY, check=True, capture_output=True, text=True).stdout
    if reason := refusal(version, current, files[1].read_text(encoding="utf-8"), changed):
        print(f"release: {reason}", file=sys.stderr)
        return 2
    release(version, files, REPOSITORY / "dist")
    print(f"dist/ holds {version}; to publish: git push origin v{version}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
