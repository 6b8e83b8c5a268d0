"""Settings of `tsuiseki track animals`: of the tracker, and what is known of the animals' points."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.background_difference import Contrast
from tsuiseki.tracking.fields import Commas, Options
from tsuiseki.tracking.formats.body_points import read_poses_file
from tsuiseki.tracking.types.tracks import PointTable


@dataclass(frozen=True, config=SETTINGS)
class AnimalSettings:
    """Settings of the tracker of animals.

    Attributes:
        smallest: least size of a region that is an animal, as a share of the usual animal's core, in (0, 1).
    """

    smallest: Annotated[float, Field(gt=0, lt=1)] = 0.3


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class AnimalChoice(Options):
    """How animals are distinguished from the background, and followed.

    Attributes:
        contrast: how animals differ from the background; auto measures it.
        threshold: difference in grey levels from which a pixel belongs to an animal; by default found in the video.
        corrections: corrections.jsonl of tsuiseki review, to apply to this result where they still hold.
        scale: millimetres of a pixel; adds a_mm,b_mm,length_mm,width_mm,speed_mm_s.
        animals: settings of the tracker.
    """

    contrast: Contrast = "auto"
    threshold: NonNegativeFloat | None = None
    corrections: Path | None = None
    scale: PositiveFloat | None = None
    animals: AnimalSettings = field(default_factory=AnimalSettings)

    def __post_init__(self) -> None:
        if self.corrections is not None and not self.corrections.is_file():
            raise RequestError(f"`corrections`: expected a file that is there, got {self.corrections}")


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class SkeletonSettings(Options):
    """What is known of the animals' points.

    Attributes:
        points: points of a skeleton in every frame: SLEAP's .slp, .h5 or analysis CSV, or DeepLabCut's CSV; the image
            is not read.
        labels: points that you marked in a few frames of this video, likewise; they teach where on the body each lies.
        line: names of a point at the back and one at the front of the body, such as tail,nose; by default measured.
        centre: name of the point whose place is reported; by default the middle of the body.
    """

    points: Path | None = None
    labels: Path | None = None
    line: Commas[tuple[str, str] | None] = None
    centre: str | None = None

    def table(self) -> PointTable | None:
        """The points of the file that is given; None for none.

        Raises:
            RequestError: both are given, the file cannot be used, or ``centre`` is no point of it.
        """
        if self.points is not None and self.labels is not None:
            raise RequestError("expected one of `points` and `labels`, got both")
        path = self.points or self.labels
        if path is None:
            if self.centre is not None or self.line is not None:
                raise RequestError("`centre` and `line` name points; give `points` or `labels`")
            return None
        table = read_poses_file(path)
        if self.centre is not None:
            table.node(self.centre)
        return table
