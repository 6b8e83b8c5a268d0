"""The rows of the omnidirectional experiment on made-up observations, without rendering."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.papers import fisheye
from benchmarks.papers.__main__ import main
from benchmarks.papers.fisheye import (
    GATED,
    ROWS,
    SIDE,
    STAGES,
    STARTS,
    CeilingClip,
    Graded,
    Observed,
    _strip,
    best_choice,
    choices_of,
    each_second,
    first_switch,
    grades,
    lowest_score,
    named,
    observe,
    pair_of,
    reproduce,
    tables,
    tracked,
)
from benchmarks.papers.store import Store
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import evaluate_sequences
from tsuiseki.tracking.fisheye.unrolled import DETECTORS
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections
from tsuiseki.tracking.weights import shipped


def score(pair):
    return evaluate_sequences([pair]).combined


def observed(seconds=12, seed=0):
    """Three people at 1 frame a second: two in the same clothes, metres apart, with errors of 10 cm."""
    rng = np.random.default_rng(seed)
    start, velocity = np.array([[0.0, 0.0], [0.0, 4.0], [5.0, 8.0]]), np.array([[0.9, 0.0], [0.8, 0.1], [-0.7, -0.2]])
    clothes = np.eye(8)[[0, 0, 1]]
    found, features = [], []
    for t in range(seconds):
        place = start + t * velocity
        seen = place + rng.normal(0, 0.1, place.shape)
        corner = 300 + 40 * seen
        boxes = np.concatenate([corner, corner + np.array([30.0, 60.0])], axis=1)
        rotated = np.column_stack([corner + np.array([15, 30]), np.full((3, 2), [30, 60]), np.zeros(3)])
        found.append(FloorDetections(Detections(boxes, np.full(3, 0.8)), rotated, seen))
        looks = clothes + rng.normal(0, 0.05, (3, 8))
        features.append(looks / np.linalg.norm(looks, axis=1, keepdims=True))
    everyone = np.ones(3 * seconds, dtype=np.bool_)
    boxes = np.concatenate([f.detections.boxes for f in found])
    truth = GroundTruth(np.repeat(np.arange(seconds), 3), np.tile([1, 2, 3], seconds), boxes, everyone, ~everyone,
                        np.ones(3 * seconds))  # fmt: skip
    kinds = dict.fromkeys(("image", "upright"), features)
    return Observed(CeilingClip("large", seed, seconds, 1, 0, None), found, kinds, truth, {})


@pytest.mark.parametrize("name", ROWS)
def test_every_row_tracks(name):
    some = observed()
    choices = choices_of(ROWS[name])
    # Neither the narrowest gates nor the widest.
    choice = choices[len(choices) // 2]
    scores = score(pair_of("a", some, tracked(name, choice, 0.1, some)))
    assert scores.labelled == 36
    if name in ("world", "both", GATED, "track fisheye"):
        assert scores.id_switches == 0
        assert scores.mota > 0.9


def test_looks_alone_exchange_those_in_the_same_clothes():
    some = observed()
    switches = {
        name: score(pair_of("a", some, tracked(name, choice, 0.1, some))).id_switches
        for name, choice in (
            ("rectification", {"feature_gate": 0.5}),
            ("both", {"feature_gate": 0.5, "reach": 0.9, "speed": 1.4}),
        )
    }
    assert switches["both"] == 0
    assert switches["rectification"] > 0


@pytest.mark.slow
def test_the_best_choice_on_validation_is_taken():
    row = ROWS["world"]
    found = best_choice(row, lambda choices: grades("world", [observed(), observed(seed=1)], 0.1, choices))
    assert found.mota > 0.9
    assert set(found.choice) == {"reach", "speed", "start_score"}


def test_the_score_to_start_is_chosen_before_the_grid_and_after():
    row = ROWS["world"]
    low, high = STARTS[0], STARTS[-1]
    near, far = min(row.grid["reach"]), max(row.grid["reach"])

    def graded(choices):
        # With the highest score to start far gates are best, with the lowest near ones, and these a little less so.
        worths = {(high, far): 0.9, (low, near): 0.8, (high, near): 0.3, (low, far): 0.2}
        middle = {high: 0.1, low: 0.0}
        return [Graded(c, worths.get((c["start_score"], c["reach"]), middle.get(c["start_score"], 0)), 0.0)
                for c in choices]  # fmt: skip

    found = best_choice(row, graded)
    assert (found.choice["start_score"], found.choice["reach"]) == (high, far)


def test_the_lowest_score_is_chosen_with_scores_to_start(tmp_path, monkeypatch):
    monkeypatch.setattr(fisheye, "grades", weak_ones_start_nothing)
    # Weak detections are of people, and cost nothing where they start no track.
    assert lowest_score(Store(tmp_path), ["baseline", "world"], []) == 0.2


def weak_ones_start_nothing(name, clips, least, choices) -> list[Graded]:
    """Stands for `grades`: the more detections the better, if a track starts from 0.5 on."""
    del name, clips
    return [Graded(c, 1 - least if c["start_score"] >= 0.5 else least, 0.0) for c in choices]


def test_the_thesis_rows_ask_for_the_place_alone():
    """Somebody is missed, and what stands there looks like nobody: the literal row goes on, the gated one does not."""
    person, thing = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    found = []
    for features in (person, person, person, thing, thing):
        detections = Detections(np.array([[100.0, 100, 130, 160]]), np.ones(1), features)
        found.append(FloorDetections(detections, np.zeros((1, 5)), np.zeros((1, 2))))
    choice = {"feature_gate": 0.4, "reach": 0.5, "speed": 1.0}
    tracks = {name: len(ROWS[name].track(found, 1.0, choice)) for name in ("both", GATED, "track fisheye")}
    assert tracks == {"both": 1, GATED: 2, "track fisheye": 2}


@pytest.mark.parametrize(("argument", "value"), [("seeds", 0), ("seconds", 0), ("fast_seeds", -1)])
def test_impossible_sizes_are_named(tmp_path, argument, value, capsys):
    words = ["--out", str(tmp_path / "out"), f"--{argument}", str(value)]
    assert main(["omnidirectional", *words]) == 2
    assert f"for --{argument}. Must be" in capsys.readouterr().err


def test_detections_below_the_lowest_score_are_left_out():
    assert sum(map(len, observed().described("upright", 0.9))) == 0


def three_people(clip: CeilingClip, *_) -> Observed:
    """Stands for `observe`: what `observed` makes up."""
    return replace(observed(clip.seconds, clip.seed + clip.camera), clip=clip, seconds=dict.fromkeys(STAGES, 1.0))


def middle_of(row):
    choices = choices_of(row)
    return [choices[len(choices) // 2]]


@pytest.mark.slow
def test_the_command_goes_to_the_end(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fisheye, "observe", three_people)
    # The middle of each grid alone, on one room: choosing well is for other tests.
    monkeypatch.setattr(fisheye, "choices_of", middle_of)
    monkeypatch.setattr(fisheye, "VALIDATION_SEEDS", fisheye.VALIDATION_SEEDS[:1])
    words = ["--seeds", "1", "--seconds", "6", "--fast-seeds", "0"]
    out = ["--out", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    assert main(["omnidirectional", *words, *out]) == 0
    assert "world" in capsys.readouterr().out
    assert {"results.json", "tables.md", "tables.json"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_only_frames_with_a_truth_are_scored():
    track = Track(1, np.arange(31), np.tile([0.0, 0, 9, 9], (31, 1)), np.ones(31))
    [kept] = each_second([track], 15)
    assert kept.frames.tolist() == [0, 1, 2]


def test_boxes_outside_a_region_do_not_count():
    some = observed()
    tracks = tracked("world", {"reach": 0.9, "speed": 1.4}, 0.1, some)
    left = pair_of("a", some, tracks, lambda boxes: boxes[:, 1] < 400)
    assert 0 < len(left.truth) < 36
    assert score(left).mota > 0.9


def test_a_prevented_switch_is_one_that_the_other_does_not_have():
    theirs = {(0, 1): 4, (1, 1): 4, (2, 1): 7}
    assert first_switch(theirs, {(0, 1): 1, (1, 1): 1, (2, 1): 1}) == (2, 1)
    assert first_switch(theirs, theirs) is None
    assert first_switch(theirs, None) == (2, 1)


@pytest.mark.slow
def test_a_room_is_drawn_observed_and_shown():
    clip = CeilingClip("small", 3, 3, 1, 0, None)
    some = observe(clip, shipped(DETECTORS["unrolled"]), shipped("appearance_people"))
    assert len(some.detections) == 3
    assert set(some.truth.frames) == {0, 1, 2}
    assert len(some.truth) > 3
    for each in some.described("upright", 0.2):
        assert np.allclose(np.linalg.norm(each.detections.features, axis=1), 1)
    tracks = tracked("world", {"reach": 0.9, "speed": 1.4}, 0.2, some)
    person = next(p for p in some.truth.ids.tolist() if (some.truth.ids == p).sum() == 3)
    assert _strip(some, (2, person), [tracks]).shape == (SIDE, 3 * SIDE, 3)


def test_no_box_is_shown_for_two():
    some = observed(seconds=1)
    # The first person's box lies on the second's, too, and nobody else is tracked.
    truth = replace(some.truth, boxes=some.truth.boxes[[0, 0, 2]] + np.array([[0.0], [1.0], [0.0]]))
    track = Track(7, np.array([0]), truth.boxes[:1], np.ones(1))
    assert named(replace(some, truth=truth), [track]) == {(0, 1): 7}


def test_tables_of_one_room_have_no_interval():
    row = {"mota": 50.0, "idf1": 50.0, "hota": 40.0, "id_switches": 3}
    values = {
        "rows": {"large 1 fps": {"both": [row], "SORT": [{**row, "mota": 41.5}]}},
        "where": {"rim": {"row": "world", "against": "SORT", "by_seed": [2.0]}},
        "milliseconds": {"large": dict.fromkeys((*STAGES, "associate"), 1.0)},
    }
    people, where, stages = tables(values)
    assert people.rows[0][:4] == ["both", "50.0", "11.7", ""]
    assert people.rows[1][:4] == ["SORT", "41.5", "-10.5", "-8.5"]
    assert where.rows == [["rim, 300 to 500 px from it", "world", "SORT", "1.757", "2.0"]]
    assert stages.rows[0] == ["detect", "18.8", "19.9", "1.00"]


def test_rooms_that_settings_are_chosen_on_are_not_tested_on(tmp_path):
    with pytest.raises(RequestError, match="`first_seed`: expected rooms without 900 and 901"):
        reproduce(store=Store(tmp_path), seeds=6, first_seed=896)


@pytest.mark.parametrize(("rate", "step"), [(1.0, 360.0), (5.0, 72.0)])
def test_the_reach_of_an_image_row_grows_by_the_second(rate, step):
    row = ROWS["DeepSORT"]
    # Somebody 60 pixels high who moves by 6 heights a second, whose boxes never overlap.
    found = []
    for frame in range(4):
        box = np.array([[100 + step * frame, 100, 130 + step * frame, 160]])
        detections = Detections(box, np.ones(1), np.array([[1.0, 0.0]]))
        found.append(FloorDetections(detections, np.zeros((1, 5)), np.zeros((1, 2))))

    def people(growth):
        return len(row.track(found, rate, {"feature_gate": 0.5, "reach": 0.05, "growth": growth, "walk": 3.0}))

    assert (people(8.0), people(4.0)) == (1, 4)
