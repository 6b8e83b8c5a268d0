"""`tsuiseki reproduce pca-particle-filter`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.trainers.experiments.goldfish.pca_particle_filter import Experiment, Piece


def pca_particle_filter(
    out: Path = Path("out/pca-particle-filter"),
    work: Path = Path("out/cache/pca-particle-filter"),
    seeds: int = 6,
    clips: int = 0,
    minutes: float = 1000.0,
    overwrite: bool = False,
) -> int:
    """How many particles a goldfish needs, with and without what was learnt of its shape and motion.

    Generates 10 clips to learn from and 10 to test on, learns from a wide run with 3000 particles, and follows the 24
    fish of the test clips in four ways with 100 to 3000 particles. DIR gets results.json, motion.json, success.png and
    turns.png (Figs. 6 and 7), beyond.png, particles.png (Figs. 8 and 9) and run.json. With the defaults it takes about
    20 minutes on one core; stopped, it goes on where it was.

    Args:
        out: folder for the results.
        work: folder that keeps clips and finished pieces.
        seeds: of the particles; more give narrower intervals, and only the new ones are run.
        clips: seed of the clips, from 0 to 9999.
        minutes: begin no new piece after so many; run it again to go on.
        overwrite: replace an earlier result.
    """
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.output import check_output_folder
    from tsuiseki.trainers.experiments.goldfish.pca_particle_filter import Experiment, run_pieces

    if seeds < 1 or not minutes > 0:
        raise RequestError(f"expected --seeds from 1 and --minutes above 0, got {seeds} and {minutes:g}")
    check_output_folder(out, overwrite)
    experiment = Experiment(clips=clips, seeds=seeds)
    total = 10 * seeds
    pieces = list(progress(run_pieces(work, experiment, minutes), "pieces", total))
    done = [piece for piece in pieces if piece is not None]
    if len(done) < total:
        print(f"{len(done)} of {total} pieces are done; run the same command again to go on")
        return 0
    _write_results(out, work, experiment, done, overwrite)
    return 0


def _write_results(out: Path, work: Path, experiment: Experiment, pieces: Sequence[Piece], overwrite: bool) -> None:
    import json
    import shutil
    from dataclasses import asdict

    from tsuiseki.datamodules.scenes.fish.sets import write_goldfish_sets
    from tsuiseki.tracking.output import RunRecord, output_folder
    from tsuiseki.trainers.experiments.goldfish.pca_particle_filter import BODY, EXTRACTION, learn, learning_success
    from tsuiseki.trainers.experiments.goldfish.plots import draw_particles, plot_success
    from tsuiseki.trainers.experiments.goldfish.runs import prepare_clip
    from tsuiseki.trainers.experiments.goldfish.summary import summarise

    sets = write_goldfish_sets(work / "clips", experiment.clips)
    followed, fish = learning_success(work, sets.learning)
    values = {**summarise(pieces), "learning_fish": fish, "learning_followed": followed}
    with output_folder(out, overwrite) as folder:
        plot_success(values, "arms", "all", folder / "success.png")
        plot_success(values, "arms", "turning", folder / "turns.png")
        plot_success(values, "beyond", "all", folder / "beyond.png")
        shown = sets.test[0]
        draw_particles(prepare_clip(shown, BODY, EXTRACTION), shown, learn(work, sets), folder / "particles.png")
        shutil.copy(work / "motion.json", folder / "motion.json")
        (folder / "results.json").write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
        settings = {**asdict(experiment), "work": str(work)}
        RunRecord(["tsuiseki", "reproduce", "pca-particle-filter"], settings, experiment.clips).write(folder)
    _show(values)
    print(f"learning run: {followed} of {fish} fish followed to the end; results: {out}")


def _show(values: Mapping[str, Any]) -> None:
    """The tables and the comparisons on the terminal."""
    from rich.table import Table

    from tsuiseki.tracking.evaluation.table import show
    from tsuiseki.trainers.experiments.goldfish.plots import table_rows

    for part in ("arms", "beyond"):
        heading, rows = table_rows(values, part)
        table = Table(*heading)
        for row in rows:
            table.add_row(*row)
        show(table)
    print(f"of {values['fish']} fish, {values['turning']} of which turn suddenly; mean of {values['seeds']} seeds")
    for claim in values["claims"]:
        every, turning = ("{:+.2f} [{:+.2f}, {:+.2f}]".format(*claim[which]) for which in ("all", "turning"))
        print(f"{claim['claim']}: {every} fish; of those that turn {turning}")
