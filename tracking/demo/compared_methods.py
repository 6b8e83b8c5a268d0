"""What `tsuiseki demo` does with a generated clip: the models it takes, and three methods on the same detections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from tsuiseki.tracking import weights
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, SequencePair, evaluate_sequences
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.people.inputs import PeopleInputs, ground_of
from tsuiseki.tracking.people.methods import people_tracker
from tsuiseki.tracking.people.settings import PeopleMethod
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.video.source import Source

# What each method is called in table and report; the tracks of the last one are drawn.
STREET_METHODS: Mapping[PeopleMethod, str] = {"sort": "SORT", "deepsort": "DeepSORT", "flow": "Min-cost flow"}
DRONE_METHODS: Mapping[Literal["flow", "flow-saf", "flow-maf"], str] = {
    "flow": "flow",
    "flow-saf": "flow, single-frame actions",
    "flow-maf": "flow, multi-frame actions",
}
# What ships for people, by what it does.
STREET_MODELS = {"detector": weights.PEOPLE_DETECTOR, "appearance": "appearance_people", "affinity": "affinity_people"}


def shipped_street() -> dict[str, Path]:
    """The files of `STREET_MODELS`."""
    return {kind: weights.shipped(name) for kind, name in STREET_MODELS.items()}


def street_inputs(
    source: Source,
    models: Mapping[str, Path],
    threads: int,
    camera: StandingCamera | None = None,
    device: Device = "auto",
) -> PeopleInputs:
    """Where people on a street come from; ``models`` are files by the kinds of `STREET_MODELS`."""
    detector = Detector(models["detector"], threads=threads, device=device)
    appearance = Appearance(models["appearance"], threads, device=device)
    return PeopleInputs(source, detector, appearance, camera=camera, ground=ground_of(detector, "auto", source))


def street_trackers(
    source: Source, models: Mapping[str, Path], threads: int, camera: StandingCamera | None = None
) -> dict[str, PeopleTracker]:
    """A tracker for each of `STREET_METHODS`, by its name, as `tsuiseki track people` would make it."""
    affinity = Affinity(models["affinity"], threads)
    return {
        name: people_tracker(method, None, affinity, source=source, camera=camera, drop_straddling=True)
        for method, name in STREET_METHODS.items()
    }


def scored(
    clip: str, truth: GroundTruth, tracks: Mapping[str, list[Track]], frames: int
) -> dict[str, PeopleEvaluation]:
    """The scores of the tracks of each method on the clip of that name, whose first ``frames`` were tracked."""
    return {name: evaluate_sequences([SequencePair(clip, truth, found, frames)]) for name, found in tracks.items()}
