"""Plots of thesis chapter 5, and its pictures of switches of ids (Figs. 5.7, 5.9 and 5.10).

A picture is a strip: a row for each result, a column for each frame, the person in the middle and enlarged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np
from matplotlib.figure import Figure

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.tracking.drone.page import captions_of
from tsuiseki.tracking.evaluation.coverage import Coverage, coverage
from tsuiseki.tracking.features.action import crop_squares
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.report.overlay import Overlay, draw_label
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, IntArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack

if TYPE_CHECKING:
    from tsuiseki.trainers.experiments.drone import ObservedClip

# Frames side by side.
SHOWN = 5
# Pixels of a cell, of the bands above the rows and below them, and of the lines between the cells.
CELL, BAND, LINE = 200, 20, 2
# Side of the part of a frame in a cell, in longer sides of the person's largest box.
AROUND = 2.6
# Most actions of a person in a cell, so that the label fits, and the least probability of each.
MOST_NAMED, THRESHOLD = 2, 0.4
QUALITY = 70
LEGEND = (
    f"In the middle the person, with id and actions above {THRESHOLD:g}; all others with their ids. "
    "Dashed: not detected, filled in. Bottom left: the frame."
)
DARK, WHITE = (40, 40, 40), (255, 255, 255)
# The people of every clip in a result.
People: TypeAlias = Sequence[Sequence[ActingTrack]]
# Number of the clip, id of the labelled person, and the first frame with the new id, 0-based.
Switch: TypeAlias = tuple[int, int, int]


@dataclass(frozen=True)
class SwitchStrip:
    """A picture of a switch.

    Attributes:
        shows: clip, person and frame, both as in its files, from 1.
        jpeg: bytes of the file.
    """

    shows: dict[str, str | int]
    jpeg: bytes


@dataclass(frozen=True)
class _Row:
    """A result in a strip.

    Attributes:
        name: stands above the row.
        people: of every clip.
        single: name the actions of single frames, not those of windows.
    """

    name: str
    people: People
    single: bool = False


class _Followers:
    """The ids that a result gives to the labelled people."""

    def __init__(self, clips: Sequence[ObservedClip], people: People) -> None:
        self._found: list[dict[int, Coverage]] = [
            {person.id: person for person in coverage(clip.truth, [one.track for one in acting])}
            for clip, acting in zip(clips, people, strict=True)
        ]

    def switches(self) -> set[Switch]:
        """All changes from one id to another, misses between passed over."""
        found = set()
        for number, everyone in enumerate(self._found):
            for person in everyone.values():
                tracked = np.flatnonzero(person.track_ids > 0)
                for k in np.flatnonzero(np.diff(person.track_ids[tracked]) != 0).tolist():
                    found.add((number, person.id, int(person.frames[tracked[k + 1]])))
        return found

    def ids(self, clip: int, person: int, frames: range) -> IntArray:
        """``(T,)`` ids of the tracks on a person, 0 where none is or the person is not labelled."""
        known = self._found[clip][person]
        by_frame = dict(zip(known.frames.tolist(), known.track_ids.tolist(), strict=True))
        return np.array([by_frame.get(frame, 0) for frame in frames], dtype=np.int64)


def draw_pictures(clips: Sequence[ObservedClip], flow: People, iterations: Sequence[People]) -> dict[str, SwitchStrip]:
    """``prevented`` (Fig. 5.7) is a switch of the flow that the alternation prevents; ``remaining`` is Fig. 5.9.

    Args:
        clips: that were tracked.
        flow: people without action features.
        iterations: people by iteration of the alternation, at least 6.

    Returns:
        Each picture that there was a switch for; ``remaining`` is where one person's id changes most often to the end.
    """
    rows = [_Row("flow", flow), _Row("SAF, iteration 1", iterations[0], single=True),
            _Row("MAF, iteration 2", iterations[1]), _Row("MAF, iteration 6", iterations[5])]  # fmt: skip
    last = _Row(f"MAF, iteration {len(iterations)}", iterations[-1])
    drawn = {"prevented": _draw(clips, _prevented(clips, flow, iterations[5]), rows)}
    drawn["remaining"] = _draw(clips, _remaining(clips, last.people), [*rows[:2], last])
    return {name: picture for name, picture in drawn.items() if picture is not None}


def draw_second(clips: Sequence[ObservedClip], iterations: Sequence[People]) -> dict[str, SwitchStrip]:
    """``second`` (Fig. 5.10): a switch of SAF that one repetition prevents, on clips unlike those learnt from.

    Args:
        clips: that were tracked.
        iterations: people by iteration of the alternation, at least 2.
    """
    rows = [_Row("SAF, iteration 1", iterations[0], single=True), _Row("MAF, iteration 2", iterations[1])]
    picture = _draw(clips, _prevented(clips, iterations[0], iterations[1]), rows)
    return {} if picture is None else {"second": picture}


def _frames_around(clips: Sequence[ObservedClip], switch: Switch) -> range:
    """The frames of a clip in a picture."""
    length = len(clips[switch[0]].detected)
    first = int(np.clip(switch[2] - SHOWN // 2, 0, max(length - SHOWN, 0)))
    return range(first, min(first + SHOWN, length))


def _prevented(clips: Sequence[ObservedClip], before: People, after: People) -> Switch | None:
    """The clearest of the switches in ``before`` that ``after`` does without.

    That is where most changes of id go away within the frames shown; of equals, where the person is followed in most of
    them, then the tallest one.
    """
    old, new = _Followers(clips, before), _Followers(clips, after)

    def gain(switch: Switch) -> int:
        where = *switch[:2], _frames_around(clips, switch)
        return _changes(old.ids(*where)) - _changes(new.ids(*where))

    def clarity(switch: Switch) -> tuple[float, ...]:
        followed = new.ids(*switch[:2], _frames_around(clips, switch)) > 0
        return gain(switch), followed.sum(), _height(clips, switch)

    # A switch that only comes a frame later is not prevented.
    return _best((switch for switch in old.switches() if gain(switch) > 0), clarity)


def _remaining(clips: Sequence[ObservedClip], people: People) -> Switch | None:
    """Where an id changes most often within the frames shown; of equals, the tallest person."""
    found = _Followers(clips, people)

    def frequency(switch: Switch) -> tuple[float, ...]:
        return _changes(found.ids(*switch[:2], _frames_around(clips, switch))), _height(clips, switch)

    return _best(found.switches(), frequency)


def _changes(ids: IntArray) -> int:
    """Of id in successive frames, those with none passed over."""
    return int((np.diff(ids[ids > 0]) != 0).sum())


def _best(found: Iterable[Switch], key: Callable[[Switch], tuple[float, ...]]) -> Switch | None:
    """The switch of the largest key; of equals the first."""
    return max(sorted(found), key=key, default=None)


def _height(clips: Sequence[ObservedClip], switch: Switch) -> float:
    """Of the person's label in the frame of the switch, pixels."""
    clip, person, frame = switch
    truth = clips[clip].truth
    box = truth.boxes[(truth.ids == person) & (truth.frames == frame)][0]
    return float(box[3] - box[1])


def _draw(clips: Sequence[ObservedClip], switch: Switch | None, rows: Sequence[_Row]) -> SwitchStrip | None:
    if switch is None:
        return None
    number, person, frame = switch
    clip, frames = clips[number], _frames_around(clips, switch)
    images = list_images(clip.folder / "img1")
    views = [Frame(at, 0.0, read_image(images[at])) for at in frames]
    squares, parts = _squares(clip, person, frames), list[ImageArray]()
    for row in rows:
        ids = _Followers(clips, row.people).ids(number, person, frames).tolist()
        cells = [
            _cell(view, square, row.people[number], follower, row.single, clip.labels.names)
            for view, square, follower in zip(views, squares, ids, strict=True)
        ]
        parts += [_band(row.name, len(cells)), np.concatenate(cells, axis=1)]
    whole = np.concatenate([*parts, _band(LEGEND, len(frames))], axis=0)
    shows: dict[str, str | int] = {"clip": clip.folder.name, "person": person, "frame": frame + 1}
    return SwitchStrip(shows, bytes(cv2.imencode(".jpg", whole[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]))


def _squares(clip: ObservedClip, person: int, frames: range) -> FloatArray:
    """``(T, 4)`` the part of each frame: one size, whole pixels, around the label that is nearest in time."""
    truth = clip.truth.select(clip.truth.ids == person)
    boxes = truth.boxes[[int(np.argmin(np.abs(truth.frames - frame))) for frame in frames]]
    half = np.rint(AROUND * (boxes[:, 2:] - boxes[:, :2]).max() / 2)
    middle = np.rint((boxes[:, :2] + boxes[:, 2:]) / 2)
    return np.concatenate([middle - half, middle + half], axis=1)


def _cell(
    view: Frame, square: FloatArray, people: Sequence[ActingTrack], follower: int, single: bool, names: Sequence[str]
) -> ImageArray:
    """``(CELL + LINE, CELL + LINE, 3)`` a square of the frame, enlarged before the tracks are drawn."""
    scale = CELL / (square[2] - square[0])
    tracks, captions = [], {}
    # The person last, on top of the others.
    for person in sorted(people, key=lambda p: p.track.id == follower):
        whole = person.track
        at = np.flatnonzero(whole.frames == view.index)
        boxes = (whole.boxes[at] - np.tile(square[:2], 2)) * scale
        # Only what reaches into the cell: labels of others would be moved into it.
        if len(at) and (boxes[0, :2] < CELL).all() and (boxes[0, 2:] > 0).all():
            tracks.append(Track(whole.id, whole.frames[at], boxes, whole.scores[at], whole.observed[at]))
            if whole.id == follower:
                shown = replace(person, multi=person.single) if single else person
                named = captions_of([shown], names, THRESHOLD).get(whole.id)
                actions = [] if named is None else named[int(at[0])].split(", ")[:MOST_NAMED]
                captions[follower] = [", ".join(actions)]
    image = crop_squares(view.image, square[None], CELL)[0]
    drawn = Overlay(tracks, 1.0, captions, trail_seconds=0.0).draw(Frame(view.index, view.time, image))
    return np.asarray(cv2.copyMakeBorder(drawn, 0, LINE, 0, LINE, cv2.BORDER_CONSTANT, value=WHITE))


def _band(text: str, cells: int) -> ImageArray:
    """A line of text as wide as so many cells."""
    band = np.full((BAND, cells * (CELL + LINE), 3), DARK, dtype=np.uint8)
    draw_label(band, text, (4, BAND - 2), DARK)
    return band


def plot_iterations(curves: Mapping[str, Sequence[Mapping[str, float]]]) -> Figure:
    """Fig. 5.8: recall and precision, and switches and MOTA, over the iterations of the alternation."""
    figure = Figure(figsize=(9, 4.2), dpi=90, layout="constrained")
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2)
    other = right.twinx()
    drawn = (("recall", "recall", left, "C0", "o"), ("precision", "precision", left, "C1", "s"),
             ("id_switches", "switches", right, "C3", "o"), ("mota", "MOTA", other, "C2", "s"))  # fmt: skip
    for (method, rows), style in zip(curves.items(), ("-", "--", ":"), strict=False):
        for score, name, axes, colour, marker in drawn:
            values = [row[score] for row in rows]
            axes.plot(range(1, len(rows) + 1), values, style, color=colour, marker=marker, label=f"{name}, {method}")
    left.set(xlabel="iteration", ylabel="percent", title="(a) recall and precision")
    right.set(xlabel="iteration", ylabel="ID switches", title="(b) switches and MOTA")
    other.set_ylabel("MOTA, percent")
    for axes, lines in ((left, left.get_lines()), (right, [*right.get_lines(), *other.get_lines()])):
        names = [str(line.get_label()) for line in lines]
        axes.legend(lines, names, fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    return figure


def plot_gains(gains: Mapping[str, float | None]) -> Figure:
    """Fig. 5.11: change of the average precision of every action from iteration 1 to iteration 10."""
    shown = {name: value for name, value in gains.items() if value is not None}
    figure = Figure(figsize=(7, 3.4), dpi=90, layout="constrained")
    axes = figure.add_subplot()
    axes.barh(list(shown), list(shown.values()), color=["C0" if value >= 0 else "C3" for value in shown.values()])
    axes.axvline(0, color="black", linewidth=0.8)
    axes.invert_yaxis()
    axes.set(xlabel="AP after iteration 10 minus AP after iteration 1, points")
    return figure
