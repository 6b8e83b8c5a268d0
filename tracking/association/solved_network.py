"""The network that the flow of a whole video was solved on, kept with its result, so that it can be solved again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, scaled
from tsuiseki.tracking.association.sliding_flow import Decision
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.types import FloatArray, IntArray, Track

NETWORK_FILE = "flow.npz"
COSTS = ("observation", "entry", "exit", "transition")
# A table with a row for each column that `SolvedNetwork` has beside the graph.
COLUMNS = ("frames", "boxes", "scores", "origin", "track")


@dataclass(frozen=True)
class SolvedNetwork:
    """N detections, what they cost, and the track that each was reported in.

    Attributes:
        frames: ``(N,)`` increasing, from 0.
        boxes: ``(N, 4)`` pixels, as detected.
        scores: ``(N,)``, NaN where not known.
        origin: ``(N, 2)`` row among the detections of its frame, and class.
        graph: their costs, with all links that were weighed.
        track: ``(N,)`` id, 0 for none.
        fewest: detections that a track needs.
        fill: longest gap that is filled, frames.
        rate: frames a second.
    """

    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    origin: IntArray
    graph: FlowGraph
    track: IntArray
    fewest: int = 1
    fill: int = 0
    rate: float = 25.0

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def given(self) -> bool:
        """Whether it is a `network_of_tracks`, in which nothing is in doubt."""
        return bool((self.graph.observation == -ALONE).all())

    def write(self, path: Path) -> None:
        """Write it as ``.npz``, costs as whole multiples of ``1 / SCALE``."""
        graph = self.graph
        table = {name: getattr(self, name) for name in COLUMNS}
        table |= {name: scaled(getattr(graph, name)) for name in COSTS} | {"tail": graph.tail, "head": graph.head}
        with path.open("wb") as file:
            np.savez_compressed(file, fewest=self.fewest, fill=self.fill, rate=self.rate, **table)

    @classmethod
    def read(cls, path: Path) -> SolvedNetwork:
        """What `write` wrote.

        Raises:
            RequestError: the file holds something else.
        """
        try:
            table = read_arrays(path, "the network of a result")
            costs = {name: table[name] / SCALE for name in COSTS}
            graph = FlowGraph(**costs, tail=table["tail"], head=table["head"])
            network = cls(
                **{name: table[name] for name in COLUMNS},
                graph=graph,
                fewest=int(table["fewest"]),
                fill=int(table["fill"]),
                rate=float(table["rate"]),
            )
            lengths = {len(getattr(network, name)) for name in COLUMNS} | {len(graph)}
            ends = np.concatenate([graph.tail, graph.head])
            if len(lengths) != 1 or (len(ends) and not 0 <= ends.min() <= ends.max() < len(network)):
                raise ValueError("columns do not fit each other")
        except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
            raise RequestError(f"{path}: expected the network of a result, got something else; track again") from error
        return network


def network_of_tracks(tracks: Sequence[Track], rate: float) -> SolvedNetwork:
    """A network whose only flow is these tracks of one video: they can be corrected, and nothing in them is in doubt.

    ``rate`` are frames a second.
    """
    columns = [[getattr(t, n)[t.observed] for t in tracks] for n in ("frames", "boxes", "scores", "origin")]
    numbers = [np.full(int(t.observed.sum()), t.id) for t in tracks]
    empty = np.empty(0, np.int64), np.empty((0, 4)), np.empty(0), np.empty((0, 2), np.int64)
    frames, boxes, scores, origin = (np.concatenate([e, *c]) for e, c in zip(empty, columns, strict=True))
    track = np.concatenate([empty[0], *numbers])
    order = np.lexsort((track, frames))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    following = np.flatnonzero(track[:-1] == track[1:])
    count, links = len(order), len(following)
    costs = np.full(count, -ALONE), np.full(count, ALONE / 4), np.full(count, ALONE / 4)
    graph = FlowGraph(*costs, place[following], place[following + 1], np.zeros(links))
    fill = round(FILL * rate)
    return SolvedNetwork(frames[order], boxes[order], scores[order], origin[order], graph, track[order], 1, fill, rate)


# Longest gap of such a track that is filled, seconds.
FILL = 2.0
# What the detections of given tracks save, nats, so that each alone is a track.
ALONE = 20.0


@dataclass
class NetworkRecord:
    """Collects the network while its windows are decided, in numbers as the file has them, of 32 bits where they fit.

    Attributes:
        parts: of each window numbers of the detections, their ``(3, K)`` costs; tails, heads and costs of the links.
    """

    parts: list[tuple[NDArray[np.signedinteger], ...]] = field(default_factory=list)

    def copy(self) -> NetworkRecord:
        """A copy that can grow by itself."""
        return NetworkRecord([*self.parts])

    def add(self, decision: Decision, numbers: IntArray, graph: FlowGraph) -> None:
        """Note what was decided, and the costs that it was decided by.

        Args:
            decision: of some of the undecided detections.
            numbers: ``(U,)`` of these.
            graph: that their flow is the cheapest in.
        """
        done = np.isin(numbers, decision.numbers, assume_unique=True)
        arcs = done[graph.tail]
        costs = scaled(np.stack([graph.observation, graph.entry, graph.exit])[:, done])
        links = numbers[graph.tail[arcs]], numbers[graph.head[arcs]], scaled(graph.transition[arcs])
        self.parts.append(tuple(_small(column) for column in (numbers[done], costs, *links)))

    def graph(self, count: int, joins: Sequence[tuple[IntArray, IntArray, FloatArray]]) -> FlowGraph:
        """The whole network of ``count`` detections.

        Args:
            count: N.
            joins: tails, heads and what joining them saves less than ending one track and starting another.
        """
        costs = np.zeros((3, count))
        for numbers, node_costs, *_ in self.parts:
            costs[:, numbers] = node_costs / SCALE
        observation, entry, exit = costs
        none = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
        joined = [(i, j, cost + entry[j] + exit[i]) for i, j, cost in joins]
        parts = [none, *((tails, heads, c / SCALE) for *_, tails, heads, c in self.parts), *joined]
        tail, head, cost = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.lexsort((cost, head, tail))
        first = np.append(True, (np.diff(tail[order]) != 0) | (np.diff(head[order]) != 0))[: len(order)]
        needed = order[first & (cost[order] < entry[head[order]] + exit[tail[order]])]
        return FlowGraph(observation, entry, exit, tail[needed], head[needed], cost[needed])


def _small(values: IntArray) -> NDArray[np.signedinteger]:
    small = values.astype(np.int32)
    return small if np.array_equal(small, values) else values
