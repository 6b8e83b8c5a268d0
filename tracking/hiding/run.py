"""People in a video hidden by their tracks and by a second, more sensitive detection: `tsuiseki hide`."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tsuiseki.tracking.bounds import Share
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.features.exported import DetectorLike
from tsuiseki.tracking.fields import Threads, refused
from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.hiding.places import WEAK, Places, Style, paint, places_of, unsupported, without_visible
from tsuiseki.tracking.output import RUN_FILE, check_output_file, is_partial, output_file
from tsuiseki.tracking.people.detections import PeopleInputs, people_detect, threads_of_a_call
from tsuiseki.tracking.people.settings import PeopleFinding
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.privacy import metadata_of
from tsuiseki.tracking.report.overlay import write_drawn
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.tracking.runs.progress import progress as watched
from tsuiseki.tracking.types import BoolArray, Detections, Frame, Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.source import Source, file_of, open_source
from tsuiseki.tracking.video.webm import check_ending
from tsuiseki.tracking.weights import PEOPLE_DETECTOR

TracksLike: TypeAlias = str | Path | Result[Any] | Sequence[Track]
# Least score of the second detection.
SENSITIVE = 0.05
# Where a track of the second detection never scores so much, its place may be empty: where it is held is no doubt.
SURE = 0.3
# Each detection of the second begins a track.
LINKS = SortSettings(min_hits=1, start_score=0.0, boxes="detected")
# Why a place is held, by `Places.held`.
REASONS = {-1: "before the track", 1: "after the track", 2: "in a gap of the track"}
# Ending of the list of doubtful places beside a video.
DOUBTS = ".doubtful.csv"


@dataclass(frozen=True)
class HideChoice:
    """Whom to hide, and what of them.

    Attributes:
        heads: heads alone.
        visible: ids of tracks that stay as they are.
    """

    heads: bool = False
    visible: frozenset[int] = frozenset()

    @classmethod
    def parse(cls, text: str) -> HideChoice:
        """What ``people``, ``heads`` or ``all-but=3,5`` asks for.

        Raises:
            RequestError: it is none of these.

        >>> sorted(HideChoice.parse("all-but=3,5").visible)
        [3, 5]
        """
        word, _, ids = text.strip().replace("=", " ", 1).partition(" ")
        numbers = [part.strip() for part in ids.split(",")]
        if word == "all-but" and all(number.isdecimal() for number in numbers):
            return cls(visible=frozenset(map(int, numbers)))
        if text not in ("people", "heads"):
            raise RequestError(f"`hide`: expected people, heads or all-but with ids, such as all-but=3,5, got {text!r}")
        return cls(heads=text == "heads")

    def check(self, tracks: Iterable[Track]) -> None:
        """Refuse an id that no track has."""
        ids = {track.id for track in tracks}
        if unknown := sorted(self.visible - ids):
            there = ", ".join(map(str, sorted(ids)[:10])) + (", …" if len(ids) > 10 else "")
            raise RequestError(f"`hide`: expected ids of the result ({there or 'it has none'}), got {unknown[0]}")


@dataclass(frozen=True)
class Hiding:
    """What is hidden in a video.

    Attributes:
        places: to hide.
        doubtful: ``(N,)`` of them those that no detection of their frame supports.
        heads: heads alone are hidden.
        style: how.
        first: 0-based number of the first frame that was tracked.
        seconds: time of each frame, from that one on.
    """

    places: Places
    doubtful: BoolArray
    heads: bool
    style: Style
    first: int
    seconds: Sequence[float]

    @property
    def doubtful_frames(self) -> int:
        """Frames in which a place is doubtful."""
        return len(np.unique(self.places.frames[self.doubtful]))

    def hidden(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """The frames with everybody hidden."""
        for frame in frames:
            boxes = self.places.boxes[self.places.at(frame.index)]
            yield replace(frame, image=paint(frame.image, boxes, self.style, self.heads))

    def write_doubts(self, path: Path) -> None:
        """Write the doubtful places as CSV, frames counted from 1; the id is empty without a track."""
        doubts = self.places.select(self.doubtful)
        columns = zip(doubts.frames.tolist(), doubts.ids.tolist(), doubts.held.tolist(), doubts.boxes, strict=True)
        with path.open("w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file, lineterminator="\n")
            rows.writerow(["frame", "time", "id", "why", "x1", "y1", "x2", "y2"])
            for frame, identity, held, box in columns:
                time = f"{self.seconds[frame - self.first]:.3f}"
                rows.writerow([frame + 1, time, identity or "", REASONS[held], *(f"{value:.1f}" for value in box)])

    def summary(self, where: Path) -> str:
        """The doubtful frames in a line."""
        number, of = self.doubtful_frames, len(self.seconds)
        if not len(self.places.frames):
            return "nothing is hidden: the result has no person to hide, and the second detection has none"
        return f"{number} of {of} frames are doubtful: a place is held there without a detection ({where})"


def find_missed(
    source: Source,
    frames: Iterable[Frame],
    tracks: Sequence[Track],
    choice: HideChoice,
    finding: PeopleFinding,
    style: Style = "pixelated",
) -> Hiding:
    """What to hide in the frames of a video: people of the tracks, and those that a second detector has beside them.

    Raises:
        RequestError: a track lies outside of the pictures, or an id is not known.
        RunError: the video breaks off.
    """
    choice.check(tracks)
    threads = threads_of_a_call(source, finding.threads)
    detect = people_detect(source, finding, PEOPLE_DETECTOR, threads)
    inputs = PeopleInputs(source, detect, batch_size=finding.batch_size, threads=finding.threads)
    visible = [track for track in tracks if track.id in choice.visible]
    first, size, detections, seconds, links = 0, (0, 0), list[Detections](), list[float](), Sort(LINKS)
    for frame, detected in inputs.with_frames(frames):
        if not detections:
            first, size = frame.index, (frame.image.shape[1], frame.image.shape[0])
            compare_with_picture("the result", np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)]), size)
        detections.append(without_visible(detected, visible, frame.index))
        seconds.append(frame.time)
        links.update(detections[-1])
    last = first + len(detections) - 1
    missed = [replace(track, frames=track.frames + first) for track in links.tracks()]
    hidden = [track for track in tracks if track.id not in choice.visible]
    parts = [places_of(track, source.frame_rate, size, last, choice.heads) for track in hidden]
    for track in missed:
        part = places_of(track, source.frame_rate, size, last, choice.heads)
        held = part.held if track.scores.max() >= SURE else np.where(part.held, WEAK, 0)
        parts.append(replace(part, ids=0 * part.ids, held=held))
    places = Places.joined(parts)
    places = places.select((places.frames >= first) & (places.frames <= last))
    return Hiding(places, unsupported(places, detections, first), choice.heads, style, first, seconds)


def hide(
    video: str | Path,
    result: TracksLike,
    out: str | Path,
    *,
    hide: str = "people",
    style: Style = "pixelated",
    detector: DetectorLike | None = None,
    score_threshold: float = SENSITIVE,
    threads: int = 0,
    device: Device = "auto",
    overwrite: bool = False,
    progress: bool = False,
) -> Hiding:
    """Write a video in which people are hidden, without sound, and beside it ``NAME.doubtful.csv``.

    Args:
        video: that was tracked.
        result: of it: a folder, a file ``tracks.txt``, what `track_people` returned, or tracks.
        out: the file to write, ``.webm`` or ``.mp4``.
        hide: ``people``, ``heads``, or ``all-but=3,5``: everybody but the tracks of these ids.
        style: ``pixelated`` or ``filled``.
        detector: the second one, as of `track_people`.
        score_threshold: the second detector keeps boxes of at least this score.
        threads: CPU threads of the detector; 0 takes all.
        device: of the detector.
        overwrite: replace earlier files.
        progress: show on the terminal how far it is.

    Returns:
        What was hidden where, and which of these places are doubtful.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    choice = HideChoice.parse(hide)
    options: Any = {"detector": detector, "score_threshold": score_threshold, "threads": threads, "device": device}
    with refused():
        finding = PeopleFinding(**options)
    video, out = a_path(video, "video"), a_path(out, "out")
    doubts = _checked_out(out, video, overwrite)
    source, tracks, facts = _opened(video, result)
    choice.check(tracks)
    watch = watched if progress else lambda items, *_: items
    with output_file(out, overwrite) as work, output_file(doubts, overwrite) as listed:
        hiding = find_missed(
            source, watch(source.frames(), "detecting", source.likely_length), tracks, choice, finding, style
        )
        last = hiding.first + len(hiding.seconds) - 1
        if late := [track.id for track in tracks if track.frames[-1] > last]:
            raise RequestError(
                f"expected the video of the result, but track {late[0]} goes on after the last frame of {video}, "
                f"{last + 1}"
            )
        frames = hiding.hidden(watch(source.frames(), "hiding", len(hiding.seconds)))
        write_drawn(work, frames, source.frame_rate, lambda frame: frame.image, metadata_of(facts))
        hiding.write_doubts(listed)
    return hiding


def _checked_out(out: Path, video: Path, overwrite: bool) -> Path:
    """The list of doubtful places beside the video ``out``; both can be written."""
    check_ending(out, "out")
    if out.exists() and (file := file_of(video)) is not None and out.samefile(file):
        raise RequestError(f"`out`: expected another file than the video, got {out}")
    doubts = out.with_suffix(DOUBTS)
    check_output_file(doubts, overwrite)
    return doubts


def _opened(video: Path, result: TracksLike) -> tuple[Source, Sequence[Track], Mapping[str, Any]]:
    """The frames of the video that were tracked, the tracks, and the facts of the result.

    Raises:
        RequestError: the result is none of people's, or is that of another video.
    """
    tracks, frame_range, loaded, complete = _read(result)
    if boxless := [track for track in tracks if not isinstance(track, Track)]:
        raise RequestError(f"expected a result with a box for each person, got {type(boxless[0]).__name__}")
    source = open_source(video)
    if source.live or not source.has_images:
        raise RequestError(f"expected a video that can be played again, got {source.name}")
    loaded.check_source(source)
    length, slack = source.likely_length, getattr(source, "slack", 0)
    last = max([frame_range.last or 0, *(int(track.frames[-1]) for track in tracks)])
    if length and (last >= length + slack or (complete and last + 1 < length - slack)):
        raise RequestError(f"expected the video of the result, which has {last + 1} frames, got {length} in {video}")
    return open_source(video, frame_range), tracks, loaded.facts


def _read(result: TracksLike) -> tuple[Sequence[Any], FrameRange, Result[Any], bool]:
    """The tracks, the frames that were tracked, the result, and whether it is known to be the whole."""
    loaded: Result[Any] = (
        result if isinstance(result, Result) else Result([] if isinstance(result, str | Path) else result)
    )
    partial = False
    if isinstance(result, str | Path):
        path = Path(result)
        folder = path.parent if path.is_file() and (path.parent / RUN_FILE).is_file() else path
        loaded, partial = Result.load(folder), is_partial(folder)
    numbers = loaded.frames.get("frame", ())
    frame_range = FrameRange(int(numbers[0]), int(numbers[-1])) if len(numbers) else FrameRange()
    complete = not partial and loaded.settings.get("frames", "") is None
    return [getattr(track, "track", track) for track in loaded], frame_range, loaded, complete


# The command has an option of this name.
hide_in = hide


def hide_people(
    result: Path,
    video: Path,
    *,
    output: OutputFile,
    hide: str = "people",
    style: Style = "pixelated",
    detector: Path | None = None,
    score_threshold: Share = SENSITIVE,
    threads: Threads = 0,
    device: Device = "auto",
) -> int:
    """Hide people in a video: those of a result, and those of a second, more sensitive detection.

    The file has no sound and nothing of the original's metadata; of the result it has the record of privacy. Beside it
    NAME.doubtful.csv lists where a place is hidden without a detection.

    Args:
        result: of track people: its folder, or a file tracks.txt.
        video: that was tracked.
        hide: people, heads, or all-but with the ids of tracks that stay as they are, such as all-but=3,5.
        style: how they are hidden.
        detector: the second one; by default the shipped one. See track people.
        score_threshold: the second detector keeps boxes of at least this score, from 0 to 1.
        threads: CPU cores of the detector; 0 takes all.
        device: of the detector: cpu, cuda, or auto.
    """
    options: Any = {"detector": detector, "score_threshold": score_threshold, "threads": threads, "device": device}
    options |= {"hide": hide, "style": style, "overwrite": output.overwrite, "progress": True}
    hiding = hide_in(video, result, output.out, **options)
    print(f"{len(hiding.seconds)} frames: {output.out}")
    print(hiding.summary(output.out.with_suffix(DOUBTS)))
    return 0
