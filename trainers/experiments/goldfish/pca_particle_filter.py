"""Section 5 of the goldfish paper (`reproduce pca-particle-filter`): how many particles a fish needs.

With and without what was learnt of shape and motion. For every test clip and seed there is one trial with all arms and
particle numbers; an experiment that is stopped goes on with the next trial.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.motion.learnt import motion_text
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.trainers.experiments.experiment import Bench, Outcome, Table, at_least_one, png
from tsuiseki.trainers.experiments.goldfish.plots import draw_particles, plot_success
from tsuiseki.trainers.experiments.goldfish.runs import prepare_clip
from tsuiseki.trainers.experiments.goldfish.summary import summarise
from tsuiseki.trainers.experiments.goldfish.trials import (
    BODY,
    EXTRACTION,
    followed_to_the_end,
    goldfish_sets,
    learn,
    learning_tracks,
    run_trial,
)

PARTICLES = (100, 200, 500, 1000, 2000, 3000)
BEYOND_PARTICLES = (100, 200, 500)


def reproduce(bench: Bench, seeds: int = 6, clips: int = 0, minutes: float = 1000.0) -> Outcome:
    """How many particles a goldfish needs, with and without what was learnt of its shape and motion.

    Generates 10 clips to learn from and 10 to test on, learns from a wide run with 3000 particles, and follows the 24
    fish of the test clips in four ways with 100 to 3000 particles. DIR gets results.json, tables.md, motion.json,
    success.png and turns.png (Figs. 6 and 7), beyond.png, and particles.png (Figs. 8 and 9). With the defaults it takes
    about 20 minutes on one core.

    Args:
        bench: where it works.
        seeds: of the particles; more give narrower intervals, and only the new ones are run.
        clips: seed of the clips, from 0 to 9999.
        minutes: begin no new trial after so many; run it again to go on.

    Raises:
        RequestError: no seed, no time, or another seed of clips.
    """
    started = time.monotonic()
    at_least_one(seeds=seeds)
    if not minutes > 0:
        raise RequestError(f"`minutes`: expected a number above 0, got {minutes:g}")
    sets = goldfish_sets(bench.store, clips)
    tracks = learning_tracks(bench.store, sets)
    learnt = learn(tracks, read_sequence(sets.learning[0]).frame_rate)
    asked = [(folder, learnt, PARTICLES, BEYOND_PARTICLES, seed) for folder in sets.test for seed in range(seeds)]
    trials = [
        bench.store.recall(run_trial, *trial)
        for trial in bench.watch.over(asked, "trials", len(asked))
        if time.monotonic() - started <= 60 * minutes or bench.store.has(run_trial, *trial)
    ]
    if len(trials) < len(asked):
        line = f"{len(trials)} of {len(asked)} trials are done; run the same command again to go on"
        return Outcome(notes=[line], finished=False)
    followed, fish = followed_to_the_end(tracks, sets)
    values = {**summarise(trials), "learning_fish": fish, "learning_followed": followed}
    shown = sets.test[0]
    return Outcome(
        values,
        [_table(values, part) for part in ("arms", "beyond")],
        {
            "success": plot_success(values, "arms", "all"),
            "turns": plot_success(values, "arms", "turning"),
            "beyond": plot_success(values, "beyond", "all"),
        },
        {
            "particles.png": png(draw_particles(prepare_clip(shown, BODY, EXTRACTION), shown, learnt)),
            "motion.json": motion_text(learnt.motion),
        },
        [*_claims(values), f"learning run: {followed} of {fish} fish followed to the end"],
    )


def _table(values: Mapping[str, Any], part: str) -> Table:
    """Fish followed, of all and of those that turn, by number of particles."""
    rows = [row for row in values["table"] if row["part"] == part]
    numbers = sorted({row["particles"] for row in rows})
    lines: list[Sequence[str]] = []
    for arm in dict.fromkeys(row["arm"] for row in rows):
        own = {row["particles"]: row for row in rows if row["arm"] == arm}
        cells = [f"{own[n]['all'][0]:.1f} / {own[n]['turning'][0]:.1f}" for n in numbers]
        lines.append([own[numbers[0]]["title"], *cells])
    return Table("", ["fish followed: all / turning", *map(str, numbers)], lines)


def _claims(values: Mapping[str, Any]) -> list[str]:
    lines = [f"of {values['fish']} fish, {values['turning']} of which turn suddenly; mean of {values['seeds']} seeds"]
    for claim in values["claims"]:
        every, turning = ("{:+.2f} [{:+.2f}, {:+.2f}]".format(*claim[which]) for which in ("all", "turning"))
        lines.append(f"{claim['claim']}: {every} fish; of those that turn {turning}")
    return lines
