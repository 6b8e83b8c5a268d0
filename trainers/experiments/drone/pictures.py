"""Pictures like thesis Figs. 5.7, 5.9 and 5.10: which switches of ids to show, in which results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.evaluation.coverage import Coverage, coverage
from tsuiseki.tracking.types import IntArray
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.trainers.experiments.drone.clips import Clip
from tsuiseki.trainers.experiments.drone.strips import StripRow, strip

# Frames side by side.
SHOWN = 5

People = Sequence[Sequence[ActingTrack]]


@dataclass(frozen=True)
class Picture:
    """A strip of a switch.

    Attributes:
        shows: clip, person and frame (both as in its files, from 1).
        jpeg: bytes of the file.
    """

    shows: dict[str, str | int]
    jpeg: bytes


@dataclass(frozen=True)
class Result:
    """One way to track all clips.

    Attributes:
        name: stands above its row.
        people: of every clip.
        single: show what single frames say, not windows.
    """

    name: str
    people: People
    single: bool = False


@dataclass(frozen=True)
class Switch:
    """A change of id.

    Attributes:
        clip: number of the clip.
        person: of the ground truth.
        frame: 0-based, the first with the new id.
    """

    clip: int
    person: int
    frame: int


class Followers:
    """Who is followed by which track in a result."""

    def __init__(self, clips: Sequence[Clip], people: People) -> None:
        self._found: list[dict[int, Coverage]] = [
            {person.id: person for person in coverage(clip.truth, [one.track for one in acting])}
            for clip, acting in zip(clips, people, strict=True)
        ]

    def switches(self) -> set[Switch]:
        """All changes of id: from one id to another, misses between passed over."""
        found = set()
        for number, everyone in enumerate(self._found):
            for person in everyone.values():
                seen = np.flatnonzero(person.track_ids > 0)
                for k in np.flatnonzero(np.diff(person.track_ids[seen]) != 0).tolist():
                    found.add(Switch(number, person.id, int(person.frames[seen[k + 1]])))
        return found

    def ids(self, clip: int, person: int, frames: range) -> IntArray:
        """``(T,)`` ids of the tracks on a person, 0 where none is or nobody labelled them."""
        known = self._found[clip][person]
        by_frame = dict(zip(known.frames.tolist(), known.track_ids.tolist(), strict=True))
        return np.array([by_frame.get(frame, 0) for frame in frames], dtype=np.int64)


def draw_pictures(clips: Sequence[Clip], flow: People, iterations: Sequence[People]) -> dict[str, Picture]:
    """``prevented`` (Fig. 5.7): a switch of the flow that the alternation prevents. ``remaining`` (5.9): where
    one person's id changes most often to the end.

    Args:
        clips: that were tracked.
        flow: people without action features.
        iterations: people by iteration of the alternation, at least 6.

    Returns:
        Each picture that there was a switch for.
    """
    rows = [
        Result("flow", flow),
        Result("SAF, iteration 1", iterations[0], single=True),
        Result("MAF, iteration 2", iterations[1]),
        Result("MAF, iteration 6", iterations[5]),
    ]
    last = Result(f"MAF, iteration {len(iterations)}", iterations[-1])
    prevented = _prevented(clips, flow, iterations[5])
    drawn = {"prevented": _draw(clips, prevented, rows)}
    drawn["remaining"] = _draw(clips, _remaining(clips, last.people), [*rows[:2], last])
    return {name: picture for name, picture in drawn.items() if picture is not None}


def draw_second(clips: Sequence[Clip], iterations: Sequence[People]) -> dict[str, Picture]:
    """``second`` (Fig. 5.10): a switch of SAF that one repetition prevents, on clips unlike those learnt from.

    Args:
        clips: that were tracked.
        iterations: people by iteration of the alternation, at least 2.

    Returns:
        As `draw_pictures`.
    """
    rows = [Result("SAF, iteration 1", iterations[0], single=True), Result("MAF, iteration 2", iterations[1])]
    picture = _draw(clips, _prevented(clips, iterations[0], iterations[1]), rows)
    return {} if picture is None else {"second": picture}


def _frames_around(switch: Switch, length: int) -> range:
    """The frames of a clip that a picture shows."""
    first = int(np.clip(switch.frame - SHOWN // 2, 0, max(length - SHOWN, 0)))
    return range(first, min(first + SHOWN, length))


def _prevented(clips: Sequence[Clip], before: People, after: People) -> Switch | None:
    """The clearest of the switches in ``before`` that ``after`` does without.

    That is where most changes of id go away within the frames shown; of equals, where the person is followed in most of
    them, then the tallest one.
    """
    old, new = Followers(clips, before), Followers(clips, after)

    def gain(switch: Switch) -> int:
        where = switch.clip, switch.person, _frames_around(switch, len(clips[switch.clip].seen))
        return _changes(old.ids(*where)) - _changes(new.ids(*where))

    def clarity(switch: Switch) -> tuple[float, ...]:
        frames = _frames_around(switch, len(clips[switch.clip].seen))
        followed = new.ids(switch.clip, switch.person, frames) > 0
        return gain(switch), followed.sum(), _height(clips, switch)

    # A switch that only comes a frame later is not prevented.
    return _best((switch for switch in old.switches() if gain(switch) > 0), clarity)


def _remaining(clips: Sequence[Clip], people: People) -> Switch | None:
    """Where an id changes most often within the frames shown; of equals, the tallest person."""
    found = Followers(clips, people)

    def frequency(switch: Switch) -> tuple[float, ...]:
        frames = _frames_around(switch, len(clips[switch.clip].seen))
        return _changes(found.ids(switch.clip, switch.person, frames)), _height(clips, switch)

    return _best(found.switches(), frequency)


def _changes(ids: IntArray) -> int:
    """Of id in successive frames, those with none passed over."""
    return int((np.diff(ids[ids > 0]) != 0).sum())


def _best(found: Iterable[Switch], key: Callable[[Switch], tuple[float, ...]]) -> Switch | None:
    """The switch of the largest key; of equals the first."""
    return max(sorted(found, key=lambda s: (s.clip, s.person, s.frame)), key=key, default=None)


def _height(clips: Sequence[Clip], switch: Switch) -> float:
    """Of the person's label in the frame of the switch, pixels."""
    truth = clips[switch.clip].truth
    box = truth.boxes[(truth.ids == switch.person) & (truth.frames == switch.frame)][0]
    return float(box[3] - box[1])


def _draw(clips: Sequence[Clip], switch: Switch | None, results: Sequence[Result]) -> Picture | None:
    if switch is None:
        return None
    clip, frames = clips[switch.clip], _frames_around(switch, len(clips[switch.clip].seen))
    rows = [
        StripRow(
            result.name,
            result.people[switch.clip],
            Followers(clips, result.people).ids(switch.clip, switch.person, frames).tolist(),
            result.single,
        )
        for result in results
    ]
    shows: dict[str, str | int] = {"clip": clip.folder.name, "person": switch.person, "frame": switch.frame + 1}
    return Picture(shows, strip(clip, switch.person, frames, rows))
