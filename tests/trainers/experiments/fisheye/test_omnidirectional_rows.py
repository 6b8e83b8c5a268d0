"""The rows of the omnidirectional experiment on made-up observations, without rendering."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import FloorDetections, FloorTrack
from tsuiseki.trainers.experiments.experiment import Bench
from tsuiseki.trainers.experiments.fisheye import selection
from tsuiseki.trainers.experiments.fisheye.observations import STAGES, Observed
from tsuiseki.trainers.experiments.fisheye.omnidirectional import reproduce
from tsuiseki.trainers.experiments.fisheye.pictures import first_switch, named
from tsuiseki.trainers.experiments.fisheye.rows import (
    GATED,
    ROWS,
    UNGATED,
    each_second,
    pair_of,
    run_row,
    score,
    world_errors,
)
from tsuiseki.trainers.experiments.fisheye.selection import Graded, best_choice, grade, lowest_score, worth
from tsuiseki.trainers.experiments.fisheye.tables import interval, notes, tables
from tsuiseki.trainers.experiments.store import Store


def observed(seconds=12, seed=0):
    """Three people at 1 frame a second: two in the same clothes, metres apart, with errors of 10 cm."""
    rng = np.random.default_rng(seed)
    start, velocity = np.array([[0.0, 0.0], [0.0, 4.0], [5.0, 8.0]]), np.array([[0.9, 0.0], [0.8, 0.1], [-0.7, -0.2]])
    clothes = np.eye(8)[[0, 0, 1]]
    found, features, places = [], [], []
    for t in range(seconds):
        place = start + t * velocity
        places.append(place)
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
    kinds = dict.fromkeys(("image", "upright", "standing"), features)
    return Observed(1, found, kinds, truth, np.concatenate(places), {}, 3 * seconds)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_every_row_tracks(row):
    some = observed()
    choices = list(row.choices())
    # Neither the narrowest gates nor the widest.
    choice = choices[len(choices) // 2]
    scores = score([pair_of("a", some, run_row(row, some, choice, 0.1))])
    assert scores.labelled == 36
    if row.place == "world":
        assert scores.id_switches == 0
        assert scores.mota > 0.9


def test_looks_alone_exchange_those_in_the_same_clothes():
    by_name = {row.name: row for row in ROWS}
    some = observed()
    switches = {
        name: score([pair_of("a", some, run_row(by_name[name], some, choice, 0.1))]).id_switches
        for name, choice in (
            ("rectification", {"feature_gate": 0.5}),
            ("both", {"feature_gate": 0.5, "reach": 0.9, "speed": 1.4}),
        )
    }
    assert switches["both"] == 0
    assert switches["rectification"] > 0


def test_the_best_choice_on_validation_is_taken():
    row = next(row for row in ROWS if row.name == "world")
    found = best_choice(row, "mota", lambda choices: [grade(row, [observed()], choice, 0.1) for choice in choices])
    assert found.mota > 0.9
    assert set(found.choice) == {"reach", "speed", "start_score"}


def test_identities_count_only_where_the_rule_says_so():
    steady, busy = Graded({}, 0.6, 0.8), Graded({}, 0.7, 0.4)
    assert worth(busy, "mota") > worth(steady, "mota")
    assert worth(steady, "mota-and-idf1") == pytest.approx(0.7)
    assert worth(steady, "mota-and-idf1") > worth(busy, "mota-and-idf1")


def test_the_score_to_start_is_chosen_before_the_grid_and_after():
    row = next(row for row in ROWS if row.name == "world")
    low, high = row.starts[0], row.starts[-1]
    near, far = min(row.grid["reach"]), max(row.grid["reach"])

    def graded(choices):
        # With the highest score to start far gates are best, with the lowest near ones, and these a little less so.
        worths = {(high, far): 0.9, (low, near): 0.8, (high, near): 0.3, (low, far): 0.2}
        middle = {high: 0.1, low: 0.0}
        return [Graded(c, worths.get((c["start_score"], c["reach"]), middle.get(c["start_score"], 0)), 0.0)
                for c in choices]  # fmt: skip

    found = best_choice(row, "mota", graded)
    assert (found.choice["start_score"], found.choice["reach"]) == (high, far)


def test_the_lowest_score_is_chosen_with_scores_to_start(tmp_path, monkeypatch):
    monkeypatch.setattr(selection, "grades", weak_ones_start_nothing)
    # Weak detections are of people, and cost nothing where they start no track.
    assert lowest_score(Store(tmp_path), ["baseline", "world"], [], "mota") == 0.2


def weak_ones_start_nothing(name, clips, choices, least) -> list[Graded]:
    """Stands for `grades`: the more detections the better, if a track starts from 0.5 on."""
    del name, clips
    return [Graded(c, 1 - least if c["start_score"] >= 0.5 else least, 0.0) for c in choices]


def test_the_thesis_rows_ask_for_the_place_alone():
    """Somebody is missed, and what stands there looks like nobody: the literal row goes on, the gated one does not."""
    rows = {row.name: row for row in ROWS}
    person, thing = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    found = []
    for features in (person, person, person, thing, thing):
        detections = Detections(np.array([[100.0, 100, 130, 160]]), np.ones(1), features)
        found.append(FloorDetections(detections, np.zeros((1, 5)), np.zeros((1, 2))))
    choice = {"feature_gate": 0.4, "reach": 0.5, "speed": 1.0}
    tracks = {name: len(rows[name].track(found, 1.0, choice)) for name in ("both", GATED, UNGATED, "track fisheye")}
    assert tracks == {"both": 1, GATED: 2, UNGATED: 1, "track fisheye": 2}


@pytest.mark.parametrize(("argument", "value"), [("seeds", 0), ("seconds", 0), ("fast_seconds", 0), ("fast_seeds", -1)])
def test_impossible_sizes_are_named(tmp_path, argument, value):
    with pytest.raises(RequestError, match=f"`{argument}`: expected"):
        reproduce(Bench(Store(tmp_path)), **{argument: value})


def test_detections_below_the_lowest_score_are_left_out():
    assert sum(map(len, observed().described("upright", 0.9))) == 0


def test_only_frames_with_a_truth_are_scored():
    track = Track(1, np.arange(31), np.tile([0.0, 0, 9, 9], (31, 1)), np.ones(31))
    [kept] = each_second([FloorTrack(track, np.zeros((31, 5)), np.zeros((31, 2)))], 15)
    assert kept.track.frames.tolist() == [0, 1, 2]


def test_world_errors_are_those_of_the_places():
    some = observed()
    row = next(row for row in ROWS if row.name == "world")
    errors = world_errors(some, run_row(row, some, {"reach": 0.9, "speed": 1.4}, 0.1))
    assert len(errors) == 36
    # The length of a vector of two Gaussian errors of 10 cm has a mean of 12.5 cm.
    assert np.isclose(errors.mean(), 0.125, atol=0.03)


def test_boxes_outside_a_region_do_not_count():
    some = observed()
    row = next(row for row in ROWS if row.name == "world")
    tracks = run_row(row, some, {"reach": 0.9, "speed": 1.4}, 0.1)
    left = pair_of("a", some, tracks, lambda boxes: boxes[:, 1] < 400)
    assert 0 < len(left.truth) < 36
    assert score([left]).mota > 0.9


def test_the_interval_of_three():
    mean, _, high = interval([1.0, 2.0, 3.0])
    # t of 2 degrees of freedom at 97.5 % is 4.303.
    assert mean == 2.0
    assert np.isclose(high - mean, 4.303 / np.sqrt(3), atol=1e-3)
    assert interval([5.0]) == (5.0, None, None)


def test_a_prevented_switch_is_one_that_the_other_does_not_have():
    theirs = {(0, 1): 4, (1, 1): 4, (2, 1): 7}
    assert first_switch(theirs, {(0, 1): 1, (1, 1): 1, (2, 1): 1}) == (2, 1)
    assert first_switch(theirs, theirs) is None
    assert first_switch(theirs, None) == (2, 1)


def test_no_box_is_shown_for_two():
    some = observed(seconds=1)
    # The first person's box lies on the second's, too, and nobody else is tracked.
    truth = replace(some.truth, boxes=some.truth.boxes[[0, 0, 2]] + np.array([[0.0], [1.0], [0.0]]))
    track = Track(7, np.array([0]), truth.boxes[:1], np.ones(1))
    assert named(replace(some, truth=truth), [FloorTrack(track, np.zeros((1, 5)), np.zeros((1, 2)))]) == {(0, 1): 7}


def test_filtered_boxes_take_the_settings_of_their_row():
    by_name = {row.name: row for row in ROWS}
    some, choice = observed(), {"min_iou": 0.01, "walk": 0.3}
    plain, filtered = (run_row(by_name[name], some, choice, 0.1) for name in ("SORT", "SORT, filtered boxes"))
    assert by_name["SORT, filtered boxes"].like == "SORT"
    assert [t.track.frames.tolist() for t in plain] == [t.track.frames.tolist() for t in filtered]
    # The detector's boxes, to the last digit, against boxes that are means with what was predicted.
    known = {tuple(box) for each in some.found for box in each.detections.boxes.tolist()}
    assert {tuple(box) for t in plain for box in t.track.boxes.tolist()} <= known
    assert not {tuple(box) for t in filtered for box in t.track.boxes[1:].tolist()} & known


def test_tables_of_one_room_have_no_interval():
    row = {"mota": [50.0], "idf1": [50.0], "hota": [40.0], "id_switches": [3], "world_error_median": None,
           "world_error_mean": None, "world_error_90": None}  # fmt: skip
    gain = {"row": "SORT", "interval": interval([8.3])}
    margins = {"asked": (3.3, 16.0), **{f"{m} over {b}": gain for m in ("mota", "idf1")
                                        for b in ("best image row", "DeepSORT")}}  # fmt: skip
    values = {
        "validation_seeds": [900], "chosen_by": "mota", "rows": {"large 1 fps": {"both": row}},
        "chosen": {"mota": {"least_score": 0.4}}, "rows_by_rule": {"mota": {"large": {"both": row}}},
        "differences": {"large": [{"row": "both", "mota": gain, "idf1": gain}]}, "where": {},
        "detector": {"large": [{"part": "0 to 20°", "boxes": 3, "ap50": 0.5, "recall": 0.2, "precision": None}]},
        "milliseconds": {"large": dict.fromkeys((*STAGES, "associate"), 1.0)},
        "margins": {"mota": {"large": margins}},
    }  # fmt: skip
    shown = {table.title: table.rows for table in tables(values)}
    assert shown["Table 4.3: large 1 fps"][0][2] == "50.0 (one room)"
    assert shown["The rows by what chose their settings, 1 fps"] == [["both", "50.0", "50.0"]]
    assert shown["Points gained, 1 fps"] == [["both", "SORT", "8.3 (one room)", "8.3 (one room)"]]
    assert notes(values)[1] == "large: MOTA of both over best image row (SORT): 8.3 (one room, asked 3.3)"


def test_rooms_that_settings_are_chosen_on_are_not_tested_on(tmp_path):
    with pytest.raises(RequestError, match="`first_seed`: expected rooms that settings are not chosen on"):
        reproduce(Bench(Store(tmp_path)), seeds=6, first_seed=896)


@pytest.mark.parametrize(("rate", "step"), [(1.0, 360.0), (5.0, 72.0)])
def test_the_reach_of_an_image_row_grows_by_the_second(rate, step):
    row = next(row for row in ROWS if row.name == "DeepSORT")
    # Somebody 60 pixels high who moves by 6 heights a second, whose boxes never overlap.
    found = []
    for frame in range(4):
        box = np.array([[100 + step * frame, 100, 130 + step * frame, 160]])
        detections = Detections(box, np.ones(1), np.array([[1.0, 0.0]]))
        found.append(FloorDetections(detections, np.zeros((1, 5)), np.zeros((1, 2))))

    def people(growth):
        return len(row.track(found, rate, {"feature_gate": 0.5, "reach": 0.05, "growth": growth, "walk": 3.0}))

    assert (people(8.0), people(4.0)) == (1, 4)
