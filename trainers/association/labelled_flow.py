"""The labelled flow x* of a network, and the windows that are cut from it.

**Labelled flow.** A detection is a person's whom it overlaps by 0.5, one to one. Detections of a person that follow
each other are linked where the tracker considers that link; where it does not, the labelled track ends and starts
again. Detections on nobody are not used. Those on an ignored label are taken out, for nobody says whether they are
right, and so are labelled runs that are shorter than the shortest track. People without detections have no arc; they
only count in MOTA.

**Windows.** A window holds the detections of some frames and the links between them. Beyond its first frame the video
goes on: whatever flow there is outside, a track can come in over a link, and then pays for that link and no start. So a
start at a detection with links from before the window costs no more than the cheapest of them, at least 0; ends
likewise. In the first frame after a border that is next to nothing, at the true beginning of the video it is the full
price, as in the tracker. These costs are constants: no gradient goes through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.trainers.association.graphs import Graph, Others

# A tracklet is used whatever it costs.
ALWAYS = 1000.0


def labelled(graph: Graph, all_used: bool = False) -> Graph:
    """The graph with the labelled flow of its owners.

    Args:
        graph: its ``labelled`` is not looked at.
        all_used: those of nobody are used, too, each by itself.
    """
    count = len(graph)
    follower = next_of_owner(graph.frames, graph.owners)
    taken = follower[graph.tail] == graph.head if count else np.zeros(0, np.bool_)
    used = np.ones(count, np.bool_) if all_used else graph.owners >= 0
    starts, ends = used.copy(), used.copy()
    starts[graph.head[taken]] = False
    ends[graph.tail[taken]] = False
    flow = np.concatenate([used, starts, ends, taken]).astype(np.float64)
    return replace(graph, labelled=flow)


def next_of_owner(frames: IntArray, owners: IntArray) -> IntArray:
    """``(N,)`` the next detection of the same person in time, -1 where there is none."""
    order = np.lexsort([frames, owners])
    same = (owners[order[:-1]] == owners[order[1:]]) & (owners[order[:-1]] >= 0)
    follower = np.full(len(frames), -1, dtype=np.int64)
    follower[order[:-1][same]] = order[1:][same]
    return follower


def taken_out(graph: Graph, which: BoolArray) -> Graph:
    """The graph without some of its detections, of which those in tracks become its others; x* is to be made anew."""
    tracked = which & (graph.tracks >= 0)
    features = None if graph.features is None else graph.features[tracked]
    more = Others(graph.frames[tracked], graph.boxes[tracked], graph.tracks[tracked], features)
    return replace(without(graph, which), others=graph.others.and_more(more))


def without(graph: Graph, which: BoolArray) -> Graph:
    """The graph without some of its detections, as if they had never been; the labelled flow is to be made anew."""
    kept = ~which
    place = np.cumsum(kept) - 1
    links = kept[graph.tail] & kept[graph.head]
    nodes = np.tile(kept, 3)
    return replace(
        graph,
        frames=graph.frames[kept],
        owners=graph.owners[kept],
        boxes=graph.boxes[kept],
        tracks=graph.tracks[kept],
        costs=graph.costs[np.append(nodes, links)],
        fixed=graph.fixed[nodes],
        detections=graph.detections[kept],
        tail=place[graph.tail[links]],
        head=place[graph.head[links]],
        links=graph.links[links],
        labelled=graph.labelled[np.append(nodes, links)],
        origin=None if graph.origin is None else graph.origin.select(kept),
        features=None if graph.features is None else graph.features[kept],
    )


def short_runs(graph: Graph, fewest: int) -> BoolArray:
    """``(N,)`` detections of labelled runs that are shorter than the shortest track: neither right nor wrong."""
    count = len(graph)
    label = np.arange(count)
    taken = graph.labelled[3 * count :] > 0
    for tail, head in sorted(zip(graph.tail[taken].tolist(), graph.head[taken].tolist(), strict=True)):
        label[head] = label[tail]
    return np.asarray((np.bincount(label, minlength=count)[label] < fewest) & (graph.owners >= 0))


def windows(graph: Graph, seconds: float, step: float | None = None) -> list[Graph]:
    """The graph cut into windows of so many seconds that start every ``step`` seconds, by default end to end."""
    length = max(1, round(seconds * graph.frame_rate))
    apart = max(1, round((step or seconds) * graph.frame_rate))
    last = int(graph.frames.max(initial=0))
    return [window(graph, first, first + length) for first in range(0, last + 1, apart)]


def window(graph: Graph, first: int, end: int) -> Graph:
    """The frames from ``first`` to before ``end``, with starts and ends that the video beyond makes cheaper."""
    count = len(graph)
    inside = (graph.frames >= first) & (graph.frames < end)
    start, stop = graph.costs[count : 2 * count].copy(), graph.costs[2 * count : 3 * count].copy()
    link = np.maximum(graph.costs[3 * count :], 0.0)
    entering = ~inside[graph.tail] & inside[graph.head]
    leaving = inside[graph.tail] & ~inside[graph.head]
    before, after = start.copy(), stop.copy()
    np.minimum.at(start, graph.head[entering], link[entering])
    np.minimum.at(stop, graph.tail[leaving], link[leaving])
    fixed = graph.fixed | np.concatenate([np.zeros(count, np.bool_), start < before, stop < after])
    costs = np.concatenate([graph.costs[:count], start, stop, graph.costs[3 * count :]])
    people = graph.people[(graph.people >= first) & (graph.people < end)]
    cut = replace(graph, costs=costs, fixed=fixed, people=people, name=f"{graph.name}, frames {first + 1}-{end}")
    always = bool(count) and bool((graph.costs[:count] <= -ALWAYS).all())
    others = graph.others.select((graph.others.frames >= first) & (graph.others.frames < end))
    return labelled(replace(without(cut, ~inside), others=others), all_used=always)


@dataclass
class FlowCounts:
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

    @classmethod
    def together(cls, parts: Sequence[FlowCounts]) -> FlowCounts:
        """The sum of counts."""
        return cls(*(sum((getattr(one, x.name) for one in parts), getattr(cls(), x.name)) for x in fields(cls)))

    @property
    def agreement(self) -> float:
        """Share on which the flow and x* agree."""
        return self.agreeing / max(self.either, 1.0)

    @property
    def mota(self) -> float:
        """1 − (missed + false + switches) / people."""
        return 1 - (self.missed + self.false + self.switches) / max(self.people, 1.0)
