"""Settings of whoever finds and links people: the options of the commands and the keywords of the Python calls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Annotated, Any, Literal, TypeAlias, get_args

from pydantic import Field, PositiveInt
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.fields import HIDDEN, OBJECTS, ClassNames, Commas, FileLike, Options, Threads, showing
from tsuiseki.tracking.people.bytetrack import ByteTrack, ByteTrackSettings
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.people.ocsort import OcSort, OcSortSettings
from tsuiseki.tracking.people.sort import DeepSort, DeepSortSettings, Sort, SortSettings
from tsuiseki.tracking.types.class_choice import ClassChoice

PeopleMethod = Literal["flow", "deepsort", "sort", "bytetrack", "ocsort"]
METHODS: tuple[PeopleMethod, ...] = get_args(PeopleMethod)
# Methods that answer at once, from their settings, which `MethodSettings` has under the same name, and a seed.
ONLINE: Mapping[PeopleMethod, Callable[[Any, int], PeopleTracker]] = {
    "deepsort": DeepSort,
    "sort": Sort,
    "bytetrack": ByteTrack,
    "ocsort": OcSort,
}
# Tiles across and down, as a word.
Tiles: TypeAlias = Annotated[str, Field(coerce_numbers_to_str=True)]
# Whether scores go by the heights of people on one ground.
Ground = Literal["auto", "off"]
# Of a detector of another project.
ForeignDetector: TypeAlias = Annotated[
    DetectorOptions,
    showing(
        "detector_options", "layout", "classes", "person", "scores", "height", "width", "resize", "colour", "pixels"
    ),
]
# Of the settings of every online method.
LIFE = ("min_hits", "max_age", "start_score")
# The word that does without a network.
NONE = "none"


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Detecting(Options):
    """The networks that detect and describe people. Python calls give functions and arrays, too, for files.

    Attributes:
        detector: ONNX file, or the name of a shipped or downloaded one (models list).
        score_threshold: least score of a detection, 0 to 1; by default 0.3, none for files.
        score_range: smallest and largest score that rows of --detections may have.
        appearance: ONNX file or name of an appearance network; none does without.
        threads: CPU cores of the networks; 0 takes all.
        device: what the networks run on.
    """

    detector: FileLike = None
    score_threshold: Share | None = None
    score_range: Annotated[Commas[tuple[float, float] | None], HIDDEN] = None
    appearance: FileLike = None
    threads: Threads = 0
    device: Device = "auto"

    @property
    def threshold(self) -> float:
        """`score_threshold`, or the usual one."""
        return 0.3 if self.score_threshold is None else self.score_threshold

    def __post_init__(self) -> None:
        check_score_range(self.score_range)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class FindingOptions(Detecting):
    """Where the detections come from.

    Attributes:
        detections: MOTChallenge detections (det.txt) to use instead of a detector.
        detector_options: reading of another project's detector, where its file leaves it open.
        view: tiles of a frame: 1 is the whole frame; 2 is two across; 3x2, three across and two down; or auto.
        batch_size: frames of one call of the detector.
        threads: CPU cores of the networks; 0 takes all.
    """

    score_range: Commas[tuple[float, float] | None] = None
    detections: FileLike = None
    detector_options: ForeignDetector = field(default_factory=DetectorOptions)
    view: Tiles = "1"
    batch_size: PositiveInt = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.detections is not None and self.detector is not None:
            raise RequestError("expected `detections` or `detector`, got both; leave one out")

    @property
    def chosen(self) -> ClassChoice | None:
        """The classes that are detected; None for people."""
        return None

    @property
    def how(self) -> Mapping[str, str]:
        """Unusual settings of the detector: plain values that distinguish its results."""
        usual = (self.detector_options, self.view) == (DetectorOptions(), "1")
        return {} if usual else {"view": self.view, "detector_options": repr(self.detector_options)}


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class PeopleFinding(FindingOptions):
    """Where the detections come from, and who is compared by appearance.

    Attributes:
        detector: ONNX file, or the name of a shipped or downloaded one (models list).
        view: tiles: auto by trials, 3 across, 3x2, or 1 for none.
        detect_every: detect in every N-th frame only.
        ground: auto lowers scores of boxes that fit nobody.
        appearance: ONNX file or name of an appearance network; none does without.
        appearance_options: what the file of another project's appearance network does not tell.
        classes: numbers or names, such as person,car; by default people.
        across_classes: one track may go through several of --classes.
        second_opinion: a second detector; boxes of both that overlap become one.
    """

    view: Tiles = "auto"
    detect_every: PositiveInt = 1
    ground: Ground = "auto"
    second_opinion: FileLike = None
    appearance_options: Annotated[AppearanceOptions, HIDDEN] = field(default_factory=AppearanceOptions)
    classes: ClassNames | None = None
    across_classes: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.across_classes and self.classes is None:
            raise RequestError("expected `across_classes` with `classes`, got it alone")
        if self.detect_every > 1 and self.detections is not None:
            raise RequestError("expected `detect_every` with a detector, got it with `detections`; leave one out")
        for name in ("detections", "classes"):
            if self.second_opinion is not None and getattr(self, name) is not None:
                raise RequestError(f"expected `second_opinion` without `{name}`, got both; leave one out")
        _ = self.chosen

    @property
    def chosen(self) -> ClassChoice | None:
        return None if self.classes is None else ClassChoice(self.classes, self.across_classes)


PeoplePreset = Literal["default", "printed"]


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class MethodSettings(Options):
    """The settings of every method.

    Attributes:
        sort: settings of --method sort.
        deepsort: settings of --method deepsort.
        bytetrack: settings of --method bytetrack.
        ocsort: settings of --method ocsort.
        flow: settings of --method flow.
    """

    sort: Annotated[SortSettings, showing("sort", *LIFE, "min_iou")] = field(default_factory=SortSettings)
    deepsort: Annotated[
        DeepSortSettings,
        showing("deepsort", *LIFE, "feature_gate", "position_gate", "memory", "reach", "reach_growth"),
    ] = field(default_factory=DeepSortSettings)
    bytetrack: Annotated[
        ByteTrackSettings, showing("bytetrack", *LIFE, "high_score", "low_score", "min_iou", "min_iou_low")
    ] = field(default_factory=ByteTrackSettings)
    ocsort: Annotated[
        OcSortSettings, showing("ocsort", *LIFE, "min_score", "min_iou", "direction_weight", "direction_span")
    ] = field(default_factory=OcSortSettings)
    flow: Annotated[
        FlowSettings,
        showing("flow", "input", "detection", "offset", "costs", "link", "miss", "appearance", "neutral", "entry",
                "exit", "places", "min_time", "fill", "smoothing"),
    ] = field(default_factory=FlowSettings)  # fmt: skip


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Linking(MethodSettings):
    """How detections are linked.

    Attributes:
        method: flow links the whole video at once, the others frame by frame.
        affinity: exported link costs of flow; none takes hand-set ones.
        preset: printed is the thesis's flow as printed.
        moving_camera: estimate the camera's motion from its pictures, and remove it.
        delay: seconds after which flow decides on a frame; by default at the end.
    """

    method: Annotated[PeopleMethod, OBJECTS] = "flow"
    affinity: FileLike = None
    preset: PeoplePreset = "default"
    moving_camera: bool = False
    delay: float | None = None

    def __post_init__(self) -> None:
        if self.preset == "printed" and (self.method != "flow" or self.delay is not None):
            raise RequestError("expected the preset printed with the method flow and without a `delay`")


def check_score_range(score_range: tuple[float, float] | None) -> None:
    """Refuse a range that no score lies in."""
    if score_range is not None and score_range[0] >= score_range[1]:
        raise RequestError(f"`score_range`: expected SMALLEST,LARGEST, got {score_range[0]:g},{score_range[1]:g}")
