"""Where the people in each frame come from, by files: options that the commands for people share.

From Python the same is said by arguments that also take functions and arrays; see `people.tracking` and `drone.models`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.foreign_options import DetectorOptions
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.weights import shipped, shipped_or_file

if TYPE_CHECKING:
    from tsuiseki.tracking.features.networks.exported import Detect
    from tsuiseki.tracking.types import Detections, IntArray
    from tsuiseki.tracking.video.source import Source


@dataclass(frozen=True, kw_only=True)
class Detecting(Shared):
    """The networks that find and describe people.

    Attributes:
        detector: exported detector; by default the shipped one. A bare word, such as street, names another shipped one.
        score_threshold: the detector keeps what scores at least this, from 0 to 1.
        score_range: smallest and largest score that the rows of --detections may have; by default any.
        appearance: exported appearance network; by default the shipped appearance_people.onnx; none does without.
        threads: CPU cores of the networks; 0 takes all.
    """

    detector: Path | None = None
    score_threshold: float = 0.3
    score_range: tuple[float, float] | None = None
    appearance: Path | None = None
    threads: int = 0

    def check(self) -> None:
        """See `Shared.check`."""
        if not 0 <= self.score_threshold <= 1:
            raise RequestError(f"`score_threshold`: expected a number from 0 to 1, got {self.score_threshold:g}")
        check_score_range(self.score_range)
        if self.threads < 0:
            raise RequestError(f"`threads`: expected 0 or more, got {self.threads}")


@dataclass(frozen=True, kw_only=True)
class FindingOptions(Detecting):
    """Where the detections come from.

    Attributes:
        detections: MOTChallenge detections (det.txt) to use instead of a detector.
        detector_options: what the file of another project's detector does not tell.
        view: in how many overlapping tiles the detector looks at a frame: 1 is the whole frame alone, tiles across
            such as 2, across and down such as 3x2, tiles (as many as show more), or auto (as many as find more people).
        batch_size: frames of one call of the detector.
        threads: CPU cores of the networks, which work on several frames at a time; 0 takes all.
    """

    detections: Path | None = None
    detector_options: DetectorOptions = field(default_factory=DetectorOptions)
    view: str = "1"
    batch_size: int = 4

    def check(self) -> None:
        """See `Shared.check`."""
        super().check()
        if self.batch_size < 1:
            raise RequestError(f"`batch_size`: expected at least 1 frame, got {self.batch_size}")
        if self.detections is not None and self.detector is not None:
            raise RequestError("expected `detections` or `detector`, got both; leave one out")

    @property
    def how(self) -> Mapping[str, str]:
        """How the detector looks, where that is not the usual way: plain values that tell its results apart."""
        usual = (self.detector_options, self.view) == (DetectorOptions(), "1")
        return {} if usual else {"view": self.view, "detector_options": repr(self.detector_options)}

    def classed(self, source: Source, wanted: Sequence[int]) -> tuple[list[Detections], list[IntArray]]:
        """The given detections, and their classes; see `classed_detections`."""
        from tsuiseki.tracking.people.finding import classed_detections

        if self.detections is None:
            raise RequestError("expected `classes` with `detections`, whose column 8 they stand in, got no detections")
        return classed_detections(self.detections, source, wanted, self.score_range)

    def _file(self, default: str) -> Path:
        return shipped(default) if self.detector is None else shipped_or_file("detector", self.detector)

    def detect(self, source: Source, default: str, threads: int | None = None) -> Detect | list[Detections]:
        """The given detections, or what finds people.

        Args:
            source: the video.
            default: name of the shipped detector to take where none is given.
            threads: of one call of the detector; by default all that the user gives.
        """
        from tsuiseki.tracking.features.networks.exported import open_detector
        from tsuiseki.tracking.features.view_choice import ViewedDetector
        from tsuiseki.tracking.features.views import parse_view
        from tsuiseki.tracking.people.finding import people_detect

        wanted = parse_view(self.view)
        if self.detections is not None or not source.has_images:
            return people_detect(source, self.detections, None, Path(), score_range=self.score_range)
        path, threads = self._file(default), self.threads if threads is None else threads
        found = open_detector(path, self.score_threshold, threads=threads, options=self.detector_options)
        return found if wanted == (1, None) else ViewedDetector(found, wanted, frame_rate=source.frame_rate)


def check_score_range(score_range: tuple[float, float] | None) -> None:
    """Refuse a range that no score lies in."""
    if score_range is not None and score_range[0] >= score_range[1]:
        raise RequestError(f"`score_range`: expected SMALLEST,LARGEST, got {score_range[0]:g},{score_range[1]:g}")
