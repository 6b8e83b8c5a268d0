"""What flows do right and wrong, over windows of labelled sequences."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.graphs import Graph


@dataclass
class Counts:
    """What a flow does right and wrong, added up over windows.

    Attributes:
        agreeing: links and detections on which it and the labelled flow agree, of those that either has.
        either: those that either has.
        missed: labelled boxes that no used detection shows.
        false: used detections on nobody.
        switches: links between two people.
        people: labelled boxes.
        windows: their names.
    """

    agreeing: float = 0.0
    either: float = 0.0
    missed: float = 0.0
    false: float = 0.0
    switches: float = 0.0
    people: float = 0.0
    windows: list[str] = field(default_factory=list)

    def add(self, graph: Graph, flow: FloatArray) -> None:
        """Take in the flow ``(3 N + P,)`` of a window."""
        count = len(graph)
        chosen = np.r_[0:count, 3 * count : len(flow)]
        self.agreeing += float(np.minimum(flow, graph.labelled)[chosen].sum())
        self.either += float(np.maximum(flow, graph.labelled)[chosen].sum())
        used, links = flow[:count] > 0, flow[3 * count :] > 0
        owners = graph.owners
        right = float((used & (owners >= 0)).sum())
        self.people += len(graph.people)
        self.missed += max(len(graph.people) - right, 0.0)
        self.false += float((used & (owners < 0)).sum())
        tail, head = owners[graph.tail[links]], owners[graph.head[links]]
        self.switches += float(((tail != head) & (tail >= 0) & (head >= 0)).sum())
        self.windows.append(graph.name)

    @property
    def agreement(self) -> float:
        """Share on which the flow and x* agree."""
        return self.agreeing / max(self.either, 1.0)

    @property
    def mota(self) -> float:
        """1 − (missed + false + switches) / people."""
        return 1 - (self.missed + self.false + self.switches) / max(self.people, 1.0)
