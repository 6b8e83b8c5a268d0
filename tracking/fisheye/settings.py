"""Settings of tracking under ceiling cameras: the views, both methods, and the options of the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from tsuiseki.tracking.association.costs import ObservationCost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.following import Drawing

MOST_TILES = 16


@dataclass(frozen=True)
class UnrollingSettings:
    """The views.

    Attributes:
        rings: number of tiles of each ring about the camera. More tiles show people larger; with tiles of 4:3 a ring
            of n shows those whole who stand farther away than n / 6 of the camera's height.
        downward: also a view straight down.
        overlap: share of a tile that the next one shows again, in [0, 0.5].
        horizon: row of a tile that is as high as the camera, share of the height.
        iou: overlap from which two turned boxes are one person.
        inside: share of a box of one tile within that of another from which they are one person.
        heights: (least, greatest) height over the floor that a person's box may reach, metres: it follows from the rows
            of head and feet and from the camera's height.
    """

    rings: tuple[int, ...] = (1, 4)
    downward: bool = True
    overlap: float = 0.25
    horizon: float = 0.03
    iou: float = 0.4
    inside: float = 0.7
    heights: tuple[float, float] = (0.7, 2.4)

    def __post_init__(self) -> None:
        if not self.rings or min(self.rings) < 1 or max(self.rings) > MOST_TILES or not 0 <= self.overlap <= 0.5:
            raise RequestError(
                f"unrolled views: expected rings of 1 to {MOST_TILES} tiles and an overlap in [0, 0.5], got rings "
                f"{','.join(map(str, self.rings)) or 'none'} and overlap {self.overlap:g}"
            )
        if not 0 <= self.heights[0] < self.heights[1]:
            raise RequestError(f"unrolled views: expected heights as (least, greatest) from 0, got {self.heights}")


@dataclass(frozen=True)
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
        memory: time constant with which a track's velocity decays, seconds, above 0.
        noise: time constant over which measured places are averaged, seconds, above 0.
        update: weight of the newest feature in a track's running mean, in (0, 1].
        confirm: seconds with a detection in every frame that confirm a track, at least 0; one detection at least.
        max_age: seconds without a detection after which a track ends, at least 0.
        start_score: least score of a detection that starts a track; one without a score always may.
    """

    by_appearance: bool = True
    by_place: bool = True
    feature_gate: float = 0.5
    reach: float = 0.9
    speed: float = 1.4
    place_feature_gate: float = 0.5
    memory: float = 1.0
    noise: float = 0.15
    update: float = 0.3
    confirm: float = 0.2
    max_age: float = 3.0
    start_score: float = 0.5

    def __post_init__(self) -> None:
        if not (self.by_appearance or self.by_place):
            raise ValueError("expected matching by appearance or by place, got neither")
        if not (0 <= self.feature_gate <= 2 and self.reach >= 0 and self.speed >= 0 and 0 < self.update <= 1):
            raise ValueError("expected feature_gate in [0, 2], reach and speed from 0, and update in (0, 1]")
        if not 0 <= self.place_feature_gate <= 2:
            raise ValueError("expected place_feature_gate in [0, 2]")
        if not (self.memory > 0 and self.noise > 0 and self.confirm >= 0 and self.max_age >= 0):
            raise ValueError("expected memory and noise above 0, confirm and max_age from 0 seconds")


@dataclass(frozen=True)
class FloorFlowSettings:
    """The minimum-cost flow on the floor.

    Attributes:
        window: longest time between two linked detections, seconds.
        reach: largest distance between two linked detections of one time, metres.
        speed: growth of that distance with the time between them, m/s.
        noise: scale of the difference of two measured places of one person who stands still, metres; see `HandSetCost`.
        pace: scale of a person's velocity, m/s.
        appearance: weight of the cosine distance of two features, at least 0.
        neutral: cosine distance that leaves the cost of a link as it is, in [0, 2].
        bias: exponent of the cost of a link between equal places with the neutral cosine distance.
        entry: cost of a track's start and of its end, at least 0.
        observation: cost of a detection. At 1 frame a second a track has few detections, and they must outweigh the
            cost of its start and end.
    """

    window: float = 3.0
    reach: float = 0.8
    speed: float = 1.5
    noise: float = 0.25
    pace: float = 0.8
    appearance: float = 10.0
    neutral: float = 0.3
    bias: float = -4.0
    entry: float = 2.0
    observation: ObservationCost = field(default_factory=lambda: ObservationCost(alpha=2.0, beta=-6.0))


DEFAULT_FLOW = FloorFlowSettings()


@dataclass(frozen=True, kw_only=True)
class CeilingOptions(Drawing):
    """The input of ceiling cameras, the model of people, and what is written.

    Attributes:
        view: input of the detector: the image unrolled into views in which people stand upright, or the image as
            it is. In the first, any detector of ordinary pictures will do.
        detector_options: reading of another project's detector, where its file leaves it open.
        unrolling: the unrolled views.
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
    detector_options: DetectorOptions = field(default_factory=DetectorOptions)
    unrolling: UnrollingSettings = field(default_factory=UnrollingSettings)
    crops: Literal["upright", "image"] = "upright"
    person_height: float = 1.7
    body_radius: float = 0.25
    resize: Literal["no", "cut", "widen"] = "no"
    tables: Path = Path("out/cache/person-tables")
    save_detections: bool = False
