"""Constraints that hold packages at the lower bounds of pyproject.toml: python .ci/lowest.py EXTRA..."""

import re
import sys
import tomllib
from pathlib import Path

FLOOR = re.compile(r"([\w.-]+)(?:\[[\w,]+\])?>=([\w.]+)")


def floors(extras: list[str]) -> dict[str, str]:
    """The lowest version of each package of the base and of the extras, by name."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [*project["dependencies"], *(line for extra in extras for line in project["optional-dependencies"][extra])]
    bounded = filter(None, map(FLOOR.match, needed))
    return {match[1]: match[2] for match in bounded}


if __name__ == "__main__":
    print("\n".join(f"{name}=={version}" for name, version in floors(sys.argv[1:]).items()))
