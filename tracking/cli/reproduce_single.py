"""`tsuiseki reproduce multi-correlation-filter`: the thesis's chapter 3."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError

PARTS = ("sweeps", "comparison", "additions", "intervals", "pictures")


def multi_correlation_filter(
    out: Path = Path("out/multi-correlation-filter"),
    data: list[Path] | None = None,
    attributes: Path | None = None,
    published: Path | None = None,
    parts: list[str] = list(PARTS),  # noqa: B006, the parser shows it and nobody changes it
    seeds: int = 5,
    sweep_seeds: int = 2,
    cache: Path = Path("out/cache/multi-correlation-filter"),
    overwrite: bool = False,
) -> None:
    """Correlation filters selected by a particle filter: Figs. 3.6-3.12 and Table 3.4, paper and here.

    DIR gets results.json, sweeps.png, comparison.png, attributes.png, intervals-*.png and search-NAME.png. What was
    run is kept in the cache, so an interrupted experiment goes on where it stopped when it is started again.

    Args:
        out: folder for the results.
        data: folders of sequences (OTB, VOT, UAV123), separated by commas; by default four generated chases.
        attributes: OTB's list of attributes; only sequences in it are used.
        published: folder of tracker_benchmark results (NAME/scores_tb50/ALL.json) to name beside.
        parts: sweeps (Figs. 3.6-3.8, Table 3.4), comparison (Figs. 3.9, 3.11, and by sequence), additions (ours without
            one of them at a time), intervals (Fig. 3.10), pictures (like Fig. 3.12), separated by commas.
        seeds: how many random seeds; their spread is the standard deviation of the mean over sequences.
        sweep_seeds: likewise for the sweeps, which are most of the work.
        cache: folder of finished passes.
        overwrite: replace an earlier result.
    """
    from tsuiseki.tracking.output import check_output_folder, output_folder
    from tsuiseki.trainers.experiments.single.runs import Runs

    if unknown := sorted(set(parts) - set(PARTS)):
        raise RequestError(f"--parts: expected some of {', '.join(PARTS)}, got {unknown[0]!r}")
    for name, value in (("--seeds", seeds), ("--sweep_seeds", sweep_seeds)):
        if value < 1:
            raise RequestError(f"{name}: expected at least 1, got {value}")
    check_output_folder(out, overwrite)
    clips = _clips(data, attributes)
    runs = Runs(cache)
    _run_all(runs, clips, parts, seeds, sweep_seeds)
    with output_folder(out, overwrite) as work:
        values = _results(work, runs, clips, published, parts, (seeds, sweep_seeds))
        (work / "results.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    print(f"results: {out}")


def _clips(data: list[Path] | None, attributes: Path | None) -> Any:
    from tsuiseki.tracking.formats.single import find_single_sequences
    from tsuiseki.trainers.experiments.single.runs import generated_clips, load

    if not data:
        return generated_clips(4)
    clips = load(s for folder in data for s in find_single_sequences(folder, attributes))
    if not clips:
        raise RequestError("--data: expected sequences with images, found none")
    return clips


def _run_all(runs: Any, clips: Any, parts: list[str], seeds: int, sweep_seeds: int) -> None:
    """Every pass that is not in the cache yet, one by one."""
    from functools import partial

    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST, THESIS
    from tsuiseki.trainers.experiments.single import multi_correlation_filter as experiment
    from tsuiseki.trainers.experiments.single.search_intervals import one_pass

    jobs: list[Any] = []
    if "sweeps" in parts:
        entrants = [experiment.combined(sweep.settings(value)) for sweep in experiment.SWEEPS for value in sweep.values]
        jobs += experiment.passes(runs, clips, entrants, range(sweep_seeds))
    if "comparison" in parts:
        jobs += experiment.passes(runs, clips, list(experiment.compared().values()), range(seeds))
    if "additions" in parts:
        jobs += experiment.passes(runs, clips, list(experiment.additions().values()), range(sweep_seeds))
    if "intervals" in parts:
        jobs += [partial(one_pass, runs, c, s, k) for s in (THESIS, ROBUST) for k in range(seeds) for c in clips]
    for job in progress(jobs, "passes", len(jobs)):
        job()


def _results(
    work: Path, runs: Any, clips: Any, published: Path | None, parts: list[str], seeds: tuple[int, int]
) -> dict[str, Any]:
    from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
    from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST, THESIS
    from tsuiseki.trainers.experiments.single import multi_correlation_filter as experiment
    from tsuiseki.trainers.experiments.single import plots
    from tsuiseki.trainers.experiments.single.search_intervals import intervals

    values: dict[str, Any] = {"sequences": [c.sequence.name for c in clips], "seeds": seeds[0], "sweep_seeds": seeds[1]}
    if "sweeps" in parts:
        sweeps = [(sweep, experiment.run_sweep(runs, sweep, clips, range(seeds[1]))) for sweep in experiment.SWEEPS]
        values["sweeps"] = {s.name: _show_sweep(s, r) for s, r in sweeps}
        plots.plot_sweeps(sweeps, work / "sweeps.png")
    if "comparison" in parts:
        results = experiment.compare(runs, clips, range(seeds[0]))
        values["comparison"] = _show_comparison(results)
        values["gains"] = _show_sequences(results, experiment)
        values["published"] = _show_published(published)
        values["attributes"] = _show_attributes(experiment.by_attribute(clips, results))
        plots.plot_comparison(results, work / "comparison.png")
        if values["attributes"]:
            plots.plot_attributes(values["attributes"], work / "attributes.png")
    if "additions" in parts:
        values["additions"] = _show_additions(
            {n: experiment.repeat(runs, clips, e, range(seeds[1])) for n, e in experiment.additions().items()}
        )
    if "intervals" in parts:
        values["intervals"] = {}
        for name, settings in (("thesis", THESIS), ("robust", ROBUST)):
            found = intervals(runs, clips, settings, range(seeds[0]))
            values["intervals"][name] = _show_intervals(name, found)
            plots.plot_intervals(found, work / f"intervals-{name}.png")
    if "pictures" in parts:
        for clip in clips:
            plots.search_pictures(clip, KcfParticle(ROBUST, 0), work / f"search-{clip.sequence.name}.png")
    return values


def _spread(areas: Any) -> str:
    return f"{areas.mean():6.2f} ± {areas.std():.2f}"


def _show_sweep(sweep: Any, results: Any) -> dict[str, Any]:
    print(f"\n{sweep.figure}, {sweep.name}: AUC with 11 thresholds [%]\n{'value':>8}  {'thesis':>6}  here")
    for value, result in results.items():
        paper = f"{sweep.paper[value]:.2f}" if value in sweep.paper else "-"
        print(f"{value:8g}  {paper:>6}  {_spread(result.areas())}")
    return {f"{value:g}": {"paper": sweep.paper.get(value), "here": r.areas().tolist()} for value, r in results.items()}


def _show_additions(results: Any) -> dict[str, Any]:
    print("\nOurs, and ours with one addition taken back: AUC [%], 21 thresholds")
    for name, result in results.items():
        print(f"{name:32}{_spread(result.areas(thesis=False))}")
    return {name: result.areas(thesis=False).tolist() for name, result in results.items()}


def _show_comparison(results: Any) -> dict[str, Any]:
    paper = {"KCF, fixed size": "38.38", "combined, thesis": "40.64"}
    print(f"\nFig. 3.9: AUC [%]\n{'tracker':30}  {'thesis':>6}  11 thresholds    21 thresholds")
    for name, result in results.items():
        print(f"{name:30}  {paper.get(name, '-'):>6}  {_spread(result.areas())}  {_spread(result.areas(thesis=False))}")
    return {
        name: {
            "auc_11": r.areas().tolist(),
            "auc_21": r.areas(thesis=False).tolist(),
            "sequences": {n: [100 * one[n].auc for one in r.scores] for n in r.scores[0]},
        }
        for name, r in results.items()
    }


def _show_sequences(results: Any, experiment: Any) -> dict[str, dict[str, list[float]]]:
    """KCF and the combined tracker sequence by sequence, and what the second gains over the first."""
    bases = list(dict.fromkeys(experiment.GAINS.values()))
    sequences = list(results[bases[0]].scores[0])
    rows = {name: [name] for name in sequences} | ({"mean of all": sequences} if len(sequences) > 1 else {})
    width = max(map(len, rows))

    def show(row: str, cells: list[str]) -> None:
        print(f"{row:{width}}" + "".join(f"  {cell:>{11 if k < len(bases) else 20}}" for k, cell in enumerate(cells)))

    print("\nAUC [%], 21 thresholds: mean ± deviation over seeds (gain over KCF with the same sizes)")
    columns = [*bases, *experiment.GAINS]
    show("", [c.removeprefix("combined, ").replace("fixed size", "fixed").replace(" search", "") for c in columns])
    values = {}
    for row, names in rows.items():
        gained = experiment.gains(results, names)
        cells = [f"{results[base].areas(thesis=False, names=names).mean():.1f}" for base in bases]
        for tracker, points in gained.items():
            areas = results[tracker].areas(thesis=False, names=names)
            cells.append(f"{areas.mean():.1f} ± {areas.std():.1f} ({points.mean():+.1f})")
        show(row, cells)
        values[row] = {tracker: points.tolist() for tracker, points in gained.items()}
    return values


def _show_published(folder: Path | None) -> dict[str, float]:
    """The thesis's comparison trackers that come as files, and which of them are missing."""
    from tsuiseki.tracking.formats.single import read_published

    wanted = ("CSK", "VTS", "Struck", "MIL", "TLD", "SCM")
    found, missing = {}, []
    for name in wanted:
        path = folder / name / "scores_tb50" if folder is not None else None
        if path is not None and (path / "ALL.json").is_file():
            found[name] = 100 * sum(read_published(path)["ALL"].success[::2]) / 11
        else:
            missing.append(name)
    for name, area in found.items():
        print(f"{name + ', published on TB-50':30}  {'-':>6}  {area:6.2f}")
    if missing:
        print(f"no published scores of {', '.join(missing)}: give their folder with --published")
    return found


def _show_attributes(values: Any) -> Any:
    for attribute, areas in values.items():
        chosen = ("KCF, fixed size", "combined, thesis", "KCF, scale search", "combined, robust")
        print(f"{attribute:4}" + "".join(f"  {name} {areas[name]:.1f}" for name in chosen))
    return values


def _show_intervals(name: str, found: Any) -> dict[str, Any]:
    print(f"\nFig. 3.10, {name}: AUC with 11 thresholds [%]")
    result = {}
    for title, part in (("during the search", found.during), ("10 frames after", found.after)):
        result[title] = {way: found.area(overlaps) for way, overlaps in part.items()}
        count = len(part["KCF"])
        print(f"{title:18} ({count} frames)" + "".join(f"  {way} {area:.1f}" for way, area in result[title].items()))
    return result
