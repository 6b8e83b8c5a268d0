"""Does equalising the likelihood keep the weak target alive? End of section 6.2 (`reproduce phd-equalisation`).

Targets of one colour and size but unequal purity stay in view for the whole clip. In the first table the particles
start on the targets, as many on each, and nothing is born, so that a target without particles stays lost. In the second
the start is not the truth, targets are born and survival is below 1. The number of particles is held, since the printed
likelihood only shrinks their sum. The arms differ in the update alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.blob_clip import BlobSceneSettings, plan_blobs
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS, ColourImage
from tsuiseki.tracking.filters.finite_sets.region_births import AnywhereBirths
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    EachAlone,
    Equalised,
    RegionLikelihood,
    Update,
    WithoutOthers,
    as_printed,
    average,
    boxes_of,
    calibrated,
)
from tsuiseki.tracking.filters.finite_sets.region_phd import RegionPhdFilter
from tsuiseki.tracking.filters.motion.points import SteppingBox
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one
from tsuiseki.trainers.experiments.finite_sets.plots import plot_particles
from tsuiseki.trainers.experiments.intervals import interval

ARMS: Mapping[str, tuple[Update, RegionLikelihood]] = {
    "as printed": (as_printed, EachAlone()),
    "equalised": (Equalised(as_printed), EachAlone()),
    "equalised by the mean": (Equalised(as_printed, average), EachAlone()),
    "calibrated": (calibrated, WithoutOthers()),
}


@dataclass(frozen=True)
class Condition:
    """How a filter begins, and what it takes for possible.

    Attributes:
        beside: the start lies so many sides of an object beside the truth; infinite for anywhere in the image.
        births: expected new targets a frame, anywhere (51).
        survival: ``pS``.
    """

    beside: float = 0.0
    births: float = 0.0
    survival: float = 1.0


CONDITIONS: Mapping[str, Condition] = {
    "half a side beside": Condition(beside=0.5),
    "survival 0.98": Condition(survival=0.98),
    "births": Condition(births=0.1),
    "anywhere, births, survival 0.98": Condition(np.inf, 0.1, 0.98),
}
"""Of the second table; each differs in one thing from the first one's, but the last."""
LEAST = 0.05
"""Share of a target's particles below which it has none to speak of."""
LOST_AFTER = 5
"""Frames without an estimate on a target after which it is lost."""


@dataclass(frozen=True)
class Arm:
    """One clip with one update.

    Attributes:
        particles: ``(T, K)`` on each target.
        expected: ``(T,)`` sum of the weights.
        lost: ``(K,)`` frame at which each target was lost; the length of the clip where it never was.
    """

    particles: FloatArray
    expected: FloatArray
    lost: FloatArray


@dataclass(frozen=True)
class Held:
    """What an update holds of the targets in one condition.

    Attributes:
        shares: for each clip and each target, weakest first, the share of the frames of the second half in which the
            target has `LEAST` of its particles.
        counts: expected count at the end of each clip.
    """

    shares: list[list[float]]
    counts: list[float]


def run_arm(name: str, settings: BlobSceneSettings, seed: int, density: int, condition: Condition = Condition()) -> Arm:
    """Follow the targets of a clip from its first frame."""
    update, likelihood = ARMS[name]
    rng = np.random.default_rng(seed)
    # As many particles as (50) gives.
    born = max(round(density * condition.births), 1) if condition.births else 0
    births = AnywhereBirths(condition.births, born, size=(32.0, 32.0))
    fixed = 0 if name == "calibrated" else density * settings.objects
    chosen = RegionPhdFilter(SteppingBox(1.5, 0.5), births, likelihood, update, density, fixed, condition.survival)
    counts, expected = [], []
    state = None
    for (image,), boxes in plan_blobs(settings, seed).frames():
        if state is None:
            size = (float(settings.width), float(settings.height))
            state = chosen.init(*_start(boxes, density, condition.beside, size, rng))
        state, info = chosen.step(state, ColourImage.of(image, NAMED_COLOURS[settings.colour]), rng)
        counts.append(_on_targets(state.particles, boxes))
        expected.append(info.expected_count)
    particles = np.array(counts)
    return Arm(particles, np.array(expected), _lost(particles, least=LEAST * density))


def reproduce(
    bench: Bench, seeds: int = 20, frames: int = 150, particles: int = 300, unknown_seeds: int = 5
) -> Outcome:
    """Whether equal likelihoods keep the weak target of three: particles over time, with and without.

    DIR gets results.json, tables.md and particles.png.

    Args:
        bench: where it works.
        seeds: clips where the start is the truth.
        frames: length of each clip.
        particles: of each target.
        unknown_seeds: clips for each of the other conditions.

    Raises:
        RequestError: a number below 1.
    """
    at_least_one(seeds=seeds, frames=frames, particles=particles, unknown_seeds=unknown_seeds)
    settings = BlobSceneSettings(
        frames=frames, objects=3, purity=(0.45, 0.95), size=(34.0, 34.0), clutter=0, enter=0.0, stay=True, speed=2.0
    )
    jobs = [(name, seed) for name in ARMS for seed in range(seeds)]
    done = {
        (name, seed): bench.store.recall(run_arm, name, settings, seed, particles)
        for name, seed in bench.watch.over(jobs, "clips", len(jobs))
    }
    runs = {name: [done[name, seed] for seed in range(seeds)] for name in ARMS}
    purity = [plan_blobs(settings, seed).paths.purity for seed in range(seeds)]
    order = [np.argsort(one) for one in purity]
    means = {
        name: np.mean([arm.particles[:, rank] for arm, rank in zip(arms, order, strict=True)], axis=0)
        for name, arms in runs.items()
    }
    lost = {name: np.array([a.lost[r] for a, r in zip(arms, order, strict=True)]) for name, arms in runs.items()}
    kept = {name: [int(np.sum(arm.lost >= frames)) for arm in arms] for name, arms in runs.items()}
    gained = {name: np.array(kept[name]) - np.array(kept["as printed"]) for name in ARMS if name != "as printed"}
    values: dict[str, Any] = {
        "seeds": seeds,
        "purity": np.sort(purity[0]).tolist(),
        "kept": {name: float(np.mean(values)) for name, values in kept.items()},
        "kept_by_seed": kept,
        "one_more_kept": {name: float(np.mean(values >= 1)) for name, values in gained.items()},
        "frames_until_loss": {name: values.mean(axis=0).tolist() for name, values in lost.items()},
        "expected_count_at_end": {
            name: float(np.mean([arm.expected[-1] for arm in arms])) for name, arms in runs.items()
        },
    }
    notes = [
        f"{name}: at least one more target kept than as printed on {100 * share:.0f} % of {seeds} seeds"
        for name, share in values["one_more_kept"].items()
    ]
    held = _held(bench, settings, unknown_seeds, particles)
    values["held"] = {condition: {name: asdict(arm) for name, arm in arms.items()} for condition, arms in held.items()}
    notes.append(f"conditions: means over {unknown_seeds} clips, 95 % by Student's t over them")
    plots = {"particles": plot_particles(means, lost, np.sort(purity[0]))}
    return Outcome(values, [_table(values), _held_table(held, np.sort(purity[0]))], plots, notes=notes)


def _held(bench: Bench, settings: BlobSceneSettings, seeds: int, density: int) -> dict[str, dict[str, Held]]:
    """What each arm holds of the targets, by condition and arm."""
    jobs = [(condition, name, seed) for condition in CONDITIONS for name in ARMS for seed in range(seeds)]
    shares: dict[tuple[str, str], list[FloatArray]] = {}
    ends: dict[tuple[str, str], list[float]] = {}
    for condition, name, seed in bench.watch.over(jobs, "clips of other conditions", len(jobs)):
        arm = bench.store.recall(run_arm, name, settings, seed, density, CONDITIONS[condition])
        rank = np.argsort(plan_blobs(settings, seed).paths.purity)
        late = arm.particles[len(arm.particles) // 2 :, rank]
        shares.setdefault((condition, name), []).append((late >= LEAST * density).mean(axis=0))
        ends.setdefault((condition, name), []).append(float(arm.expected[-1]))
    return {
        condition: {name: Held(np.array(shares[condition, name]).tolist(), ends[condition, name]) for name in ARMS}
        for condition in CONDITIONS
    }


def _held_table(held: Mapping[str, Mapping[str, Held]], purity: FloatArray) -> Table:
    """Means over the clips with their intervals, and what each update adds to the printed one for the weakest."""
    columns = [f"held, purity {share:.2f}" for share in purity]
    rows = []
    for condition, arms in held.items():
        printed = np.array(arms["as printed"].shares)[:, 0]
        for name, arm in arms.items():
            shares = np.array(arm.shares)
            gain = "" if name == "as printed" else _percent(shares[:, 0] - printed, "+")
            held_shares = [_percent(column) for column in shares.T]
            rows.append((condition, name, *held_shares, gain, f"{np.mean(arm.counts):.3g}"))
    return Table("", ("condition", "update", *columns, "weakest − as printed", "expected count at the end"), rows)


def _percent(shares: FloatArray, sign: str = "") -> str:
    """Mean and interval; of shares, which have no sign, the interval is cut to what a share can be."""
    lowest = -1.0 if sign else 0.0
    mean, low, high = (f"{100 * np.clip(one, lowest, 1.0):{sign}.0f}" for one in interval(shares))
    return f"{mean} [{low}, {high}] %" if len(shares) > 1 else f"{mean} %"


def _table(values: Mapping[str, Any]) -> Table:
    purity = [f"frames, purity {share:.2f}" for share in values["purity"]]
    rows = [
        (
            name,
            f"{kept:.2f}",
            *(f"{frames:.0f}" for frames in values["frames_until_loss"][name]),
            f"{values['expected_count_at_end'][name]:.3g}",
        )
        for name, kept in values["kept"].items()
    ]
    return Table("", ("update", "kept of 3", *purity, "expected count at the end"), rows)


def _start(
    boxes: FloatArray, density: int, beside: float, size: tuple[float, float], rng: np.random.Generator
) -> tuple[FloatArray, IntArray, float]:
    """Particles on or beside each target with its size, their labels, and the number of targets."""
    count = len(boxes)
    labels = np.repeat(np.arange(1, count + 1), density)
    middles, sides = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    if np.isfinite(beside):
        angle = rng.uniform(0, 2 * np.pi, count)
        middles = middles + beside * sides * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        centres = np.repeat(middles, density, axis=0) + rng.standard_normal((count * density, 2))
    else:
        centres = rng.random((count * density, 2)) * size
    before = centres - 2.0 * rng.standard_normal(centres.shape)
    return np.concatenate([centres, before, np.repeat(sides, density, axis=0)], axis=1), labels, float(count)


def _on_targets(particles: FloatArray, boxes: FloatArray) -> FloatArray:
    """Particles ``(K,)`` whose centre is nearest to each target and inside it."""
    centres = boxes_of(particles)
    middle = (centres[:, :2] + centres[:, 2:]) / 2
    targets = (boxes[:, :2] + boxes[:, 2:]) / 2
    inside = np.all((middle[:, None] >= boxes[None, :, :2]) & (middle[:, None] <= boxes[None, :, 2:]), axis=2)
    distance = np.where(inside, np.linalg.norm(middle[:, None] - targets[None], axis=2), np.inf)
    nearest = np.argmin(distance, axis=1)
    return np.bincount(nearest[np.isfinite(distance.min(axis=1))], minlength=len(boxes)).astype(np.float64)


def _lost(particles: FloatArray, least: float) -> FloatArray:
    """First frame of each target from which ``LOST_AFTER`` frames or the rest have fewer particles than ``least``."""
    frames, targets = particles.shape
    few = particles < least
    lost = np.full(targets, float(frames))
    for target in range(targets):
        for frame in np.flatnonzero(few[:, target]):
            if few[frame : frame + LOST_AFTER, target].all():
                lost[target] = frame
                break
    return lost
