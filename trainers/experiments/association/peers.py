"""The online trackers of roboflow's ``trackers``, run in whatever environment has them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.trainers.experiments.association.peer_program import NAMES
from tsuiseki.trainers.experiments.association.sequences import Clip, read_clip, table_of

PROGRAM = Path(__file__).with_name("peer_program.py")
PEERS = tuple(NAMES)


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
        """What ``program`` answers to a job there, both as JSON."""
        done = subprocess.run(
            [self.python, str(program)], input=json.dumps(job), capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout)


def find_peer(
    python: str | None, program: Path = PROGRAM, package: str = "the package trackers", argument: str = "peer"
) -> Peer | None:
    """The peer in an environment; None where it is not installed.

    Args:
        python: an interpreter; by default the one that runs this.
        program: runs there, and prints the package's version after ``--version``.
        package: what it needs, for the message.
        argument: that names the interpreter, likewise.

    Raises:
        RequestError: a named interpreter cannot be run or has not the package.
    """
    try:
        asked = subprocess.run(
            [python or sys.executable, str(program), "--version"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError) as error:
        if python is None:
            return None
        raise RequestError(
            f"{argument}: expected the python of an environment with {package}, got {python}, which has none"
        ) from error
    return Peer(python or sys.executable, asked.stdout.strip())


def peer_tracks(peer: Peer, program: Path, clip: Clip, logistic: bool) -> dict[str, FloatArray]:
    """What each tracker of the peer makes of a sequence, as `table_of` writes it.

    Args:
        peer: which.
        program: what runs there; its text belongs to the result.
        clip: the sequence.
        logistic: scores are logits and become probabilities first.
    """
    boxes = [
        [frame, *box, 1 / (1 + np.exp(-score)) if logistic else score]
        for frame, found in enumerate(read_clip(clip))
        for box, score in zip(found.boxes.tolist(), found.scores.tolist(), strict=True)
    ]
    job = {"boxes": boxes, "length": len(clip.kept), "rate": clip.rate}
    return {name: _table(rows) for name, rows in peer.answer(program, job)["tracks"].items()}


def _table(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Rows of the peer as tracks; a box that it gives without an area is left out."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    table = table[(table[:, 4] > table[:, 2]) & (table[:, 5] > table[:, 3])]
    tracks = []
    for number in np.unique(table[:, 1]):
        mine = table[table[:, 1] == number]
        tracks.append(Track(int(number), mine[:, 0].astype(np.int64), mine[:, 2:6], mine[:, 6]))
    return table_of(tracks)
