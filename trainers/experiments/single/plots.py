"""Plots of the thesis's chapter 3, made again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from matplotlib.figure import Figure

from tsuiseki.tracking.evaluation.single import OVERLAPS
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.types import ImageArray
from tsuiseki.trainers.experiments.single.comparison import Repeated, Sweep
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.single.search_intervals import Intervals

DPI = 110
STYLES = ("-", "--", ":")


def plot_sweeps(sweeps: Sequence[tuple[Sweep, Mapping[float, Repeated]]]) -> Figure:
    """One panel a parameter: the mean over seeds with its spread, and the paper's points."""
    figure = Figure(figsize=(3.2 * len(sweeps), 3.2), dpi=DPI, layout="constrained")
    for axes, (sweep, results) in zip(np.atleast_1d(figure.subplots(1, len(sweeps))), sweeps, strict=True):
        areas = [r.areas() for r in results.values()]
        axes.errorbar(
            list(results),
            [a.mean() for a in areas],
            [a.std() for a in areas],
            color=COLOURS[0],
            marker="o",
            label="here",
        )
        if sweep.paper:
            axes.plot(list(sweep.paper), list(sweep.paper.values()), "s--", color=COLOURS[4], label="thesis, TB-50")
        axes.set_xlabel(sweep.name)
        axes.set_title(sweep.figure, loc="left")
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=8)
    figure.supylabel("AUC, 11 thresholds [%]", fontsize=9)
    return figure


def plot_comparison(results: Mapping[str, Repeated]) -> Figure:
    """Fig. 3.9: success curves, best first."""
    figure = Figure(figsize=(9, 4.8), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    ranked = sorted(results.items(), key=lambda item: -item[1].areas().mean())
    for n, (name, result) in enumerate(ranked):
        axes.plot(
            OVERLAPS, 100 * result.success(), label=f"{name} [{result.areas().mean():.1f}]",
            color=COLOURS[n % len(COLOURS)], linestyle=STYLES[n // len(COLOURS) % len(STYLES)],
        )  # fmt: skip
    axes.set_xlabel("Overlap threshold")
    axes.set_ylabel("Frames above it [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    return figure


def plot_attributes(values: Mapping[str, Mapping[str, float]]) -> Figure:
    """Fig. 3.11: KCF and the combined tracker by attribute."""
    shown = ("KCF, fixed size", "combined, printed", "KCF, scale search", "combined, robust")
    figure = Figure(figsize=(8.5, 3.4), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    for n, name in enumerate(shown):
        heights = [areas[name] for areas in values.values()]
        axes.bar(np.arange(len(values)) + 0.2 * (n - 1.5), heights, 0.18, color=COLOURS[n], label=name)
    axes.set_xticks(np.arange(len(values)), list(values))
    axes.set_ylabel("AUC, 11 thresholds [%]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1))
    return figure


def plot_intervals(found: Intervals) -> Figure:
    """Fig. 3.10: success in the frames of search, and after it."""
    figure = Figure(figsize=(9, 3.6), dpi=DPI, layout="constrained")
    titles = ("(a) during the search", "(b) the 10 frames after")
    for axes, title, part in zip(figure.subplots(1, 2), titles, (found.during, found.after), strict=True):
        for n, (name, overlaps) in enumerate(part.items()):
            curve = [100 * (overlaps > t).mean() if len(overlaps) else np.nan for t in OVERLAPS]
            axes.plot(OVERLAPS, curve, color=COLOURS[n], label=f"{name} [{Intervals.area(overlaps):.1f}]")
        axes.set_title(title, loc="left")
        axes.set_xlabel("Overlap threshold")
        axes.set_ylabel("Frames above it [%]")
        axes.set_ylim(0, 102)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False)
    return figure


def search_pictures(clip: Clip, tracker: KcfParticle) -> ImageArray | None:
    """Like Fig. 3.12: frames about the longest search, with the box, the truth and the particles; None without one."""
    tracker.start(clip.images[0], clip.sequence.boxes[0])
    shown: list[tuple[int, ImageArray, bool]] = []
    for t, image in enumerate(clip.images[1:], 1):
        count = tracker.searched_frames
        box = tracker.follow(image).box
        shown.append((t, _picture(clip, tracker, image, box, t), tracker.searched_frames > count))
    searching = np.array([s for _, _, s in shown])
    if not searching.any():
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[False], searching, [False]]).astype(int)))
    runs = edges.reshape(-1, 2)
    first, last = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    chosen: Sequence[int] = np.unique(np.clip([first - 1, first, last - 1, last + 2], 0, len(shown) - 1)).tolist()
    return np.concatenate([shown[k][1] for k in chosen], axis=1)


def _picture(clip: Clip, tracker: KcfParticle, image: ImageArray, box: np.ndarray, t: int) -> ImageArray:
    picture = image.copy()
    if tracker.search is not None:
        for x, y in np.round(tracker.search.state.particles[:, :2]).astype(int).tolist():
            cv2.circle(picture, (x, y), 1, (255, 200, 0), -1)
    for corners, colour in ((clip.sequence.boxes[t], (0, 200, 0)), (box, (230, 40, 40))):
        if np.isfinite(corners).all():
            x1, y1, x2, y2 = np.round(corners).astype(int).tolist()
            cv2.rectangle(picture, (x1, y1), (x2, y2), colour, 2)
    cv2.putText(
        picture, f"{t + 1}: {tracker.target.peak:.2f}", (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1
    )
    return picture
