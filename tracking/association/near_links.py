"""A cheapest flow of a network in a crowd, solved on few of its links: columns are priced and come in where they pay.

Where all detections of a second may follow each other, most links are far from any use. The flow is solved on the best
of them. Its potentials price the others (`ResidualFlow`): who has a reduced cost below 0 comes in, and it is solved
again, until there is none. Then the flow is the cheapest of the whole network (column generation, Dantzig and Wolfe,
1960).
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, scaled
from tsuiseki.tracking.association.residual_flow import ResidualFlow
from tsuiseki.tracking.association.sliding_flow import solve_in_windows
from tsuiseki.tracking.types import BoolArray

# Links a detection up to which all are solved at once.
FEW = 20
# Links a detection that a larger network begins with.
FIRST = 10
# Links that come in, too, since a correction may need them: those of a reduced cost below this, nats.
NEAR = 4.0


def solved_on_near_links(graph: FlowGraph) -> tuple[BoolArray, ResidualFlow]:
    """The cheapest flow of a network, and ``(P,)`` which of its links that has: all of one that is not dense.

    Links that it lacks have reduced costs of 0 or more.
    """
    count = len(graph)
    if len(graph.tail) <= FEW * count:
        return np.ones(len(graph.tail), np.bool_), ResidualFlow(graph, solve_in_windows(graph))
    extra = graph.transition - graph.exit[graph.tail] - graph.entry[graph.head]
    near, cost = extra <= np.partition(extra, FIRST * count)[FIRST * count], scaled(graph.transition)
    while True:
        part = graph.with_transitions(near)
        flow = ResidualFlow(part, solve_in_windows(part))
        out, into = flow.potential[1:-1:2], flow.potential[:-1:2]
        reduced = cost + out.copy()[graph.tail] - into.copy()[graph.head]
        if not (~near & (reduced < 0)).any():
            return near, flow
        near |= reduced < NEAR * SCALE
