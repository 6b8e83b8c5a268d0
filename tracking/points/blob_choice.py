"""What `tsuiseki track blobs` follows, and how: its options, and the tracker that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.people.settings import check_score_range
from tsuiseki.tracking.points.blob_tracker import BlobPreset, BlobSettings, BlobTracker, SingleBlobTracker
from tsuiseki.tracking.points.tracker import PointMethod, PointSettings, PointTracker
from tsuiseki.tracking.points.tracking import chosen_colour, colour_tracker, extent_of, read_measurements
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.video.source import Source

AnyBlobTracker: TypeAlias = BlobTracker | SingleBlobTracker | PointTracker
SIZE = (32.0, 32.0)


@dataclass(frozen=True)
class BlobChoice(Shared):
    """Objects of a colour, or measured points or boxes.

    Attributes:
        colour: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with hues in
            degrees.
        colour_box: X,Y,W,H in 0-based pixels of an object in the first frame, whose colour is taken.
        detections: measurements: MOTChallenge boxes (det.txt), or points as CSV with the columns frame,x,y.
        preset: for colours: calibrated follows any number; paper uses the likelihood as printed, whose expected count
            means nothing; single follows one.
        method: for measurements: labelled multi-Bernoulli filter, or phd.
        particles: of each target.
        size: width and height in pixels, of objects that appear with paper and single, and of points.
        smallest: least side in pixels of an object, and of a patch of colour that may be a new one.
        confirm: M,N: with calibrated, a new object is believed once a patch of the colour was at it in M of its first N
            frames; 1,1 believes at once.
        detection: for measurements: probability that a target is measured, from 0 to 1.
        clutter: for measurements: expected false ones in a frame.
        score_range: smallest and largest score that the rows of --detections may have.
    """

    colour: str | None = None
    colour_box: tuple[float, float, float, float] | None = None
    detections: Path | None = None
    preset: BlobPreset = "calibrated"
    method: PointMethod = "labelled"
    particles: int = 500
    size: tuple[float, float] = SIZE
    smallest: float = 12.0
    confirm: tuple[int, int] = (3, 3)
    detection: float = 0.85
    clutter: float = 1.0
    score_range: tuple[float, float] = (0.0, 1.0)

    def check(self) -> None:
        """See `Shared.check`."""
        if sum(choice is not None for choice in (self.colour, self.colour_box, self.detections)) != 1:
            raise RequestError("expected one of `colour`, `colour_box` and `detections`")
        if self.colour_box is not None and min(self.colour_box[2:]) <= 0:
            raise RequestError(f"`colour_box`: expected X,Y,W,H with a width and height above 0, got {self.colour_box}")
        check_score_range(self.score_range)

    def opened(self, source: Source, seed: int) -> tuple[AnyBlobTracker, Sequence[Detections] | None]:
        """A fresh tracker, and the measurements of each frame, where it does not look at the frames themselves.

        Raises:
            RequestError: something of this cannot be used; the message says what and why.
        """
        width, height = extent = extent_of(source)
        if not (0 < self.size[0] <= max(width, SIZE[0]) and 0 < self.size[1] <= max(height, SIZE[1])):
            shown = f"{self.size[0]:g},{self.size[1]:g}"
            raise RequestError(f"`size`: expected at most the {width:g}x{height:g} pixels of a frame, got {shown}")
        if self.detections is not None:
            points = PointSettings(
                method=self.method,
                particles=self.particles,
                detection=self.detection,
                clutter=self.clutter,
                box=self.size,
            )
            measured = read_measurements(source, self.detections, self.size, self.score_range)
            return PointTracker(points, extent, seed), measured
        settings = BlobSettings(
            preset=self.preset,
            particles=self.particles,
            size=self.size,
            smallest=self.smallest,
            confirm=self.confirm,
        )
        if self.colour_box is None:
            colour = chosen_colour(source, self.colour or "")
        else:
            x, y, w, h = self.colour_box
            colour = chosen_colour(source, (x, y, x + w, y + h))
        return colour_tracker(colour, settings, seed), None
