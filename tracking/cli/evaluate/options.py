"""Options that the commands of `tsuiseki evaluate` share."""

from __future__ import annotations

import json as text
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.result_names import result_names
from tsuiseki.tracking.formats.drone.okutama import Protocol
from tsuiseki.tracking.options import BY_PLACE, Files, Shared
from tsuiseki.tracking.types.frame_range import FrameRange, parse_frames

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Comparison(Files):
    """What is scored against what, and where the scores go.

    Attributes:
        truth: the labels.
        results: what is scored; several are compared.
        names: of the results in the table, separated by commas; by default their files' or folders'.
        json: write all scores to this file.
    """

    file_options: ClassVar[Sequence[str]] = ("json",)
    truth: Path = field(metadata=BY_PLACE)
    results: list[Path] = field(metadata=BY_PLACE)
    names: list[str] | None = None
    json: Path | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        self.named()

    def named(self) -> dict[str, Path]:
        """The results, each by a name as short as tells them apart."""
        return dict(zip(result_names(self.results, self.names), self.results, strict=True))

    def report(self, table: Table, values: Mapping[str, Any]) -> None:
        """Print the scores, and write them where that is wanted."""
        from tsuiseki.tracking.evaluation.table import show

        show(table)
        if self.json is not None:
            self.write(self.json, lambda path: path.write_text(text.dumps(values, indent=1) + "\n", encoding="utf-8"))


@dataclass(frozen=True, kw_only=True)
class PlottedComparison(Comparison):
    """Likewise, with a plot.

    Attributes:
        plot: write a comparison plot to this file (PNG, SVG or PDF).
    """

    file_options: ClassVar[Sequence[str]] = ("json", "plot")
    plot: Path | None = None

    def draw(self, save: Callable[[Path], object]) -> None:
        """Write the plot, where that is wanted."""
        if self.plot is not None:
            self.write(self.plot, save)


@dataclass(frozen=True)
class Stretch(Shared):
    """Which frames count.

    Attributes:
        frames: score this stretch only, counted from 1 with both ends, such as 301-400.
    """

    frames: str | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        parse_frames(self.frames)

    @property
    def range(self) -> FrameRange:
        """The frames, 0-based."""
        return parse_frames(self.frames)


@dataclass(frozen=True)
class Labels(Stretch):
    """How labels are read.

    Attributes:
        protocol: for labels like Okutama-Action's. lenient scores all frames, and results on hidden people are neither
            right nor wrong; published, as in the numbers published with the data, leaves out the first frame and all
            labels of hidden people, so that results on them are wrong.
        size: width and height of the frames that were tracked, to which labels of Okutama-Action are scaled, given in
            pixels of 3840x2160; by default those of the frames that lie with the labels, or else 1280,720.
    """

    protocol: Protocol = "lenient"
    size: tuple[int, int] | None = None

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        if self.size is not None and min(self.size) < 1:
            width, height = self.size
            raise RequestError(f"`size`: expected a width and height from 1 pixel on, got {width},{height}")
