"""Settings of tracking under ceiling cameras: the method hungarian, and the options of the command."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, NonNegativeFloat, model_validator
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, CosineDistance, Seconds
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.fields import HIDDEN
from tsuiseki.tracking.runs.following import Drawing


@dataclass(frozen=True, config=SETTINGS)
class FisheyeSettings:
    """How detections are matched to tracks.

    Attributes:
        by_appearance: match by appearance in the first stage.
        by_place: match by place in the second stage, and gate the first stage by place.
        feature_gate: ε_feat, the largest cosine distance of a match by appearance, in [0, 2].
        reach: ε_pos right after a detection, metres, at least 0.
        speed: growth of ε_pos with the time since the last detection, m/s, at least 0.
        place_feature_gate: the largest cosine distance of a match by place, in [0, 2]; 2 has no gate, as in the thesis,
            and the track of a person who is missed may go on with furniture.
        confirm: seconds with a detection in every frame that confirm a track, at least 0; one detection at least.
        max_age: seconds without a detection after which a track ends, at least 0.
        start_score: least score of a detection that starts a track; one without a score always may.
    """

    by_appearance: bool = True
    by_place: bool = True
    feature_gate: CosineDistance = 0.5
    reach: NonNegativeFloat = 0.9
    speed: NonNegativeFloat = 1.4
    place_feature_gate: CosineDistance = 0.5
    confirm: Seconds = 0.2
    max_age: Seconds = 3.0
    start_score: float = 0.5

    @model_validator(mode="after")
    def _by_something(self) -> Self:
        if not (self.by_appearance or self.by_place):
            raise ValueError("expected matching by appearance or by place, got neither")
        return self


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class CeilingOptions(Drawing):
    """The input of ceiling cameras, the model of people, and what is written.

    Attributes:
        view: input of the detector: the image unrolled into views in which people stand upright, or the image as
            it is. In the first, any detector of ordinary pictures will do.
        detector_options: reading of another project's detector, where its file leaves it open.
        crops: input of the appearance network: people turned upright, or as in the image.
        person_height: height of the model of a person, metres.
        body_radius: radius of the model of a person, metres.
        resize: where images have another size than the calibration, scale it: cut, where they show a part of what was
            calibrated, widen, where they show more at the sides.
        tables: folder that keeps the tables of the cameras.
        save_detections: also write detections.json: the rotated box and score of every detection, as --detections and
            tsuiseki evaluate detection read them.
    """

    view: Literal["unrolled", "image"] = "unrolled"
    detector_options: Annotated[DetectorOptions, HIDDEN] = field(default_factory=DetectorOptions)
    crops: Literal["upright", "image"] = "upright"
    person_height: Annotated[float, Field(gt=0, le=3)] = 1.7
    body_radius: Annotated[float, Field(gt=0, le=3)] = 0.25
    resize: Literal["no", "cut", "widen"] = "no"
    tables: Path = Path("out/cache/person-tables")
    save_detections: bool = False
