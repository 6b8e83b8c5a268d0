"""The online trackers of roboflow's ``trackers``, run in whatever environment has them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.trainers.experiments.association.peer_program import NAMES
from tsuiseki.trainers.experiments.association.sequences import Clip, read_clip, table_of
from tsuiseki.trainers.experiments.peers import Peer

PROGRAM = Path(__file__).with_name("peer_program.py")
PACKAGE = "the package trackers"
PEERS = tuple(NAMES)


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
