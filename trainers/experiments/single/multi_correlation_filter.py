"""The thesis's chapter 3 (`reproduce multi-correlation-filter`): correlation filters selected by a particle filter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.single import find_single_sequences, read_published
from tsuiseki.tracking.single.constants import PRINTED, ROBUST
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.single import comparison, lost_status, other_witnesses, plots, unseen
from tsuiseki.trainers.experiments.single.comparison import GAINS, SWEEPS, Repeated, Sweep
from tsuiseki.trainers.experiments.single.runs import Clip, generated_clips, load
from tsuiseki.trainers.experiments.single.search_intervals import Intervals, intervals, one_pass
from tsuiseki.trainers.experiments.study import Bench, Outcome, Table, at_least_one, png

PARTS = ("unseen", "status", "witnesses", "sweeps", "comparison", "additions", "intervals", "pictures")
PUBLISHED = ("CSK", "VTS", "Struck", "MIL", "TLD", "SCM")
# Areas of Fig. 3.9 that the text gives, percent.
PAPER = {"KCF, fixed size": "38.38", "combined, printed": "40.64"}
BY_ATTRIBUTE = ("KCF, fixed size", "combined, printed", "KCF, scale search", "combined, robust")
SEARCHES = {"printed": PRINTED, "robust": ROBUST}


def reproduce(
    bench: Bench,
    data: list[Path] | None = None,
    attributes: Path | None = None,
    published: Path | None = None,
    parts: list[str] = list(PARTS),  # noqa: B006, the parser shows it and nobody changes it
    seeds: int = 5,
    sweep_seeds: int = 2,
    contrib: Path | None = None,
) -> Outcome:
    """Correlation filters selected by a particle filter: Figs. 3.6-3.12 and Table 3.4, paper and here.

    DIR gets results.json, tables.md, sweeps.png, comparison.png, attributes.png, intervals-*.png and search-NAME.png.

    Args:
        bench: where it works.
        data: folders of sequences (OTB, VOT, UAV123), separated by commas; by default four generated chases.
        attributes: OTB's list of attributes; only sequences in it are used.
        published: folder of tracker_benchmark results (NAME/scores_tb50/ALL.json) to name beside.
        parts: unseen (the gain over KCF where no setting was chosen), status (whether `lost` is
            true), witnesses (rules by other witnesses of a loss, on generated chases), sweeps (Figs. 3.6-3.8, Table
            3.4), comparison (Figs. 3.9, 3.11, and by sequence), additions (kcf-particle's `robust` without one
            of them at a time), intervals (Fig. 3.10), pictures (like Fig. 3.12), separated by commas.
        seeds: how many random seeds; their spread is the standard deviation of the mean over sequences.
        sweep_seeds: likewise for the sweeps, which are most of the work.
        contrib: the Python of an environment that has opencv-contrib-python-headless: `unseen` gets rows of its CSRT.

    Raises:
        RequestError: an unknown part, a number below 1, no sequence with images, or no OpenCV-contrib in ``contrib``.
    """
    if unknown := sorted(set(parts) - set(PARTS)):
        raise RequestError(f"`parts`: expected some of {', '.join(PARTS)}, got {unknown[0]!r}")
    at_least_one(seeds=seeds, sweep_seeds=sweep_seeds)
    clips = _clips(data, attributes)
    jobs = _jobs(bench, clips, parts, seeds, sweep_seeds, contrib)
    for job in bench.watch.over(jobs, "passes", len(jobs)):
        job()
    names = [clip.sequence.name for clip in clips]
    values: dict[str, Any] = {"sequences": names, "seeds": seeds, "sweep_seeds": sweep_seeds}
    found: list[Outcome] = []
    if "unseen" in parts:
        found.append(unseen.unseen(bench.store, clips, range(seeds), contrib))
    if "status" in parts:
        found.append(lost_status.lost_status(bench.store, clips, range(seeds)))
    if "witnesses" in parts:
        found.append(other_witnesses.other_witnesses(bench.store, range(seeds)))
    if "sweeps" in parts:
        found.append(_sweeps(bench, clips, range(sweep_seeds)))
    if "comparison" in parts:
        found.append(_comparison(bench, clips, range(seeds), published))
    if "additions" in parts:
        found.append(_additions(bench, clips, range(sweep_seeds)))
    if "intervals" in parts:
        found.append(_intervals(bench, clips, range(seeds)))
    if "pictures" in parts:
        strips = {clip.sequence.name: plots.search_pictures(clip, KcfParticle(ROBUST, 0)) for clip in clips}
        files = {f"search-{name}.png": png(strip) for name, strip in strips.items() if strip is not None}
        found.append(Outcome(files=files))
    return Outcome(
        values | {name: value for one in found for name, value in (one.values or {}).items()},
        [table for one in found for table in one.tables],
        {name: plot for one in found for name, plot in one.plots.items()},
        {name: file for one in found for name, file in one.files.items()},
        [note for one in found for note in one.notes],
    )


def _clips(data: Sequence[Path] | None, attributes: Path | None) -> list[Clip]:
    if not data:
        return generated_clips(4)
    clips = load(s for folder in data for s in find_single_sequences(folder, attributes))
    if not clips:
        raise RequestError("`data`: expected sequences with images, found none")
    return clips


def _jobs(
    bench: Bench, clips: Sequence[Clip], parts: Sequence[str], seeds: int, sweep_seeds: int, contrib: Path | None
) -> list[Callable[[], object]]:
    """Every pass that the parts ask for."""
    store, jobs = bench.store, list[Callable[[], object]]()
    if "unseen" in parts and len(clips) > 1:
        jobs += unseen.passes(store, clips, range(seeds), contrib)
    if "status" in parts:
        jobs += lost_status.passes(store, clips, range(seeds))
    if "witnesses" in parts:
        jobs += other_witnesses.passes(store, range(seeds))
    if "sweeps" in parts:
        entrants = [sweep.settings(value) for sweep in SWEEPS for value in sweep.values]
        jobs += comparison.passes(store, clips, entrants, range(sweep_seeds))
    if "comparison" in parts:
        jobs += comparison.passes(store, clips, comparison.compared().values(), range(seeds))
    if "additions" in parts:
        jobs += comparison.passes(store, clips, comparison.additions().values(), range(sweep_seeds))
    if "intervals" in parts:
        jobs += [
            partial(store.recall, one_pass, c, s, k) for s in SEARCHES.values() for k in range(seeds) for c in clips
        ]
    return jobs


def _spread(areas: FloatArray) -> str:
    return f"{areas.mean():.2f} ± {areas.std():.2f}"


def _sweeps(bench: Bench, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    sweeps = [(sweep, comparison.run_sweep(bench.store, sweep, clips, seeds)) for sweep in SWEEPS]
    values = {
        sweep.name: {
            f"{value:g}": {"paper": sweep.paper.get(value), "here": result.areas().tolist()}
            for value, result in results.items()
        }
        for sweep, results in sweeps
    }
    tables = [_sweep_table(sweep, results) for sweep, results in sweeps]
    return Outcome({"sweeps": values}, tables, {"sweeps": plots.plot_sweeps(sweeps)})


def _sweep_table(sweep: Sweep, results: Mapping[float, Repeated]) -> Table:
    rows = [
        (f"{value:g}", f"{sweep.paper[value]:.2f}" if value in sweep.paper else "-", _spread(result.areas()))
        for value, result in results.items()
    ]
    return Table(f"{sweep.figure}, {sweep.name}: AUC with 11 thresholds [%]", ("value", "thesis", "here"), rows)


def _comparison(bench: Bench, clips: Sequence[Clip], seeds: Sequence[int], published: Path | None) -> Outcome:
    results = comparison.compare(bench.store, clips, seeds)
    found, missing = _published(published)
    attributes = comparison.by_attribute(clips, results)
    gained, by_sequence = _sequences(results)
    trackers = [
        (name, PAPER.get(name, "-"), _spread(result.areas()), _spread(result.areas(thesis=False)))
        for name, result in results.items()
    ]
    trackers += [(f"{name}, published on TB-50", "-", f"{area:.2f}", "") for name, area in found.items()]
    tables = [
        Table("Fig. 3.9: AUC [%]", ("tracker", "thesis", "11 thresholds", "21 thresholds"), trackers),
        by_sequence,
    ]
    figures = {"comparison": plots.plot_comparison(results)}
    if attributes:
        rows = [(name, *(f"{areas[one]:.1f}" for one in BY_ATTRIBUTE)) for name, areas in attributes.items()]
        tables.append(Table("Fig. 3.11: AUC with 11 thresholds [%]", ("attribute", *BY_ATTRIBUTE), rows))
        figures["attributes"] = plots.plot_attributes(attributes)
    values = {
        "comparison": {
            name: {
                "auc_11": r.areas().tolist(),
                "auc_21": r.areas(thesis=False).tolist(),
                "sequences": {n: [100 * one[n].auc for one in r.scores] for n in r.scores[0]},
            }
            for name, r in results.items()
        },
        "gains": gained,
        "published": found,
        "attributes": attributes,
    }
    notes = [f"no published scores of {', '.join(missing)}: give their folder as published"] if missing else []
    return Outcome(values, tables, figures, notes=notes)


def _sequences(results: Mapping[str, Repeated]) -> tuple[dict[str, dict[str, list[float]]], Table]:
    """KCF and the combined tracker sequence by sequence, and what the second gains over the first."""
    bases = list(dict.fromkeys(GAINS.values()))
    sequences = list(results[bases[0]].scores[0])
    named = {name: [name] for name in sequences} | ({"mean of all": sequences} if len(sequences) > 1 else {})
    columns = [
        c.removeprefix("combined, ").replace("fixed size", "fixed").replace(" search", "") for c in (*bases, *GAINS)
    ]
    rows, values = [], {}
    for row, names in named.items():
        gained = comparison.gains(results, names)
        cells = [f"{results[base].areas(thesis=False, names=names).mean():.1f}" for base in bases]
        for tracker, points in gained.items():
            areas = results[tracker].areas(thesis=False, names=names)
            cells.append(f"{areas.mean():.1f} ± {areas.std():.1f} ({points.mean():+.1f})")
        rows.append((row, *cells))
        values[row] = {tracker: points.tolist() for tracker, points in gained.items()}
    title = "AUC [%], 21 thresholds: mean ± deviation over seeds (gain over KCF with the same sizes)"
    return values, Table(title, ("sequence", *columns), rows)


def _published(folder: Path | None) -> tuple[dict[str, float], list[str]]:
    """Areas of the thesis's comparison trackers that come as files, percent, and which of them are missing."""
    found, missing = {}, []
    for name in PUBLISHED:
        path = folder / name / "scores_tb50" if folder is not None else None
        if path is not None and (path / "ALL.json").is_file():
            found[name] = 100 * sum(read_published(path)["ALL"].success[::2]) / 11
        else:
            missing.append(name)
    return found, missing


def _additions(bench: Bench, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    areas = {
        name: comparison.repeat(bench.store, clips, entrant, seeds).areas(thesis=False)
        for name, entrant in comparison.additions().items()
    }
    title = "Ours, and ours with one addition taken back: AUC [%], 21 thresholds"
    table = Table(title, ("", "here"), [(name, _spread(one)) for name, one in areas.items()])
    return Outcome({"additions": {name: one.tolist() for name, one in areas.items()}}, [table])


def _intervals(bench: Bench, clips: Sequence[Clip], seeds: Sequence[int]) -> Outcome:
    found = {name: intervals(bench.store, clips, settings, seeds) for name, settings in SEARCHES.items()}
    values = {
        name: {
            title: {way: one.area(overlaps) for way, overlaps in part.items()}
            for title, part in _stretches(one).items()
        }
        for name, one in found.items()
    }
    tables = [
        Table(
            f"Fig. 3.10, {name}: AUC with 11 thresholds [%]",
            ("", "frames", *one.during),
            [
                (title, str(len(part["KCF"])), *(f"{area:.1f}" for area in values[name][title].values()))
                for title, part in _stretches(one).items()
            ],
        )
        for name, one in found.items()
    ]
    figures = {f"intervals-{name}": plots.plot_intervals(one) for name, one in found.items()}
    return Outcome({"intervals": values}, tables, figures)


def _stretches(found: Intervals) -> dict[str, Mapping[str, FloatArray]]:
    return {"during the search": found.during, "10 frames after": found.after}
