"""The experiment of chapter 3 on a tiny clip."""

from dataclasses import replace

import numpy as np

from tsuiseki.datamodules.scenes.single_clip import ChaseSettings, render_chase
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.single.constants import PRINTED
from tsuiseki.tracking.single.kcf_particle import KcfParticle
from tsuiseki.trainers.experiments.single.comparison import SWEEPS, by_attribute, repeat
from tsuiseki.trainers.experiments.single.plots import plot_intervals, search_pictures
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.single.search_intervals import Intervals, intervals
from tsuiseki.trainers.experiments.store import Store

ALWAYS = replace(PRINTED, response_share=1.0, switch=10.0, plain_frames=3, hypotheses=3, particles=30, convergence=1e9)


def tiny_clip():
    settings = ChaseSettings(frames=14, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = render_chase(np.random.default_rng(1), settings)
    return Clip(SingleSequence("tiny", (), made.boxes, frozenset({"OCC"})), list(made.images))


def test_sweeps_hold_the_thesis_s_values_and_change_one_parameter():
    for sweep in SWEEPS:
        assert set(sweep.paper) <= set(sweep.values)
        assert len({sweep.settings(v) for v in sweep.values}) == len(sweep.values)


def test_intervals_compare_three_ways_on_the_same_frames(tmp_path):
    found = intervals(Store(tmp_path), [tiny_clip()], ALWAYS, [0])
    for part in (found.during, found.after):
        assert len({len(overlaps) for overlaps in part.values()}) == 1
    assert len(found.during["Fix"]) == 4  # frames 2, 6, 10 and 14: each search ends at once, then three without
    assert len(found.after["Fix"]) == 9
    assert 0 <= Intervals.area(found.during["Proposed"]) <= 100
    titles = [axes.get_title(loc="left") for axes in plot_intervals(found).axes]
    assert titles == ["(a) during the search", "(b) the 10 frames after"]
    strip = search_pictures(tiny_clip(), KcfParticle(ALWAYS))
    assert strip is not None
    assert (strip.shape[0], strip.shape[1] % 120) == (90, 0)


def test_results_by_attribute_and_seed(tmp_path):
    clip = tiny_clip()
    results = {"combined": repeat(Store(tmp_path), [clip], ALWAYS, [0, 1])}
    assert results["combined"].areas().shape == (2,)
    assert by_attribute([clip], results)["OCC"]["combined"] == results["combined"].areas().mean()


def test_what_was_run_is_not_run_again_and_other_constants_are(tmp_path):
    def kept():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}

    clip = tiny_clip()
    first, before = repeat(Store(tmp_path), [clip], ALWAYS, [0, 1]).areas(), kept()
    assert len(before) == 2
    again = repeat(Store(tmp_path), [clip], ALWAYS, [0, 1]).areas()
    assert kept() == before
    assert first.tolist() == again.tolist()
    repeat(Store(tmp_path), [clip], replace(ALWAYS, particles=31), [0])
    assert len(kept()) == 3
    assert kept().items() > before.items()
