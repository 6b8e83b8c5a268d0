"""The experiment of chapter 3 on a tiny clip."""

from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes.street.chase import ChaseSettings, render_chase
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.trackers.single.kcf_particle import KcfParticle
from tsuiseki.tracking.trackers.single.kcf_particle_settings import THESIS
from tsuiseki.trainers.experiments.single.multi_correlation_filter import SWEEPS, by_attribute, combined, repeat
from tsuiseki.trainers.experiments.single.plots import plot_intervals, search_pictures
from tsuiseki.trainers.experiments.single.runs import Clip, Entrant, Runs
from tsuiseki.trainers.experiments.single.search_intervals import Intervals, intervals

ALWAYS = replace(THESIS, response_share=1.0, switch=10.0, plain_frames=3, hypotheses=3, particles=30, convergence=1e9)


def tiny_clip():
    settings = ChaseSettings(frames=14, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = render_chase(np.random.default_rng(1), settings)
    return Clip(SingleSequence("tiny", (), made.boxes, frozenset({"OCC"})), list(made.images))


def test_sweeps_hold_the_thesis_s_values_and_change_one_parameter():
    for sweep in SWEEPS:
        assert set(sweep.paper) <= set(sweep.values)
        assert len({sweep.settings(v) for v in sweep.values}) == len(sweep.values)


def test_intervals_compare_three_ways_on_the_same_frames(tmp_path):
    found = intervals(Runs(tmp_path), [tiny_clip()], ALWAYS, [0])
    for part in (found.during, found.after):
        assert len({len(overlaps) for overlaps in part.values()}) == 1
    assert len(found.during["Fix"]) == 4  # frames 2, 6, 10 and 14: each search ends at once, then three without
    assert len(found.after["Fix"]) == 9
    assert 0 <= Intervals.area(found.during["Proposed"]) <= 100
    plot_intervals(found, tmp_path / "i.png")
    assert search_pictures(tiny_clip(), KcfParticle(ALWAYS), tmp_path / "p.png")


def test_results_by_attribute_and_seed(tmp_path):
    clip = tiny_clip()
    results = {"combined": repeat(Runs(tmp_path), [clip], combined(ALWAYS), [0, 1])}
    assert results["combined"].areas().shape == (2,)
    assert by_attribute([clip], results)["OCC"]["combined"] == results["combined"].areas().mean()


def test_what_was_run_is_not_run_again_and_other_constants_are(tmp_path):
    clip, made = tiny_clip(), []

    def entrant(settings):
        return Entrant(repr(settings), lambda seed: made.append(seed) or KcfParticle(settings, seed))

    first = repeat(Runs(tmp_path), [clip], entrant(ALWAYS), [0, 1]).areas()
    again = repeat(Runs(tmp_path), [clip], entrant(ALWAYS), [0, 1]).areas()
    assert made == [0, 1]
    assert first.tolist() == again.tolist()
    repeat(Runs(tmp_path), [clip], entrant(replace(ALWAYS, particles=31)), [0])
    assert made == [0, 1, 0]
