"""Programs of others, run in whatever environment has them, to be measured beside our own.

A program is a file that imports nothing of ours, with the functions ``version() -> str`` and ``answer(job)``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError, RunError

RUN = """
import json, runpy, sys, warnings
warnings.filterwarnings("ignore")
program = runpy.run_path(sys.argv[1])
result = program["answer"](json.load(sys.stdin)) if len(sys.argv) == 2 else program["version"]()
json.dump(result, sys.stdout)
"""


@dataclass(frozen=True)
class Peer:
    """An environment with the peer's package.

    Attributes:
        python: its interpreter.
        version: of the package.
    """

    python: str
    version: str

    @property
    def fingerprint(self) -> str:
        """Where it is installed makes no difference to what it computes."""
        return f"peer {self.version}"

    def answer(self, program: Path, job: Mapping[str, Any]) -> Any:
        """What ``program`` answers to a job there, both of them JSON.

        Raises:
            RunError: it broke off.
        """
        command = [self.python, "-c", RUN, str(program)]
        done = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True)
        if done.returncode:
            last = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[-1]
            raise RunError(f"{program.name}: expected an answer from {self.python}, it broke off: {last}")
        return json.loads(done.stdout)


def find_peer(python: str | None, program: Path, package: str) -> Peer | None:
    """The peer in an environment; None where it is not installed.

    Args:
        python: an interpreter; by default the one that runs this.
        program: runs there, and knows the package's version.
        package: what it needs, for the message.

    Raises:
        RequestError: a named interpreter cannot be run or has not the package.
    """
    try:
        command = [python or sys.executable, "-c", RUN, str(program), "version"]
        asked = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        if python is None:
            return None
        raise RequestError(
            f"`peer`: expected the python of an environment with {package}, got {python}, which has none"
        ) from error
    return Peer(python or sys.executable, json.loads(asked.stdout))
