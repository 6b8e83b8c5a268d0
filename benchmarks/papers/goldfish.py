"""Section 5 of the goldfish paper (`pca-particle-filter`): how many particles a fish needs.

With and without what was learnt of shape and motion. Every test clip and seed of the particles is a trial with all arms
and numbers of particles, which share the clip's edges; the store keeps trials, so an interrupted experiment goes on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from cyclopts.types import PositiveInt
from matplotlib.figure import Figure

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.plots import Curve, curves
from benchmarks.papers.store import Cached, Store, write_planned
from benchmarks.papers.tables import Column, Name, interval, tabulated, with_interval
from tsuiseki.datamodules.scenes.goldfish_clip import GoldfishClip, GoldfishSettings
from tsuiseki.tracking.bodies.body import Goldfish
from tsuiseki.tracking.bodies.contour import EdgeImage, Extraction, wide_noise
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.bodies.tracker import DeformableTracker
from tsuiseki.tracking.features.colour_region import ColourRange
from tsuiseki.tracking.filters.body_motion import BodyMotion, RandomWalk
from tsuiseki.tracking.filters.learnt_motion import LearntMotion, motion_text
from tsuiseki.tracking.filters.resampling import probabilities, systematic
from tsuiseki.tracking.formats.body_states import centre_inside, read_silhouettes, read_states, write_states
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, Status
from tsuiseki.tracking.types.tracks import BodyTrack
from tsuiseki.tracking.video.source import open_source
from tsuiseki.trainers.learn_motion import learn_motion

# Fish of the clips to learn from, 20 together, and of those to test on, 24; their seeds lie apart.
LEARNING_FISH = (1, 2, 3, 2, 1, 2, 3, 2, 2, 2)
TEST_FISH = (2, 3, 2, 3, 2, 2, 3, 2, 3, 2)
FIRST_SEEDS = {"learning": 1_000_000, "test": 2_000_000}
LEARNING_PARTICLES = 3000
# Times the learnt deviations; the best of 1, 1.3 and 1.6 with 100 and 200 particles on development clips.
WIDER = 1.6
BODY = Goldfish()
# Brighter than the mirror images in the glass; set on development clips.
EXTRACTION = Extraction(ColourRange((10.0, 42.0), (0.42, 1.0), (0.6, 1.0)))
# A fish that is missed is not searched for again: in the experiment it has failed before.
TRACKER = DeformableSettings(patience=10**6)
# A sudden turn: its least angle, its longest time, and the least step before and after it, pixels.
SUDDEN_ANGLE, WITHIN_FRAMES, LEAST_STEP = np.deg2rad(60.0), 4, 3.0
# Figs. 8 and 9: particles that are drawn, and shown of them; half the side of the part shown, pixels.
DRAWN, SHOWN, HALF = 500, 10, 110
ARMS: Mapping[str, tuple[str, Callable[[LearntMotion], BodyMotion]]] = {
    "A": ("A: random walk (8)", lambda learnt: learnt.random_walk()),
    "B": ("B: body-fixed velocity (16)-(17), independent", lambda learnt: learnt.independent()),
    "C": ("C: body-fixed velocity (16)-(18), learnt together", lambda learnt: learnt.proposal()),
    "D": ("D: constant velocity (9)", lambda learnt: learnt.constant_velocity()),
    "P": ("C as printed, by (14)", lambda learnt: learnt.printed_proposal()),
    "both": ("C + velocity, bend and lag: `--preset conditional`", lambda learnt: learnt.conditional()),
    "wider": (f"C, `--widen {WIDER:g}`", lambda learnt: learnt.widened(WIDER).proposal()),
    "wider B": (f"B, `--widen {WIDER:g}`", lambda learnt: learnt.widened(WIDER).independent()),
}
"""How particles are expected to move, from what was learnt: title and motion; the paper's arms, and what is added."""
PARTS = {"arms": (("A", "B", "C", "D", "P"), (100, 200, 500, 1000, 2000, 3000)),
         "beyond": (("C", "both", "wider", "wider B"), (100, 200, 500))}  # fmt: skip
"""Arms and numbers of particles: the paper's, and what is added."""
CLAIMS = (
    ("the paper: C with 500 against A with 3000", ("C", 500), ("A", 3000)),
    ("C as printed with 500 against A with 3000", ("P", 500), ("A", 3000)),
    ("correlation: C against B, 500", ("C", 500), ("B", 500)),
    ("correlation: C against B, 100", ("C", 100), ("B", 100)),
    ("body-fixed velocity: B against A, 500", ("B", 500), ("A", 500)),
    ("body-fixed and not image velocity: B against D, 500", ("B", 500), ("D", 500)),
    ("what is added and not what is printed: C against (14), 500", ("C", 500), ("P", 500)),
)
Asked: TypeAlias = tuple[str, int]
"""An arm and a nominal number of particles."""
Trial: TypeAlias = Mapping[str, Any]
"""Of one clip and seed, as `run_trial` returns it."""


def reproduce(*, store: Cached, seeds: PositiveInt = 6) -> Outcome:
    """How many particles a goldfish needs, with and without what was learnt of its shape and motion.

    Generates 10 clips to learn from and 10 to test on, learns from a wide run with 3000 particles, and follows the 24
    fish of the test clips in four ways with 100 to 3000 particles. DIR gets results.json, tables.md, motion.json,
    success.png (Figs. 6 and 7) and particles.png (Figs. 8 and 9). With the defaults it takes about 20 minutes on one
    core.

    Args:
        store: of what was computed.
        seeds: of the particles; more give narrower intervals, and only the new ones are run.
    """
    learning, test = clips(store, "learning", LEARNING_FISH), clips(store, "test", TEST_FISH)
    learnt, learning_followed, learning_fish = learn(store, learning)
    runs = list(dict.fromkeys((arm, n) for arms, numbers in PARTS.values() for arm in arms for n in numbers))
    trials = store.each(run_trial, [(folder, learnt, runs, n) for folder in test for n in range(seeds)], "trials")
    by_seed = np.array([followed_counts(trials[seed::seeds]) for seed in range(seeds)])
    counts = {entry: by_seed[:, number] for number, entry in enumerate(runs)}
    turns = np.concatenate([trial["turning"] for trial in trials[::seeds]]).tolist()
    claims: dict[Name, FloatArray] = {
        text: counts[first] - counts[second] for text, first, second in CLAIMS if {first, second} <= set(counts)
    }
    columns = [Column(of, itemgetter(k), "+.2f", show=with_interval) for k, of in enumerate(("all", "that turn"))]
    tables = []
    for part, (arms, numbers) in PARTS.items():
        fish = {ARMS[arm][0]: np.stack([counts[arm, n] for n in numbers], axis=1) for arm in arms}
        of = [Column(str(n), itemgetter(k), ".1f", show=_both) for k, n in enumerate(numbers)]
        tables.append(tabulated(fish, of, ["fish followed: all / turning"], f"Fish followed, {part}"))
    tables.append(tabulated(claims, columns, title="Differences"))
    seconds, frames = (np.sum([entry[name] for entry in trials], axis=0) for name in ("seconds", "fish_frames"))
    preparation = np.mean([entry["preparation"] for entry in trials])
    values = {
        "fish": len(turns),
        "turning": sum(turns),
        "learning_followed": learning_followed,
        "learning_fish": learning_fish,
        "claims": claims,
        "runs": [
            {
                "arm": arm, "title": ARMS[arm][0], "particles": particles, "all": of[:, 0], "turning": of[:, 1],
                "milliseconds": 1000 * spent, "frames_per_second": 1 / (preparation + spent),
            }
            for ((arm, particles), of), spent in zip(counts.items(), (seconds / frames).tolist(), strict=True)
        ],
    }  # fmt: skip
    plots = {"success": plot_success(counts, (len(turns), sum(turns))), "particles": plot_particles(test[0], learnt)}
    notes = [
        f"{len(turns)} fish, {sum(turns)} of which turn suddenly; {seeds} seeds, 95 %",
        f"learning run: {learning_followed} of {learning_fish} fish followed to the end",
    ]
    return Outcome(values, tables, plots, {"motion.json": motion_text(learnt)}, notes)


def clips(store: Store, name: str, counts: Sequence[int]) -> list[Path]:
    """Folders of the clips ``NAME-01`` … of as many fish as ``counts`` says; each is made once."""
    plans = [(GoldfishSettings(fish=fish), FIRST_SEEDS[name] + n) for n, fish in enumerate(counts)]
    return [store.made(f"{name}-{n:02d}", write_planned, GoldfishClip, *plan) for n, plan in enumerate(plans, 1)]


def learn(store: Store, folders: Sequence[Path]) -> tuple[LearntMotion, int, int]:
    """What the learning run over some clips teaches, how many fish it followed to the end, and of how many."""
    files = [store.made(f"{f.name}.csv", write_learning_tracks, f) for f in folders]
    tracks = [track for file in files for track in read_states(file, BODY.fields)]
    parts = [part for track in tracks for part in track.segments()]
    motion = learn_motion(parts, BODY.name, BODY.fields, BODY.angles, read_sequence(folders[0]).frame_rate)
    longest = max(len(list((folder / "img1").iterdir())) for folder in folders)
    return motion, sum(int(track.tracking.sum()) == longest for track in tracks), len(tracks)


def write_learning_tracks(path: Path, clip: Path) -> None:
    """The learning run of section 4.1 on a clip: a fish counts up to the frame before its centre left the silhouette.

    Args:
        path: CSV to write.
        clip: folder of the clip.
    """
    settings = replace(TRACKER, particles=LEARNING_PARTICLES)
    tracks = follow_fish(prepare_clip(clip), RandomWalk(wide_noise(BODY)), settings, seed=0)
    statuses: tuple[Status, Status] = "tracking", "lost"
    right = [replace(t, statuses=statuses[:1] * n + statuses[1:] * (len(t) - n)) for t, n in tracks]
    write_states(path, right, BODY.fields)


@dataclass(frozen=True)
class FishClip:
    """A clip, ready to be tracked many times: edges depend on the frame alone, so that all arms share them.

    Attributes:
        edges: of each frame.
        silhouettes: ``(T, H, W)``, see `read_silhouettes`.
        fish: exact states of each.
        preparation: CPU seconds that a frame's edges and distances took.
    """

    edges: tuple[EdgeImage, ...]
    silhouettes: ImageArray
    fish: tuple[BodyTrack, ...]
    preparation: float


@lru_cache(maxsize=1)
def prepare_clip(folder: Path) -> FishClip:
    """Read a clip and find its edges; kept for the next run on it, since it takes some 300 MB and a second."""
    edges, seconds = [], 0.0
    for frame in open_source(folder).frames():
        started = time.process_time()
        edges.append(EdgeImage.of(frame.image, EXTRACTION))
        seconds += time.process_time() - started
    fish = tuple(read_states(folder / "states.csv", BODY.fields))
    return FishClip(tuple(edges), read_silhouettes(folder), fish, seconds / len(edges))


def follow_fish(
    clip: FishClip, motion: BodyMotion, settings: DeformableSettings, seed: int
) -> list[tuple[BodyTrack, int]]:
    """Follow all fish of a clip from their exact states in the first frame; stop when all have failed.

    Returns:
        Of each fish its track, and the frames before the estimated centre was outside its silhouette: the length of the
        clip where it never was.
    """
    starts = np.array([fish.states[0] for fish in clip.fish])
    tracker = DeformableTracker(BODY, motion, None, settings, starts, seed)
    survived = np.zeros(len(clip.fish), dtype=np.int64)
    for index, edges in enumerate(clip.edges):
        tracker.update_edges(index, edges)
        for row, target in enumerate(tracker.targets):
            inside = centre_inside(clip.silhouettes[index : index + 1], target.id, target.estimate[None, :2])
            survived[row] += int(inside[0] and survived[row] == index)
        if np.all(survived <= index):
            break
    return list(zip(tracker.tracks(), survived.tolist(), strict=True))


def run_trial(folder: Path, learnt: LearntMotion, runs: Sequence[Asked], seed: int) -> Trial:
    """Every arm and number of particles that is ``asked`` for, on the clip in ``folder`` with one ``seed``.

    Returns:
        ``turning``: ``(F,)`` of each fish, whether it turns suddenly; ``preparation``: CPU seconds a frame to find
        edges and distances; ``followed``: ``(A, F)`` of each run and fish, whether the estimated centre lay in the
        fish's silhouette to the end; ``seconds``: ``(A,)`` of CPU for all fish in each run, without the preparation;
        ``fish_frames``: ``(A,)`` how many fish in how many frames that took.
    """
    clip = prepare_clip(folder)
    followed, seconds, frames = [], [], []
    for arm, particles in runs:
        started = time.process_time()
        tracks = follow_fish(clip, ARMS[arm][1](learnt), replace(TRACKER, particles=particles), seed)
        seconds.append(time.process_time() - started)
        followed.append([survived == len(clip.edges) for _, survived in tracks])
        frames.append(sum(len(track) for track, _ in tracks))
    turning = np.array([sudden_turns(fish.states).any() for fish in clip.fish])
    return {
        "turning": turning, "preparation": clip.preparation, "followed": np.array(followed),
        "seconds": np.array(seconds), "fish_frames": np.array(frames),
    }  # fmt: skip


def followed_counts(trials: Sequence[Trial]) -> FloatArray:
    """``(A, 2)`` fish followed to the end in each run of all clips with one seed, of all and of those that turn."""
    followed = np.concatenate([trial["followed"] for trial in trials], axis=1)
    turning = np.concatenate([trial["turning"] for trial in trials])
    return np.stack([followed.sum(axis=1), followed[:, turning].sum(axis=1)], axis=1).astype(np.float64)


def _both(values: FloatArray, form: str) -> str:
    return " / ".join(f"{mean:{form}}" for mean in values.reshape(-1, 2).mean(axis=0))


def plot_success(counts: Mapping[Asked, FloatArray], fish: Sequence[int]) -> Figure:
    """Figs. 6 and 7, and what is added, with intervals over seeds: ``(S, 2)`` followed, of all and of those that turn,
    and how many ``fish`` there are of each."""
    panels: dict[str, list[Curve]] = {}
    panes = (
        ("Fig. 6: all fish", "arms", 0),
        ("Fig. 7: fish that turn suddenly", "arms", 1),
        ("all fish", "beyond", 0),
    )
    for title, part, of in panes:
        arms, numbers = PARTS[part]
        for place, arm in enumerate(arms):
            mean, low, high = np.array([interval(counts[arm, n][:, of]) for n in numbers]).T
            # Intervals that share a number of particles would hide each other.
            across = np.array(numbers) * 1.015 ** (place - len(arms) / 2)
            bars = np.nan_to_num(np.stack([mean - low, high - mean]))
            panels.setdefault(title, []).append(Curve(ARMS[arm][0], across, mean, bars))
    figure = curves(panels, ["particles"] * 3, "followed to the end", (6, 4.8))
    for axes, (_, part, of) in zip(figure.axes, panes, strict=True):
        axes.axhline(fish[of], color="0.6", linewidth=0.8)
        axes.set(xscale="log", ylim=(0, 1.06 * fish[of]))
        axes.set_xticks(PARTS[part][1], [str(number) for number in PARTS[part][1]])
        axes.minorticks_off()
    return figure


def plot_particles(folder: Path, learnt: LearntMotion) -> Figure:
    """Ten particles of the first and of the third arm as they are drawn in a sudden turn, side by side: Figs. 8 and 9.

    Both arms follow a fish from its exact state three frames before it has turned; states are drawn for that frame from
    the particles of the frame before.
    """
    clip = prepare_clip(folder)
    frames = [(n, np.flatnonzero(sudden_turns(fish_truth.states))) for n, fish_truth in enumerate(clip.fish)]
    turns = [(n, int(turned[turned > 3][0])) for n, turned in frames if (turned > 3).any()]
    # Any fish and frame where none has turned.
    fish, frame = next(iter(turns), (0, min(10, len(clip.edges) - 1)))
    image = list(open_source(folder).frames())[frame].image
    x, y = clip.fish[fish].states[frame, :2]
    figure = Figure(figsize=(10, 5.2), dpi=120, layout="constrained")
    for axes, arm in zip(figure.subplots(1, 2), "AC", strict=True):
        axes.imshow(image)
        rng, motion = np.random.default_rng(1), ARMS[arm][1](learnt)
        tracker = DeformableTracker(BODY, motion, None, TRACKER, clip.fish[fish].states[frame - 3 : frame - 2], seed=1)
        for index in range(frame - 3, frame):
            tracker.update_edges(index, clip.edges[index])
        state = tracker.targets[0].particles
        drawn = state.particles[systematic(probabilities(state.log_weights), DRAWN, rng)]
        chosen = rng.choice(DRAWN, SHOWN, replace=False)
        for contour in BODY.contour(motion(drawn, 1, rng)[chosen, : len(BODY.fields)]):
            for stroke in BODY.strokes:
                points = contour[stroke.first : stroke.last]
                axes.plot(*np.concatenate([points, points[: int(stroke.closed)]]).T, color="#3cff78", linewidth=0.8)
        axes.set(xlim=(x - HALF, x + HALF), ylim=(y + HALF, y - HALF), title=ARMS[arm][0], xticks=(), yticks=())
    return figure


def sudden_turns(centres: FloatArray) -> BoolArray:
    """Frames ``(T,)`` by which the direction of motion has turned by over 60 degrees within 4 frames.

    The direction in frame ``t`` is that of the step from ``t - 1``. A fish that hangs still or sways has no direction,
    so both steps must be long enough.

    Args:
        centres: ``(T, 2)`` of one body, pixels; further columns are ignored.
    """
    steps = np.diff(centres[:, :2], axis=0)
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    moving = np.linalg.norm(steps, axis=1) >= LEAST_STEP
    turned = np.zeros(len(centres), dtype=np.bool_)
    for lag in range(1, min(WITHIN_FRAMES, len(steps) - 1) + 1):
        change = np.abs(np.angle(np.exp(1j * (direction[lag:] - direction[:-lag]))))
        turned[1 + lag :] |= (change > SUDDEN_ANGLE) & moving[lag:] & moving[:-lag]
    return turned
