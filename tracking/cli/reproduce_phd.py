"""`tsuiseki reproduce phd` and `phd-equalisation`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tsuiseki.tracking.errors import RequestError


def phd(
    out: Path = Path("out/phd"),
    data: Path = Path("../shared/data"),
    particles: int = 1000,
    runs: int = 10,
    overwrite: bool = False,
) -> None:
    """The finite-set filters on the standard scenarios and on real detections: OSPA, identities, time.

    DIR gets results.json, ospa.png and scaling.png.

    Args:
        out: folder for the results.
        data: folder that holds phd/phd_scenario_*.json and, for the real rows, mot/PETS09-S2L1-first.
        particles: of each target.
        runs: Monte-Carlo runs of each scenario; at most as many as it has.
        overwrite: replace an earlier result.
    """
    from tsuiseki.tracking.output import output_folder
    from tsuiseki.trainers.experiments.finite_sets.phd import reproduce_phd

    if not any((data / "phd").glob("phd_scenario_*.json")):
        raise RequestError(f"expected phd/phd_scenario_*.json in {data}, found none; give the folder with --data")
    at_least_one(particles=particles, runs=runs)
    with output_folder(out, overwrite) as work:
        values = reproduce_phd(data, work, particles, runs)
        finish(work, values, "phd", {"particles": particles, "runs": runs})
    show_rows(
        ("scenario", "clutter", "method", "OSPA p=1", "p=2", "OSPA(2)", "|count|", "switches", "ms/step", "peer p=1"),
        [
            (
                row["scenario"], f"{row['clutter']:g}", row["method"], f"{row['ospa1']:.2f} ± {row['ospa1_error']:.2f}",
                f"{row['ospa2']:.2f}", f"{row['ospa_tracks']:.2f}", f"{row['cardinality_error']:.3f}",
                f"{row['switches']:.1f}", f"{row['milliseconds']:.2f}",
                "" if row["peer"] is None else f"{row['peer']:.1f}",
            )
            for row in values["scenarios"]
        ],
    )  # fmt: skip
    for one in values["scaling"]:
        print(f"{one['method']}: log-log slope over {one['what']} {one['slope']:.2f}")
    show_rows(
        ("PETS09-S2L1-first", "MOTA", "IDF1", "HOTA", "switches"),
        [
            (name, f"{s['mota']:.3f}", f"{s['idf1']:.3f}", f"{s['hota']:.3f}", str(s["id_switches"]))
            for name, s in values["real"].items()
        ],
    )


def equalisation(
    out: Path = Path("out/phd-equalisation"),
    seeds: int = 20,
    frames: int = 150,
    particles: int = 300,
    overwrite: bool = False,
) -> None:
    """Whether equal likelihoods keep the weak target of three: particles over time, with and without.

    DIR gets results.json and particles.png.

    Args:
        out: folder for the results.
        seeds: clips.
        frames: length of each clip.
        particles: of each target.
        overwrite: replace an earlier result.
    """
    from tsuiseki.tracking.output import output_folder
    from tsuiseki.trainers.experiments.finite_sets.equalisation import reproduce_equalisation

    at_least_one(seeds=seeds, frames=frames, particles=particles)
    with output_folder(out, overwrite) as work:
        values = reproduce_equalisation(work, seeds, frames, particles)
        finish(work, values, "phd-equalisation", {"seeds": seeds, "frames": frames, "particles": particles})
    purity = [f"frames, purity {share:.2f}" for share in values["purity"]]
    show_rows(
        ("update", "kept of 3", *purity, "expected count at the end"),
        [
            (
                name, f"{values['kept'][name]:.2f}", *(f"{v:.0f}" for v in values["frames_until_loss"][name]),
                f"{values['expected_count_at_end'][name]:.3g}",
            )
            for name in values["kept"]
        ],
    )  # fmt: skip
    for name, share in values["one_more_kept"].items():
        print(f"{name}: at least one more target kept than as printed on {100 * share:.0f} % of {seeds} seeds")


def at_least_one(**numbers: int) -> None:
    """Refuse options below 1."""
    for name, value in numbers.items():
        if value < 1:
            raise RequestError(f"--{name}: expected at least 1, got {value}")


def finish(work: Path, values: dict[str, Any], name: str, settings: dict[str, Any]) -> None:
    """Write ``results.json`` and ``run.json``."""
    import json

    from tsuiseki.tracking.output import RunRecord

    (work / "results.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    RunRecord(["tsuiseki", "reproduce", name], settings).write(work)


def show_rows(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; nothing where it has no row."""
    from rich.console import Console
    from rich.table import Table

    if not rows:
        return
    table = Table()
    for name in heading:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*row)
    Console(width=160).print(table)
