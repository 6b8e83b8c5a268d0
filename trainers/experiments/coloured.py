"""Coloured objects that particles find in the image itself: beside connected components, and with equal likelihoods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tsuiseki.datamodules.scenes.blob_clip import BlobClip, BlobSceneSettings, as_ground_truth
from tsuiseki.tracking.evaluation.point_distances import PointScores, PointTracks, evaluate_points
from tsuiseki.tracking.features.colour_region import NAMED_COLOURS, ColourImage
from tsuiseki.tracking.filters.finite_sets import region_likelihoods as likelihoods
from tsuiseki.tracking.filters.finite_sets.region_phd import AnywhereBirths, PatchBirths, RegionPhdFilter
from tsuiseki.tracking.filters.point_motion import SteppingBox
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.people.tracker import run_tracker
from tsuiseki.tracking.points.settings import BlobSettings
from tsuiseki.tracking.points.tracker import BlobTracker
from tsuiseki.tracking.types import Detections, FloatArray, Frame, IntArray
from tsuiseki.trainers.experiments import study
from tsuiseki.trainers.experiments.study import Bench, Column, Outcome, Study, tabulated, values_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUT_OFF = 50.0
FIRST_SEED = 700
"""Of the clips beside components: nothing else draws from it on."""
USUAL = BlobSceneSettings(frames=100, width=480, height=360)
SCENES: Mapping[str, BlobSceneSettings] = {
    "usual clutter: 12 patches up to a third of an object": USUAL,
    "hard: 40 patches up to a half of an object": replace(USUAL, clutter=40, clutter_reach=0.25),
}


METHODS = ("components and SORT", "track blobs")


def blobs(bench: Bench, seeds: int = 5, particles: int = 300) -> Outcome:
    """The tracker of coloured objects beside connected components and SORT, with usual and with hard clutter.

    DIR gets results.json and tables.md.

    Args:
        bench: where it works.
        seeds: clips of each kind.
        particles: number of particles of each target.

    Raises:
        RequestError: a number below 1.
    """
    study.at_least_one(seeds=seeds, particles=particles)
    rows = {(scene, name): (SCENES[scene], name, particles) for scene in SCENES for name in METHODS}
    found = Study(rows, range(FIRST_SEED, FIRST_SEED + seeds), run_blobs, "clips").run(bench)
    columns = [
        Column("OSPA p=1", "ospa1", ".1f", show=study.with_error),
        Column("missed a frame", "missed"),
        Column("false a frame", "false"),
        Column("count error", "cardinality_error"),
        Column("switches a clip", "switches"),
    ]
    note = f"{seeds} clips of each kind from seed {FIRST_SEED}, cut-off {CUT_OFF:g}; ± is the standard error."
    table = tabulated(found, columns, ("clutter", "method"))
    return Outcome(values_of(found, ("scene", "method")), [table], notes=[note])


def run_blobs(row: tuple[BlobSceneSettings, str, int], seed: int) -> PointScores:
    """A method with so many particles on one clip, an object being there while half of it is in the image."""
    scene, method, particles = row
    frames = list(BlobClip(scene, seed).frames())
    colour = NAMED_COLOURS[scene.colour]
    if method == METHODS[0]:
        # Each patch of the colour that is large enough for an object in the filter's births.
        patches = PatchBirths(smallest=BlobSettings().smallest, limit=200)
        found = [patches.patches(ColourImage.of(image, colour), np.empty((0, 4))) for (image,), _ in frames]
        tracks = run_tracker((Detections(boxes, np.ones(len(boxes))) for boxes in found), Sort())
    else:
        tracker = BlobTracker(colour, BlobSettings(particles=particles))
        for index, ((image,), _) in enumerate(frames):
            tracker.update(Frame(index, index / scene.frame_rate, image))
        tracks = tracker.tracks()
    truth = as_ground_truth(_half_inside(np.stack([boxes for _, boxes in frames]), scene))
    places = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2
    return evaluate_points(PointTracks(truth.frames, truth.ids, places), PointTracks.of(tracks), scene.frames, CUT_OFF)


def _half_inside(boxes: FloatArray, scene: BlobSceneSettings) -> FloatArray:
    """Boxes ``(T, K, 4)``, NaN while less than half lies in the image."""
    size = np.array([scene.width, scene.height])
    sides = np.clip(np.minimum(boxes[..., 2:], size) - np.maximum(boxes[..., :2], 0), 0, None)
    share = sides.prod(axis=-1) / (boxes[..., 2:] - boxes[..., :2]).prod(axis=-1)
    return np.asarray(np.where((share >= 0.5)[..., None], boxes, np.nan))


UPDATES: Mapping[str, tuple[likelihoods.Update, likelihoods.RegionLikelihood]] = {
    "as printed": (likelihoods.as_printed, likelihoods.EachAlone()),
    "equalised": (likelihoods.Equalised(likelihoods.as_printed), likelihoods.EachAlone()),
    "calibrated": (likelihoods.calibrated, likelihoods.WithoutOthers()),
}


TARGETS = 3
LEAST, LOST_AFTER = 0.05, 5
"""A target with fewer than this share of its particles has none to speak of, and is lost after so many such frames."""


@dataclass(frozen=True)
class Weakened:
    """One clip with one update; K targets, the weakest first.

    Attributes:
        particles: ``(T, K)`` on each target.
        expected: ``(T,)`` sum of the weights.
        lost: ``(K,)`` frame at which each target was lost; the length of the clip where it never was.
    """

    particles: FloatArray
    expected: FloatArray
    lost: FloatArray


def equalisation(bench: Bench, seeds: int = 20, frames: int = 150, particles: int = 300) -> Outcome:
    """Whether equal likelihoods keep the weak target of three: particles over time, with and without.

    The end of section 6.2. Targets of one colour and size but unequal purity stay in the image for the whole clip. The
    particles start on the targets, as many on each, and nothing is born, so that a target without particles stays lost.
    Their number is held, since the printed likelihood only shrinks their sum. DIR gets results.json, tables.md and
    particles.png.

    Args:
        bench: where it works.
        seeds: clips.
        frames: length of each clip.
        particles: number of particles of each target.

    Raises:
        RequestError: a number below 1.
    """
    study.at_least_one(seeds=seeds, frames=frames, particles=particles)
    scene = BlobSceneSettings(
        frames=frames, objects=TARGETS, purity=(0.45, 0.95), size=(34.0, 34.0), clutter=0, enter=0.0, stay=True,
        speed=2.0,
    )  # fmt: skip
    rows = {update: (update, scene, particles) for update in UPDATES}
    found = Study(rows, range(seeds), run_update, "clips").run(bench)
    purity = np.sort(BlobClip(scene, 0).purity)
    columns = [
        Column(f"kept of {TARGETS}", lambda one: (one.lost >= frames).sum(), gain=_one_more),
        *(Column(f"frames, purity {p:.2f}", f"lost.{k}", ".0f") for k, p in enumerate(purity)),
        Column("expected count at the end", lambda one: one.expected[-1], ".3g"),
    ]
    table = tabulated(found, columns, ("update",), base="as printed")
    plots, notes = {"particles": plot_particles(found, purity)}, [f"means over {seeds} clips"]
    numbers = {u: [{"lost": w.lost, "expected_count_at_end": w.expected[-1]} for w in of] for u, of in found.items()}
    return Outcome(values_of(numbers, ("update",)), [table], plots, notes=notes)


def _one_more(gained: FloatArray, form: str) -> str:
    del form
    return f"at least one on {100 * np.mean(gained >= 1):.0f} % of the clips"


def run_update(row: tuple[str, BlobSceneSettings, int], seed: int) -> Weakened:
    """Follow the targets of a clip from its first frame with one of `UPDATES` and so many particles of each target."""
    name, scene, density = row
    update, likelihood = UPDATES[name]
    rng = np.random.default_rng(seed)
    fixed = 0 if name == "calibrated" else density * scene.objects
    nowhere = AnywhereBirths(0.0, 0, size=(32.0, 32.0))
    chosen = RegionPhdFilter(SteppingBox(1.5, 0.5), nowhere, likelihood, update, density, fixed, 1.0)
    clip = BlobClip(scene, seed)
    counts, expected = [], []
    state = None
    for (image,), boxes in clip.frames():
        if state is None:
            state = chosen.init(*_start(boxes, density, rng))
        state, info = chosen.step(state, ColourImage.of(image, NAMED_COLOURS[scene.colour]), rng)
        counts.append(_on_targets(state.particles, boxes))
        expected.append(info.expected_count)
    particles = np.array(counts)[:, np.argsort(clip.purity)]
    return Weakened(particles, np.array(expected), _lost(particles, least=LEAST * density))


def _start(boxes: FloatArray, density: int, rng: np.random.Generator) -> tuple[FloatArray, IntArray, float]:
    """Particles on each target with its size, their labels, and the number of targets."""
    count = len(boxes)
    labels = np.repeat(np.arange(1, count + 1), density)
    middles, sides = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    # Drawn for nothing, so that a seed gives the particles of the published numbers.
    rng.uniform(0, 2 * np.pi, count)
    centres = np.repeat(middles, density, axis=0) + rng.standard_normal((count * density, 2))
    before = centres - 2.0 * rng.standard_normal(centres.shape)
    return np.concatenate([centres, before, np.repeat(sides, density, axis=0)], axis=1), labels, float(count)


def _on_targets(particles: FloatArray, boxes: FloatArray) -> FloatArray:
    """Particles ``(K,)`` whose centre is nearest to each target and inside it."""
    centres = likelihoods.boxes_of(particles)
    middle = (centres[:, :2] + centres[:, 2:]) / 2
    targets = (boxes[:, :2] + boxes[:, 2:]) / 2
    inside = np.all((middle[:, None] >= boxes[None, :, :2]) & (middle[:, None] <= boxes[None, :, 2:]), axis=2)
    distance = np.where(inside, np.linalg.norm(middle[:, None] - targets[None], axis=2), np.inf)
    nearest = np.argmin(distance, axis=1)
    return np.bincount(nearest[np.isfinite(distance.min(axis=1))], minlength=len(boxes)).astype(np.float64)


def _lost(particles: FloatArray, least: float) -> FloatArray:
    """First frame of each target from which `LOST_AFTER` frames or the rest have fewer particles than ``least``."""
    few = np.concatenate([particles < least, np.ones((LOST_AFTER, particles.shape[1]), dtype=np.bool_)])
    return np.asarray(sliding_window_view(few, LOST_AFTER, axis=0).all(axis=-1).argmax(axis=0), dtype=np.float64)


def plot_particles(found: Mapping[str, list[Weakened]], purity: FloatArray) -> Figure:
    """Particles on each target over time, and how many of the clips still have it; a column for each update."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.6 * len(found), 5.4), dpi=90, layout="constrained")
    panels = figure.subplots(2, len(found), sharex=True, sharey="row", squeeze=False)
    for (name, clips), (above, below) in zip(found.items(), panels.T, strict=True):
        mean, lost = np.mean([one.particles for one in clips], axis=0), np.array([one.lost for one in clips])
        for target in reversed(range(len(purity))):
            above.plot(mean[:, target], label=f"purity {purity[target]:.2f}")
            below.plot(np.mean(lost[:, target, None] > np.arange(len(mean)), axis=0))
        above.set(title=name, ylim=(0, None))
        below.set(xlabel="frame", ylim=(0, 1.05))
    panels[0, 0].set_ylabel("particles on the target")
    panels[1, 0].set_ylabel("share of clips that still have it")
    panels[0, 0].legend(fontsize="small")
    return figure
