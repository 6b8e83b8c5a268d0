"""`tsuiseki reproduce multi-correlation-filter`: the thesis's chapter 3."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError

PARTS = ("sweeps", "comparison", "intervals", "pictures")


def multi_correlation_filter(
    out: Path = Path("out/multi-correlation-filter"),
    data: list[Path] | None = None,
    attributes: Path | None = None,
    published: Path | None = None,
    parts: list[str] = list(PARTS),  # noqa: B006, the parser shows it and nobody changes it
    seeds: int = 5,
    overwrite: bool = False,
) -> None:
    """Correlation filters selected by a particle filter: Figs. 3.6-3.12 and Table 3.4, paper and here.

    DIR gets results.json, sweeps.png, comparison.png, intervals.png and search-NAME.png.

    Args:
        out: folder for the results.
        data: folders of sequences (OTB, VOT, UAV123), separated by commas; by default four generated chases.
        attributes: OTB's list of attributes; only sequences in it are used.
        published: folder of tracker_benchmark results (NAME/scores_tb50/ALL.json) to name beside.
        parts: sweeps, comparison, intervals, pictures, separated by commas.
        seeds: how many random seeds.
        overwrite: replace an earlier result.
    """
    from tsuiseki.tracking.output import output_folder

    if unknown := sorted(set(parts) - set(PARTS)):
        raise RequestError(f"--parts: expected some of {', '.join(PARTS)}, got {unknown[0]!r}")
    if seeds < 1:
        raise RequestError(f"--seeds: expected at least 1, got {seeds}")
    with output_folder(out, overwrite) as work:
        values = _run(work, data, attributes, published, parts, list(range(seeds)))
        (work / "results.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    print(f"results: {out}")


def _run(
    work: Path,
    data: list[Path] | None,
    attributes: Path | None,
    published: Path | None,
    parts: list[str],
    seeds: list[int],
) -> dict[str, Any]:
    from tsuiseki.tracking.formats.single import find_single_sequences
    from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
    from tsuiseki.tracking.trackers.single.kcf_particle_settings import ROBUST, THESIS
    from tsuiseki.trainers.experiments import multi_correlation_filter as experiment
    from tsuiseki.trainers.experiments import multi_correlation_filter_plots as plots

    clips = (
        experiment.load(s for folder in data for s in find_single_sequences(folder, attributes))
        if data
        else experiment.generated_clips(4)
    )
    if not clips:
        raise RequestError("--data: expected sequences with images, found none")
    values: dict[str, Any] = {"sequences": [c.sequence.name for c in clips], "seeds": seeds}
    if "sweeps" in parts:
        sweeps = {sweep: experiment.run_sweep(sweep, clips, seeds) for sweep in experiment.SWEEPS}
        values["sweeps"] = {s.name: _show_sweep(s, r) for s, r in sweeps.items()}
        plots.plot_sweeps(sweeps, work / "sweeps.png")
    if "comparison" in parts:
        results = experiment.compare(clips, seeds)
        values["comparison"] = _show_comparison(results)
        values["published"] = _show_published(published)
        values["attributes"] = _show_attributes(experiment.by_attribute(clips, results))
        plots.plot_comparison(results, work / "comparison.png")
    if "intervals" in parts:
        found = experiment.intervals(clips, THESIS, seeds), experiment.intervals(clips, ROBUST, seeds)
        values["intervals"] = {n: _show_intervals(n, f) for n, f in zip(("thesis", "robust"), found, strict=True)}
        plots.plot_intervals(found[0], work / "intervals.png")
        plots.plot_intervals(found[1], work / "intervals-robust.png")
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
