"""Options that several commands share, each told once: what to look at, and where the result goes.

A command takes such a dataclass as a parameter; the parser makes its fields options of the command itself. A field
marked `BY_PLACE` is given by place, without its name.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from tsuiseki.tracking.cli.ending import signal_of
from tsuiseki.tracking.errors import InputWarning, Interrupted, RequestError
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.output import check_output_file, check_output_folder, output_file

if TYPE_CHECKING:
    from tsuiseki.tracking.cli.run import Run
    from tsuiseki.tracking.video import Source

T = TypeVar("T")
PLOT_KINDS = (".png", ".svg", ".pdf")


# Metadata of fields of `Shared` dataclasses: given by place (a list takes all words that follow); no option at all.
BY_PLACE: Mapping[str, bool] = {"positional": True}
NO_OPTION: Mapping[str, bool] = {"option": False}


class Shared:
    """A dataclass whose fields are options of the command itself, not below the parameter's name.

    The texts for the help stand under ``Attributes:``; a command may word one of its own under ``Args:``.
    """

    def check(self) -> None:
        """Refuse values; called by the parser.

        Raises:
            RequestError: with names of options in backquotes.
        """


@dataclass(frozen=True)
class Overlay(Shared):
    """Whether to draw.

    Attributes:
        overlay: also write a video with the result drawn in.
        overlay_format: of that video; mp4 where OpenCV can write it.
    """

    overlay: bool = False
    overlay_format: Literal["webm", "mp4"] = "webm"

    @property
    def overlay_file(self) -> str:
        """Its name in the output folder."""
        return f"overlay.{self.overlay_format}"


@dataclass(frozen=True, kw_only=True)
class Video(Overlay):
    """What to look at.

    Attributes:
        source: a video file, a folder of images, a sequence folder (MOTChallenge, OTB, UAV123, VOT), the number of a
            webcam (0, 1, …) or the address of a stream.
        frames: track this stretch only, counted from 1 with both ends, such as 301-400.
        fps: frames a second, where the source does not say or is wrong; by default what it says, or 25.
    """

    source: str = field(metadata=BY_PLACE)
    frames: str | None = None
    fps: float | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        parse_frames(self.frames)
        if self.fps is not None and not 0 < self.fps <= 1000:
            raise RequestError(f"`fps`: expected frames a second above 0 and up to 1000, got {self.fps:g}")

    def open(self, *, images: bool = False, replayable: bool = False, timed: bool = False) -> Source:
        """The source, checked.

        Args:
            images: refuse a sequence that is text only.
            replayable: refuse a webcam or stream.
            timed: the result depends on the frame rate, so say where it is not known.

        Raises:
            RequestError: see `open_source`; or there is nothing to draw the overlay on.
        """
        from tsuiseki.tracking.video import open_source

        opened = open_source(self.source, parse_frames(self.frames), self.fps)
        if timed and opened.rate_missing:
            warnings.warn(
                f"{opened.name} does not say its frame rate: {opened.frame_rate:g} a second are taken; give `fps`",
                InputWarning,
                stacklevel=2,
            )
        if images and not opened.has_images:
            raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
        if replayable and opened.live:
            raise RequestError("expected a video that can be played again, got a live source; record it first")
        if self.overlay and not opened.has_images:
            raise RequestError(f"{opened.name} has no images to draw on; leave `overlay` out")
        return opened


@dataclass(frozen=True)
class Given:
    """The request, for ``run.json``.

    Attributes:
        command: the program's words.
        settings: every option with its value, as a file for ``--config`` has them.
    """

    command: Sequence[str] = ("tsuiseki",)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Output(Shared):
    """Where the result goes.

    Attributes:
        out: folder for the results.
        overwrite: replace an earlier result in the folder.
    """

    out: Path
    overwrite: bool = False
    given: Given = field(default_factory=Given, metadata=NO_OPTION)

    @property
    def random_seed(self) -> int:
        """For ``run.json``."""
        return int(self.given.settings.get("seed", 0))

    def check(self) -> None:
        """See `Shared.check`."""
        check_output_folder(self.out, self.overwrite)

    def run(self) -> Run:
        """A run that writes there; see `tsuiseki.tracking.cli.run`."""
        from tsuiseki.tracking.cli.run import Run

        return Run(self)


@dataclass(frozen=True)
class Seed(Shared):
    """For chance.

    Attributes:
        seed: of all random numbers.
    """

    seed: int = 0

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        if self.seed < 0:
            raise RequestError(f"`seed`: expected a whole number from 0, got {self.seed}")


@dataclass(frozen=True)
class SeededOutput(Seed, Output):
    """Where the result of something random goes."""


@dataclass(frozen=True, kw_only=True)
class Files(Shared):
    """Files to write, each whole or not at all.

    Attributes:
        overwrite: replace existing files.
    """

    overwrite: bool = False
    written: list[Path] = field(default_factory=list, metadata=NO_OPTION)
    # Options that name a file to write.
    file_options: ClassVar[Sequence[str]] = ()

    def check(self) -> None:
        """See `Shared.check`."""
        for name in self.file_options:
            path = getattr(self, name)
            if path is not None:
                check_output_file(path, self.overwrite)
            if name == "plot" and path is not None and path.suffix.lower() not in PLOT_KINDS:
                raise RequestError(f"`plot`: expected a file name ending in {', '.join(PLOT_KINDS)}, got {path}")

    def write(self, path: Path, write: Callable[[Path], T]) -> T:
        """Make the file ``path``; returns what ``write`` does."""
        try:
            with output_file(path, self.overwrite) as work:
                result = write(work)
        except KeyboardInterrupt as error:
            if not self.written:
                raise
            raise Interrupted(signal_of(error), f"{', '.join(map(str, self.written))} is written") from error
        self.written.append(path)
        return result


@dataclass(frozen=True, kw_only=True)
class OutputFile(Files):
    """A file to write.

    Attributes:
        out: file to write.
    """

    file_options: ClassVar[Sequence[str]] = ("out",)
    out: Path


@dataclass(frozen=True, kw_only=True)
class PlottedFile(OutputFile):
    """A file to write, and a picture of it.

    Attributes:
        plot: also draw a plot into this file (PNG, SVG or PDF).
    """

    file_options: ClassVar[Sequence[str]] = ("out", "plot")
    plot: Path | None = None

    def draw(self, save: Callable[[Path], object]) -> None:
        """Write the plot, where that is wanted."""
        if self.plot is not None:
            self.write(self.plot, save)
