"""The sliding window against the solution of the whole video."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, FlowSolution, solution_of, solve
from tsuiseki.tracking.association.sliding_flow import SlidingFlow, solve_in_windows


def _instance(seed: int) -> tuple[np.ndarray, FlowGraph, int, int]:
    """A random network, the number of its frames and its longest gap.

    Costs are drawn at random, not from walking people: choices hang together over many frames.
    """
    rng = np.random.default_rng(seed)
    length, crowd, longest = int(rng.integers(8, 50)), int(rng.integers(1, 6)), int(rng.integers(1, 6))
    frames = np.sort(rng.integers(0, length, length * crowd))
    count = len(frames)
    gap = frames[None] - frames[:, None]
    tail, head = np.nonzero((gap >= 1) & (gap <= longest))
    kept = rng.random(len(tail)) < min(1.0, 4 * count / max(len(tail), 1))
    tail, head = tail[kept], head[kept]
    if seed % 4 == 3:  # ties everywhere
        costs = rng.integers(-4, 3, count), np.full(count, 2), np.full(count, 2), rng.integers(0, 4, len(tail))
    else:
        costs = (
            rng.normal(-1, 2, count),
            rng.uniform(1, 3, count),
            rng.uniform(1, 3, count),
            rng.exponential(2, len(tail)),
        )
    observation, entry, end, transition = (np.asarray(c, dtype=np.float64) for c in costs)
    return frames, FlowGraph(observation, entry, end, tail, head, transition), length, longest


def _part(graph: FlowGraph, frames: np.ndarray, first: int, last: int) -> tuple[np.ndarray, FlowGraph]:
    inside = (frames >= first) & (frames < last)
    arcs = inside[graph.head]
    return frames[inside], FlowGraph(
        graph.observation[inside],
        graph.entry[inside],
        graph.exit[inside],
        graph.tail[arcs],
        graph.head[arcs],
        graph.transition[arcs],
    )


def _windowed(
    frames: np.ndarray, graph: FlowGraph, length: int, flow: SlidingFlow, chunk: int
) -> tuple[FlowSolution, list[int]]:
    """The solution put together from all decisions, and how many detections were kept after each."""
    used, follower = np.zeros(len(graph), dtype=bool), np.full(len(graph), -1)
    times_decided, kept = np.zeros(len(graph), dtype=int), []
    for first in range(0, length, chunk):
        flow.extend(*_part(graph, frames, first, first + chunk))
        for decision in [flow.decide(min(first + chunk, length) - 1)] + [flow.remainder()] * (first + chunk >= length):
            used[decision.numbers], follower[decision.numbers] = decision.used, decision.follower
            times_decided[decision.numbers] += 1
        kept.append(len(flow.undecided))
    assert (times_decided == 1).all()
    return solution_of(graph, np.zeros(len(graph), dtype=bool), used, follower), kept


@pytest.mark.parametrize("seed", range(120))
def test_cost_and_tracks_are_those_of_the_whole_video(seed: int) -> None:
    frames, graph, length, longest = _instance(seed)
    whole = solve(graph)
    flow = SlidingFlow(overlap=longest + 1, most_saving=3.0)
    pieced, _ = _windowed(frames, graph, length, flow, chunk=1 + seed % 9)
    assert flow.exact
    assert pieced.cost == pytest.approx(whole.cost, abs=2 * len(graph) / SCALE)
    if seed % 4 != 3:
        np.testing.assert_array_equal(pieced.used, whole.used)
        np.testing.assert_array_equal(pieced.follower, whole.follower)


@pytest.mark.parametrize("seed", range(60))
def test_it_is_enough_that_the_optimum_has_no_long_gap(seed: int) -> None:
    """Transitions as long as the overlap may exist, as long as the whole video's optimum does without them."""
    frames, graph, length, _ = _instance(4 * seed)
    whole = solve(graph)
    linked = whole.follower >= 0
    gaps = frames[whole.follower[linked]] - frames[linked]
    overlap = max(2, int(gaps.max(initial=0)) + 1)
    pieced, _ = _windowed(frames, graph, length, SlidingFlow(overlap, 3.0), chunk=1 + seed % 5)
    assert pieced.cost == pytest.approx(whole.cost, abs=2 * len(graph) / SCALE)
    np.testing.assert_array_equal(pieced.follower, whole.follower)


def _walkers(length: int, people: int, seed: int) -> tuple[np.ndarray, FlowGraph]:
    """People on random walks along a line, some detections missed and some false."""
    rng = np.random.default_rng(seed)
    place = np.cumsum(rng.normal(0, 1, (length, people)), axis=0) + rng.uniform(0, 40 * people, people)
    seen = rng.random((length, people)) < 0.9
    frames = np.repeat(np.arange(length), seen.sum(axis=1))
    x = (place + rng.normal(0, 0.5, place.shape))[seen]
    near = [np.flatnonzero(np.abs(x[:-g] - x[g:]) < 15) for g in range(1, 4 * people)]
    tail = np.concatenate(near)
    head = np.concatenate([part + g for g, part in enumerate(near, start=1)])
    gap = frames[head] - frames[tail]
    arcs = (gap >= 1) & (gap <= 3)
    tail, head, gap = tail[arcs], head[arcs], gap[arcs]
    transition = (x[tail] - x[head]) ** 2 / (4 * gap) + 0.3 * (gap - 1)
    count = len(x)
    return frames, FlowGraph(np.full(count, -2.0), np.full(count, 3.0), np.full(count, 3.0), tail, head, transition)


@pytest.mark.parametrize(("seed", "detections"), [(0, 40), (1, 40), (2, 100), (3, 100)])
def test_a_long_video_is_solved_in_windows(monkeypatch: pytest.MonkeyPatch, seed: int, detections: int) -> None:
    _, graph = _walkers(120, 8, seed)
    inflow = np.zeros(len(graph), dtype=np.bool_)
    inflow[np.random.default_rng(seed).integers(0, 30, 4)] = True
    whole = solve(graph, inflow)
    monkeypatch.setattr("tsuiseki.tracking.association.sliding_flow.AT_ONCE", 1)
    ours = solve_in_windows(graph, inflow, detections)
    assert ours.cost == pytest.approx(whole.cost, abs=2 * len(graph) / SCALE)
    np.testing.assert_array_equal(ours.used, whole.used)
    np.testing.assert_array_equal(ours.follower, whole.follower)


@pytest.mark.parametrize("seed", range(8))
def test_windows_cost_as_much_as_all_at_once(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    _, graph, _, _ = _instance(seed)
    monkeypatch.setattr("tsuiseki.tracking.association.sliding_flow.AT_ONCE", 1)
    assert solve_in_windows(graph, None, 10).cost == pytest.approx(solve(graph).cost, abs=2 * len(graph) / SCALE)


def test_a_crowd_comes_by_as_many_as_a_transition_reaches_over(monkeypatch: pytest.MonkeyPatch) -> None:
    people, frames = 200, 24
    tail = np.concatenate([np.arange(people * (frames - gap)) for gap in (1, 2, 3)])
    head = tail + np.repeat([1, 2, 3], [people * (frames - gap) for gap in (1, 2, 3)]) * people
    count = people * frames
    costs = np.full(count, -2.0), np.full(count, 3.0), np.full(count, 3.0)
    graph = FlowGraph(*costs, tail, head, 0.1 * (head - tail) / people)
    solved: list[int] = []

    def counted(part: FlowGraph, inflow: np.ndarray) -> FlowSolution:
        solved.append(len(part))
        return solve(part, inflow)

    monkeypatch.setattr("tsuiseki.tracking.association.sliding_flow.solve", counted)
    monkeypatch.setattr("tsuiseki.tracking.association.sliding_flow.AT_ONCE", 1)
    ours = solve_in_windows(graph, None, detections=50)
    # Each window once, and once more for what no future can change.
    assert len(solved) <= 20
    assert max(solved) <= 4 * 3 * people
    np.testing.assert_array_equal(ours.follower, solve(graph).follower)


def test_memory_does_not_grow_with_the_video() -> None:
    frames, graph = _walkers(600, 5, seed=0)
    flow = SlidingFlow(overlap=4, most_saving=3.0)
    pieced, kept = _windowed(frames, graph, 600, flow, chunk=10)
    assert pieced.cost == pytest.approx(solve(graph).cost, abs=2 * len(graph) / SCALE)
    # A frontier of 3 frames holds 15 detections; what is undecided beyond it does not pile up.
    assert np.median(kept) < 60
    assert max(kept[30:]) <= 2 * max(kept[:30])


def test_each_part_of_the_overlap_rule_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plain overlap, with everything before the frontier decided, misses the optimum."""
    monkeypatch.setattr(
        "tsuiseki.tracking.association.sliding_flow.safe_detections",
        lambda *arguments: ~arguments[3],
    )
    missed = 0
    for seed in range(0, 40, 4):
        frames, graph, length, longest = _instance(seed)
        pieced, _ = _windowed(frames, graph, length, SlidingFlow(longest + 1, 3.0), chunk=1 + seed % 9)
        missed += pieced.cost > solve(graph).cost + 1e-3
    assert missed > 0


def test_broken_order_and_settings_are_refused() -> None:
    flow = SlidingFlow(3, 1.0)
    one = FlowGraph(*(np.array([v]) for v in (-1.0, 1.0, 1.0)), np.empty(0, int), np.empty(0, int), np.empty(0))
    flow.extend(np.array([5]), one)
    with pytest.raises(ValueError, match="frames after 5"):
        flow.extend(np.array([5]), one)
    with pytest.raises(ValueError, match="saves at most"):
        SlidingFlow(3, 0.5).extend(np.array([0]), one)
    with pytest.raises(ValueError, match="overlap"):
        SlidingFlow(1, 1.0)


def test_empty_windows_pass() -> None:
    flow = SlidingFlow(2, 1.0)
    flow.extend(np.empty(0, int), FlowGraph(*(np.empty(0),) * 3, np.empty(0, int), np.empty(0, int), np.empty(0)))
    assert len(flow.decide(9).numbers) == 0
    assert len(flow.remainder().numbers) == 0


@pytest.mark.parametrize("seed", range(12))
def test_changed_costs_are_solved_from_the_solution_before(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsuiseki.tracking.association.sliding_flow.MANY_LINKS", 0)
    frames, graph, _, longest = _instance(seed)
    rng = np.random.default_rng(seed)
    flow = SlidingFlow(longest + 1, 50.0)
    inflow = (np.arange(len(graph)) < 3) & (seed % 2 == 0)
    flow.extend(frames, graph, inflow)
    for _ in range(4):
        flow.replace(replace(graph, transition=graph.transition + rng.normal(0, 1, len(graph.tail))))
        direct = solve(flow.graph, inflow)
        assert flow.solution().cost == pytest.approx(direct.cost, abs=4 * len(graph) / SCALE)
        # With random costs no two flows cost the same.
        assert (flow.solution().follower == direct.follower).all()


def test_reduced_costs_have_the_same_cheapest_flow() -> None:
    _, graph, _, _ = _instance(1)
    first, second = np.random.default_rng(0).normal(0, 5, (2, len(graph)))
    assert (solve(graph.at_potentials(first, second)).follower == solve(graph).follower).all()
