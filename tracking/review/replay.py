"""Corrections of an earlier result, done again on tracks of other settings or of another detector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.review.corrections import Correction, Video, append, read_corrections
from tsuiseki.tracking.review.solving import CorrectedFlow
from tsuiseki.tracking.review.tracks import Reporter, track_ids
from tsuiseki.tracking.types import Track


@dataclass(frozen=True)
class Replayed:
    """What came of corrections.

    Attributes:
        tracks: corrected.
        names: of tracks, by id.
        said: how many corrections there are.
        done: those that can hold together.
        left_out: a line for each that does not.
        video: of which they speak.
    """

    tracks: Sequence[Track]
    names: dict[int, str]
    said: int
    done: tuple[Correction, ...]
    left_out: tuple[str, ...]
    video: Video

    def write(self, path: Path) -> None:
        """Write what was done as corrections of this result."""
        append(path, self.done, self.video)


def replayed(tracks: Sequence[Track], network: SolvedNetwork, path: Path, video: Video) -> Replayed:
    """The tracks under the corrections in a file, as far as they apply by overlap of boxes.

    Args:
        tracks: of a result.
        network: that they were chosen from.
        path: of the corrections.
        video: of the result.

    Raises:
        RequestError: it cannot be read, or speaks of another video.
    """
    said = read_corrections(path, video).said
    flow, left_out = CorrectedFlow(network), list[str]()
    try:
        flow.correct(said)
        done = list(said)
    except RequestError:
        # With other detections some cannot hold any more: each is tried by itself.
        done = []
        for one in said:
            try:
                flow.correct([*done, one])
                done.append(one)
            except RequestError as error:
                left_out.append(str(error))
    reporter = Reporter(tracks)
    ids = track_ids(flow.network.track, flow.labels(), reporter.most)
    names = {int(ids[n]): name for n, name in flow.demands.names.items() if ids[n] and name}
    corrected = reporter.tracks(flow.network, ids, flow.demands.shown)
    return Replayed(corrected, names, len(said), tuple(done), (*left_out, *flow.demands.left_out), video)
