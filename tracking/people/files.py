"""People through a video from files alone, as `tsuiseki track people` asks: its options, and what runs by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.motion.camera_trajectory import said_of_camera
from tsuiseki.tracking.features.networks.exported import Describe, open_appearance
from tsuiseki.tracking.features.networks.foreign_options import AppearanceOptions
from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.finding import (
    NONE,
    Ground,
    PeopleInputs,
    ground_of,
    people_describer,
    threads_of_a_call,
)
from tsuiseki.tracking.people.finding_options import FindingOptions
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.methods import (
    MethodSettings,
    PeopleMethod,
    camera_for,
    compares_appearance,
    cost_of_scores,
    people_affinity,
    people_tracker,
    straddling_of,
)
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import IntArray
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR


@dataclass(frozen=True, kw_only=True)
class PeopleFinding(FindingOptions):
    """Where the detections come from, and who is compared by appearance.

    Attributes:
        detector: detector as ONNX; by default the shipped detector_people.onnx; a bare word, such as street, names
            another shipped one. One of other projects (YOLO, YOLOX, RT-DETR, RF-DETR, torchvision) is recognised by its
            inputs and outputs.
        view: in how many overlapping tiles the detector looks at a frame: auto (as many as find more people, by looks
            at some frames), tiles across such as 3 (1 is the whole frame alone), across and down such as 3x2, or tiles
            (as many as show more than fewer).
        ground: auto lowers the scores of boxes that are not as high as people on one ground are in their row, once
            those found so far tell; off leaves all scores as they are. Those of --detections are never touched.
        appearance: appearance network as ONNX for deepsort and flow; by default the shipped appearance_people.onnx;
            none does without. One of other projects may be anything from crops to features.
        appearance_options: what the file of another project's appearance network does not tell.
        classes: track the rows of --detections of these classes (column 8), each class apart, such as 1,3; tracks.txt
            then has the class in column 8. By default all rows, as one class.
    """

    view: str = "auto"
    ground: Ground = "auto"
    appearance_options: AppearanceOptions = field(default_factory=AppearanceOptions)
    classes: list[int] | None = None

    def describer(self, source: Source, method: PeopleMethod, threads: int) -> Describe | None:
        """What describes appearance, where the method compares it and there are images."""
        compared, given = compares_appearance(method), self.appearance
        if not compared or given is None or str(given) == NONE:
            return people_describer(source, compared, given, threads)
        return open_appearance(given, threads, options=self.appearance_options)


@dataclass(frozen=True, kw_only=True)
class Linking(MethodSettings):
    """How detections are linked.

    Attributes:
        method: sort follows positions; bytetrack, through low scores, too; ocsort, through gaps; deepsort compares
            appearance, too; flow links the whole video at once, which is the most accurate and gives its result at the
            end, or with --delay a fixed time after each frame.
        affinity: exported link costs for flow; by default the shipped affinity_people.onnx after a detector, and
            hand-set costs after --detections, whose scores it does not know; none takes hand-set costs always.
        moving_camera: estimate how the camera moves from its pictures and link people as if it stood still. Without it
            the flow sees in them where the camera stands still, and takes the motion of the boxes elsewhere.
        delay: seconds after which --method flow decides on a frame for good, such as 1.0, with memory that does not
            grow but for the result; by default it decides at the end.
    """

    method: PeopleMethod = "flow"
    affinity: Path | None = None
    moving_camera: bool = False
    delay: float | None = None


def opened(
    source: Source, finding: PeopleFinding, linking: Linking, seed: int
) -> tuple[PeopleInputs, PeopleTracker, Callable[[int], int]]:
    """All models and files opened and checked: where people come from, a tracker, and the class of each id (-1: none).

    Raises:
        RequestError: something cannot be used; the message says what and why.
    """
    if linking.moving_camera and not source.has_images:
        raise RequestError(f"{source.name} has no images to tell how the camera moves; leave `moving_camera` out")
    threads = threads_of_a_call(source, finding.threads)
    kinds: Sequence[IntArray] = []
    if finding.classes is None:
        detect = finding.detect(source, PEOPLE_DETECTOR, threads)
    else:
        detect, kinds = finding.classed(source, finding.classes)
    describe = finding.describer(source, linking.method, threads)
    camera = camera_for(linking.method, moving=linking.moving_camera)
    ground = ground_of(detect, finding.ground, source)
    inputs = PeopleInputs(source, detect, describe, finding.batch_size, camera, finding.threads, ground)
    learnt = people_affinity(linking.method, linking.affinity, finding.threads, known_scores=knows_scores(detect))

    def make() -> PeopleTracker:
        scores = cost_of_scores(detect)
        straddling = straddling_of(detect)
        return people_tracker(linking.method, linking, learnt, seed, source, camera, linking.delay, scores, straddling)

    if finding.classes is None:
        return inputs, make(), lambda _: -1
    by_class = ByClass(make, kinds[source.frames_wanted.first :], finding.classes)
    return inputs, by_class, by_class.class_of


def facts_of(inputs: PeopleInputs, tracker: PeopleTracker, milliseconds: float) -> tuple[dict[str, Any], list[str]]:
    """What a finished run found out about its input, as values by name, and what of it is worth a line to the user.

    Args:
        inputs: of the run.
        tracker: of the run.
        milliseconds: that the detector took a frame.
    """
    facts: dict[str, Any] = {}
    lines: list[str] = []
    if isinstance(tracker, FlowTracker):
        facts["flow"] = tracker.facts()
        lines += _said_of_flow(tracker)
    elif isinstance(tracker, ByClass):
        flows = {number: one for number, one in tracker.trackers.items() if isinstance(one, FlowTracker)}
        if flows:
            facts["flow"] = {str(number): one.facts() for number, one in flows.items()}
        lines += [f"class {number}: {line}" for number, one in flows.items() for line in _said_of_flow(one)]
    if isinstance(inputs.detect, ViewedDetector) and inputs.detect.summary:
        told = any(choice.milliseconds is not None for choice in inputs.detect.choices.values())
        cost = "" if told else f", about {milliseconds:.0f} ms a frame"
        facts["view"] = f"{inputs.detect.summary}{cost}"
        lines.append(f"looked at {facts['view']}; --view says in how many tiles")
    if inputs.ground is not None and inputs.ground.frames:
        facts["ground"] = inputs.ground.facts()
        if inputs.ground.used:
            lines.append(f"{inputs.ground}; --ground off leaves all scores as they are")
    return facts, lines


def _said_of_flow(tracker: FlowTracker) -> list[str]:
    """What of the facts of a flow is worth a line."""
    lines = []
    camera = tracker.camera
    if camera.lost:
        lines.append(said_of_camera(camera.lost.from_one(), camera.source))
    if tracker.duplicates:
        boxes = "1 box" if tracker.duplicates == 1 else f"{tracker.duplicates} boxes"
        lines.append(f"{boxes} left out that lay on another")
    rejected, given = tracker.rejected
    if 2 * rejected > given:
        lines.append(f"{rejected} of {given} detections belong to no track: too rarely found again")
    return lines
