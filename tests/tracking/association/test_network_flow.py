"""The flow against brute force, against a linear program, and its network's bookkeeping."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import coo_array

from tsuiseki.tracking.association.network_flow import SCALE, FlowGraph, FlowSolution, build_graph, solve, track_labels


def random_graph(
    rng: np.random.Generator, count: int, frames: int, density: float = 1.0
) -> tuple[np.ndarray, FlowGraph]:
    """Frames and a network of random costs with transitions over up to 3 frames."""
    when = np.sort(rng.integers(0, frames, count))
    gap = when[None] - when[:, None]
    tail, head = np.nonzero((gap >= 1) & (gap <= 3) & (rng.random((count, count)) < density))
    graph = FlowGraph(
        rng.normal(-1, 2, count),
        rng.uniform(1, 3, count),
        rng.uniform(1, 3, count),
        tail,
        head,
        rng.exponential(2, len(tail)),
    )
    return when, graph


def objective(graph: FlowGraph, solution: FlowSolution) -> float:
    """Eq. 2.17, term by term."""
    costs = {(i, j): c for i, j, c in zip(graph.tail, graph.head, graph.transition, strict=True)}
    followed = set(solution.follower[solution.follower >= 0].tolist())
    total = 0.0
    for i in np.flatnonzero(solution.used):
        total += graph.observation[i] + (0 if i in followed else graph.entry[i])
        j = solution.follower[i]
        total += graph.exit[i] if j < 0 else costs[i, j]
    return total


def _brute_force(graph: FlowGraph) -> float:
    """Least cost over all choices of a follower, or none, for every detection."""
    costs = {(i, j): c for i, j, c in zip(graph.tail, graph.head, graph.transition, strict=True)}
    count = len(graph)
    best = 0.0
    options = [[-1, *[j for j in range(count) if (i, j) in costs]] for i in range(count)]
    for used in itertools.product([False, True], repeat=count):
        allowed = [[j for j in options[i] if j < 0 or used[j]] if used[i] else [-1] for i in range(count)]
        for follower in itertools.product(*allowed):
            followed = [j for j in follower if j >= 0]
            if len(set(followed)) == len(followed):
                solution = FlowSolution(np.array(used), np.array(follower))
                best = min(best, objective(graph, solution))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_it_is_the_least_of_all_sets_of_tracks(seed: int) -> None:
    _, graph = random_graph(np.random.default_rng(seed), 6, 4)
    solution = solve(graph)
    np.testing.assert_allclose(solution.cost, _brute_force(graph), atol=2 * 6 / SCALE)
    np.testing.assert_allclose(solution.cost, objective(graph, solution), atol=1e-12)


def _linear_program(graph: FlowGraph) -> float:
    """The relaxation of eq. 2.17; its matrix is totally unimodular, so its value is the integer optimum."""
    n, links = len(graph), len(graph.tail)
    entry, observed, end, link = np.split(np.arange(3 * n + links), [n, 2 * n, 3 * n])
    nodes = np.arange(n)
    rows = np.concatenate([nodes, nodes, graph.head, n + nodes, n + nodes, n + graph.tail])
    columns = np.concatenate([entry, observed, link, observed, end, link])
    signs = np.concatenate([np.ones(n), -np.ones(n), np.ones(links), np.ones(n), -np.ones(n), -np.ones(links)])
    costs = np.concatenate([graph.entry, graph.observation, graph.exit, graph.transition])
    balance = coo_array((signs, (rows, columns)), shape=(2 * n, 3 * n + links)).tocsr()
    return float(linprog(costs, A_eq=balance, b_eq=np.zeros(2 * n), bounds=(0, 1), method="highs").fun)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_optimum_of_the_linear_program(seed: int) -> None:
    _, graph = random_graph(np.random.default_rng(100 + seed), 150, 40, density=0.5)
    np.testing.assert_allclose(solve(graph).cost, _linear_program(graph), atol=2 * 150 / SCALE)


def test_the_number_of_tracks_comes_by_itself() -> None:
    """Two good chains and one poor detection, priced by hand."""
    graph = FlowGraph(
        np.array([-5.0, -5, -5, -5, -1]),
        np.full(5, 2.0),
        np.full(5, 2.0),
        np.array([0, 1]),
        np.array([2, 3]),
        np.array([0.5, 0.25]),
    )
    solution = solve(graph)
    assert solution.used.tolist() == [True, True, True, True, False]
    assert track_labels(solution).tolist() == [0, 1, 0, 1, -1]
    assert solution.cost == pytest.approx(objective(graph, solution))
    assert solution.cost == pytest.approx(-20 + 8 + 0.75)


def test_detections_that_continue_a_track_are_used_without_an_entry() -> None:
    graph = FlowGraph(*(np.array([v]) for v in (3.0, 2.0, 1.0)), *(np.empty(0, int),) * 2, np.empty(0))
    assert not solve(graph).used.any()
    continued = solve(graph, inflow=np.array([True]))
    assert continued.used.all()
    assert continued.cost == pytest.approx(3 + 1)


@pytest.mark.parametrize("seed", range(5))
def test_transitions_dearer_than_a_new_track_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, whole = random_graph(rng, 60, 20)
    n = len(whole)
    whole = FlowGraph(whole.observation, np.full(n, 2.0), np.full(n, 1.5), whole.tail, whole.head, whole.transition)
    half = len(whole.tail) // 2
    pieces = [(whole.tail[s], whole.head[s], whole.transition[s]) for s in (slice(None, half), slice(half, None))]
    thinned = build_graph(whole.observation, pieces, entry=2.0, exit=1.5)
    assert len(thinned.tail) < len(whole.tail)
    assert solve(thinned).cost == pytest.approx(solve(whole).cost, abs=2 * n / SCALE)


def test_an_empty_video_has_no_track() -> None:
    solution = solve(build_graph(np.empty(0), [], 1.0, 1.0))
    assert solution.cost == 0
    assert len(track_labels(solution)) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_costs_must_be_finite_and_fit_the_solver(value: float) -> None:
    with pytest.raises(ValueError, match="observation costs"):
        build_graph(np.array([value]), [], 1.0, 1.0)
