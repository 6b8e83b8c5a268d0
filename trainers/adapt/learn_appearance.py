"""The appearance network, learnt on tracks: one track is one person, two people seen at one time are different.

A camera shows few people, too few to teach a whole network what tells people apart. So its layers stay and one more,
linear, is put after them: it weighs what they see, and starts as one that changes nothing. Tracks that never meet may
be one person who came back, and say nothing.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch.nn import functional

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.retrieval import area_under_roc
from tsuiseki.tracking.features.exported import Appearance, open_appearance
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.adapt.examples import chosen, coexisting, people_of
from tsuiseki.trainers.affinity.affinity_samples import LabelledDetections

_TRAINED_ON = "; its last layer on unlabelled video of one camera (tsuiseki adapt)"
# Views of one person this many frames apart look the same to anything.
_APART = 5
_MOST_VIEWS = 2000
_LEARNT_AT_ONCE = 256


@dataclass(frozen=True)
class ProjectionSettings:
    """How the last layer is learnt.

    Attributes:
        steps: of Adam.
        learning_rate: of it.
        temperature: of the softmax over cosine similarities.
        stay: weight of the mean square by which features move, which keeps what the network knew.
    """

    steps: int = 150
    learning_rate: float = 2e-3
    temperature: float = 0.1
    stay: float = 3.0


@dataclass(frozen=True)
class Projection:
    """A linear layer over features.

    Link costs know what cosine distance two people usually have. Learning drives them apart, and the views of one with
    them; a last feature that is the same for everybody brings all distances back by one factor.

    Attributes:
        weight: ``(D, D)``.
        bias: ``(D,)``.
        scale: of the cosine distances, in (0, 1].
    """

    weight: FloatArray
    bias: FloatArray
    scale: float = 1.0

    def __call__(self, features: FloatArray) -> FloatArray:
        """``(N, D + 1)`` unit-length features out of ``(N, D)``; NaN stays."""
        rows = features @ self.weight.T + self.bias
        unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        same = np.where(np.isnan(unit[:, :1]), np.nan, np.sqrt(1 - self.scale))
        return np.concatenate([np.sqrt(self.scale) * unit, same], axis=1)


def learn_projection(samples: LabelledDetections, settings: ProjectionSettings, seed: int) -> Projection | None:
    """The layer that brings views of one track together and those of people seen at one time apart.

    The loss is the softmax contrastive one: each view shall be nearest to one of its own track among all that are known
    to show somebody else.

    Args:
        samples: named detections with features.
        settings: of the learning.
        seed: of the views of each step.

    Returns:
        None where no two people are seen at one time.
    """
    people = _some(people_of(samples))
    if people.features is None or not len(people):
        return None
    other = coexisting(people.frames, people.ids)
    same = (people.ids[:, None] == people.ids[None]) & (np.abs(people.frames[:, None] - people.frames[None]) >= _APART)
    if not other.any() or not same.any():
        return None
    features = torch.tensor(people.features, dtype=torch.float32)
    weight = torch.eye(features.shape[1], requires_grad=True)
    bias = torch.zeros(features.shape[1], requires_grad=True)
    optimiser = torch.optim.Adam([weight, bias], lr=settings.learning_rate)
    rng = np.random.default_rng(seed)
    for _ in range(settings.steps):
        rows = rng.choice(len(people), min(_LEARNT_AT_ONCE, len(people)), replace=False)
        loss = _loss(features[rows], weight, bias, same[np.ix_(rows, rows)], other[np.ix_(rows, rows)], settings)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    learnt = Projection(weight.detach().double().numpy(), bias.detach().double().numpy())
    before, after = (_mean_distance(rows, other) for rows in (people.features, learnt(people.features)))
    return dataclasses.replace(learnt, scale=min(1.0, before / max(after, 1e-9)))


def _mean_distance(features: FloatArray, pairs: BoolArray) -> float:
    """Mean cosine distance of the ``pairs`` ``(N, N)`` of unit-length rows ``(N, D)``."""
    return float(1 - (features @ features.T)[pairs].mean())


def _loss(
    features: torch.Tensor,
    weight: torch.Tensor,
    bias: torch.Tensor,
    same: BoolArray,
    other: BoolArray,
    settings: ProjectionSettings,
) -> torch.Tensor:
    moved = functional.linear(features, weight, bias)
    unit = functional.normalize(moved, dim=1)
    logits = unit @ unit.T / settings.temperature
    ours, theirs = torch.from_numpy(same), torch.from_numpy(other)
    told = ours.any(dim=1) & theirs.any(dim=1)
    stay = settings.stay * (moved - features).square().sum(dim=1).mean()
    if not told.any():
        return stay
    against = torch.logsumexp(logits.masked_fill(~theirs, -torch.inf)[told], dim=1, keepdim=True)
    shares = functional.softplus(against - logits[told])
    counted = ours[told].float()
    return ((shares * counted).sum(dim=1) / counted.sum(dim=1)).mean() + stay


def _some(people: LabelledDetections) -> LabelledDetections:
    """At most `_MOST_VIEWS` of them, evenly spread: each is compared with each."""
    every = max(1, -(-len(people) // _MOST_VIEWS))
    return chosen(people, np.arange(len(people)) % every == 0)


def separation(samples: LabelledDetections, projection: Projection | None = None) -> float | None:
    """How well appearance tells one from two: the area under the ROC of cosine similarity.

    Args:
        samples: named detections with features.
        projection: of the features; None takes them as they are.

    Returns:
        None where no two people are seen at one time, or nobody is seen twice.
    """
    people = _some(people_of(samples))
    if people.features is None or not len(people):
        return None
    features = people.features if projection is None else projection(people.features)
    alike = features @ features.T
    later = people.frames[None] - people.frames[:, None] >= _APART
    same = (people.ids[:, None] == people.ids[None]) & later
    other = coexisting(people.frames, people.ids) & later
    if not same.any() or not other.any():
        return None
    return area_under_roc(alike[same], alike[other])


def refuse_other_appearance(network: Path) -> None:
    """Refuse an appearance network that no last layer can be put after.

    Raises:
        RequestError: the file is none of this toolkit's.
    """
    if not isinstance(open_appearance(network, 1), Appearance):
        raise RequestError(
            f"{network}: expected an appearance network of this toolkit to learn on, got one of another project; leave "
            "it out here, and give it to track people"
        )


def export_projected(network: Path, projection: Projection, out: Path) -> None:
    """Write the appearance network of the file ``network`` with ``projection`` after it.

    Args:
        network: exported by this toolkit.
        projection: of as many features.
        out: the file.

    Raises:
        RequestError: ``network`` is no appearance network of this toolkit.
    """
    refuse_other_appearance(network)
    model = onnx.load(network)
    entry = next(p for p in model.metadata_props if p.key == METADATA_KEY)
    card = ModelCard.from_json(entry.value)
    length = len(projection.bias) + 1
    card = dataclasses.replace(card, training_data=card.training_data + _TRAINED_ON, feature_length=length)
    entry.value = card.to_json()
    graph, output = model.graph, model.graph.output[0].name
    # A network that was learnt here before has such a layer already.
    layer = f"projection{sum(x.name.endswith('.pads') for x in graph.initializer) or ''}"
    parts = {
        "weight": projection.weight.T,
        "bias": projection.bias,
        "scale": np.sqrt(projection.scale),
        "same": np.sqrt(1 - projection.scale),
    }
    graph.initializer.extend(
        numpy_helper.from_array(np.asarray(value, dtype=np.float32), f"{layer}.{name}") for name, value in parts.items()
    )
    graph.initializer.append(numpy_helper.from_array(np.array([0, 0, 0, 1]), f"{layer}.pads"))
    graph.output[0].type.tensor_type.shape.dim[1].dim_value = length
    for node in graph.node:
        for names in (node.input, node.output):
            for n, name in enumerate(names):
                if name == output:
                    names[n] = f"{layer}.input"
    graph.node.extend(_layer(layer, output))
    onnx.checker.check_model(model)
    with output_file(out, overwrite=True) as work:
        onnx.save(model, work)


def _layer(name: str, output: str) -> list[onnx.NodeProto]:
    """The nodes of a last layer ``name``, from its input to ``output``."""

    def at(*parts: str) -> list[str]:
        return [f"{name}.{part}" for part in parts]

    return [
        helper.make_node("Gemm", at("input", "weight", "bias"), at("moved")),
        helper.make_node("LpNormalization", at("moved"), at("unit"), axis=1, p=2),
        helper.make_node("Mul", at("unit", "scale"), at("scaled")),
        helper.make_node("Pad", at("scaled", "pads", "same"), [output]),
    ]
