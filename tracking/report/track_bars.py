"""Tracks in words and bars: how many of what there are, and when each was followed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.report.page import Bar
from tsuiseki.tracking.types import Track

# One who is followed, and several.
PERSON = ("person", "people")


def class_of(track: Track, noun: str = "person") -> str:
    """Name of a track's class, or class and its number; ``noun`` where neither is known."""
    return track.class_name or (f"class {track.class_id}" if track.class_id >= 0 else noun)


def counted(tracks: Sequence[Track], nouns: tuple[str, str] = PERSON) -> str:
    """How many there are, by class where classes are distinguished, such as ``4 x person, 2 x car``."""
    classes = Counter(class_of(track, nouns[0]) for track in tracks)
    if classes.keys() <= {nouns[0]}:
        return f"{len(tracks)} {nouns[len(tracks) != 1]}"
    return ", ".join(f"{count} x {name}" for name, count in sorted(classes.items()))


def followed(track: Track, noun: str = "person", doubtful: bool = False) -> tuple[str, list[Bar]]:
    """The row of a track: when it was followed, pale where no detection supports it; ``?`` where it is doubtful."""
    name = f"{class_of(track, noun)} {track.id}{'?' * doubtful}"
    return name, [
        Bar(span.first, span.last, name, track.id, pale=not span.value)
        for span in spans(track.frames, track.observed.astype(np.int64))
    ]
