"""What a result of the flow keeps so that it can be corrected, and corrections of an earlier result done again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.result import Writer
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.video.source import Source, image_size


def network_at(tracker: object, first: int) -> SolvedNetwork | None:
    """The network of a flow that was solved whole, once it was asked for its tracks; None of others.

    Args:
        tracker: of people.
        first: number of its first frame.
    """
    network = tracker.network() if isinstance(tracker, FlowTracker) else None
    return None if network is None else replace(network, frames=network.frames + first)


def check_corrections(path: Path, source: Source) -> None:
    """Refuse corrections of another video before one is tracked, as far as it tells its size and length.

    Raises:
        RequestError: they are, or cannot be read.
    """
    from tsuiseki.tracking.review.corrections import Video, read_corrections

    wanted = source.frames_wanted
    length = source.length or getattr(source, "promised", 0)
    frames = wanted.last + 1 if wanted.last is not None else int(length or 0)
    video = Video(Path(source.name).name, image_size(source), frames)
    read_corrections(path, video, getattr(source, "slack", 0.0) if wanted.last is None else 0.0)


def correction_files(
    tracks: list[Track],
    network: SolvedNetwork | None,
    corrections: Path | None,
    source: Source,
    frames: Sequence[int],
) -> tuple[list[Track], dict[str, Writer], dict[str, Any], list[str]]:
    """Tracks under the corrections of an earlier result, and what keeps them open to more.

    Args:
        tracks: of a run.
        network: that they were chosen from; None where the method has none.
        corrections: file; None for none.
        source: the video.
        frames: numbers of those that were tracked in.

    Returns:
        The tracks, files of the result, its facts, and lines for the user.

    Raises:
        RequestError: the corrections cannot be read, or speak of another video.
    """
    files: dict[str, Writer] = {} if network is None else {NETWORK_FILE: lambda path, _: network.write(path)}
    if corrections is None:
        return tracks, files, {}, []
    from tsuiseki.tracking.review.corrections import CORRECTIONS_FILE, Video
    from tsuiseki.tracking.review.session import FILL, SOLVED_FILE
    from tsuiseki.tracking.review.tracks import replayed

    last = max([*frames, *(int(track.frames[-1]) for track in tracks)], default=-1)
    video = Video(Path(source.name).name, image_size(source), last + 1)
    rate = source.frame_rate
    known = network_of_tracks(tracks, round(FILL * rate), rate) if network is None else network
    found = replayed(tracks, known, corrections, video)
    files |= {
        SOLVED_FILE: lambda path, _: write_tracks(path, tracks),
        CORRECTIONS_FILE: lambda path, _: found.write(path),
    }
    facts: Mapping[str, Any] = {"corrections": len(found.done), "track_names": found.names}
    every, lost = found.said, len(found.left_out)
    lines = [f"corrections: {every - lost} of {every} done again"]
    return list(found.tracks), files, dict(facts), [*lines, *(f"left out: {line}" for line in found.left_out)]
