"""What networks that learn with the costs say of a window, with gradients into them: appearance, and scores.

**Appearance.** The tracker averages features along the track found so far, over some time before a link and after it
(eq. 5.3, one-sided), and weighs the cosine distance d of the two averages: weight · (d − neutral), and d is a feature
of the network of costs. Both are computed here again from the features that the Siamese network gives the crops of a
window. By how much a link is dearer than its rivals is held fixed within a step.

**Scores.** The tracker takes a score s for the probability p that the video's own calibration gives it, and logit p,
times a weight, is what a detection is worth. That calibration is a staircase without a useful slope. So a step takes
the tracker's cost where the training began, and from there on a straight line: with ℓ the logit of s at the detection's
anchor and ℓ₀ what it was at first,

    Δ logit p = slope · (ℓ − ℓ₀),      Δ cost = κ · Δ logit p,

slope that of the line which fits logit p to ℓ over the sequence, κ < 0 the cost of a logit. Both features of the
network of costs that hold them change likewise. Boxes, and how well they are measured, are held fixed within a step.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.detector import DetectionBatch, collate
from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.models.appearance import softmax_contrastive_loss
from tsuiseki.tracking.association.evidence import DETECTION_FEATURES, LINK_FEATURES
from tsuiseki.tracking.association.flow_rounds import AVERAGED
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.nearby import gaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.preprocessing import crop_boxes, fit_image
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.flow.graphs import Graph
from tsuiseki.trainers.network_module import normalised

# Column of a link's features that holds its cost.
COST = LINK_FEATURES.index("cost")
# Column of the distance between the averaged appearances of its two sides.
DISTANCE = LINK_FEATURES.index("appearance")
# Column that is 1 where that distance is known.
KNOWN = LINK_FEATURES.index("appearance_known")
# Of the softmax over the views of a window, as of those that the network was trained on.
TEMPERATURE = 0.1


@dataclass(frozen=True)
class WindowCrops:
    """The crops of a window's N detections and then of its M others, and along which of them the tracker averages.

    Attributes:
        images: ``(N + M, H, W, 3)`` uint8 RGB.
        past: ``(N, N + M)`` 1 for those that are averaged before a link from each detection.
        future: ``(N, N + M)`` likewise after a link to each.
    """

    images: ImageArray
    past: FloatArray
    future: FloatArray


def crops_of(graph: Graph, height: int, width: int) -> WindowCrops:
    """The crops of a window's detections and others, stretched to ``height`` by ``width``."""
    nodes = graph.nodes.and_then(graph.others)
    frames, tracks, boxes = nodes.frames, nodes.tracks, nodes.boxes
    images = np.empty((len(frames), height, width, 3), dtype=np.uint8)
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        images[here] = crop_boxes(read_image(graph.images[frame]), boxes[here], height, width)
    past = averaged(frames, tracks, gaps(AVERAGED, graph.frame_rate))
    return WindowCrops(images, past[: len(graph)], past.T[: len(graph)].copy())


def averaged(frames: IntArray, tracks: IntArray, reach: int) -> FloatArray:
    """``(N, N)`` 1 where the second detection lies in the track of the first, up to ``reach`` frames before it."""
    same = (tracks[:, None] == tracks[None]) & (tracks[:, None] >= 0)
    offset = frames[:, None] - frames[None]
    within: FloatArray = (same & (offset >= 0) & (offset <= reach)).astype(np.float64)
    np.fill_diagonal(within, 1.0)
    return within


def distances(features: Tensor, crops: WindowCrops, graph: Graph) -> Tensor:
    """``(P,)`` cosine distances of the averages at both ends of every link.

    Args:
        features: ``(N + M, D)`` of the crops, of unit length.
        crops: of the window.
        graph: the window.
    """
    past, future = (
        functional.normalize(torch.as_tensor(part, dtype=features.dtype, device=features.device) @ features, dim=1)
        for part in (crops.past, crops.future)
    )
    tail, head = (torch.as_tensor(part, device=features.device) for part in (graph.tail, graph.head))
    return 1 - (past[tail] * future[head]).sum(dim=1)


def with_new_distances(rows: Tensor, distance: Tensor, cost: LinkCost) -> tuple[Tensor, Tensor]:
    """Features of the links with another distance of appearance, and by how much that changes the default's costs.

    Args:
        rows: ``(P, F)`` the features, with another distance or none.
        distance: ``(P,)``.
        cost: what a distance costs.
    """
    weight, neutral = cost.appearance[1], cost.neutral[1]
    applied = torch.where(rows[:, KNOWN] > 0, rows[:, DISTANCE] - neutral, torch.zeros_like(distance))
    change = weight * (distance - neutral - applied)
    columns = list(rows.unbind(dim=1))
    columns[COST] = columns[COST] + change
    columns[DISTANCE], columns[KNOWN] = distance, torch.ones_like(distance)
    return torch.stack(columns, dim=1), change


def contrast_within(features: Tensor, graph: Graph) -> Tensor:
    """The Siamese network's own loss, over the people of a window who have several detections in it."""
    names, place, counts = np.unique(graph.nodes.owners, return_inverse=True, return_counts=True)
    several = (counts > 1) & (names >= 0)
    if several.sum() < 2:
        return features.new_zeros(())
    chosen = torch.as_tensor(np.flatnonzero(several[place]), device=features.device)
    return softmax_contrastive_loss(
        features[chosen], torch.as_tensor(place, device=features.device)[chosen], TEMPERATURE
    )


# Column of a detection's features that holds its cost.
DETECTION_COST = DETECTION_FEATURES.index("cost")
# Column of the logit of its probability.
LOGIT = DETECTION_FEATURES.index("logit")


@dataclass(frozen=True)
class WindowFrames:
    """The images of a window.

    Attributes:
        batch: T images fitted into the detector, with the labels of their people.
        which: ``(N,)`` image of each detection.
    """

    batch: DetectionBatch
    which: IntArray


def frames_of(graph: Graph, card: ModelCard) -> WindowFrames:
    """The images of a window's frames, from the first to the last one with a detection.

    Raises:
        RequestError: nothing says where the detections come from.
    """
    if graph.origin is None or graph.truth is None:
        raise RequestError(f"{graph.name}: expected detections of --data.detector, whose heads are to learn")
    frames = range(int(graph.nodes.frames.min(initial=0)), int(graph.nodes.frames.max(initial=-1)) + 1)
    examples = []
    for frame in frames:
        image, scale = fit_image(read_image(graph.images[frame]), card)
        people = graph.truth.between(frame, frame)
        people = people.select(people.evaluated | people.ignored)
        examples.append(Example(image, people.boxes * np.tile(scale, 2), ~people.evaluated))
    nothing = torch.empty(0, card.input_height, card.input_width, 3, dtype=torch.uint8)
    none = DetectionBatch(nothing, torch.empty(0, 0, 4), torch.empty(0, 0, dtype=torch.int64))
    return WindowFrames(collate(examples) if examples else none, graph.nodes.frames - frames.start)


class FrozenTrunk:
    """The maps that a trunk which does not learn makes of images: those of the latest images are kept.

    Args:
        frames_at_most: images that are kept; one of 640 by 480 pixels takes about 2.5 MB.
    """

    def __init__(self, frames_at_most: int = 320) -> None:
        self.most = frames_at_most
        # Each image's place in the maps, the latest last. One block a level: many small ones would scatter the memory.
        self._place: OrderedDict[bytes, int] = OrderedDict()
        self._levels: list[Tensor] = []

    def heads(self, detector: Detector, images: Tensor) -> tuple[Tensor, Tensor]:
        """Raw heads of ``(T, H, W, 3)`` uint8 images; all normalisations keep the statistics they were trained with.

        Raises:
            RequestError: there are more images than are kept.
        """
        if len(images) > self.most:
            raise RequestError(f"expected windows of at most {self.most} frames for the detector, got {len(images)}")
        detector.eval()
        places = [self._placed(detector, image) for image in images]
        logits, offsets = detector.network.heads([level[places] for level in self._levels])
        return logits, offsets

    def _placed(self, detector: Detector, image: Tensor) -> int:
        key = hashlib.blake2b(image.cpu().numpy().tobytes(), digest_size=16).digest()
        if key not in self._place:
            with torch.no_grad():
                maps = detector.network.features(normalised(image[None].to(detector.device), detector.card))
            if not self._levels:
                self._levels = [feature_map.new_empty(self.most, *feature_map.shape[1:]) for feature_map in maps]
            full = len(self._place) == self.most
            place = self._place.popitem(last=False)[1] if full else len(self._place)
            for level, feature_map in zip(self._levels, maps, strict=True):
                level[place] = feature_map[0]
            self._place[key] = place
        self._place.move_to_end(key)
        return self._place[key]


def score_logits(logits: Tensor, frames: WindowFrames, graph: Graph) -> Tensor:
    """``(N,)`` logits of the scores of a window's detections, from the raw heads ``(T, A, 2)`` of its images.

    Detections of a branch, whose anchors come after those A, keep theirs.
    """
    origin = graph.origin
    assert origin is not None
    which, anchors = (torch.as_tensor(part, device=logits.device) for part in (frames.which, origin.anchors))
    kept = torch.as_tensor(origin.logits, dtype=logits.dtype, device=logits.device)
    chosen = logits[which, anchors.clamp(max=logits.shape[1] - 1)]
    return torch.where(anchors < logits.shape[1], chosen[:, 1] - chosen[:, 0], kept)


def rescored(rows: Tensor, logits: Tensor, graph: Graph) -> tuple[Tensor, Tensor]:
    """Features of the detections at other scores, and by how much that changes the default's costs.

    Args:
        rows: ``(N, G)`` features at the scores where the training began.
        logits: ``(N,)`` of the scores now.
        graph: the window.
    """
    origin = graph.origin
    assert origin is not None
    surer = origin.slope * (logits - torch.as_tensor(origin.logits, dtype=logits.dtype, device=logits.device))
    columns = list(rows.unbind(dim=1))
    columns[LOGIT] = columns[LOGIT] + surer
    columns[DETECTION_COST] = columns[DETECTION_COST] + origin.cost_slope * surer
    return torch.stack(columns, dim=1), origin.cost_slope * surer


def own_loss(detector: Detector, outputs: tuple[Tensor, Tensor], frames: WindowFrames) -> Tensor:
    """The loss that the detector is trained by apart, on the images of a window."""
    boxes, labels = (part.to(detector.device) for part in frames.batch[1:])
    terms = detector.network.loss(outputs, boxes, labels)
    total: Tensor = terms["class_loss"] + terms["box_loss"]
    return total
