"""The clips of the drone experiment, what a detector finds in them, and what the networks say; each made once."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.drone.models import as_detections
from tsuiseki.tracking.drone.observations import Observation, Observers, file_digest, video_observations
from tsuiseki.tracking.evaluation.action_files import LabelledActions, read_labelled_actions
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.camera_motion import CameraMotionSettings
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth, read_tracks, write_detections
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.processes import on_all_cores
from tsuiseki.tracking.types import IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.store import Store, code_version

# Fixed on clips of other seeds, before anything was compared: violent motion, people dressed alike, and a detector that
# misses two in five. There the flow alone switches more than twice in a hundred frames.
TEST_SCENE = DroneSceneSettings(frames=300, camera="violent", people=9, look_alikes=0.5)
# The second set, to which everything learnt is carried over: few people from low and calm, as in Drone-Action.
SECOND_SCENE = DroneSceneSettings(frames=200, camera="calm", people=4, altitude=(10.0, 16.0), look_alikes=0.5)
FAULTS = DetectorFaults(jitter=0.07, missed=0.35, hidden=0.8, false_alarms=0.6)
FIRST_SEED, SECOND_SEED = 3000, 9000
# Of clips that the networks of actions learnt from, that chose the settings of the flow and of DeepSORT, that the costs
# of actions come from (docs/methods/drone.md), and that the detector's scores were made probabilities on
# (docs/methods/drone-detector.md).
SEEN = frozenset(
    [
        *range(1000, 1013),
        *range(20000, 20235),
        *range(21000, 21024),
        *range(2000, 2003),
        *range(20500, 20506),
        *range(910000, 910004),
    ]
)


@dataclass(frozen=True)
class Networks:
    """Exported models.

    Attributes:
        actions: one file a stream.
        appearance: appearance network.
        detector: None draws faulty detections from the labels.
    """

    actions: tuple[Path, ...]
    appearance: Path
    detector: Path | None = None


@dataclass(frozen=True)
class Clip:
    """A clip with all that is known of it before tracking.

    Attributes:
        folder: MOTChallenge sequence.
        truth: who is where.
        labels: who does what.
        seen: observations of the detected people.
        given: observations of the labelled people, in the order of ``given_labels``.
        given_labels: ``(N,)`` which labelled person each is.
    """

    folder: Path
    truth: GroundTruth
    labels: LabelledActions
    seen: list[Observation]
    given: list[Observation]
    given_labels: IntArray


ClipPlan: TypeAlias = tuple[str, DroneSceneSettings, int]


def prepare_clips(
    store: Store, plans: Sequence[ClipPlan], networks: Networks, say: Callable[[str], None]
) -> list[Clip]:
    """Make or load clips, on all cores; what is there from an earlier run is not made again.

    Args:
        store: keeps clips and observations.
        plans: name, scene and seed of each.
        networks: that look at them.
        say: gets a line for each clip.
    """
    clips = []
    for clip, drawn in on_all_cores(partial(_prepare, store, networks), plans):
        clips.append(clip)
        say(f"{clip.folder.name}: {'drawn and ' if drawn else ''}looked at, {len(clips)} of {len(plans)} clips")
    return clips


def _write_clip(folder: Path, scene: DroneSceneSettings, seed: int) -> Path:
    return write_clip(folder, plan_drone(scene, seed))


def _prepare(store: Store, networks: Networks, plan: ClipPlan) -> tuple[Clip, bool]:
    """The clip, and whether it had to be drawn."""
    name, scene, seed = plan
    missing = not store.has_made(name, _write_clip, scene, seed)
    folder = store.made(name, _write_clip, scene, seed)
    (clip,) = look_at([folder], observations_in(store), networks)
    return clip, missing


def observations_in(store: Store) -> Path:
    """The folder for observations that this version of the code makes."""
    return store.folder / "observations" / code_version([video_observations.__module__])


def look_at(folders: Sequence[Path], cache: Path, networks: Networks) -> list[Clip]:
    """Labelled clips with what detector and networks say of them.

    Args:
        folders: of the clips.
        cache: folder that keeps observations.
        networks: that look at them.
    """
    streams, appearance = ActionRecogniser(networks.actions, threads=1), Appearance(networks.appearance, threads=1)
    found = None if networks.detector is None else Detector(networks.detector, threads=1)
    return [_look(folder, cache, networks, streams, appearance, found) for folder in folders]


def _look(
    folder: Path,
    cache: Path,
    networks: Networks,
    streams: ActionRecogniser,
    appearance: Appearance,
    detector: Detector | None,
) -> Clip:
    sequence = read_sequence(folder)
    truth = read_ground_truth(sequence.ground_truth_path)
    key = {f"model {n}": file_digest(path) for n, path in enumerate((*networks.actions, networks.appearance))}
    if detector is None:
        if not sequence.detections_path.is_file():
            # The number in the name is the clip's own seed.
            rng = np.random.default_rng([int(number) for number in re.findall(r"\d+", folder.name)[:1]] or 0)
            drawn = simulate_detections(rng, truth, sequence.length, sequence.width, sequence.height, FAULTS)
            sequence.detections_path.parent.mkdir(exist_ok=True)
            write_detections(sequence.detections_path, drawn)
        detections: object = read_detections(sequence.detections_path, sequence.length)
        key["detections"] = file_digest(sequence.detections_path)
    else:
        detections = detector
        key["detections"] = f"{file_digest(networks.detector or Path())} from {detector.score_threshold}"
    camera = CameraMotionSettings()
    observers = Observers(detections, appearance, streams, camera)  # type: ignore[arg-type]
    seen = list(video_observations(folder, observers, {**key, "camera": repr(camera)}, cache))
    boxes, labels = as_detections(read_tracks(sequence.ground_truth_path), sequence.length)
    right = replace(observers, detect=boxes, describe=None, camera=None)
    given = list(
        video_observations(folder, right, {**key, "detections": file_digest(sequence.ground_truth_path)}, cache)
    )
    return Clip(folder, truth, read_labelled_actions(folder, "lenient")[0], seen, given, labels)
