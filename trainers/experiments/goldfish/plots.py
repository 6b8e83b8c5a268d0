"""Figures 6 to 9 of the goldfish paper, drawn from the runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from tsuiseki.datamodules.scenes.fish.turns import sudden_turns
from tsuiseki.tracking.bodies.page import draw_contour
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.filters.motion.body_motion import draw
from tsuiseki.tracking.filters.particles.resampling import systematic
from tsuiseki.tracking.filters.particles.weights import probabilities
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import open_source
from tsuiseki.trainers.experiments.goldfish.arms import ARMS, Learnt
from tsuiseki.trainers.experiments.goldfish.runs import Clip
from tsuiseki.trainers.experiments.goldfish.trials import BODY, TRACKER

SHOWN_PARTICLES = 10
ZOOM = 3
HALF = 110


def plot_success(values: Mapping[str, Any], part: str, which: str) -> Figure:
    """Fish followed to the end over the number of particles, with intervals over seeds: Fig. 6, and Fig. 7 for turns.

    Args:
        values: see `summarise`.
        part: ``arms`` or ``beyond``.
        which: ``all`` or ``turning``.
    """
    rows = [row for row in values["table"] if row["part"] == part]
    total = values["fish"] if which == "all" else values["turning"]
    figure = Figure(figsize=(7, 4.8), dpi=110, layout="constrained")
    axes = figure.subplots()
    arms = list(dict.fromkeys(row["arm"] for row in rows))
    for place, arm in enumerate(arms):
        own = [row for row in rows if row["arm"] == arm]
        mean, low, high = np.array([row[which] for row in own]).T
        # Intervals that share a number of particles would hide each other.
        x = np.array([row["particles"] for row in own]) * 1.015 ** (place - len(arms) / 2)
        error = np.nan_to_num(np.stack([mean - low, high - mean]))
        axes.errorbar(x, mean, error, marker="o", markersize=4, capsize=2, color=_colour(place), label=own[0]["title"])
    axes.axhline(total, color="0.6", linewidth=0.8)
    axes.set_xscale("log")
    ticks = sorted({row["particles"] for row in rows})
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    what = "fish" if which == "all" else "fish that turn suddenly"
    axes.set(xlabel="particles", ylabel=f"{what} followed to the end", ylim=(0, 1.06 * total))
    axes.grid(visible=True, alpha=0.3)
    figure.legend(fontsize="small", loc="outside lower center", ncols=2, frameon=False)
    return figure


def _colour(place: int) -> str:
    return (*COLOURS, "#000000", "#999999", "#b8860b", "#8b0000")[place]


def draw_particles(clip: Clip, folder: Path, learnt: Learnt, particles: int = 500) -> ImageArray:
    """Ten particles of the first and of the third arm as they are drawn in a sudden turn, side by side: Figs. 8 and 9.

    Both arms follow a fish from its exact state three frames before it has turned.

    Args:
        clip: to look at; its first fish that turns in time is shown.
        folder: of the clip.
        learnt: what the arms draw from.
        particles: that are drawn, of which ten are shown.
    """
    fish, frame = first_turn(clip)
    image = list(open_source(folder).frames())[frame].image
    tiles = [_tile(image, predicted(clip, arm, learnt, fish, frame, particles), ARMS[arm].title) for arm in "AC"]
    return np.concatenate(tiles, axis=1)


def first_turn(clip: Clip) -> tuple[int, int]:
    """Index of a fish, and the frame from the fourth on in which it has turned suddenly; any frame where none has."""
    for index, fish in enumerate(clip.fish):
        frames = np.flatnonzero(sudden_turns(fish.states))
        frames = frames[frames > 3]
        if len(frames):
            return index, int(frames[0])
    return 0, min(10, len(clip.edges) - 1)


def predicted(clip: Clip, arm: str, learnt: Learnt, fish: int, frame: int, particles: int) -> FloatArray:
    """States ``(10, D)`` drawn for ``frame`` from the particles of the frame before."""
    motion = ARMS[arm].motion(learnt)
    rng = np.random.default_rng(1)
    first = frame - 3
    tracker = DeformableTracker(BODY, motion, None, TRACKER, clip.fish[fish].states[first : first + 1], seed=1)
    for index in range(first, frame):
        tracker.update_edges(index, clip.edges[index])
    state = tracker.targets[0].particles
    drawn = state.particles[systematic(probabilities(state.log_weights), particles, rng)]
    chosen = rng.choice(particles, SHOWN_PARTICLES, replace=False)
    return np.asarray(draw(motion, drawn, rng)[chosen, : len(BODY.fields)])


def _tile(image: ImageArray, states: FloatArray, title: str) -> ImageArray:
    """The part of the image about the particles, enlarged, with their contours and a title."""
    x, y = np.round(np.median(states[:, :2], axis=0)).astype(int)
    left, top = np.clip([x - HALF, y - HALF], 0, [image.shape[1] - 2 * HALF, image.shape[0] - 2 * HALF])
    part = cv2.resize(image[top : top + 2 * HALF, left : left + 2 * HALF], None, fx=ZOOM, fy=ZOOM)
    tile = np.asarray(part, dtype=np.uint8)
    for contour in (BODY.contour(states) - np.array([left, top], dtype=np.float32)) * np.float32(ZOOM):
        draw_contour(tile, BODY, contour, (60, 255, 120), 1)
    cv2.rectangle(tile, (0, 0), (tile.shape[1], 26), (255, 255, 255), cv2.FILLED)
    cv2.putText(tile, title, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    tile[:, -2:] = 255
    return tile
