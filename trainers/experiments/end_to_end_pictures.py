"""Networks that read pictures, trained on through the flow: the Siamese network and the heads of the detector.

Each is compared with itself as it ships, and with as many steps by its own loss alone. The tests are tracked with the
default's costs, which take all places of starts and ends alike, so that a gain is the network's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.evaluation.detection import evaluate_detections, labelled_boxes
from tsuiseki.tracking.evaluation.multi import SequencePair
from tsuiseki.tracking.evaluation.resampling import score_sums
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.preprocessing import crop_boxes, fit_image
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fitted
from tsuiseki.trainers.association.flow_loss import FlowLoss
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.starting import siamese_of
from tsuiseki.trainers.association.training import AppearanceLearning, AssociationTraining, HeadsLearning
from tsuiseki.trainers.association.videos import LIKE_REAL, detected_videos, filmed
from tsuiseki.trainers.association.window_detector import FrozenTrunk
from tsuiseki.trainers.association.windows import FLOWS, TrackerName, WindowImages, affordable
from tsuiseki.trainers.experiments.given_sequences import combined_scores, score_table
from tsuiseki.trainers.experiments.study import Bench, Study, Table
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining
from tsuiseki.trainers.networks.detector_training import DetectorTraining, detections

PETS = "mot/PETS09-S2L1-first"
FRAMES, CLIPS, SEED = 60, 6, 500
LOOK_ALIKES, UNLIKE = 0.7, 0.0
# Of the Siamese network: steps, seconds of a window, its learning rate, and numbers that a projection leaves.
APPEARANCE_WAYS = ("as it ships", "its own loss", "through the flow", "projected, its own loss", "projected, the flow")
APPEARANCE_FIT, APPEARANCE_RATE, KEPT = Fit(steps=40, seconds=1.5), 0.05, 32
# Of the heads: likewise, and the weight of their own loss.
HEADS_WAYS = ("as it ships", "its own loss", "the flow's loss", "both losses")
HEADS_FIT, HEADS_RATE, HEADS_OWN = Fit(steps=20, seconds=0.6), 0.1, 0.3
# The heads learn from as many frames of PETS as their trunk reads in a minute.
HEADS_FROM = 201
# They learn from unsure detections, too; `tsuiseki track people` tracks the others.
LEARNT_FROM, TRACKED_FROM = 0.1, 0.3
# Of which the maps of the trunk are kept: 1 GB.
MOST_IMAGES = 400


@dataclass(frozen=True)
class FramesOf:
    """A part of a sequence with pictures.

    Attributes:
        folder: of the sequence.
        first: its first frame, 1-based.
        last: its last frame, included.
    """

    folder: Path
    first: int
    last: int


@dataclass(frozen=True)
class Taught:
    """Parts of sequences that teach, and parts that are tracked.

    Attributes:
        start: exported network that is trained on.
        train: the first.
        tests: the second.
        tracker: whose costs are taken.
    """

    start: Path
    train: tuple[FramesOf, ...]
    tests: tuple[FramesOf, ...]
    tracker: TrackerName = "people"


def appearance_tables(bench: Bench, data: Path) -> tuple[list[Table], dict[str, Any]]:
    """The Siamese network that ships, trained on by its own loss, and through the flow."""
    start = shipped("appearance_people")
    sources = {
        "PETS 1–300 → 301–400": _pets(start, data),
        "streets of look-alikes": _clips(start, bench, write_pictured, LOOK_ALIKES),
        "streets of unlike clothing": _clips(start, bench, write_pictured, UNLIKE),
        "drone, look-alikes": _clips(start, bench, write_drones, LOOK_ALIKES, "drone"),
        "drone, unlike clothing": _clips(start, bench, write_drones, UNLIKE, "drone"),
    }
    tables, values = list[Table](), dict[str, Any]()
    for title, source in sources.items():
        if source is not None:
            study = Study(dict(zip(APPEARANCE_WAYS, APPEARANCE_WAYS, strict=True)), [source], appearance_sums, title)
            rows = {str(way): np.stack(sums) for way, (sums,) in study.run(bench).items()}
            tables.append(score_table(title, rows, APPEARANCE_WAYS[:1]))
            values[title] = {way: combined_scores(sums) for way, sums in rows.items()}
    return tables, values


def heads_tables(bench: Bench, data: Path) -> tuple[list[Table], dict[str, Any]]:
    """The detector of drawn people, its heads trained on by its own loss, through the flow, and by both."""
    start = shipped("detector_street")
    sources = {
        f"PETS {HEADS_FROM}–300 → 301–400": _pets(start, data, HEADS_FROM),
        "streets": _clips(start, bench, write_pictured, UNLIKE),
    }
    tables, values = list[Table](), dict[str, Any]()
    for title, source in sources.items():
        if source is not None:
            bench.watch.say(f"heads, {title}")
            every = bench.store.recall(heads_sums, source)
            found = {way: np.stack(sums) for way, sums in zip(HEADS_WAYS, every, strict=True)}
            rows = {way: sums[:, :83] for way, sums in found.items()}
            precision = {way: f"{sums[:, 83].mean():.3f}" for way, sums in found.items()}
            tables.append(score_table(title, rows, HEADS_WAYS[:1], precision, "AP50"))
            values[title] = {way: {**combined_scores(rows[way]), "AP50": precision[way]} for way in rows}
    return tables, values


def _pets(start: Path, data: Path, first: int = 1) -> Taught | None:
    folder = data / PETS
    if not folder.is_dir():
        return None
    return Taught(start, (FramesOf(folder, first, 300),), tuple(FramesOf(folder, a, a + 49) for a in (301, 351)))


def _clips(
    start: Path, bench: Bench, write: Callable[..., None], look_alikes: float, tracker: TrackerName = "people"
) -> Taught:
    """Generated clips with pictures: half of them to learn from, half to track."""
    home = bench.store.made("pictured", write, CLIPS, FRAMES, look_alikes)
    clips = tuple(FramesOf(folder, 1, FRAMES) for folder in sorted(home.iterdir()))
    return Taught(start, clips[: CLIPS // 2], clips[CLIPS // 2 :], tracker)


def appearance_sums(way: str, source: Taught) -> list[FloatArray]:
    """``(83,)`` sums of the scores of each test, see `score_sums`.

    Args:
        way: one of `APPEARANCE_WAYS`; ``projected`` leaves the network as it is, and trains a projection of its
            features.
        source: sequences that teach, and that are tracked.
    """
    settings, projects, start = FLOWS[source.tracker], way.startswith("projected"), source.start
    read = read_filmed if source.tracker == "drone" else read_frames
    torch.manual_seed(0)
    siamese, _ = siamese_of(start)
    learning = AppearanceLearning(
        None if projects else start, APPEARANCE_RATE, contrast=0.3, projection=KEPT if projects else 0
    )
    module = AssociationTraining(appearance=learning, joins=0.0)
    if way != APPEARANCE_WAYS[0]:
        module.network.requires_grad_(False)
        module.link_cost = settings.costs.link
        graphs = [graphs_of_video(_described(read(one), siamese), settings) for one in source.train]
        fit = replace(APPEARANCE_FIT, flow=0.0 if way.endswith("its own loss") else 1.0)
        size = siamese.card.input_height, siamese.card.input_width
        fitted(module, graphs, fit, WindowImages(crops=None if projects else size))
    sums = []
    for one in source.tests:
        video = _described(read(one), module.siamese or siamese)
        found = [NetworkChanges(module.network).projected(each) for each in video.detections]
        sums.append(tracked_sums(video, found, settings))
    return sums


def heads_sums(source: Taught) -> list[list[FloatArray]]:
    """For each of `HEADS_WAYS` and each test ``(84,)``: sums of scores, then AP50.

    Args:
        source: sequences that teach, and that are tracked.
    """
    start = source.start
    found, trunk = Detector(start, LEARNT_FROM, threads=1), FrozenTrunk(MOST_IMAGES)
    graphs = [graphs_of_video(read_frames(one, found)) for one in source.train]
    videos = [read_frames(one) for one in source.tests]
    sums = []
    for way in HEADS_WAYS:
        torch.manual_seed(0)
        own = 0.0 if way == "the flow's loss" else HEADS_OWN
        module = AssociationTraining(
            loss=FlowLoss("fenchel_young"), detector=HeadsLearning(start, HEADS_RATE, own), joins=0.0
        )
        module.trunk = trunk
        module.network.requires_grad_(False)
        if way != HEADS_WAYS[0]:
            fit = replace(HEADS_FIT, flow=0.0 if way == "its own loss" else 1.0)
            fitted(module, graphs, fit, WindowImages(frames=found.model.card))
        assert module.detector is not None
        sums.append([_detected_sums(video, module.detector, trunk) for video in videos])
    return sums


def read_frames(part: FramesOf, detector: Detector | None = None) -> DetectedVideo:
    """The labels of a part of a sequence with given detections, or with those of a detector."""
    (video,) = detected_videos([part.folder], detector or "given", (part.first, part.last))
    return video


def read_filmed(part: FramesOf) -> DetectedVideo:
    """As `read_frames`, with the camera's motion from the images."""
    return filmed(read_frames(part))


def graphs_of_video(video: DetectedVideo, settings: FlowSettings | None = None) -> Graphs:
    """The networks of a video at the tracker's own costs."""
    graphs = sequence_graphs(video, settings)
    return Graphs(affordable(graphs.detections), graphs.tracklets)


def tracked_sums(video: DetectedVideo, found: list[Detections], settings: FlowSettings | None = None) -> FloatArray:
    """``(83,)`` sums of the flow's tracks with its own costs, see `score_sums`."""
    tracker = FlowTracker(settings, frame_rate=video.frame_rate, size=video.size, camera=video.path())
    for one in found:
        tracker.update(one)
    return score_sums(SequencePair(video.name, video.truth, tracker.tracks(), len(video.detections)))


def _described(video: DetectedVideo, siamese: AppearanceTraining) -> DetectedVideo:
    """The video with the network's features of its detections."""
    siamese.eval()
    card, found = siamese.card, []
    for one, path in zip(video.detections, video.images, strict=True):
        crops = crop_boxes(read_image(path), one.boxes, card.input_height, card.input_width)
        with torch.no_grad():
            features = siamese(torch.as_tensor(crops)) if len(crops) else torch.empty(0, card.feature_length)
        found.append(one.with_features(features.double().numpy()))
    return replace(video, detections=found)


def _detected_sums(video: DetectedVideo, detector: DetectorTraining, trunk: FrozenTrunk) -> FloatArray:
    every = [_found(read_image(path), detector, trunk) for path in video.images]
    precision = evaluate_detections(labelled_boxes(video.truth, range(len(every))), every).average_precision
    sure = [Detections(f.boxes[f.scores >= TRACKED_FROM], f.scores[f.scores >= TRACKED_FROM]) for f in every]
    return np.append(tracked_sums(video, sure, FLOWS["people"]), precision)


@torch.no_grad()
def _found(image: ImageArray, detector: DetectorTraining, trunk: FrozenTrunk) -> Detections:
    """All detections in an image, however unsure."""
    fitted_image, scale = fit_image(image, detector.card)
    heads = trunk.heads(detector, torch.from_numpy(fitted_image)[None])
    (found,) = detections(*heads, detector.network.anchors, detector.card)
    boxes = clip_boxes(found.boxes / np.tile(scale, 2), image.shape[1], image.shape[0])
    whole = ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
    return Detections(boxes[whole], found.scores[whole])


def write_pictured(folder: Path, clips: int, frames: int, look_alikes: float) -> None:
    """Streets with pictures, 10 frames a second, and det.txt of one simulated detector.

    Args:
        folder: is made.
        clips: how many.
        frames: of each.
        look_alikes: probability of being dressed much like somebody else around.
    """
    settings = StreetSettings(
        frames=frames, frame_rate=10.0, people=12, look_alikes=look_alikes, person_height=(40.0, 170.0)
    )
    for number in range(clips):
        home = write_clip(folder / f"street-{number:02d}", plan_street(settings, SEED + number))
        write_simulated(home, settings, np.random.default_rng([SEED + number, 2]), replace(LIKE_REAL, missed=0.1))


def write_drones(folder: Path, clips: int, frames: int, look_alikes: float) -> None:
    """Clips from a drone that hovers; otherwise as `write_pictured`."""
    settings = DroneSceneSettings(
        640, 360, frames, 10.0, camera="calm", altitude=(10.0, 20.0), look_alikes=look_alikes, samples=1
    )
    for number in range(clips):
        home = write_clip(folder / f"drone-{number:02d}", plan_drone(settings, SEED + number))
        write_simulated(home, settings, np.random.default_rng([SEED + number, 3]), replace(LIKE_REAL, missed=0.1))


def write_simulated(
    home: Path, settings: StreetSettings | DroneSceneSettings, rng: np.random.Generator, faults: DetectorFaults
) -> None:
    """Add det.txt of a simulated detector to a labelled clip."""
    truth = read_ground_truth(home / "gt" / "gt.txt")
    found = simulate_detections(rng, truth, settings.frames, settings.width, settings.height, faults)
    (home / "det").mkdir(parents=True)
    write_detections(home / "det" / "det.txt", found)
