"""What a source says of itself, for its results, and whether another source is the video of a result."""

from __future__ import annotations

import warnings
from contextlib import suppress

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types.recording import Recording
from tsuiseki.tracking.video.frame_source import Source


def recording_of(source: Source) -> Recording:
    """What ``source`` says."""
    fingerprint = ""
    # Who tracked may have taken the file away.
    with suppress(OSError):
        fingerprint = source.fingerprint
    return Recording(source.frame_rate, source.size, source.first_time, source.likely_length or 0, fingerprint)


def check_recording(source: Source, recording: Recording, last: int = -1) -> None:
    """Refuse a source that is not the video of a result, and say where it may be another.

    Args:
        source: what is taken for the video.
        recording: what the result says of it.
        last: 0-based number of the last frame of the result.

    Raises:
        RequestError: it has another size, or ends before ``last``.
    """
    if recording.size is not None and source.size is not None and recording.size != source.size:
        raise RequestError(
            f"{source.name}: expected frames of {recording.size[0]}x{recording.size[1]} pixels as in the result, got "
            f"{source.size[0]}x{source.size[1]}; give the video of the result"
        )
    if source.length is not None and source.length <= last:
        raise RequestError(f"{source.name}: expected {last + 1} frames as in the result, got {source.length}")
    fingerprint = source.fingerprint
    if fingerprint and not recording.fingerprint and recording != Recording():
        _warn(f"{source.name}: the result does not say of which file it is, so that this is not checked")
    elif fingerprint and recording.fingerprint and fingerprint != recording.fingerprint:
        told = {
            "frames": (recording.length, source.likely_length or 0),
            "frames a second": (recording.frame_rate, source.frame_rate),
            "s at its first frame": (recording.first_time, source.first_time),
        }
        differ = [f"{new:g} {unit} instead of {old:g}" for unit, (old, new) in told.items() if new != old]
        reason = "; ".join(["its bytes are others", *differ])
        _warn(f"{source.name} is not the file that the result is of: {reason}; boxes may lie elsewhere in it")


def _warn(text: str) -> None:
    warnings.warn(text, InputWarning, stacklevel=4)
