"""Programs of others, run in whatever environment has them, to be measured beside our own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.papers.peer_programs import PACKAGES
from tsuiseki.tracking.errors import RequestError, RunError

PROGRAMS = Path(__file__).with_name("peer_programs.py")


@dataclass(frozen=True)
class Peer:
    """An environment with a peer's packages.

    Attributes:
        program: one of those in peer_programs.py.
        python: interpreter of the environment.
        version: of the packages.
    """

    program: str
    python: str
    version: str

    def answer(self, job: Mapping[str, Any]) -> Any:
        """What the program answers to a job, both of them JSON.

        Raises:
            RunError: it broke off.
        """
        done = _run(self.python, self.program, job)
        if done.returncode:
            last = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()[-1]
            raise RunError(f"{self.program}: expected an answer from {self.python}, it broke off: {last}")
        return json.loads(done.stdout)


def _run(python: str, program: str, job: Mapping[str, Any] | None = None) -> subprocess.CompletedProcess[str]:
    """A program on a job; without one it tells its version."""
    command = [python, "-c", PROGRAMS.read_text(encoding="utf-8"), program]
    return subprocess.run(command, input=json.dumps(job), capture_output=True, text=True)


def find_peer(python: str | None, program: str) -> Peer | None:
    """The peer in an environment; None where it is not installed.

    Args:
        python: an interpreter; by default the one that runs this.
        program: one of those in peer_programs.py.

    Raises:
        RequestError: a named interpreter cannot be run or has not the packages.
    """
    try:
        done = _run(python or sys.executable, program)
        done.check_returncode()
    except (OSError, subprocess.CalledProcessError) as error:
        if python is None:
            return None
        packages = " and ".join(PACKAGES[program])
        raise RequestError(
            f"`peer`: expected the python of an environment with the packages {packages}, got {python}, which has none"
        ) from error
    return Peer(program, python or sys.executable, json.loads(done.stdout))


def skipped(program: str) -> str:
    """The note that a peer is not measured."""
    packages = " and ".join(PACKAGES[program])
    return f"peers: skipped, the packages {packages} are not installed here; name a python that has them as peer"
