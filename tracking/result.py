"""What a run gives: the tracks, and what is known of how they came to be; the command writes it, the user takes it."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self, overload

import numpy as np
from typing_extensions import TypeVar

from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.formats.body_points import point_files
from tsuiseki.tracking.formats.body_states import write_states
from tsuiseki.tracking.formats.correction_log import CORRECTIONS_FILE, CorrectedVideo, append, read_corrections
from tsuiseki.tracking.formats.exports import SUFFIXES, format_at, format_named, read_exported
from tsuiseki.tracking.formats.mot import read_tracks, write_tracks
from tsuiseki.tracking.formats.result_folder import SOLVED_FILE, SOLVED_STATES, STATES_FILE, filled_frames, read_folder
from tsuiseki.tracking.formats.track_tables import (
    cut_to,
    names_in,
    needed,
    read_table,
    table_of,
    tracks_of,
    write_table,
)
from tsuiseki.tracking.formats.tracked_video import TrackedVideo
from tsuiseki.tracking.interchange import as_detections
from tsuiseki.tracking.openers.text import refusing
from tsuiseki.tracking.output import RunRecord, columns_shifted, output_file, output_folder
from tsuiseki.tracking.types import Frame, ImageArray, Position, Targets, Track
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames
from tsuiseki.tracking.types.recording import Recording
from tsuiseki.tracking.types.tracks import (
    ActingTrack,
    BodyTrack,
    FloorTrack,
    PointTable,
    boxes_about,
    frames_up_to,
    positive_ids,
    targets_at,
)
from tsuiseki.tracking.video.frame_source import uneven
from tsuiseki.tracking.video.recording import check_recording, recording_of
from tsuiseki.tracking.video.source import Source, SourceLike, absolute, file_of, open_source

if TYPE_CHECKING:
    import pandas
    import supervision

    from tsuiseki.tracking.evaluation.quality import Quality

T_co = TypeVar("T_co", covariant=True, default=Any)
Writer = Callable[[Path, Path], object]
"""Writes one file: its path, and the folder in which the files before it lie."""
# Endings of files that hold the tracks.
FILES = (".csv", ".json", ".parquet", ".txt")
# Endings of videos that are written.
VIDEOS = (".mp4", ".webm")
# Frames a second where nothing says how many there were.
USUAL_RATE = 25.0
# Rows of the table that a notebook shows.
MOST_ROWS = 20


class MotionContent(Protocol):
    """What a page says of how tracks move."""

    def columns(self) -> Mapping[str, Mapping[int, float | None]]:
        """Of the table of all that was followed beside its times, by name with unit and by id."""

    def table(self) -> Mapping[str, Sequence[Any]]:
        """The columns of ``report/motion.csv``."""

    def sections(self) -> Sequence[str]:
        """HTML of further sections."""


@dataclass(frozen=True)
class PageContent:
    """What ``report.html`` of a result says that its tracks do not.

    Attributes:
        nouns: one who is followed, and several.
        anchor: point of a box that stands for what is in it; None as for people.
        scale: metres a pixel; None where it is not known.
        hide: hides in frames who must not be recognised.
        sections: gives the HTML of further sections.
        motion: of tracks how they move, and the page shows the part of the picture in which they do; None as people.
        quality: it says how good the tracks probably are, see `Result.quality`.
    """

    nouns: tuple[str, str] = ("person", "people")
    anchor: Literal["centre"] | None = None
    scale: float | None = None
    hide: Callable[[Iterable[Frame]], Iterable[Frame]] | None = None
    sections: Callable[[], Sequence[str]] = tuple
    motion: Callable[[Sequence[Any]], MotionContent] | None = None
    quality: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Result(Collection[T_co]):
    """The tracks of a run, in their order.

    Frames count from 0 here and in all that is asked of it; in files they count from 1.

    >>> import numpy as np
    >>> from tsuiseki.tracking.types import Track
    >>> one = Track(7, np.array([0]), np.array([[1.0, 1.0, 5.0, 9.0]]), np.array([0.9]), np.array([True]))
    >>> result = Result([one], source="street.mp4", frame_rate=25.0)
    >>> len(result), result.by_id[7] is one, result.at(0).ids
    (1, True, array([7]))

    Attributes:
        tracks: one for each person or object; of a ball in space, its position at each moment.
        source: what was tracked in, as `open_source` takes it; of several videos the first; empty where there is none.
        frame_rate: frames a second of the source; 0 where there are none.
        size: width and height of a frame in pixels; None where not known.
        settings: of the run, by name, as for ``run.json``.
        facts: what the run measured of its input or chose by itself, by name.
        seconds: that each stage of the run took.
        frames: what happened in each frame: columns by name, all as long as ``frame``, the numbers of the frames.
        files: what `save` writes into a folder, by name and in this order; by default the tracks.
        painter: gives the image of a frame with the tracks drawn in; by default boxes are.
        names: of what a track has beside its place: the numbers of a body's state, or what people do.
        points: of all animals, where a skeleton is known.
        page: what the page of these tracks says beside them; None where they have a page of their own, or none.
        network: gives what the tracks were chosen from, for corrections; None where nothing else was weighed.
        recording: what the source says of itself, by which it is known again.
    """

    tracks: Sequence[T_co]
    source: str = ""
    frame_rate: float = 0.0
    size: tuple[int, int] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    files: Mapping[str, Writer] = field(default_factory=dict)
    painter: Callable[[Frame], ImageArray] | None = None
    names: tuple[str, ...] = ()
    points: PointTable | None = None
    page: PageContent | None = None
    network: Callable[[], SolvedNetwork] | None = None
    recording: Recording = field(default_factory=Recording)

    @classmethod
    def of(cls, source: Source, tracks: Sequence[Any], **attributes: Any) -> Self:
        """The tracks in a video, with what it says of itself; ``attributes`` are the others."""
        frames = attributes.get("frames", {})
        if "frame" in frames and "time" not in frames and not source.live and uneven(list(source.times.values())):
            at = source.times_of(frames["frame"]).round(4).tolist()
            attributes["frames"] = {**frames, "time": at}
        attributes = {"frame_rate": source.frame_rate, "size": source.size, **attributes}
        return cls(tracks, source.address, recording=recording_of(source), **attributes)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """What `save` or a command wrote: a folder, or a file ``.csv``, ``.json``, ``.parquet`` or ``.txt``.

        A folder, JSON and Parquet also tell the source, its rate and size, the settings and the facts. Tracks of CVAT,
        COCO, Label Studio and YOLO are read, too.

        Raises:
            RequestError: there is nothing of this, or something else; Parquet needs pyarrow.
        """
        with refusing(f"{path}: expected a result, got one that is broken: ", str):
            return cls._load(a_path(path))

    @classmethod
    def _load(cls, path: Path) -> Self:
        attributes = dict[str, Any]()
        tracks: list[Any]
        if format_at(path):
            read = read_exported(path).in_pixels(path)
            tracks, attributes = [*read.tracks], {"frame_rate": read.frame_rate, "size": read.size}
            attributes["frames"] = {"frame": list(range(read.length))} if read.length else {}
        elif path.is_dir():
            tracks, attributes = read_folder(path)
            if (path / NETWORK_FILE).is_file():
                attributes["network"] = partial(SolvedNetwork.read, path / NETWORK_FILE)
        elif path.suffix.lower() == ".txt":
            tracks = list(read_tracks(path))
        elif path.suffix.lower() in FILES:
            table, attributes = read_table(path)
            tracks, attributes["frames"] = tracks_of(table), columns_shifted(attributes.get("frames", {}), -1)
            attributes.setdefault("names", names_in(table))
        else:
            got = f"got {path}" if path.exists() else f"found no {path}"
            raise RequestError(f"expected the folder of a result, or a file {', '.join(FILES)}, {got}")
        recording = Recording.parse(attributes, path)
        attributes |= {"recording": recording, "frame_rate": recording.frame_rate, "size": recording.size}
        attributes["names"] = tuple(attributes.get("names", ()))
        names = {attribute.name for attribute in fields(cls)}
        return cls(tracks, **{name: value for name, value in attributes.items() if name in names})

    @classmethod
    def from_supervision(cls, detections: Iterable[supervision.Detections], **attributes: Any) -> Result[Track]:
        """Tracks out of what supervision holds of each frame in order; ``attributes`` are others, as ``frame_rate``.

        Raises:
            RequestError: a detection has no ``tracker_id``.
        """
        parts, numbers, names = [], [], dict[int, str]()
        for frame, tracked in enumerate(detections):
            numbers.append(frame)
            if len(tracked) and tracked.tracker_id is None:
                raise RequestError(f"expected detections with tracker_id, got none in frame {frame}; track them first")
            if len(tracked):
                scores = np.ones(len(tracked)) if tracked.confidence is None else tracked.confidence
                usable = as_detections(tracked)
                if len(usable) < len(tracked):
                    raise RequestError(f"expected boxes that have an area, got others in frame {frame}")
                names |= usable.names
                columns = np.full(len(tracked), frame), tracked.tracker_id, tracked.xyxy, scores, usable.origin[:, 1]
                parts.append(np.column_stack(columns))
        rows = np.concatenate(parts) if parts else np.empty((0, 8))
        ids = positive_ids(rows[:, 1].astype(np.int64))
        table = dict(zip(("x1", "y1", "x2", "y2", "score", "detection_class"), rows[:, 2:].T, strict=True))
        table |= {"frame": rows[:, 0].astype(np.int64), "id": ids}
        tracks = [replace(track, names=names) for track in tracks_of(table)]
        return Result(tracks, **{"frames": {"frame": numbers}, **attributes})

    def __len__(self) -> int:
        return len(self.tracks)

    def __iter__(self) -> Iterator[T_co]:
        return iter(self.tracks)

    def __contains__(self, track: object) -> bool:
        return track in self.tracks

    @overload
    def __getitem__(self, index: int) -> T_co: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T_co]: ...
    def __getitem__(self, index: int | slice) -> T_co | Sequence[T_co]:
        return self.tracks[index]

    def __repr__(self) -> str:
        where = f" in {self.name}" if self.source else ""
        return f"<Result: {len(self)} {'track' if len(self) == 1 else 'tracks'}{where}>"

    def _repr_html_(self) -> str:
        """A table for notebooks: the tracks, from which frame to which."""
        from tsuiseki.tracking.report.rendering import render

        table = self._table()
        ids = table.get("id", np.ones(len(table["score"]), np.int64) if "score" in table else np.empty(0, np.int64))
        frames = table.get("frame", np.arange(len(ids)))
        numbers = np.unique(ids).tolist()
        moments = [(number, frames[ids == number]) for number in numbers[:MOST_ROWS]]
        rows = [(number, where.min(), where.max(), len(where)) for number, where in moments]
        return render("result.html.j2", text=repr(self)[1:-1], rows=rows, more=len(numbers) - MOST_ROWS)

    @property
    def name(self) -> str:
        """Of the source, for people."""
        short = Path(self.source.split("?")[0]).name or self.source or "images"
        return f"webcam {short}" if short.isdecimal() else short

    @cached_property
    def by_id(self) -> Mapping[int, T_co]:
        """The tracks by their ids."""
        tracks: Sequence[Any] = self.tracks
        return {track.id: track for track in tracks}

    def check_source(self, source: Source, last: int = -1) -> None:
        """Refuse what is not the video of these tracks, and say where it may be another; see `check_recording`."""
        check_recording(source, replace(self.recording, frame_rate=self.frame_rate, size=self.size), last)

    def opened_source(self) -> Source | None:
        """The source, where it is a file or folder that is still there and of the size that was tracked.

        It is said where it has changed since.
        """
        if file_of(self.source) is None:
            return None
        source = open_source(self.source)
        self.check_source(source)
        return source

    @property
    def _boxed(self) -> list[Track] | None:
        """Each track as a `Track`; None where targets have no boxes."""
        tracks: Sequence[Any] = self.tracks
        boxes = [getattr(track, "track", track) for track in tracks]
        return boxes if all(isinstance(track, Track) for track in boxes) else None

    def _table(self) -> dict[str, Any]:
        """The table of the tracks, with ``time`` where it is known."""
        table = table_of(self.tracks, self.names)
        if "frame" not in table or "time" in table or not self.frame_rate > 0:
            return table
        numbers, times = self.frames.get("frame", ()), self.frames.get("time")
        even = table["frame"] / self.frame_rate
        return table | {"time": even if times is None else np.interp(table["frame"], numbers, times)}

    @overload
    def at(self: Result[Track | ActingTrack | FloorTrack], frame: int) -> Targets: ...  # type: ignore[overload-overlap]
    @overload
    def at(self, frame: int) -> list[T_co]: ...
    def at(self, frame: int) -> Targets | list[T_co]:
        """What is in a frame: the `Targets` there, of bodies and sensed targets their tracks, cut to this frame.

        Args:
            frame: counted from 0; of a ball in space, the number of the moment.
        """
        boxes = self._boxed
        if boxes is not None:
            return targets_at(boxes, frame)
        if isinstance(self.tracks[0], Position):
            return list(self.tracks[frame : frame + 1])
        return [part for track in self.tracks if (part := cut_to(track, frame)) is not None]

    def to_dataframe(self) -> pandas.DataFrame:
        """A row for each track in each frame, by frame and id; the columns are those of `formats.track_tables`.

        Where it is known, ``time`` are seconds of the source.

        Raises:
            RequestError: pandas is not installed.
        """
        frame: pandas.DataFrame = needed("pandas", "a data frame").DataFrame(self._table())
        return frame

    def to_supervision(self) -> list[supervision.Detections]:
        """Each frame from 0 to the last as supervision holds it, with ``tracker_id``; boxes filled in are there, too.

        Raises:
            RequestError: supervision is not installed, or the tracks have no boxes.
        """
        boxes = self._boxed
        if boxes is None:
            raise RequestError("expected tracks of boxes for supervision, got others")
        make = needed("supervision", "`to_supervision`").Detections
        table = table_of(boxes)
        last = max([*self.frames.get("frame", ()), *table["frame"][-1:].tolist()], default=-1)
        edges = np.searchsorted(table["frame"], np.arange(last + 2))
        corners = np.column_stack([table[name] for name in ("x1", "y1", "x2", "y2")])
        classes = {"class_id": table["class_id"]} if "class_id" in table else {}
        names = {"class_name": table["class_name"]} if "class_name" in table else {}
        return [
            make(
                xyxy=corners[a:b],
                confidence=table["score"][a:b],
                tracker_id=table["id"][a:b],
                data={name: column[a:b] for name, column in names.items()},
                **{name: column[a:b] for name, column in classes.items()},
            )
            for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        ]

    @cached_property
    def _paint(self) -> Callable[[Frame], ImageArray]:
        if self.painter is not None:
            return self.painter
        boxes, tracks = self._boxed, list[Any](self.tracks)
        if boxes is None and self.names[:3] == ("a", "b", "theta") and isinstance(tracks[0], BodyTrack):
            from tsuiseki.tracking.report.overlay import draw_marks

            return lambda frame: draw_marks(frame, tracks, self.names, self.points)
        if boxes is None:
            raise RequestError("only the run that made these tracks can draw them; a file keeps no places in pictures")
        from tsuiseki.tracking.report.overlay import Overlay

        length = frames_up_to(self.frames.get("frame", ()), boxes)
        return Overlay.of_people(boxes, self.frame_rate, self.size, length)

    @overload
    def draw(self, image: int) -> ImageArray: ...
    @overload
    def draw(self, image: ImageArray, frame: int) -> ImageArray: ...
    def draw(self, image: ImageArray | int, frame: int | None = None) -> ImageArray:
        """A copy of an image with the tracks drawn in.

        Args:
            image: ``(H, W, 3)`` uint8 RGB; or the number of a frame alone, whose image the source has.
            frame: number of the image, counted from 0.

        Raises:
            RequestError: the image has another size than the source, there is nothing that can be drawn, or the source
                cannot be played again or has no such frame.
        """
        if frame is None:
            frame = operator.index(image)
            image = self._image(frame)
        image = np.asarray(image)
        if self.size is not None and image.shape[1::-1] != self.size:
            width, height = self.size
            raise RequestError(f"expected an image of {width}x{height} pixels, got shape {image.shape}")
        return self._paint(Frame(frame, frame / (self.frame_rate or 1.0), image))

    def _image(self, frame: int) -> ImageArray:
        """A frame of the source, by its number from 0."""
        if not self.source:
            raise RequestError("expected an image and the number of its frame, for the tracks come from no video")
        opened = open_source(self.source, FrameRange(frame, frame))
        self.check_source(opened)
        if opened.endless or not opened.has_images:
            raise RequestError(f"{opened.name} has no pictures that can be played again; give the image")
        for read in opened.frames():
            return read.image
        raise RequestError(f"expected a frame of {opened.name}, got {frame}")

    def overlay(self, path: str | Path, source: SourceLike | None = None, overwrite: bool = False) -> Path:
        """Write the video with the tracks drawn in; returns its path.

        Args:
            path: ends in ``.mp4`` (H.264 where PyAV writes it, or else VP9) or ``.webm``.
            source: the video; by default the one that was tracked in.
            overwrite: replace an earlier file.

        Raises:
            RequestError: the ending is another, the file exists, or the video cannot be played again.
            RunError: the video breaks off, or cannot be written.
        """
        from tsuiseki.tracking.report.overlay import write_drawn

        path = a_path(path)
        if path.suffix.lower() not in VIDEOS:
            raise RequestError(f"expected the name of a video {' or '.join(VIDEOS)}, got {path}")
        if source is None and not self.source:
            raise RequestError("expected a `source` to draw on, for the tracks come from none")
        numbers, text = self.frames.get("frame"), self.settings.get("frames")
        tracked = (
            FrameRange(numbers[0], numbers[-1]) if numbers else parse_frames(text if isinstance(text, str) else None)
        )
        opened = open_source(self.source if source is None else source, tracked)
        self.check_source(opened)
        if opened.endless or not opened.has_images:
            raise RequestError(f"{opened.name} has no pictures that can be played again; give a `source` that has")
        frames = opened.frames()
        with output_file(path, overwrite) as work:
            rate = self.frame_rate or opened.frame_rate
            write_drawn(work, frames, rate, lambda frame: self.draw(frame.image, frame.index))
        return path

    def corrected(self, corrections: str | Path) -> Self:
        """The tracks under what somebody said in `tsuiseki review`, as far as it applies to them.

        Corrections find their detections by their boxes, so that they may be of other settings or another detector.

        Args:
            corrections: ``corrections.jsonl`` of a reviewed result of this video.

        Returns:
            People or animals, whose ``facts`` have the number of corrections and the names of tracks.

        Raises:
            RequestError: the corrections cannot be read, or speak of another video; these tracks are corrected
                already, or are neither people nor animals.
        """
        from tsuiseki.tracking.association.corrected_tracks import corrected_bodies, renamed_points, replayed

        solved = boxes_about(self.tracks, self.names)
        bodies = [track for track in self.tracks if isinstance(track, BodyTrack)]
        if len(solved) not in (len(bodies), sum(isinstance(track, Track) for track in self.tracks)):
            raise RequestError("expected tracks of people or animals to correct, got others; use tsuiseki review")
        if self.facts.get("corrections"):
            raise RequestError("expected tracks as the tracker left them, got corrected ones; use tsuiseki review")
        length = frames_up_to(self.frames.get("frame", ()), solved)
        about = CorrectedVideo(self.name if self.source else "", self.size, length)
        network = network_of_tracks(solved, self.frame_rate or USUAL_RATE) if self.network is None else self.network()
        again = replayed(solved, network, a_path(corrections, "corrections"), about)
        again.warn()
        boxes, tracks, points = list(again.tracks), list[Any](again.tracks), self.points
        files = {} if self.network is None else {NETWORK_FILE: _writer(network.write)}
        files |= {
            SOLVED_FILE: _writer(write_tracks, solved),
            CORRECTIONS_FILE: _writer(append, again.done, about),
        }
        if bodies:
            tracks = corrected_bodies(boxes, bodies, self.names)
            files[STATES_FILE] = _writer(write_states, tracks, self.names)
            files[SOLVED_STATES] = _writer(write_states, bodies, self.names)
            if points is not None:
                points = renamed_points(points, bodies, boxes)
                files |= point_files(points, length)
        else:
            files["tracks.txt"] = _writer(write_tracks, boxes)
        columns = people_in(self.frames["frame"], boxes) if "people" in self.frames else {}
        facts = {**self.facts, "corrections": len(again.done), "track_names": again.names}
        changed = replace(
            self,
            tracks=tracks,
            points=points,
            painter=None,
            facts=facts,
            files={**self.files, **files},
            frames={**self.frames, **columns},
        )
        return replace(changed, painter=changed._paint)

    def quality(self) -> Quality:
        """How good the tracks of people probably are, estimated without labels, with intervals of 90 %.

        Most is known of tracks of ``flow`` that nobody corrected; what is not seen stands in ``unseen``.

        Raises:
            RequestError: the targets have no boxes, or so few that they say nothing.
        """
        from tsuiseki.tracking.evaluation.quality import people_quality

        boxes, numbers = self._boxed, self.frames.get("frame", ())
        if boxes is None:
            raise RequestError("expected tracks of people with boxes to estimate their quality, got others")
        # The network does not know of corrections.
        network = None if self.network is None or self.facts.get("corrections") else self.network()
        frames = (numbers[0], numbers[-1]) if len(numbers) else None
        quality = people_quality(boxes, network, self.frame_rate or USUAL_RATE, self.size, frames)
        notes = [] if self.frame_rate else [f"the frame rate: {USUAL_RATE:g} a second were taken"]
        notes += ["other classes than people, on whom estimates are fitted"] if self.settings.get("classes") else []
        return replace(quality, unseen=(*quality.unseen, *notes))

    def video_record(self) -> dict[str, Any]:
        """What ``run.json`` keeps of the video beside the tracks, see `formats.result_folder`."""
        filled = filled_frames(self.tracks)
        about = {"source": absolute(self.source), **vars(self.recording)}
        about |= {"frame_rate": self.frame_rate, "size": self.size}
        return about | ({"filled": filled} if filled else {})

    def save(
        self, path: str | Path, overwrite: bool = False, to: str | None = None, video: str | Path | None = None
    ) -> Path:
        """Write the tracks into a file, or the files that the command writes and ``run.json`` into a folder.

        Args:
            path: a file of a format by its suffix, such as ``.csv``, ``.parquet``, ``.txt`` (MOTChallenge) or ``.xml``
                (CVAT); any other name is that of a folder, which is made where it does not exist.
            overwrite: replace an earlier result.
            to: name of the format, see `formats.exports`; it is needed where several have the suffix, or a folder.
            video: the source, where a format needs the size of the frames and the result does not know it.

        Returns:
            The path.

        Raises:
            RequestError: the file exists, or the folder holds files, and ``overwrite`` is False; it cannot be written
                to; there is no such format, or it cannot hold these tracks; or it needs a package.
        """
        path, video = a_path(path), None if video is None else a_path(video, "video")
        ending = path.suffix.lower()
        if to is None and (path.is_dir() or not ending[1:].isalnum() or ending[1:].isdecimal()):
            return self._save_folder(path, overwrite)
        if to is None and ending not in SUFFIXES:
            raise RequestError(f"expected the name of a folder, or of a file {', '.join(SUFFIXES)}, got {path}")
        name = SUFFIXES[ending] if to is None else to
        form = format_named(name)
        what = self._tracked_video(video, form.sized)
        form.check(name, path, what)
        with (output_file if form.suffix else output_folder)(path, overwrite) as work:
            form.write(work, what)
        return path

    def _tracked_video(self, video: str | Path | None, sized: bool) -> TrackedVideo:
        """The tracks for a file, of which some need the size of the frames."""
        source = str(video or self.source)
        opened = open_source(source) if video or (sized and file_of(source) is not None) else None
        if opened is not None:
            self.check_source(opened)
        size = self.size or (opened.size if opened else None)
        if sized and size is None:
            raise RequestError("expected the size of the frames, which this result does not tell; give its `video`")
        boxes, about = self._boxed or [], ("settings", "facts", "seconds", "names")
        record = self.video_record() | {name: getattr(self, name) for name in about}
        return TrackedVideo(
            boxes,
            Path(source).name or "video",
            self.frame_rate or (opened.frame_rate if opened else 0.0),
            size,
            (opened.length if opened else None) or max(self.frames.get("frame", ()), default=-1) + 1,
            images=tuple(path.name for path in getattr(opened, "images", ())),
            points=self.points,
            table=self._table(),
            about=record | {"frames": columns_shifted(self.frames, 1)},
        )

    def _save_folder(self, folder: Path, overwrite: bool) -> Path:
        files = self.files or {"tracks.csv": lambda path, _: write_table(path, self._table(), {})}
        with output_folder(folder, overwrite) as work:
            for name, write in files.items():
                (work / name).parent.mkdir(parents=True, exist_ok=True)
                write(work / name, work)
            seed = int(self.settings.get("seed", 0))
            record = RunRecord(["tsuiseki"], self.settings, seed, self.seconds, self.frames, facts=self.facts)
            replace(record, results={".": self.video_record()}).write(work)
        return folder


def _writer(write: Callable[..., object], *values: object) -> Writer:
    return lambda path, _: write(path, *values)


def people_in(frames: Sequence[int], tracks: Sequence[Track]) -> dict[str, list[Any]]:
    """Columns by frame number: how many people are tracked there, and their mean score, None without any."""
    numbers = np.asarray(frames, dtype=np.int64)
    rows = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
    scores = np.concatenate([np.empty(0), *(track.scores for track in tracks)])
    size = int(max(numbers.max(initial=-1), rows.max(initial=-1))) + 1
    counts = np.bincount(rows, minlength=size)[numbers]
    sums = np.bincount(rows, weights=scores, minlength=size)[numbers]
    means = sums / np.maximum(counts, 1)
    return {
        "people": counts.tolist(),
        "people_score": [round(m, 4) if c else None for m, c in zip(means.tolist(), counts.tolist(), strict=True)],
    }


def check_corrections(path: Path, source: Source) -> None:
    """Refuse corrections of another video before one is tracked, as far as it tells its size and length.

    Raises:
        RequestError: they are, or cannot be read.
    """
    frame_range = source.frames_wanted
    frames = frame_range.last + 1 if frame_range.last is not None else source.likely_length or 0
    about = CorrectedVideo(Path(source.name).name, source.size, frames)
    read_corrections(path, about, getattr(source, "slack", 0.0) if frame_range.last is None else 0.0)


def convert(
    result: str | Path | Result[Any],
    to: str,
    out: str | Path,
    video: str | Path | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a result into the file of another program; returns its path.

    Args:
        result: what a command wrote, see `Result.load`; or a result.
        to: name of the format, see `formats.exports`.
        out: file or folder to write.
        video: the source, where the format needs the size of the frames and the result does not know it.
        overwrite: replace an earlier file.

    Raises:
        RequestError: the result cannot be read, or see `Result.save`.
    """
    format_named(to)
    loaded: Result[Any] = result if isinstance(result, Result) else Result.load(a_path(result, "result"))
    return loaded.save(out, overwrite, to, video)
