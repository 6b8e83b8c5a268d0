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
from tsuiseki.tracking.fields import OBJECTS, ClassNames, Commas, FileLike, Options, Threads
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
# The word that does without a network.
NONE = "none"


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Detecting(Options):
    """The networks that detect and describe people. Python calls give functions and arrays, too, for files.

    Attributes:
        detector: exported detector; by default the shipped one. A bare word names another shipped one, such as street,
            or a downloaded one, such as yolox-s (see tsuiseki models list).
        score_threshold: least score of a detection, from 0 to 1; by default 0.3, and none with --detections. In track
            people the beginning of the video tells it for detectors of other projects.
        score_range: smallest and largest score that the rows of --detections may have; by default any.
        appearance: exported appearance network; by default the shipped appearance_people.onnx; none does without.
        threads: CPU cores of the networks; 0 takes all.
        device: what the networks run on: cpu, cuda (a GPU, with onnxruntime-gpu), or auto (cuda where it works).
    """

    detector: FileLike = None
    score_threshold: Share | None = None
    score_range: Commas[tuple[float, float] | None] = None
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
        view: overlapping tiles of a frame for the detector: 1 is the whole frame alone, tiles across
            such as 2, across and down such as 3x2, tiles (as many as show more), or auto (as many as find more people).
        batch_size: frames of one call of the detector.
        threads: CPU cores of the networks, which work on several frames at a time; 0 takes all.
    """

    detections: FileLike = None
    detector_options: DetectorOptions = field(default_factory=DetectorOptions)
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
        detector: detector as ONNX; by default the shipped detector_people.onnx; a bare word names another shipped one,
            such as street, or a downloaded one, such as yolox-s (tsuiseki models list). One of other projects (YOLO,
            YOLOX, RT-DETR, RF-DETR, torchvision) is recognised by its inputs and outputs.
        view: overlapping tiles of a frame for the detector: auto (as many as detect more people, by trials
            at some frames), tiles across such as 3 (1 is the whole frame alone), across and down such as 3x2, or tiles
            (as many as show more than fewer).
        ground: auto lowers the scores of boxes that are not as high as people on one ground are in their row, once
            those detected so far tell; off leaves all scores as they are. Those of --detections are never touched.
        appearance: appearance network as ONNX for deepsort and flow; by default the shipped appearance_people.onnx;
            none does without. One of other projects may be anything from crops to features.
        appearance_options: what the file of another project's appearance network does not tell.
        classes: track these classes, by number or name, such as person,car or 1,3; tracks.txt then has the class in
            column 8. By default people, and of --detections (column 8) and functions all, as one class.
        across_classes: with --classes, one track may go through several of them; by default each is tracked apart.
    """

    view: Tiles = "auto"
    ground: Ground = "auto"
    appearance_options: AppearanceOptions = field(default_factory=AppearanceOptions)
    classes: ClassNames | None = None
    across_classes: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.across_classes and self.classes is None:
            raise RequestError("expected `across_classes` with `classes`, got it alone")
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

    sort: SortSettings = field(default_factory=SortSettings)
    deepsort: DeepSortSettings = field(default_factory=DeepSortSettings)
    bytetrack: ByteTrackSettings = field(default_factory=ByteTrackSettings)
    ocsort: OcSortSettings = field(default_factory=OcSortSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)


@dataclass(frozen=True, kw_only=True, config=SETTINGS)
class Linking(MethodSettings):
    """How detections are linked.

    Attributes:
        method: sort follows positions; bytetrack, through low scores, too; ocsort, through gaps; deepsort compares
            appearance, too; flow links the whole video at once, which is the most accurate and gives its result at the
            end, or with --delay a fixed time after each frame.
        affinity: exported link costs for flow; by default the shipped affinity_people.onnx after a detector, and
            hand-set costs after --detections, whose scores it does not know; none takes hand-set costs always.
        preset: printed makes of flow the thesis's MCF as printed, by the overlap and appearance of pairs; for
            comparison. Its costs come from train affinity --features thesis.
        moving_camera: estimate how the camera moves from its pictures and link people as if it stood still. Without it
            the flow sees in them where the camera stands still, and takes the motion of the boxes elsewhere.
        delay: seconds after which --method flow decides on a frame for good, such as 1.0, with memory that does not
            grow but for the result; by default it decides at the end.
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
