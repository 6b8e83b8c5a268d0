"""Write requirements.lock: the versions and hashes that pip finds now for the extras of contributors.

For Linux and the Python that runs this. To install it: pip install --require-hashes -r requirements.lock, then
pip install --no-deps --editable .
"""

import hashlib
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

FOLDER = Path(__file__).resolve().parent.parent
LOCK = FOLDER / "requirements.lock"
EXTRAS = ("train", "dev", "docs")


def needed() -> list[str]:
    """What pyproject.toml asks for, in the base and in the extras of contributors."""
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*project["dependencies"], *(line for extra in EXTRAS for line in project["optional-dependencies"][extra])]


def digest() -> str:
    """By which a lock file is known to be of this pyproject.toml."""
    return hashlib.sha256("\n".join(sorted(needed())).encode()).hexdigest()


def main() -> None:
    """Ask pip, which installs nothing, and write the file."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        options = ["--quiet", "--dry-run", "--ignore-installed", "--only-binary", ":all:", "--report", str(report)]
        subprocess.run([sys.executable, "-m", "pip", "install", *options, *needed()], check=True)
        found = json.loads(report.read_text(encoding="utf-8"))["install"]
    rows = []
    for package in found:
        about, archive = package["metadata"], package["download_info"]["archive_info"]
        rows.append(f"{about['name'].lower()}=={about['version']} --hash=sha256:{archive['hashes']['sha256']}")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    head = f"# Written by `make lock` for Linux and Python {version}, of pyproject.toml with the sum\n# {digest()}\n"
    LOCK.write_text(head + "\n".join(sorted(rows)) + "\n", encoding="utf-8")
    print(f"{len(rows)} packages: {LOCK.name}")


if __name__ == "__main__":
    main()
