"""Windows of labelled sequences with their detections, for learning the costs of the flow through the flow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from torch.utils.data import DataLoader, Dataset

from tsuiseki.datamodules.labelled_images import LabelledPart, labelled_parts
from tsuiseki.datamodules.network_data import NetworkData
from tsuiseki.tracking.drone.settings import DRONE_FLOW
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.flow.graphs import DetectedVideo, Graph, Graphs, kept_of, sequence_graphs, window, windows
from tsuiseki.trainers.flow.videos import OTHER_RATE, acting, described, detected_videos, filmed, part_of
from tsuiseki.trainers.flow.window_costs import WindowCrops, WindowFrames, crops_of, frames_of

TrackerName = Literal["people", "drone"]
FLOWS: dict[TrackerName, FlowSettings] = {"people": FlowSettings().alike(), "drone": DRONE_FLOW}
# A link that costs more by default is none that training could still make worth taking.
DEAREST = 12.0


@dataclass(frozen=True)
class TrainingWindow:
    """What a step of training sees.

    Attributes:
        detections: the network of a window.
        tracklets: the joins of its whole sequence.
        crops: what its detections look like; None where not needed.
        frames: its images; None where no detector learns from them.
    """

    detections: Graph
    tracklets: Graph
    crops: WindowCrops | None = None
    frames: WindowFrames | None = None


@dataclass(frozen=True)
class WindowImages:
    """What the networks that learn with the costs see of a window.

    Attributes:
        crops: height and width of crops for the Siamese network; None for none.
        frames: how images are fitted into the detector; None for no images.
    """

    crops: tuple[int, int] | None = None
    frames: ModelCard | None = None

    def at(self, detections: Graph, tracklets: Graph) -> TrainingWindow:
        """The window with its observations."""
        crops = None if self.crops is None else crops_of(detections, *self.crops)
        frames = None if self.frames is None else frames_of(detections, self.frames)
        return TrainingWindow(detections, tracklets, crops, frames)


class RandomWindows(Dataset[TrainingWindow]):
    """Windows of so many ``seconds`` at random places, longer sequences the more often, ``count`` an epoch.

    Each is decided by seed, epoch and number alone; the first two are asked anew for every window.
    """

    def __init__(
        self,
        graphs: Sequence[Graphs],
        seconds: float,
        count: int,
        seed: Callable[[], tuple[int, int]],
        images: WindowImages = WindowImages(),
    ) -> None:
        self.graphs, self.seconds, self.count, self.seed, self.images = graphs, seconds, count, seed, images
        sizes = np.array([len(graph.detections) for graph in graphs], dtype=np.float64)
        self.chances = sizes / sizes.sum()

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> TrainingWindow:
        if index >= self.count:
            raise IndexError(index)
        rng = np.random.default_rng([*self.seed(), index])
        chosen = self.graphs[int(rng.choice(len(self.graphs), p=self.chances))]
        graph = chosen.detections
        length, last = max(2, round(self.seconds * graph.frame_rate)), int(graph.nodes.frames.max(initial=0)) + 1
        # A window may reach over either end of the sequence, so that its borders are learnt from as often as the rest.
        first = int(rng.integers(-length // 2, max(last - length // 2, 1)))
        return self.images.at(window(graph, max(first, 0), min(first + length, last)), chosen.tracklets)


class EveryWindow(Dataset[TrainingWindow]):
    """The sequences cut into windows end to end."""

    def __init__(self, graphs: Sequence[Graphs], seconds: float, images: WindowImages = WindowImages()) -> None:
        self.images = images
        self.windows = [
            TrainingWindow(part, graph.tracklets) for graph in graphs for part in windows(graph.detections, seconds)
        ]

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, index: int) -> TrainingWindow:
        held = self.windows[index]
        return self.images.at(held.detections, held.tracklets)


class AssociationData(NetworkData):
    """Windows of labelled sequences; a step takes one.

    Args:
        train: sequences to learn from, or folders of them: MOTChallenge (generated clips, too), KITTI tracking,
            Okutama-Action, VisDrone-MOT or Drone-Action.
        val: likewise, to choose the checkpoint by; by default the last part of every training sequence.
        val_share: that part, a share of the frames.
        batches: steps of an epoch.
        frames: first and last frame to learn from, 1-based and both included.
        detections: ``given`` takes det/det.txt of each sequence; ``simulated`` draws faulty ones from the labels.
        detector: exported detector, or the name of a shipped one, to use in place of both.
        score_threshold: it keeps what scores at least this, from 0 to 1; lower where its heads are to learn.
        heads: the windows hold their images, for the detector's heads, which learn with the costs.
        appearance: exported network that describes the detections for the tracker; with it the windows hold crops.
        frame_rate: frames a second of layouts that do not tell it, as Okutama-Action's.
        tracker: whose costs the training starts from, and who takes what it learns: track ``people`` or ``drone``,
            which takes the camera's motion from the images.
        action: exported action streams, which say what people do; only ``drone`` has a cost for it.
        seconds: length of a window.
        seed: of windows and of simulated detections.

    Raises:
        RequestError: a folder is missing, or arguments are out of bounds or do not belong together.
    """

    kind = "association"

    def __init__(
        self,
        train: Sequence[Path | str] | Path | str,
        val: Sequence[Path | str] | Path | str | None = None,
        val_share: float = 0.2,
        batches: int = 40,
        frames: tuple[int, int] | None = None,
        detections: Literal["given", "simulated"] = "given",
        detector: Path | str | None = None,
        score_threshold: float = 0.3,
        heads: bool = False,
        appearance: Path | str | None = None,
        frame_rate: float = OTHER_RATE,
        tracker: TrackerName = "people",
        action: list[Path] | None = None,
        seconds: float = 2.0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        if min(seconds, frame_rate) <= 0 or batches < 1 or not 0 < val_share < 1 or not 0 <= score_threshold <= 1:
            raise RequestError(
                "expected seconds and frame_rate above 0, batches from 1, val_share in (0, 1) and score_threshold from "
                "0 to 1"
            )
        if heads and detector is None:
            raise RequestError("expected --data.detector ONNX with --data.heads, for its heads to learn; got none")
        self.train = [Path(part.folder) for part in labelled_parts(train, "train", LabelledPart)]
        self.val = None if val is None else [Path(part.folder) for part in labelled_parts(val, "val", LabelledPart)]
        self.val_share, self.frames = val_share, frames
        if action and tracker != "drone":
            raise RequestError("expected --data.tracker drone with --data.action, for people have no cost of actions")
        self.detections, self.detector, self.appearance = detections, detector, appearance
        self.frame_rate = frame_rate
        self.tracker, self.settings, self.action = tracker, FLOWS[tracker], action or []
        self.score_threshold, self.heads = score_threshold, heads
        self.images = WindowImages()
        self.seconds, self.batches, self.seed = seconds, batches, seed
        self.learnt: list[Graphs] = []
        self.held: list[Graphs] = []

    @property
    def described(self) -> str:
        """What is learnt from, in words."""
        part = "" if self.frames is None else f", frames {self.frames[0]}-{self.frames[1]}"
        return ", ".join(path.name for path in self.train) + part

    def setup(self, stage: str) -> None:
        """Track every sequence once, and keep its networks."""
        del stage
        if self.learnt:
            return
        detector = appearance = crops = None
        if self.detector is not None:
            detector = Detector(shipped_or_file("detector", self.detector), self.score_threshold)
        if self.appearance is not None:
            appearance = Appearance(shipped_or_file("appearance", self.appearance))
            crops = appearance.model.card.input_height, appearance.model.card.input_width
        self.images = WindowImages(crops, detector.model.card if detector is not None and self.heads else None)
        recognise = ActionRecogniser(self.action) if self.action else None

        def detected(folders: list[Path], frames: tuple[int, int] | None) -> list[DetectedVideo]:
            videos = detected_videos(folders, detector or self.detections, frames, self.seed, self.frame_rate)
            videos = map(filmed, videos) if self.tracker == "drone" else videos
            return [acting(described(video, appearance), recognise) for video in videos]

        videos = detected(self.train, self.frames)
        if self.val is None:
            held = [part_of(video, 1 - self.val_share, 1.0) for video in videos]
            videos = [part_of(video, 0.0, 1 - self.val_share) for video in videos]
        else:
            held = detected(self.val, None)
        self.learnt = graphs_of(videos, self.settings)
        self.held = graphs_of(held, self.settings, check=False)

    def train_dataloader(self) -> DataLoader[TrainingWindow]:
        """Windows at random places, others in every epoch."""
        data = RandomWindows(self.learnt, self.seconds, self.batches, self._seed, self.images)
        return DataLoader(data, batch_size=None, collate_fn=None)

    def _seed(self) -> tuple[int, int]:
        # Devices share the windows of an epoch out among them.
        return self.seed, 0 if self.trainer is None else self.epoch_seed()[1]

    def val_dataloader(self) -> DataLoader[TrainingWindow]:
        """All windows of what was held back."""
        return DataLoader(EveryWindow(self.held, self.seconds, self.images), batch_size=None)

    def test_dataloader(self) -> DataLoader[TrainingWindow]:
        return self.val_dataloader()

    def predict_dataloader(self) -> DataLoader[TrainingWindow]:
        return self.val_dataloader()


def graphs_of(
    videos: Sequence[DetectedVideo], settings: FlowSettings | None = None, check: bool = True
) -> list[Graphs]:
    """The networks of sequences, without links that are far too dear.

    With ``check`` sequences that teach nothing are named and left out, and those are named whose labels seem foreign.

    Raises:
        RequestError: no sequence has two people that could be taken for each other; only with ``check``.
    """
    graphs = [sequence_graphs(video, settings) for video in videos]
    if check:
        graphs = [graph for graph, video in zip(graphs, videos, strict=True) if _teaches(graph.detections, video.name)]
        if not graphs:
            names = ", ".join(video.name for video in videos) or "nothing"
            raise RequestError(f"expected a sequence with two people, who could be taken for each other; got {names}")
    return [replace(graph, detections=affordable(graph.detections)) for graph in graphs if len(graph.detections)]


def _teaches(graph: Graph, name: str) -> bool:
    """Whether two people have detections; says what speaks against a sequence."""
    owners = graph.nodes.owners[graph.nodes.owners >= 0]
    people = len(np.unique(owners))
    if people < 2:
        who = "no person" if not people else "one person"
        print(f"{name}: left out, for its detections in the frames to learn from show {who} who is labelled")
    elif 2 * len(owners) < len(graph):
        share = 1 - len(owners) / len(graph)
        print(f"{name}: {share:.0%} of its detections are false positives; are all labelled, and of the same class?")
    return people > 1


def affordable(graph: Graph) -> Graph:
    """The graph without the links that cost more than `DEAREST` by default, unless the labelled flow has them."""
    nodes = 3 * len(graph)
    arcs = (graph.costs[nodes:] <= DEAREST) | (graph.labelled[nodes:] > 0)
    return kept_of(graph, np.ones(len(graph), np.bool_), arcs)
