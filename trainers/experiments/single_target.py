"""The thesis's chapter 3 (`reproduce multi-correlation-filter`): correlation filters selected by a particle filter.

The paper's numbers are areas under the success curve with 11 thresholds over the 50 sequences of TB-50; here they are
the same over the sequences that are given, so levels differ and the shapes of the curves are what can be compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.single import OVERLAPS
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.combined import CombinedSettings
from tsuiseki.tracking.single.kcf_particle import PRINTED, ROBUST
from tsuiseki.tracking.single.particles import KcfParticleSettings
from tsuiseki.tracking.single.regularised import RegularisedSettings
from tsuiseki.tracking.single.settings import SingleMethod
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.video.image_folder import read_image
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.peers import Peer, find_peer
from tsuiseki.trainers.experiments.single_passes import (
    CSRT,
    WAYS,
    ClipScores,
    Csrt,
    Entrant,
    Recognising,
    TargetClip,
    area,
    chase,
    clip_scores,
    passes,
    searches,
    success,
)
from tsuiseki.trainers.experiments.study import (
    Bench,
    Column,
    Curve,
    Name,
    Outcome,
    at_least_one,
    curves,
    mean_only,
    some_of,
    tabulated,
    with_bootstrap,
    with_deviation,
)

PARTS = ("unseen", "status", "sweeps", "comparison", "intervals")
BASELINES: tuple[SingleMethod, ...] = (
    "csk", "mosse", "template", "histogram", "kalman", "meanshift", "camshift", "medianflow", "colour-particle", "mil",
)  # fmt: skip
COMPARED: Mapping[str, Entrant] = {
    "KCF, fixed size": kcf.THESIS,
    "KCF, scale search": kcf.KcfSettings(),
    "combined, printed": PRINTED,
    "combined, robust, fixed size": replace(ROBUST, kcf=kcf.THESIS),
    "combined, robust": ROBUST,
    **{method: method for method in BASELINES},
}
"""Fig. 3.9: KCF and the combined tracker, the thesis's and ours, and the baselines of chapter 2."""
PAPER: Mapping[Name, float] = {"KCF, fixed size": 38.38, "combined, printed": 40.64}
"""Areas of Fig. 3.9 that the text gives, percent."""
SEARCHES = {"printed": PRINTED, "robust": ROBUST}


@dataclass(frozen=True)
class Sweep:
    """One parameter, the others at the thesis's values, to the letter.

    Attributes:
        figure: of the thesis.
        field: of `KcfParticleSettings`.
        values: tried here.
        paper: its areas by value, where the text gives them, percent.
        others: fields that differ besides.
    """

    figure: str
    field: str
    values: tuple[float, ...]
    paper: Mapping[float, float]
    others: Mapping[str, Any]

    def settings(self, value: float) -> KcfParticleSettings:
        """The tracker with one value of the parameter."""
        return replace(PRINTED, **{**self.others, self.field: value})


SWEEPS: Mapping[str, Sweep] = {
    "epsilon_2": Sweep(
        "Fig. 3.6", "convergence", (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.1), {0.0: 32.84, 0.03: 37.73},
        {"response_share": 1.0, "hypotheses": 1},
    ),
    "alpha": Sweep(
        "Fig. 3.7", "response_share", (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0), {0.3: 38.60, 1.0: 37.73},
        {"hypotheses": 1},
    ),
    "M": Sweep("Fig. 3.8", "hypotheses", (1, 2, 5, 10, 20, 30, 40, 50), {1: 38.60, 20: 40.64}, {}),
    "mu, uniform": Sweep(
        "Table 3.4", "past_share", (0.0, 0.25, 0.5, 0.75, 1.0),
        {0.0: 39.97, 0.25: 39.28, 0.5: 40.64, 0.75: 38.95, 1.0: 38.84}, {},
    ),
    "mu, score": Sweep("Table 3.4", "past_share", (0.0, 0.25, 0.5, 0.75, 1.0), {}, {"past_by_score": True}),
}  # fmt: skip


def _combined(**changes: float) -> CombinedSettings:
    return CombinedSettings(filter=RegularisedSettings(**changes))  # type: ignore[arg-type]


@dataclass(frozen=True)
class ClipGroup:
    """Trackers that all try other sizes, or none: KCF, others beside it, and candidates of ours to choose from."""

    base: kcf.KcfSettings
    others: Mapping[str, Entrant]
    candidates: Mapping[str, CombinedSettings]


GROUPS: Mapping[str, ClipGroup] = {
    "scale search": ClipGroup(
        kcf.KcfSettings(),
        {"kcf-particle, robust": ROBUST, "filter alone": RegularisedSettings(),
         "combined as shipped": CombinedSettings()},
        {
            **{
                f"far sizes {agreement or 'no'}, area {area if area < 2 else 'no'}": _combined(
                    size_agreement=agreement, size_reach=24 if agreement else 0, size_by_area=area
                )
                # No far sizes, those of the contrast of colours alone, and those of their area, too.
                for agreement, area in (
                    (0.0, 2.0), (0.9, 2.0), (0.95, 2.0), (0.9, 0.45), (0.95, 0.4), (0.95, 0.45), (0.95, 0.5)
                )
            },
            "far sizes 0.95, area 0.45, calibration 1": _combined(calibration=1.0),
        },
    ),
    "fixed size": ClipGroup(
        kcf.THESIS,
        {"kcf-particle, printed": PRINTED, "kcf-particle, robust": replace(ROBUST, kcf=kcf.THESIS),
         "filter alone": RegularisedSettings(sizes=1), "combined as shipped": _combined(sizes=1)},
        {
            f"colours {share:g}, certain {certain:g}": replace(_combined(colour_share=share, sizes=1), certain=certain)
            for share in (0.2, 0.3) for certain in (0.4, 0.8)
        },
    ),
}  # fmt: skip
OURS = "combined, chosen on the others"
STATUS: Mapping[str, Entrant] = {
    "KCF": kcf.KcfSettings(),
    "combined": CombinedSettings(),
    "combined, --recognise": Recognising(shipped("appearance_people")),
    "kcf-particle, robust": ROBUST,
}
CHASES = ((0, 24), (24, 48), (48, 96), (24, 96))
"""Generated clips: `combined` and `recognition` were tuned on the first 24, `recognition` on the next 24, too."""


def reproduce(
    bench: Bench,
    data: list[Path] | None = None,
    parts: list[str] = list(PARTS),  # noqa: B006, the parser shows it and nobody changes it
    seeds: int = 5,
    sweep_seeds: int = 2,
    contrib: Path | None = None,
) -> Outcome:
    """Correlation filters selected by a particle filter: Figs. 3.6-3.10 and Table 3.4, paper and here.

    DIR gets results.json, tables.md, sweeps.png, comparison.png and intervals-*.png.

    Args:
        bench: where it works.
        data: folders of sequences (OTB, VOT, UAV123), separated by commas; by default four generated clips.
        parts: unseen (the gain over KCF on sequences that no setting was tuned on), status (whether `lost` is true),
            sweeps (Figs. 3.6-3.8, Table 3.4), comparison (Fig. 3.9), intervals (Fig. 3.10), separated by
            commas.
        seeds: how many random seeds; their spread is the standard deviation of the mean over sequences.
        sweep_seeds: likewise for the sweeps, which are most of the work.
        contrib: the Python of an environment that has opencv-contrib-python-headless: `unseen` gets rows of its CSRT.

    Raises:
        RequestError: an unknown part, a number below 1, no sequence with images, or no OpenCV-contrib in ``contrib``.
    """
    some_of(PARTS, parts=parts)
    at_least_one(seeds=seeds, sweep_seeds=sweep_seeds)
    clips = _clips(data)
    peer = find_peer(str(contrib), CSRT, "opencv-contrib-python-headless", "`contrib`") if contrib else None
    run: Mapping[str, Any] = {
        "unseen": partial(unseen, bench, clips, range(seeds), peer),
        "status": partial(lost_status, bench, clips, range(seeds)),
        "sweeps": partial(sweeps, bench, clips, range(sweep_seeds)),
        "comparison": partial(comparison, bench, clips, range(seeds)),
        "intervals": partial(intervals, bench, clips, range(seeds)),
    }
    found: list[Outcome] = [run[part]() for part in PARTS if part in parts]
    values = {name: value for one in found for name, value in (one.values or {}).items()}
    return Outcome(
        {"sequences": [clip.sequence.name for clip in clips], **values},
        [table for one in found for table in one.tables],
        {name: plot for one in found for name, plot in one.plots.items()},
        notes=[note for one in found for note in one.notes],
    )


def _clips(data: Sequence[Path] | None) -> list[TargetClip]:
    if not data:
        return [chase(number) for number in range(4)]
    sequences = [s for folder in data for s in find_single_sequences(folder) if s.images]
    if not sequences:
        raise RequestError("`data`: expected sequences with images, found none")
    return [TargetClip(s, [read_image(path) for path in s.images]) for s in sequences]


def scored(
    bench: Bench, clips: Sequence[TargetClip | int], entrants: Mapping[str, Entrant], seeds: Sequence[int], what: str
) -> dict[str, list[ClipScores]]:
    """Scores of each tracker on each clip, or on the chase of a number."""
    found: dict[str, list[ClipScores]] = {name: [] for name in entrants}
    jobs = [(clip, name) for clip in clips for name in entrants]
    for clip, name in bench.watch.over(jobs, what, len(jobs)):
        own = passes(bench.store, clip, entrants[name], seeds)
        found[name].append(clip_scores(chase(clip) if isinstance(clip, int) else clip, own))
    return found


def by_seed(scores: Sequence[ClipScores]) -> list[dict[str, float]]:
    """Mean areas over the clips, one a seed."""
    means = {name: np.mean([getattr(one, name) for one in scores], axis=0) for name in ("auc_11", "auc_21")}
    return [{name: float(areas[seed]) for name, areas in means.items()} for seed in range(len(means["auc_11"]))]


def unseen(bench: Bench, clips: Sequence[TargetClip], seeds: Sequence[int], peer: Peer | None = None) -> Outcome:
    """What the combined tracker gains over KCF on sequences that its settings were not tuned on.

    Of a few candidates the one with the best mean over all *other* sequences, with the first seed, is scored on a
    sequence, with all seeds; so no sequence is scored with settings that it helped to choose.
    """
    if len(clips) < 2:
        return Outcome(notes=["unseen: expected at least two sequences to choose settings on others"])
    values: dict[str, Any] = {}
    tables = []
    for name, group in GROUPS.items():
        rows: dict[str, Entrant] = {"KCF": group.base, **group.others}
        rows |= {"CSRT": Csrt(peer, 33 if name == "scale search" else 1)} if peer else {}
        found = {row: areas(of) for row, of in scored(bench, clips, rows, seeds, name).items()}
        first = scored(bench, clips, group.candidates, seeds[:1], f"{name}, candidates")
        chosen = leave_one_out({candidate: areas(of) for candidate, of in first.items()})
        found[OURS] = np.array(
            [
                clip_scores(clip, passes(bench.store, clip, group.candidates[one], seeds)).auc_21.mean()
                for clip, one in zip(clips, chosen, strict=True)
            ]
        )
        title = f"Unseen, {name}: AUC [%], 21 thresholds; gain with 95 % over sequences"
        tables.append(tabulated(found, [Column("mean", form=".1f", gain=_gain)], ("tracker",), title, "KCF"))
        by_clip: dict[Name, list[dict[str, float]]] = {
            clip.sequence.name: [{row: float(one[k]) for row, one in found.items()}] for k, clip in enumerate(clips)
        }
        columns = [Column(row, itemgetter(row), ".1f") for row in found]
        tables.append(tabulated(by_clip, columns, ("sequence",), f"The same, {name}, by sequence"))
        values[name] = {"chosen": chosen, **{row: one.tolist() for row, one in found.items()}}
    return Outcome({"unseen": values}, tables)


def _gain(gains: FloatArray, form: str) -> str:
    return f"{with_bootstrap(gains, form)}, worst {gains.min():{form}}"


def areas(scores: Iterable[ClipScores]) -> FloatArray:
    """``(C,)`` areas with 21 thresholds of C clips, means over the seeds, percent."""
    return np.array([one.auc_21.mean() for one in scores])


def leave_one_out(candidates: Mapping[str, FloatArray]) -> list[str]:
    """For each of S > 1 sequences the name of the candidate that is best in the mean of the others.

    Args:
        candidates: ``(S,)`` scores by name; of equal ones the first is taken.
    """
    names, scores = list(candidates), np.array(list(candidates.values()))
    others = scores.sum(axis=1, keepdims=True) - scores
    return [names[k] for k in np.argmax(others, axis=0)]


def lost_status(bench: Bench, clips: Sequence[TargetClip], seeds: Sequence[int]) -> Outcome:
    """Whether ``lost`` says the truth: within ten frames of losing the target, and not while it is followed."""
    last = max(high for _, high in CHASES)
    given = scored(bench, clips, STATUS, seeds, "status, given clips")
    drawn = scored(bench, range(last), STATUS, seeds, "status, generated clips")
    found = {("given clips", name): of for name, of in given.items()}
    for low, high in CHASES:
        found |= {(f"generated clips {low + 1} to {high}", name): of[low:high] for name, of in drawn.items()}
    columns = [
        Column("AUC [%]", lambda one: one.auc_21.mean(), ".1f", gain=with_bootstrap),
        Column("losses noticed within 10 frames", lambda one: [one.noticed, one.losses], "d", show=_of),
        Column("called lost while followed [% of frames]", lambda one: [one.alarms, one.followed], ".1f", show=_share),
    ]
    table = tabulated(found, columns, ("clips", "tracker"), "Status lost", lambda name: (name[0], next(iter(STATUS))))
    values = {
        ", ".join(name): {
            **{key: sum(getattr(one, key) for one in of) for key in ("losses", "noticed", "followed", "alarms")},
            "areas": areas(of).tolist(),
        }
        for name, of in found.items()
    }
    return Outcome({"status": values}, [table])


def _of(values: FloatArray, form: str) -> str:
    part, whole = values.reshape(-1, 2).sum(axis=0).astype(int)
    return f"{part:{form}} of {whole:{form}}"


def _share(values: FloatArray, form: str) -> str:
    part, whole = values.reshape(-1, 2).sum(axis=0)
    return f"{100 * part / whole if whole else 0.0:{form}}"


def sweeps(bench: Bench, clips: Sequence[TargetClip], seeds: Sequence[int]) -> Outcome:
    """Figs. 3.6 to 3.8 and Table 3.4."""
    tables, panels, values = [], {}, {}
    for name, sweep in SWEEPS.items():
        entrants = {f"{value:g}": sweep.settings(value) for value in sweep.values}
        found = {value: by_seed(of) for value, of in scored(bench, clips, entrants, seeds, name).items()}
        paper: Mapping[Name, float] = {f"{value:g}": area for value, area in sweep.paper.items()}
        columns = [Column("here", "auc_11", show=with_deviation, paper=paper, beside="thesis")]
        tables.append(tabulated(found, columns, ("value",), f"{sweep.figure}, {name}: AUC with 11 thresholds [%]"))
        here = [np.array([one["auc_11"] for one in of]) for of in found.values()]
        lines = [Curve("here", sweep.values, [float(a.mean()) for a in here], [float(a.std()) for a in here])]
        if sweep.paper:
            lines.append(Curve("thesis, TB-50", list(sweep.paper), list(sweep.paper.values()), style="s--"))
        panels[sweep.figure if sweep.paper else f"{sweep.figure}, by score"] = lines
        values[name] = {v: {"paper": paper.get(v), "here": [one["auc_11"] for one in of]} for v, of in found.items()}
    figure = curves(panels, list(SWEEPS), "AUC, 11 thresholds [%]", (3.2, 3.2))
    return Outcome({"sweeps": values}, tables, {"sweeps": figure})


def comparison(bench: Bench, clips: Sequence[TargetClip], seeds: Sequence[int]) -> Outcome:
    """Fig. 3.9."""
    found = scored(bench, clips, COMPARED, seeds, "comparison")
    rows = {name: by_seed(of) for name, of in found.items()}
    columns = [
        Column("11 thresholds", "auc_11", show=with_deviation, paper=PAPER, beside="thesis"),
        Column("21 thresholds", "auc_21", show=with_deviation),
    ]
    tables = [tabulated(rows, columns, ("tracker",), "Fig. 3.9: AUC [%]")]
    ranked = sorted(found, key=lambda name: -float(np.mean([one["auc_11"] for one in rows[name]])))
    lines = [
        Curve(
            f"{name} [{mean_only(np.array([one['auc_11'] for one in rows[name]]), '.1f')}]", OVERLAPS,
            100 * np.mean([curve for one in found[name] for curve in one.success], axis=0),
            style=("-", "--", ":")[place // 6 % 3],
        )
        for place, name in enumerate(ranked)
    ]  # fmt: skip
    plots = {"comparison": curves({"Fig. 3.9": lines}, ["overlap threshold"], "frames above it [%]", (9, 5))}
    values = {name: {"by_seed": rows[name], "clips": areas(of).tolist()} for name, of in found.items()}
    return Outcome({"comparison": values}, tables, plots)


def intervals(bench: Bench, clips: Sequence[TargetClip], seeds: Sequence[int]) -> Outcome:
    """Fig. 3.10: overlaps in the frames of search and in the ten frames after, by what is done in the search."""
    tables, plots, values = [], {}, {}
    for name, settings in SEARCHES.items():
        jobs = [(clip, settings, seed) for clip in clips for seed in seeds]
        found = [bench.store.recall(searches, *job) for job in bench.watch.over(jobs, f"searches, {name}", len(jobs))]
        panels, cells = {}, {}
        for part, title in enumerate(("during the search", "10 frames after")):
            own = {way: np.concatenate([np.array(one[part][way]) for one in found]) for way in WAYS}
            cells[title] = [{"frames": len(own["KCF"]), **{way: area(overlaps) for way, overlaps in own.items()}}]
            panels[f"({'ab'[part]}) {title}"] = [
                Curve(f"{way} [{area(overlaps):.1f}]", OVERLAPS, success(overlaps), style="-")
                for way, overlaps in own.items()
            ]
        columns = [Column("frames", "frames", ".0f"), *(Column(way, way, ".1f") for way in WAYS)]
        tables.append(tabulated(cells, columns, ("",), f"Fig. 3.10, {name}: AUC with 11 thresholds [%]"))
        plots[f"intervals-{name}"] = curves(panels, ["overlap threshold"] * 2, "frames above it [%]")
        values[name] = {title: own[0] for title, own in cells.items()}
    return Outcome({"intervals": values}, tables, plots)
