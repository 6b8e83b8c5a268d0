"""The thesis's chapter 3 (`multi-correlation-filter`): correlation filters selected by a particle filter.

The paper's numbers are areas under the success curve with 11 thresholds over the 50 sequences of TB-50; here they are
the same over the sequences that are given, so levels differ and the shapes of the curves are what can be compared.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from operator import call, itemgetter
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from cyclopts.types import PositiveInt

from benchmarks.papers.outcome import Outcome
from benchmarks.papers.peers import Peer, find_peer
from benchmarks.papers.plots import Curve, curves
from benchmarks.papers.store import Cached, Store
from benchmarks.papers.tables import Column, Name, share_of_all, tabulated, with_bootstrap, with_interval
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import spans
from tsuiseki.tracking.evaluation.success_curves import OVERLAPS, evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence, find_single_sequences
from tsuiseki.tracking.geometry import corners_from_xywh, iou_pairs, xywh_from_corners
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST, KcfParticle
from tsuiseki.tracking.single.particles import KcfParticleSettings
from tsuiseki.tracking.single.regularised import RegularisedSettings, RegularisedTracker
from tsuiseki.tracking.single.settings import SingleChoice, SingleMethod
from tsuiseki.tracking.single.tracker import SingleTracker
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray
from tsuiseki.tracking.video.image_folder import read_image

WITHIN, FOLLOWED = 10, 0.5
"""Frames without overlap that are a loss, to be noticed within them; overlap above which a target is followed."""
AFTERWARDS = 10
WAYS = ("KCF", "Fix", "Proposed")
"""Of going on at the start of a search (Fig. 3.10): KCF, a box that stands still, and the particles."""
Loaded: TypeAlias = tuple[FloatArray, list[ImageArray]]
"""Boxes ``(T, 4)`` of a target, NaN without a label, and ``T`` images ``(H, W, 3)`` uint8."""
TargetClip: TypeAlias = Callable[[], Loaded]
"""Loads a clip when it is needed, since all together would fill the memory."""


loaded: Callable[[TargetClip], Loaded] = lru_cache(maxsize=4)(call)
"""Loads a clip, which is kept for the next tracker on it."""


def read_clip(sequence: SingleSequence) -> Loaded:
    """Boxes and images of a sequence."""
    return sequence.boxes, [read_image(path) for path in sequence.images]


def draw_clip(number: int) -> Loaded:
    """Boxes and images of a generated clip."""
    frames = list(SingleClip(SingleClipSettings(), (17, number)).frames())
    return np.concatenate([truth.boxes for _, truth in frames]), [image for (image,), _ in frames]


def drawn_clips(count: int) -> dict[str, TargetClip]:
    """The first so many generated clips by name."""
    return {f"generated-{number + 1}": partial(draw_clip, number) for number in range(count)}


@dataclass(frozen=True)
class Csrt:
    """CSRT of OpenCV-contrib in the environment of ``peer``; it tries so many ``scales``, and 1 keeps the first."""

    peer: Peer
    scales: int


Entrant: TypeAlias = (
    CombinedSettings | KcfParticleSettings | RegularisedSettings | kcf.KcfSettings | SingleMethod | Csrt
)
"""A tracker of an experiment: ours, the thesis's, their filters alone, one of chapter 2, or the peer."""
MAKERS: Mapping[type, Callable[[Any, int], SingleTracker]] = {
    CombinedSettings: Combined,
    KcfParticleSettings: KcfParticle,
    RegularisedSettings: lambda settings, _: RegularisedTracker(settings),
    kcf.KcfSettings: lambda settings, _: kcf.KcfTracker(settings),
    str: lambda method, seed: SingleChoice(method).tracker(seed),
}
"""New trackers by what names them, from that and a seed."""
Scores: TypeAlias = Mapping[str, Any]
"""Of one tracker on one clip, as `clip_scores` returns them."""
Part: TypeAlias = Literal["unseen", "status", "sweeps", "comparison", "intervals", "changes"]
PARTS: tuple[Part, ...] = get_args(Part)
BASELINES: tuple[SingleMethod, ...] = (
    "csk", "mosse", "template", "histogram", "kalman", "meanshift", "camshift", "medianflow", "colour-particle", "mil",
)  # fmt: skip
COMPARED: Mapping[str, Entrant] = {
    "KCF, fixed size": kcf.THESIS,
    "KCF, scale search": kcf.KcfSettings(),
    "thesis, printed": PRINTED,
    "thesis, robust, fixed size": replace(ROBUST, kcf=kcf.THESIS),
    "thesis, robust": ROBUST,
    **{method: method for method in BASELINES},
}
"""Fig. 3.9: KCF, the thesis's tracker as printed and with robust settings, and the baselines of chapter 2."""
BY_CHANGE: Mapping[str, Entrant] = {
    **{name: COMPARED[name] for name in ("KCF, fixed size", "thesis, printed", "thesis, robust, fixed size")},
    "combined, fixed size": CombinedSettings(filter=RegularisedSettings(sizes=1)),
}
"""Fig. 3.11, and the toolkit's own tracker."""
PAPER: Mapping[Name, float] = {"KCF, fixed size": 38.38, "thesis, printed": 40.64}
"""Areas of Fig. 3.9 that the text gives, percent."""
PAPER_MILLISECONDS: Mapping[Name, float] = {"KCF, fixed size": 12.7, "thesis, printed": 35.0}
"""A frame, of 3.3.4, on a Core i7-6700K."""
SEARCHES = {"printed": PRINTED, "robust": ROBUST}
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
SWEEPS: Mapping[str, tuple[str, Mapping[float, KcfParticleSettings], Mapping[float, float]]] = {
    "epsilon_2": (
        "Fig. 3.6",
        {v: replace(PRINTED, response_share=1.0, hypotheses=1, convergence=v)
         for v in (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.1)},
        {0.0: 32.84, 0.03: 37.73},
    ),
    "alpha": (
        "Fig. 3.7",
        {v: replace(PRINTED, hypotheses=1, response_share=v) for v in (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0)},
        {0.3: 38.60, 1.0: 37.73},
    ),
    "M": (
        "Fig. 3.8", {v: replace(PRINTED, hypotheses=v) for v in (1, 2, 5, 10, 20, 30, 40, 50)}, {1: 38.60, 20: 40.64}
    ),
    "mu, uniform": (
        "Table 3.4", {v: replace(PRINTED, past_share=v) for v in SHARES},
        dict(zip(SHARES, (39.97, 39.28, 40.64, 38.95, 38.84), strict=True)),
    ),
    "mu, score": ("Table 3.4", {v: replace(PRINTED, past_by_score=True, past_share=v) for v in SHARES}, {}),
}  # fmt: skip
"""One parameter, the others at the thesis's values, to the letter: the figure of the thesis, trackers by value of the
parameter, and areas by value, where the text gives them, percent."""
FIXED = CombinedSettings(filter=RegularisedSettings(sizes=1))
GROUPS: Mapping[str, tuple[int, Mapping[str, Entrant], Mapping[str, CombinedSettings]]] = {
    "scale search": (
        33,
        {"KCF": kcf.KcfSettings(), "thesis, robust": ROBUST, "filter alone": RegularisedSettings(),
         "combined": CombinedSettings()},
        {},
    ),
    "fixed size": (
        1,
        {"KCF": kcf.THESIS, "thesis, printed": PRINTED, "thesis, robust": replace(ROBUST, kcf=kcf.THESIS),
         "filter alone": FIXED.filter, "combined": FIXED},
        {
            f"colours {share:g}, doubt {doubt:g}": replace(
                FIXED, filter=replace(FIXED.filter, colour_share=share), doubt=doubt
            )
            for share in (0.2, 0.3) for doubt in (0.5, 0.6)
        },
    ),
}  # fmt: skip
"""Trackers that all try other sizes, or none: the sizes of CSRT, those that are compared, and ours to choose from."""
OURS = "combined, chosen on the others"
STATUS: Mapping[str, Entrant] = {
    "KCF": kcf.KcfSettings(),
    "combined": CombinedSettings(),
    "thesis, robust": ROBUST,
}
GENERATED = ((0, 24), (24, 48), (48, 96), (24, 96))
"""Generated clips: `combined` was tuned on the first 24."""


def reproduce(
    *,
    store: Cached,
    data: list[Path] | None = None,
    attributes: Path | None = None,
    parts: Sequence[Part] = PARTS,
    seeds: PositiveInt = 5,
    sweep_seeds: PositiveInt = 5,
    swept: Sequence[str] = tuple(SWEEPS),
    peer: str | None = None,
) -> Outcome:
    """Correlation filters selected by a particle filter: Figs. 3.6-3.11 and Table 3.4, paper and here.

    DIR gets results.json, tables.md, sweeps.png, comparison.png and intervals-*.png.

    Args:
        store: of what was computed.
        data: folders of sequences (OTB, VOT, UAV123); by default four generated clips.
        attributes: OTB's list of what changes in which sequence, a line each: its name, a tab, and kinds such as
            `SV, OCC` (Table 3.1); for changes.
        parts: unseen (the gain over KCF on sequences that no setting was tuned on), status (whether `lost` is true),
            sweeps (Figs. 3.6-3.8, Table 3.4), comparison (Fig. 3.9), intervals (Fig. 3.10), changes (Fig. 3.11).
        seeds: how many random seeds; intervals of 95 % are over them, of the mean over sequences.
        sweep_seeds: likewise for the sweeps, which are most of the work.
        swept: parameters of the sweeps: epsilon_2, alpha, M, "mu, uniform", "mu, score".
        peer: python of an environment with opencv-contrib-python-headless: `unseen` gets rows of its CSRT; by default
            this one, if it has it.

    Raises:
        RequestError: an unknown part, no sequence with images, or a python without the package.
    """
    clips = drawn_clips(0 if data else 4)
    for folder in data or ():
        clips |= {s.name: partial(read_clip, s) for s in find_single_sequences(folder) if s.images}
    if not clips:
        raise RequestError("`data`: expected sequences with images, found none")
    run: Mapping[str, Callable[..., Outcome]] = {
        "unseen": partial(unseen, peer=find_peer(peer, "csrt")),
        "status": lost_status,
        "sweeps": partial(sweeps, swept=swept),
        "comparison": comparison,
        "intervals": intervals,
        "changes": partial(changes, attributes=attributes),
    }
    outcomes = [
        run[part](store, clips, range(sweep_seeds if part == "sweeps" else seeds)) for part in PARTS if part in parts
    ]
    return Outcome(
        {"sequences": list(clips), **{k: v for outcome in outcomes for k, v in (outcome.values or {}).items()}},
        [table for outcome in outcomes for table in outcome.tables],
        {name: plot for outcome in outcomes for name, plot in outcome.plots.items()},
        notes=[note for outcome in outcomes for note in outcome.notes],
    )


def scored(
    store: Store, clips: Mapping[str, TargetClip], entrants: Mapping[str, Entrant], seeds: Sequence[int], what: str
) -> dict[str, list[Scores]]:
    """Scores of each tracker on each clip."""
    scores: dict[str, list[Scores]] = {name: [] for name in entrants}
    jobs = [(clip, name) for clip in clips.values() for name in entrants]
    for clip, name in progress(jobs, what, len(jobs)):
        scores[name].append(clip_scores(store, clip, entrants[name], seeds))
    return scores


def by_seed(scores: Sequence[Scores]) -> list[dict[str, float]]:
    """Mean areas and milliseconds a frame over the clips, one a seed."""
    names = ("auc_11", "auc_21", "milliseconds")
    means = np.mean([[clip[name] for name in names] for clip in scores], axis=0)
    return [dict(zip(names, seed, strict=True)) for seed in means.T.tolist()]


def unseen(store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int], peer: Peer | None = None) -> Outcome:
    """What the combined tracker gains over KCF on sequences that its settings were not tuned on.

    Of a few candidates the one with the best mean over all *other* sequences, with the first seed, is scored on a
    sequence, with all seeds; so no sequence is scored with settings that it helped to choose.
    """
    if len(clips) < 2:
        return Outcome(notes=["unseen: expected at least two sequences to choose settings on others"])
    values: dict[str, Any] = {}
    tables = []
    mean = Column("mean", form=".1f", gain=lambda g, form: f"{with_bootstrap(g, form)}, worst {g.min():{form}}")
    for name, (scales, rows, candidates) in GROUPS.items():
        rivals: dict[str, Entrant] = {"CSRT": Csrt(peer, scales)} if peer else {}
        areas_of = {row: areas(of) for row, of in scored(store, clips, {**rows, **rivals}, seeds, name).items()}
        chosen: list[str] = []
        if candidates:
            first = scored(store, clips, candidates, seeds[:1], f"{name}, candidates")
            chosen = leave_one_out({candidate: areas(of) for candidate, of in first.items()})
            ours = zip(clips.values(), chosen, strict=True)
            areas_of[OURS] = areas(clip_scores(store, clip, candidates[entry], seeds) for clip, entry in ours)
        title = f"Unseen, {name}: AUC [%], 21 thresholds; gain with 95 % over sequences"
        tables.append(tabulated(areas_of, [mean], ("tracker",), title, "KCF"))
        by_clip = {clip: [k] for k, clip in enumerate(clips)}
        columns = [Column(row, entry.__getitem__, ".1f") for row, entry in areas_of.items()]
        tables.append(tabulated(by_clip, columns, ("sequence",), f"The same, {name}, by sequence"))
        values[name] = {"chosen": chosen, **{row: entry.tolist() for row, entry in areas_of.items()}}
    return Outcome({"unseen": values}, tables)


def areas(scores: Iterable[Scores]) -> FloatArray:
    """``(C,)`` areas with 21 thresholds of C clips, means over the seeds, percent."""
    return np.array([clip["auc_21"].mean() for clip in scores])


def leave_one_out(candidates: Mapping[str, FloatArray]) -> list[str]:
    """For each of S > 1 sequences the name of the candidate that is best in the mean of the others.

    Args:
        candidates: ``(S,)`` scores by name; of equal ones the first is taken.
    """
    names, scores = list(candidates), np.array(list(candidates.values()))
    others = scores.sum(axis=1, keepdims=True) - scores
    return [names[k] for k in np.argmax(others, axis=0)]


def lost_status(store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int]) -> Outcome:
    """Whether ``lost`` says the truth: within ten frames of losing the target, and not while it is followed."""
    last = max(high for _, high in GENERATED)
    scores_here = scored(store, clips, STATUS, seeds, "status, given clips")
    drawn = scored(store, drawn_clips(last), STATUS, seeds, "status, generated clips")
    measured = {("given clips", name): of for name, of in scores_here.items()}
    for low, high in GENERATED:
        measured |= {(f"generated clips {low + 1} to {high}", name): of[low:high] for name, of in drawn.items()}
    columns = [
        Column("AUC [%]", lambda clip: clip["auc_21"].mean(), ".1f", gain=with_bootstrap),
        Column("losses noticed within 10 frames", itemgetter("noticed", "losses"), show=_of),
        Column("called lost while followed [% of frames]", itemgetter("alarms", "followed"), ".1f", 1, share_of_all),
    ]
    table = tabulated(
        measured, columns, ("clips", "tracker"), "Status lost", lambda name: (name[0], next(iter(STATUS)))
    )
    values = {
        ", ".join(name): {
            **{key: sum(clip[key] for clip in of) for key in ("losses", "noticed", "followed", "alarms")},
            "areas": areas(of).tolist(),
        }
        for name, of in measured.items()
    }
    return Outcome({"status": values}, [table])


def _of(values: FloatArray, _: str) -> str:
    return "{:.0f} of {:.0f}".format(*values.reshape(-1, 2).sum(axis=0))


def sweeps(
    store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int], swept: Sequence[str] = tuple(SWEEPS)
) -> Outcome:
    """Figs. 3.6 to 3.8 and Table 3.4."""
    tables, panels, values = [], {}, {}
    for name, (figure, trackers, published) in SWEEPS.items():
        if name not in swept:
            continue
        entrants = {f"{value:g}": tracker for value, tracker in trackers.items()}
        areas_of = {value: by_seed(of) for value, of in scored(store, clips, entrants, seeds, name).items()}
        paper: Mapping[Name, float] = {f"{value:g}": area for value, area in published.items()}
        columns = [Column("here, 95 % over seeds", "auc_11", show=with_interval, paper=paper, beside="thesis")]
        tables.append(tabulated(areas_of, columns, ("value",), f"{figure}, {name}: AUC with 11 thresholds [%]"))
        here = [np.array([seed["auc_11"] for seed in of]) for of in areas_of.values()]
        lines = [Curve("here", list(trackers), [float(a.mean()) for a in here], [float(a.std()) for a in here])]
        if published:
            lines.append(Curve("thesis, TB-50", list(published), list(published.values()), style="s--"))
        panels[figure if published else f"{figure}, by score"] = lines
        values[name] = {
            v: {"paper": paper.get(v), "here": [seed["auc_11"] for seed in of]} for v, of in areas_of.items()
        }
    plot = curves(panels, [name for name in SWEEPS if name in swept], "AUC, 11 thresholds [%]", (3.2, 3.2))
    return Outcome({"sweeps": values}, tables, {"sweeps": plot})


def comparison(store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int]) -> Outcome:
    """Fig. 3.9."""
    scores = scored(store, clips, COMPARED, seeds, "comparison")
    rows = {name: by_seed(of) for name, of in scores.items()}
    columns = [
        Column("11 thresholds", "auc_11", show=with_interval, paper=PAPER, beside="thesis"),
        Column("21 thresholds", "auc_21"),
        Column("ms a frame", "milliseconds", ".1f", paper=PAPER_MILLISECONDS, beside="thesis"),
    ]
    tables = [tabulated(rows, columns, ("tracker",), "Fig. 3.9: AUC [%]")]
    ranked = sorted(scores, key=lambda name: -float(np.mean([part["auc_11"] for part in rows[name]])))
    lines = [
        Curve(
            f"{name} [{np.mean([part['auc_11'] for part in rows[name]]):.1f}]", OVERLAPS,
            100 * np.mean([curve for part in scores[name] for curve in part["success"]], axis=0),
            style=("-", "--", ":")[place // 6 % 3],
        )
        for place, name in enumerate(ranked)
    ]  # fmt: skip
    plots = {"comparison": curves({"Fig. 3.9": lines}, ["overlap threshold"], "frames above it [%]", (9, 5))}
    values = {name: {"by_seed": rows[name], "clips": areas(of).tolist()} for name, of in scores.items()}
    return Outcome({"comparison": values}, tables, plots)


def changes(
    store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int], attributes: Path | None = None
) -> Outcome:
    """Fig. 3.11: areas by kind of change in appearance (Table 3.1), of the sequences that ``attributes`` names."""
    if attributes is None:
        return Outcome(notes=["changes: expected `attributes`, the kinds of change of each sequence"])
    listed = dict(line.split("\t") for line in attributes.read_text(encoding="utf-8").splitlines() if "\t" in line)
    kinds = {name: {kind.strip() for kind in listed[name].split(",")} for name in clips if name in listed}
    if not kinds:
        raise RequestError(f"{attributes}: expected lines for sequences of `data`, such as {next(iter(clips))}")
    scores = scored(store, {name: clips[name] for name in kinds}, BY_CHANGE, seeds, "changes")
    area_of = [{name: of[k]["auc_11"].mean() for name, of in scores.items()} for k in range(len(kinds))]
    by_kind = {
        kind: [areas for areas, shown in zip(area_of, kinds.values(), strict=True) if kind in shown]
        for kind in sorted(set().union(*kinds.values()))
    }
    columns = [Column("sequences", lambda _: 1, show=lambda values, _: str(len(values)))]
    columns += [Column(name, name, ".1f") for name in BY_CHANGE]
    table = tabulated(by_kind, columns, ("change",), "Fig. 3.11: AUC with 11 thresholds [%] by kind of change")
    return Outcome({"changes": by_kind}, [table])


def intervals(store: Store, clips: Mapping[str, TargetClip], seeds: Sequence[int]) -> Outcome:
    """Fig. 3.10: overlaps in the frames of search and in the ten frames after, by what is done in the search."""
    tables, plots, values = [], {}, {}
    for name, settings in SEARCHES.items():
        jobs = [(clip, settings, seed) for clip in clips.values() for seed in seeds]
        overlaps_of = store.each(searches, jobs, f"searches, {name}")
        panels, cells = {}, {}
        for part, title in enumerate(("during the search", "10 frames after")):
            pooled = {way: np.concatenate([np.array(run[part][way]) for run in overlaps_of]) for way in WAYS}
            cells[title] = [{"frames": len(pooled["KCF"]), **{way: area(overlaps) for way, overlaps in pooled.items()}}]
            panels[f"({'ab'[part]}) {title}"] = [
                Curve(f"{way} [{area(overlaps):.1f}]", OVERLAPS, success(overlaps), style="-")
                for way, overlaps in pooled.items()
            ]
        columns = [Column("frames", "frames", ".0f"), *(Column(way, way, ".1f") for way in WAYS)]
        tables.append(tabulated(cells, columns, ("",), f"Fig. 3.10, {name}: AUC with 11 thresholds [%]"))
        plots[f"intervals-{name}"] = curves(panels, ["overlap threshold"] * 2, "frames above it [%]")
        values[name] = {title: pooled[0] for title, pooled in cells.items()}
    return Outcome({"intervals": values}, tables, plots)


class Pass(NamedTuple):
    """A tracker's way through a sequence.

    Attributes:
        boxes: ``(T, 4)``.
        lost: ``(T,)`` whether the status was ``lost``.
        drew: whether random numbers were drawn; else every seed gives the same boxes.
        milliseconds: of processor time a frame; NaN of another process.
    """

    boxes: FloatArray
    lost: BoolArray
    drew: bool
    milliseconds: float = float("nan")


def follow(clip: TargetClip, entrant: Entrant, seed: int) -> Pass:
    """One pass."""
    truth, images = loaded(clip)
    first = truth[0]
    if isinstance(entrant, Csrt):
        boxes = follow_with_csrt(entrant, images, first)
        return Pass(boxes, np.zeros(len(boxes), dtype=np.bool_), drew=False)
    tracker = MAKERS[type(entrant)](entrant, seed)
    tracker.start(images[0], first)
    begin = time.process_time()
    states = [tracker.follow(image) for image in images[1:]]
    milliseconds = 1e3 * (time.process_time() - begin) / max(len(states), 1)
    boxes = np.array([first] + [state.box for state in states])
    lost = np.array([False] + [state.status == "lost" for state in states])
    # Particles are the only ones that draw, and these two count the frames in which they have any.
    searched = getattr(tracker, "searched_frames", None)
    return Pass(boxes, lost, searched is None or searched > 0, milliseconds)


def follow_with_csrt(settings: Csrt, images: Sequence[ImageArray], box: FloatArray) -> FloatArray:
    """Boxes ``(T, 4)`` from the first one on; where it reports a failure the box before stands."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "images.npy"
        np.save(path, np.stack(images)[..., ::-1])
        job = {"images": str(path), "box": xywh_from_corners(box).tolist(), "scales": settings.scales}
        boxes = np.array(settings.peer.answer(job), dtype=np.float64)
    return np.asarray(np.concatenate([box[None], corners_from_xywh(boxes)]))


def clip_scores(store: Store, clip: TargetClip, entrant: Entrant, seeds: Sequence[int]) -> Scores:
    """A tracker on a clip, one pass a seed, or one where it never draws random numbers.

    Returns:
        ``auc_11``, ``auc_21``: ``(S,)`` by seed, areas under the success curve with so many thresholds, percent;
        ``success``: ``(S, 21)`` success curves; ``milliseconds``: ``(S,)`` of processor time a frame; of all seeds
        together ``losses``: segments of ten frames and more without any overlap, ``noticed``: those called lost within
        ten frames, ``followed``: frames with an overlap above 0.5, ``alarms``: those called lost.
    """
    first, truth = store.recall(follow, clip, entrant, 0), loaded(clip)[0]
    draws = isinstance(entrant, CombinedSettings | KcfParticleSettings) or entrant == "colour-particle"
    passes = [store.recall(follow, clip, entrant, s) if first.drew else first for s in (seeds if draws else (0,))]
    scores = [evaluate_boxes(truth, result.boxes) for result in passes]
    counts = np.zeros(4, dtype=np.int64)
    for result in passes:
        overlaps = iou_pairs(truth[1:], result.boxes[1:])
        overlaps[~np.isfinite(truth[1:]).all(axis=1)] = np.nan
        counts += count_losses(overlaps, result.lost[1:])
    return {
        "auc_11": 100 * np.array([result.thesis_auc for result in scores]),
        "auc_21": 100 * np.array([result.auc for result in scores]),
        "success": np.array([result.success for result in scores]),
        "milliseconds": np.array([result.milliseconds for result in passes]),
        **dict(zip(("losses", "noticed", "followed", "alarms"), counts.tolist(), strict=True)),
    }


def count_losses(overlaps: FloatArray, lost: BoolArray) -> tuple[int, int, int, int]:
    """Losses, those noticed, followed frames, and those called lost, of one pass.

    Args:
        overlaps: ``(T,)`` with the true box, in [0, 1]; NaN without label, which ends a segment.
        lost: ``(T,)`` whether the status was ``lost``.
    """
    gone = [span for span in spans(np.arange(len(overlaps)), (overlaps <= 0).astype(np.int64)) if span.value]
    begins = [span.first for span in gone if span.last - span.first + 1 >= WITHIN]
    noticed = sum(bool(lost[begin : begin + WITHIN].any()) for begin in begins)
    followed = overlaps > FOLLOWED
    return len(begins), noticed, int(followed.sum()), int((followed & lost).sum())


def searches(clip: TargetClip, settings: KcfParticleSettings, seed: int) -> list[dict[str, list[float]]]:
    """Overlaps during the searches of one pass, and in the ten frames after each, by what is done in the search.

    At each start of a search, KCF and a box that stands still go on from the same state beside the particles.
    """
    tracker, (truth, images) = KcfParticle(settings, seed), loaded(clip)
    parts: list[dict[str, list[float]]] = [{way: [] for way in WAYS} for _ in range(2)]
    tracker.start(images[0], truth[0])
    boxes, searching, states = [truth[0]], [False], [tracker.target]
    for image in images[1:]:
        count = tracker.searched_frames
        boxes.append(tracker.follow(image).box)
        searching.append(tracker.searched_frames > count)
        states.append(tracker.target)
    for begin in [t for t in range(1, len(searching)) if searching[t] and not searching[t - 1]]:
        end = next((t for t in range(begin, len(searching)) if not searching[t]), len(searching))
        stop = next((t for t in range(end, len(searching)) if searching[t]), len(searching))
        last = min(end + AFTERWARDS, stop)
        frames, start = range(begin, last), states[begin - 1]
        paths = (
            _kcf_boxes(images, tracker, start, frames, learn_from=begin),
            _kcf_boxes(images, tracker, start, frames, learn_from=end),
            boxes[begin:last],
        )
        labelled: BoolArray = np.asarray(np.isfinite(truth[begin:last]).all(axis=1))
        for way, path in zip(WAYS, paths, strict=True):
            overlaps = np.where(labelled, iou_pairs(truth[begin:last], np.array(path)), np.nan)
            for part, part_overlaps in zip(parts, np.split(overlaps, [end - begin]), strict=True):
                part[way] += part_overlaps[~np.isnan(part_overlaps)].tolist()
    return parts


def _kcf_boxes(
    images: Sequence[ImageArray], tracker: KcfParticle, state: kcf.KcfState, frames: range, learn_from: int
) -> list[FloatArray]:
    """KCF from ``learn_from`` on; before that the box stands still."""
    boxes = []
    for t in frames:
        if t >= learn_from:
            state = kcf.step(tracker.model, state, images[t])
        boxes.append(tracker.model.box(state.centre, state.size))
    return boxes


def success(overlaps: FloatArray) -> FloatArray:
    """``(21,)`` percent of the frames with a greater overlap than each threshold; NaN without frames."""
    if not len(overlaps):
        return np.full(len(OVERLAPS), np.nan)
    return np.array([100 * (overlaps > threshold).mean() for threshold in OVERLAPS])


def area(overlaps: FloatArray) -> float:
    """Area under the success curve with 11 thresholds, percent; NaN without frames."""
    return float(success(overlaps)[::2].mean())
