"""Settings of the trackers of an unknown number of objects, and the options of `tsuiseki track blobs`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, model_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Particles, Share
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.people.settings import check_score_range

SetMethod = Literal["labelled", "phd"]
"""The finite-set filter: labelled multi-Bernoulli, or PHD."""
BlobPreset = Literal["calibrated", "paper", "single"]
Lag = Literal[0, 1]
# Typical width and height of a coloured object, pixels.
SIZE = (32.0, 32.0)
# Pixels; of less a region has no likelihood.
Side = Annotated[float, Field(ge=3)]


@dataclass(frozen=True, config=SETTINGS)
class PointSettings:
    """Settings of the tracker of measured points and boxes.

    Attributes:
        method: ``labelled`` or ``phd``.
        particles: number of particles of each target.
        detection: probability that a target is measured, in [0, 1].
        clutter: expected false measurements in a frame, >= 0.
        box: width and height in pixels of points without a size.
    """

    method: SetMethod = "labelled"
    particles: Particles = 500
    detection: Share = 0.85
    clutter: NonNegativeFloat = 1.0
    box: tuple[PositiveFloat, PositiveFloat] = (20.0, 20.0)


@dataclass(frozen=True, config=SETTINGS)
class BlobSettings:
    """Settings of the tracker of coloured objects.

    Attributes:
        preset: ``calibrated`` follows any number, by the likelihood's ratio to background; ``paper`` does so by the
            printed likelihood, equalised between targets; ``single`` follows one by an ordinary particle filter.
        particles: number of particles of each target.
        size: typical width and height in pixels, for births anywhere.
        smallest: least side in pixels of a target, and of a patch of colour that may be a new one.
        confirm: with ``calibrated``, a new target is confirmed once a patch of the colour was at it in so many of its
            first so many frames, and dropped when that cannot be any more; ``(1, 1)`` confirms at once.
    """

    preset: BlobPreset = "calibrated"
    particles: Particles = 500
    size: tuple[Side, Side] = SIZE
    smallest: PositiveFloat = 12.0
    confirm: tuple[PositiveInt, PositiveInt] = (3, 3)

    @model_validator(mode="after")
    def _confirmed_in_time(self) -> Self:
        if self.confirm[0] > self.confirm[1]:
            raise ValueError(f"`confirm`: expected M,N with M <= N frames, got {self.confirm}")
        return self


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class BlobChoice(Options):
    """Objects of a colour, or measured points or boxes.

    Attributes:
        colour: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with hues in
            degrees.
        colour_box: X,Y,W,H in 0-based pixels of an object in the first frame, whose colour is taken.
        detections: measurements: MOTChallenge boxes (det.txt), or points as CSV with the columns frame,x,y.
        detector: network whose boxes are measurements, as ONNX or the name of a shipped or downloaded one.
        preset: for colours: calibrated follows any number; paper uses the likelihood as printed, whose expected count
            means nothing; single follows one.
        method: for measurements: labelled multi-Bernoulli filter, or phd.
        particles: number of particles of each target.
        size: width and height in pixels, of objects that appear with paper and single, and of points.
        smallest: least side in pixels of an object, and of a patch of colour that may be a new one.
        confirm: M,N: with calibrated, confirm a new object that has its colour in M of its first N frames; 1,1
            confirms at once.
        detection: for measurements: probability that a target is measured, from 0 to 1.
        clutter: for measurements: expected false ones in a frame.
        score_range: smallest and largest score that the rows of --detections may have.
    """

    colour: str | None = None
    colour_box: Commas[tuple[float, float, float, float] | None] = None
    detections: Path | None = None
    detector: Path | None = None
    preset: BlobPreset = "calibrated"
    method: SetMethod = "labelled"
    particles: PositiveInt = 500
    size: Commas[tuple[PositiveFloat, PositiveFloat]] = SIZE
    smallest: NonNegativeFloat = 12.0
    confirm: Commas[tuple[int, int]] = (3, 3)
    detection: Share = 0.85
    clutter: NonNegativeFloat = 1.0
    score_range: Commas[tuple[float, float]] = (0.0, 1.0)

    def check(self) -> None:
        """Refuse what names no objects, or does so twice; raises RequestError."""
        choices = self.colour, self.colour_box, self.detections, self.detector
        if sum(choice is not None for choice in choices) != 1:
            raise RequestError("expected one of `colour`, `colour_box`, `detections` and `detector`")
        if self.colour_box is not None and min(self.colour_box[2:]) <= 0:
            raise RequestError(f"`colour_box`: expected X,Y,W,H with a width and height above 0, got {self.colour_box}")
        check_score_range(self.score_range)
