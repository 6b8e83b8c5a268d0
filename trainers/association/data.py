"""Windows of labelled sequences with their detections, for learning the costs of the flow through the flow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import lightning
import numpy as np
from torch.utils.data import DataLoader, Dataset

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.mot import Sequence as VideoSequence
from tsuiseki.tracking.formats.mot import find_sequences, list_images, read_detections
from tsuiseki.tracking.trackers.people.flow import FlowSettings
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.association.graphs import DetectedVideo, Graph, Graphs, sequence_graphs, window
from tsuiseki.trainers.association.window_appearance import WindowCrops, crops_of
from tsuiseki.trainers.experiments.association.oracle import owners_of

# A link that costs more by default is none that training could still make worth taking.
DEAREST = 12.0
# Okutama-Action's videos.
OTHER_RATE = 30.0


@dataclass(frozen=True)
class TrainingWindow:
    """What a step of training sees.

    Attributes:
        detections: the network of a window.
        tracklets: the joins of its whole sequence.
        crops: what its detections look like; None where nothing looks at them.
    """

    detections: Graph
    tracklets: Graph
    crops: WindowCrops | None = None


class RandomWindows(Dataset[TrainingWindow]):
    """Windows at random places, longer sequences the more often; each is decided by seed, epoch and number alone.

    Args:
        graphs: of the sequences.
        seconds: length of a window.
        count: windows an epoch.
        seed: of the places, and of the epoch, asked anew for every window.
        crop_size: height and width of crops; None for none.
    """

    def __init__(
        self,
        graphs: Sequence[Graphs],
        seconds: float,
        count: int,
        seed: Callable[[], tuple[int, int]],
        crop_size: tuple[int, int] | None = None,
    ) -> None:
        self.graphs, self.seconds, self.count, self.seed, self.crop_size = graphs, seconds, count, seed, crop_size
        sizes = np.array([len(one.detections) for one in graphs], dtype=np.float64)
        self.chances = sizes / sizes.sum()

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> TrainingWindow:
        if index >= self.count:
            raise IndexError(index)
        rng = np.random.default_rng([*self.seed(), index])
        chosen = self.graphs[int(rng.choice(len(self.graphs), p=self.chances))]
        graph = chosen.detections
        length, last = max(2, round(self.seconds * graph.frame_rate)), int(graph.frames.max(initial=0)) + 1
        # A window may reach over either end of the sequence, so that its borders are seen as often as the rest.
        first = int(rng.integers(-length // 2, max(last - length // 2, 1)))
        return _with_crops(window(graph, max(first, 0), min(first + length, last)), chosen.tracklets, self.crop_size)


class EveryWindow(Dataset[TrainingWindow]):
    """The sequences cut into windows end to end."""

    def __init__(self, graphs: Sequence[Graphs], seconds: float, crop_size: tuple[int, int] | None = None) -> None:
        self.crop_size = crop_size
        self.windows = [
            TrainingWindow(window(one.detections, first, first + length), one.tracklets)
            for one in graphs
            for length in [max(2, round(seconds * one.detections.frame_rate))]
            for first in range(0, int(one.detections.frames.max(initial=0)) + 1, length)
        ]

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, index: int) -> TrainingWindow:
        held = self.windows[index]
        return _with_crops(held.detections, held.tracklets, self.crop_size)


def _with_crops(detections: Graph, tracklets: Graph, size: tuple[int, int] | None) -> TrainingWindow:
    crops = None if size is None else crops_of(detections, *size)
    return TrainingWindow(detections, tracklets, crops)


class AssociationData(lightning.LightningDataModule):
    """Windows of labelled sequences.

    Args:
        train: sequences to learn from, or folders of them: MOTChallenge (generated clips and KITTI's text, too) or
            Okutama-Action.
        validation: likewise, to choose the checkpoint by; by default the last part of every training sequence.
        held_back: that part, a share of the frames.
        frames: first and last frame to learn from, 1-based and both included.
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.
        detector: exported detector to use in place of both.
        appearance: exported network that describes the detections for the tracker; with it the windows hold crops.
        seconds: length of a window.
        windows: steps of an epoch.
        seed: of windows and of simulated detections.
    """

    def __init__(
        self,
        train: list[Path],
        validation: list[Path] | None = None,
        held_back: float = 0.2,
        frames: tuple[int, int] | None = None,
        detections: Literal["given", "simulated"] = "given",
        detector: Path | None = None,
        appearance: Path | None = None,
        seconds: float = 2.0,
        windows: int = 40,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if seconds <= 0 or windows < 1 or not 0 < held_back < 1:
            raise RequestError("expected seconds above 0, windows from 1 and held_back in (0, 1)")
        self.train, self.validation, self.held_back, self.frames = train, validation, held_back, frames
        self.detections, self.detector, self.appearance = detections, detector, appearance
        self.crop_size: tuple[int, int] | None = None
        self.seconds, self.windows, self.seed = seconds, windows, seed
        self.learnt: list[Graphs] = []
        self.held: list[Graphs] = []

    @property
    def described(self) -> str:
        """What is learnt from, in words."""
        stretch = "" if self.frames is None else f", frames {self.frames[0]}-{self.frames[1]}"
        return ", ".join(path.name for path in self.train) + stretch

    def setup(self, stage: str) -> None:
        """Track every sequence once, and keep its networks."""
        del stage
        if self.learnt:
            return
        find = self.detections if self.detector is None else Detector(self.detector)
        look = None if self.appearance is None else Appearance(self.appearance)
        if look is not None:
            self.crop_size = look.model.card.input_height, look.model.card.input_width
        videos = [described(video, look) for video in detected_videos(self.train, find, self.frames, self.seed)]
        if self.validation is None:
            held = [_stretch(video, 1 - self.held_back, 1.0) for video in videos]
            videos = [_stretch(video, 0.0, 1 - self.held_back) for video in videos]
        else:
            held = [described(video, look) for video in detected_videos(self.validation, find, None, self.seed)]
        self.learnt, self.held = graphs_of(videos), graphs_of(held, check=False)

    def train_dataloader(self) -> DataLoader[TrainingWindow]:
        """Windows at random places, others in every epoch."""
        data = RandomWindows(self.learnt, self.seconds, self.windows, self._seed, self.crop_size)
        return DataLoader(data, batch_size=None, collate_fn=None)

    def _seed(self) -> tuple[int, int]:
        return self.seed, 0 if self.trainer is None else self.trainer.current_epoch

    def val_dataloader(self) -> DataLoader[TrainingWindow]:
        """All windows of what was held back."""
        return DataLoader(EveryWindow(self.held, self.seconds, self.crop_size), batch_size=None)


def graphs_of(
    videos: Sequence[DetectedVideo], settings: FlowSettings | None = None, check: bool = True
) -> list[Graphs]:
    """The networks of sequences, without links that are far too dear.

    Raises:
        RequestError: no sequence has two people that could be taken for each other; only with ``check``.
    """
    found = [sequence_graphs(video, settings) for video in videos]
    graphs = [replace(one, detections=affordable(one.detections)) for one in found if len(one.detections)]
    several = [one for one in graphs if len(np.unique(one.detections.owners[one.detections.owners >= 0])) > 1]
    if check and not several:
        names = ", ".join(video.name for video in videos) or "nothing"
        raise RequestError(f"expected a sequence with two people, who could be taken for each other; got {names}")
    return graphs


def affordable(graph: Graph, most: float = DEAREST) -> Graph:
    """The graph without the links that cost more than ``most`` by default, unless the labelled flow has them."""
    nodes = 3 * len(graph)
    kept = (graph.costs[nodes:] <= most) | (graph.labelled[nodes:] > 0)
    every = np.append(np.ones(nodes, np.bool_), kept)
    return replace(
        graph,
        costs=graph.costs[every],
        tail=graph.tail[kept],
        head=graph.head[kept],
        links=graph.links[kept],
        labelled=graph.labelled[every],
    )


def detected_videos(
    folders: Sequence[Path],
    find: Detector | Literal["given", "simulated"],
    frames: tuple[int, int] | None = None,
    seed: int = 0,
    faults: DetectorFaults | None = None,
) -> Iterator[DetectedVideo]:
    """The labelled sequences of folders, with detections.

    Args:
        folders: sequences, or folders of them.
        find: det/det.txt, detections drawn from the labels, or a detector that looks at the images.
        frames: first and last frame, 1-based.
        seed: of drawn detections.
        faults: of drawn detections.

    Raises:
        RequestError: labels without detections, an id twice in a frame, nobody who counts, or detections that lie on
            nobody.
    """
    rng = np.random.default_rng(seed)
    for folder in folders:
        for labelled in open_labelled(folder):
            sequence = _sequence(folder, labelled.name)
            truth = labelled.people()
            length = labelled.length or int(truth.frames.max(initial=-1)) + 1
            rate, size = (OTHER_RATE, None) if sequence is None else (sequence.frame_rate, _size(sequence))
            if find == "given":
                found = _given(folder, labelled.name, sequence, length)
            elif find == "simulated":
                wide, tall = size or np.ceil(truth.boxes[:, 2:].max(axis=0)).astype(int).tolist()
                found = simulate_detections(rng, truth, length, wide, tall, faults or DetectorFaults())
            else:
                found = _detected(labelled.name, sequence, find)
            images = () if sequence is None else sequence.images
            video = DetectedVideo(labelled.name, found, truth, rate, size, images)
            check_video(video)
            yield video if frames is None else _between(video, frames[0] - 1, frames[1])


def described(video: DetectedVideo, appearance: Appearance | None) -> DetectedVideo:
    """The sequence with what its detections look like.

    Raises:
        RequestError: it has no images.
    """
    if appearance is None:
        return video
    if len(video.images) < len(video.detections):
        raise RequestError(
            f"{video.name}: expected an image a frame in img1/ for the appearance, got {len(video.images)}"
        )
    detections = [
        found.with_features(appearance.describe(read_image(path), found.boxes))
        for found, path in zip(video.detections, video.images, strict=False)
    ]
    return replace(video, detections=detections)


def check_video(video: DetectedVideo) -> None:
    """Refuse what would be learnt from silently and wrongly.

    Raises:
        RequestError: nobody who counts, or detections that lie on nobody.
    """
    truth = video.truth.select(video.truth.evaluated)
    if not len(truth):
        raise RequestError(
            f"{video.name}: expected labels of people who count, got none; see columns 7 and 8 of gt.txt"
        )
    counts = [len(found) for found in video.detections]
    boxes = np.concatenate([found.boxes for found in video.detections]) if sum(counts) else np.empty((0, 4))
    owners = owners_of(np.repeat(np.arange(len(counts)), counts), boxes, truth)
    if len(boxes) and not (owners >= 0).any():
        raise RequestError(
            f"{video.name}: expected detections on labelled people, but none of {len(boxes)} overlaps one by half; are "
            "they of the same class, size and frames?"
        )


def _sequence(folder: Path, name: str) -> VideoSequence | None:
    try:
        return next((one for one in find_sequences(folder) if one.name == name), None)
    except RequestError:
        return None


def _size(sequence: VideoSequence) -> tuple[int, int] | None:
    return (sequence.width, sequence.height) if min(sequence.width, sequence.height) > 0 else None


def _given(folder: Path, name: str, sequence: VideoSequence | None, length: int) -> list[Detections]:
    if sequence is None or not sequence.detections_path.is_file():
        raise RequestError(
            f"{folder}: expected det/det.txt beside the labels of {name}, found none; give a detector, or detections "
            "simulated"
        )
    return read_detections(sequence.detections_path, length)


def _detected(name: str, sequence: VideoSequence | None, detector: Detector) -> list[Detections]:
    images = [] if sequence is None else list_images(sequence.folder / "img1")
    if not images:
        raise RequestError(f"{name}: expected images for the detector in img1/, found none; give detections instead")
    return [detector.detect([read_image(path)])[0] for path in images]


def _stretch(video: DetectedVideo, first: float, last: float) -> DetectedVideo:
    count = len(video.detections)
    return _between(video, round(first * count), round(last * count))


def _between(video: DetectedVideo, first: int, end: int) -> DetectedVideo:
    """The frames from ``first`` to before ``end``, numbered from 0."""
    first, end = max(first, 0), min(end, len(video.detections))
    truth: GroundTruth = video.truth.between(first, end - 1)
    moved = replace(truth, frames=truth.frames - first)
    images = video.images[first:end]
    return replace(video, detections=list(video.detections[first:end]), truth=moved, images=images)
