"""A picture of the gradient: which arcs of a crossing the loss makes dearer and cheaper, before and after training."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fit_network
from tsuiseki.trainers.association.flow_loss import DifferenceWeights, FlowLoss, cheapest
from tsuiseki.trainers.association.graphs import DetectedVideo, Graph, Graphs
from tsuiseki.trainers.association.labelled_flow import window
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.windows import affordable
from tsuiseki.trainers.networks.modules import Optimisation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FRAMES, MEETING = 40, 20
DRAWS = 200
LEAST = 0.02


def crossing(seed: int, frames: int = FRAMES) -> DetectedVideo:
    """Two people of a height of 100 pixels who meet and turn round: constant velocity says that they pass.

    They are missed while they meet, now and then elsewhere, and a false box stands beside.
    """
    rng = np.random.default_rng(seed)
    meeting = frames // 2 + int(rng.integers(-3, 4))
    speed = rng.uniform(3.0, 5.0)
    detections, labels = [], []
    for frame in range(frames):
        away = 6 + speed * abs(frame - meeting)
        x = np.array([300 - away, 300 + away])
        boxes = np.stack([x - 20, [100, 104], x + 20, [200, 204]], axis=1)
        labels.append(boxes)
        seen = rng.random(2) > (0.9 if abs(frame - meeting) < 4 else 0.05)
        shown = (boxes + rng.normal(0, 2.0, (2, 4)))[seen]
        scores = rng.uniform(0.7, 1, len(shown))
        if meeting - 8 <= frame < meeting - 4:
            shown = np.concatenate([shown, [[420, 90, 450, 170]]])
            scores = np.append(scores, 0.5)
        detections.append(Detections(shown, scores))
    every = np.ones(2 * frames, dtype=np.bool_)
    frame_of, ids = np.repeat(np.arange(frames), 2), np.tile([1, 2], frames)
    truth = GroundTruth(frame_of, ids, np.concatenate(labels), every, ~every, np.ones(2 * frames))
    return DetectedVideo(f"crossing {seed}", detections, truth, 25.0, (640, 480))


def gradient_of(graph: Graph, changes: NetworkChanges | None, epsilon: float) -> FloatArray:
    """``(3 N + P,)`` the gradient of the Fenchel-Young loss over the arcs' costs."""
    costs, count = graph.costs, len(graph)
    if changes is not None:
        change = changes.detections(graph.detections).T.reshape(3 * count)
        costs = costs + np.concatenate([np.where(graph.fixed, 0, change), changes.links(graph.links)])
    loss, arcs = FlowLoss("fenchel_young", epsilon, DRAWS), graph.arcs(DifferenceWeights())
    problems = loss.problems(costs, arcs, np.random.default_rng(0))
    return loss.value(costs, arcs, problems, [cheapest(problem) for problem in problems])[1]


def trained_on_crossings(seeds: range, fit: Fit) -> NetworkChanges:
    """The network that other crossings teach."""
    found = [sequence_graphs(crossing(seed)) for seed in seeds]
    return NetworkChanges(fit_network([Graphs(affordable(g.detections), g.tracklets, g.lost) for g in found], fit))


def draw_gradient(meetings: int = 20, steps: int = 400, seed: int = 100, epsilon: float = 1.0) -> Figure:
    """The arcs of a meeting that training has not seen, before and after training on others."""
    from matplotlib.figure import Figure

    graph = affordable(sequence_graphs(crossing(seed)).detections)
    meeting = window(graph, MEETING - 9, MEETING + 10)
    how = Optimisation(0.01, 1e-2, warmup_steps=10)
    fit = Fit(FlowLoss("fenchel_young"), trust=1.0, steps=steps, optimisation=how)
    changes = trained_on_crossings(range(meetings), fit)
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    for axes, title, known in zip(
        figure.subplots(1, 2, sharey=True), ("before", "after"), (None, changes), strict=True
    ):
        gradient = gradient_of(meeting, known, epsilon)
        _draw(axes, meeting, gradient)
        axes.set_title(f"{title} training: |gradient| {np.abs(gradient).sum():.1f}")
    return figure


def _draw(axes: Axes, graph: Graph, gradient: FloatArray) -> None:
    """Detections by frame and place; links and rings are green where cheaper, red where dearer is asked for."""
    count = len(graph)
    place = graph.boxes[:, [0, 2]].mean(axis=1)
    links = gradient[3 * count :]
    for k in np.argsort(np.abs(links)):
        if abs(links[k]) < LEAST and not graph.labelled[3 * count + k]:
            continue
        i, j = graph.tail[k], graph.head[k]
        right = graph.labelled[3 * count + k] > 0
        strong = abs(links[k]) >= LEAST
        colour = ("tab:green" if links[k] > 0 else "tab:red") if strong else "lightgray"
        axes.plot(graph.frames[[i, j]], place[[i, j]], color=colour, lw=0.8 + 4 * abs(links[k]), zorder=1 + strong,
                  ls="-" if right else (0, (4, 2)))  # fmt: skip
    starts, ends = gradient[count : 2 * count], gradient[2 * count : 3 * count]
    for arcs, marker, offset in ((starts, "<", -0.32), (ends, ">", 0.32)):
        for k in np.flatnonzero(np.abs(arcs) >= LEAST):
            colour, size = "tab:green" if arcs[k] > 0 else "tab:red", 30 + 90 * abs(arcs[k])
            axes.scatter(graph.frames[k] + offset, place[k], s=size, c=colour, marker=marker, zorder=4)
    fill = np.where(graph.owners < 0, "white", "black")
    axes.scatter(graph.frames, place, s=26, c=fill, edgecolors="black", zorder=5)
    axes.set_xlabel("frame")
    axes.set_ylabel("x, pixels")
