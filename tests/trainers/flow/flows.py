"""All flows of a small network, for brute force."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray


def all_flows(count: int, tail: IntArray, head: IntArray) -> Iterator[FloatArray]:
    """Every flow: each detection is left out, starts a track, or follows one that nothing follows yet."""
    into = [np.flatnonzero(head == node) for node in range(count)]

    def go_on(node: int, flow: FloatArray) -> Iterator[FloatArray]:
        if node == count:
            yield flow
            return
        yield from go_on(node + 1, flow)
        used = flow.copy()
        used[[node, 2 * count + node]] = 1
        start = used.copy()
        start[count + node] = 1
        yield from go_on(node + 1, start)
        for link in into[node]:
            if flow[2 * count + tail[link]]:
                linked = used.copy()
                linked[3 * count + link] = 1
                linked[2 * count + tail[link]] = 0
                yield from go_on(node + 1, linked)

    yield from go_on(0, np.zeros(3 * count + len(tail)))
