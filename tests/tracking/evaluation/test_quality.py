"""The estimate of a result's quality: signs in closed form, good and bad results, what is not known."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy

from benchmarks.quality import __main__ as benchmark
from benchmarks.quality.streets import detected_street
from tests.tracking.review.conftest import FRAMES, PEOPLE, SIZE, walkers
from tsuiseki.tracking.association.network_flow import FlowGraph
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.page import with_page
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation import quality
from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.evaluation.quality import people_quality
from tsuiseki.tracking.evaluation.quality_signs import NETWORK_SIGNS, link_doubts, network_signs, track_signs
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.report.local_page import address_of
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Position, Track

# Streets that no fit has seen begin here.
UNSEEN = 50_000


def walk(number, first, last, x=300.0, observed=None, size=(40.0, 100.0), scores=None):
    """Somebody who stands at ``x``."""
    frames = np.arange(first, last)
    boxes = np.tile([x, 200.0, x + size[0], 200.0 + size[1]], (len(frames), 1))
    there = np.ones(len(frames), dtype=bool) if observed is None else observed
    return Track(number, frames, boxes, np.full(len(frames), 0.9) if scores is None else scores, there)


def signs_of(*tracks, frames=(0, 99)):
    return track_signs(tracks, 10.0, (640, 480), frames)


def chain(margin, gap=1):
    """Two detections of one track, whose other way costs so much more."""
    costs = np.full(2, -5.0), np.full(2, 2.0), np.full(2, 2.0)
    graph = FlowGraph(*costs, np.array([0]), np.array([1]), np.array([4.0 - margin]))
    boxes = np.tile([10.0, 10, 30, 60], (2, 1))
    frames, track = np.array([3, 3 + gap]), np.array([7, 7])
    return SolvedNetwork(frames, boxes, np.ones(2), np.zeros((2, 2), np.int64), graph, track, rate=10.0)


@pytest.fixture(scope="module")
def crossing():
    """People who pass each other, by the flow, in pictures that there are none of."""
    rng, tracks = np.random.default_rng(0), walkers(PEOPLE, FRAMES, SIZE)
    noise, scores = rng.normal(0, 1, (FRAMES, PEOPLE, 4)), rng.uniform(0.8, 0.95, (FRAMES, PEOPLE))
    found = [np.column_stack([[t.boxes[f] for t in tracks] + noise[f], scores[f]]) for f in range(FRAMES)]
    return track_people(np.zeros((FRAMES, SIZE[1], SIZE[0], 3), np.uint8), detections=found, appearance="none",
                        frame_rate=25.0)  # fmt: skip


# ---- Signs


def test_what_is_filled_in_is_counted():
    observed = np.arange(50) % 5 > 0
    assert signs_of(walk(1, 0, 50, observed=observed))["filled"] == pytest.approx(0.2)
    assert signs_of(walk(1, 0, 50, observed=observed))["detected"] == pytest.approx(0.8)


def test_a_track_that_goes_on_where_another_ended_is_broken_and_resumed():
    signs = signs_of(walk(1, 0, 40), walk(2, 45, 100, x=310.0))
    assert (signs["broken"], signs["resumed"]) == (1.0, 0.5)
    apart = signs_of(walk(1, 0, 40), walk(2, 45, 100, x=560.0))
    assert (apart["broken"], apart["resumed"]) == (1.0, 0.0)
    assert signs_of(walk(1, 0, 100))["broken"] == 0


def test_a_track_that_ends_at_the_border_is_not_broken():
    assert signs_of(walk(1, 0, 40, x=0.0), walk(2, 0, 100))["broken"] == 0


def test_frames_that_were_not_processed_are_none_of_its_ends():
    assert signs_of(walk(1, 300, 400), frames=(300, 399)) == signs_of(walk(1, 0, 100), frames=(0, 99))


def test_half_a_box_behind_another_is_covered():
    behind, before = walk(1, 0, 100), walk(2, 0, 100, x=320.0, size=(40.0, 110.0))
    assert signs_of(behind, before)["covered"] == pytest.approx(0.25)


@pytest.mark.parametrize("margin", [0.5, 2.0, 3.9])
@pytest.mark.parametrize("gap", [1, 4])
def test_the_doubt_of_a_link_is_that_of_its_margin(margin, gap):
    tail, head, wrong = link_doubts(chain(margin, gap))
    assert (tail.tolist(), head.tolist()) == ([0], [1])
    assert wrong[0] == pytest.approx(scipy.special.expit(-1.6 + 0.45 * np.log2(gap) - 0.45 * margin), abs=1e-6)


def test_a_doubtful_link_is_a_place_and_a_sure_one_is_none():
    (place,) = quality.doubtful_places(chain(0.1, gap=8))
    assert (place.frame, place.ids) == (3, (7,))
    assert quality.doubtful_places(chain(3.9)) == ()


def test_signs_of_a_network_are_the_same_each_time_and_have_their_names(crossing):
    network = crossing.network()
    signs = network_signs(network)
    assert signs == network_signs(network)
    assert set(signs) == set(NETWORK_SIGNS)
    assert signs["kept"] > 0.9


# ---- Estimates


def test_scores_come_back_from_their_scale():
    for name in quality.SCORES:
        values = np.array([0.0, 0.3, 0.9])
        assert quality.score_of(name, quality.scaled_score(name, values)) == pytest.approx(values, abs=1e-6)


def test_a_good_result_scores_high_and_broken_ids_lower_its_idf1(crossing):
    good = crossing.quality()
    parts = [
        replace(track, id=10 * track.id + k, frames=track.frames[rows], boxes=track.boxes[rows],
                scores=track.scores[rows], observed=track.observed[rows], origin=track.origin[rows])
        for track in crossing for k, rows in enumerate(np.array_split(np.arange(len(track)), 6))
    ]  # fmt: skip
    whole, broken = (people_quality(tracks, None, 25.0, SIZE, (0, FRAMES - 1)) for tracks in ([*crossing], parts))
    assert min(good.idf1.value, good.recall.value, good.precision.value) > 0.75
    assert broken.idf1.value < whole.idf1.value - 0.1
    assert broken.id_switches.value > whole.id_switches.value
    for score in quality.SCORES:
        value, low, high = getattr(good, score)
        assert low <= value <= high


@pytest.mark.slow
def test_intervals_hold_the_scores_of_streets_that_no_fit_has_seen():
    held = []
    for seed in range(UNSEEN, UNSEEN + 14):
        street = detected_street(seed)
        tracker = FlowTracker(frame_rate=street.rate, size=street.size)
        tracks, last = run_tracker(street.detections, tracker), len(street.detections) - 1
        true = evaluate_sequence(street.truth, tracks, last + 1)
        if true.recall < 0.35 or true.precision < 0.45:
            continue
        estimate = people_quality(tracks, tracker.network(), street.rate, street.size, (0, last))
        for name in quality.SCORES:
            _, low, high = getattr(estimate, name)
            held.append(low - 1e-3 <= getattr(true, name) <= high + 1e-3)
    assert len(held) >= 6 * 8
    assert np.mean(held) >= 0.8


def test_the_fit_goes_on_where_it_ended_without_streets_that_no_camera_shows(tmp_path, monkeypatch):
    drawn = []

    def street_of(seed):
        drawn.append(seed)
        if seed == 1:
            raise RequestError("expected a person_height that cameras can show")
        return detected_street(seed)

    monkeypatch.setattr(benchmark, "detected_street", street_of)
    cases, again = (benchmark.street_cases(range(2), tmp_path / "streets.jsonl") for _ in range(2))
    assert cases == again
    assert [case.name for case in cases] == ["0"]
    assert drawn == [0, 1, 1]


# ---- What is not known


def test_what_cannot_be_seen_is_said(crossing):
    assert crossing.quality().unseen == (quality.BLIND,)
    online = Result([*crossing], frame_rate=25.0, size=SIZE).quality()
    assert quality.NO_NETWORK in online.unseen
    assert online.doubtful == ()
    bare = [replace(track, scores=np.ones(len(track))) for track in crossing]
    without = Result(bare, settings={"classes": ["car"]}).quality()
    assert without.unseen[2] == quality.NO_SCORES
    assert "frame rate" in without.unseen[3]
    assert "other classes" in without.unseen[4]


def test_too_few_boxes_say_nothing():
    with pytest.raises(RequestError, match="at least 50 boxes to estimate its quality from, got 5"):
        Result([walk(1, 0, 5)]).quality()


def test_targets_without_boxes_are_refused():
    place = Position(0.0, np.zeros(3), np.eye(3), 1.0, "tracking")
    with pytest.raises(RequestError, match="expected tracks of people with boxes"):
        Result([place]).quality()


def test_results_of_an_online_method_say_less():
    tracker = Sort()
    tracks = run_tracker([np.array([t.boxes[f] for t in walkers(PEOPLE, FRAMES, SIZE)]) for f in range(40)], tracker)
    estimate = people_quality(tracks, None, 25.0, SIZE)
    assert quality.NO_NETWORK in estimate.unseen


# ---- The command and the page


def test_the_command_estimates_scores_without_labels(tmp_path, crossing, capsys):
    folder, file = crossing.save(tmp_path / "result"), tmp_path / "quality.json"
    assert main(["evaluate", "people", str(folder), "--unlabelled", "--json", str(file)]) == 0
    shown, (values,) = capsys.readouterr().out, json.loads(file.read_text()).values()
    assert all(heading in shown for heading in ("HOTA", "MOTA", "IDF1", "IDSW", "Rcll", "Prcn"))
    assert "doubtful: " in shown
    assert f"not seen: {quality.BLIND}" in shown
    estimate = crossing.quality()
    assert values["idf1"]["value"] == pytest.approx(estimate.idf1.value, abs=0.02)
    assert set(values) == {*quality.SCORES, "doubtful", "unseen"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--unlabelled scores it without labels"),
        (["--unlabelled", "--offset", "3"], "leave out what is about labels"),
        (["--unlabelled", "--frames", "1-5"], "leave out what is about labels"),
        (["--unlabelled", "--plot", "x.png"], "leave it out with --unlabelled"),
    ],
    ids=str,
)
def test_what_does_not_go_together_is_refused(tmp_path, crossing, words, message, capsys):
    folder = crossing.save(tmp_path / "result")
    assert main(["evaluate", "people", str(folder), *words]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_the_page_says_how_good_it_probably_is(tmp_path, crossing, monkeypatch):
    monkeypatch.setattr(quality, "DOUBTFUL", 0.0)
    out = with_page(crossing).save(tmp_path / "result")
    page = (out / "report.html").read_text()
    assert "How good it probably is" in page
    assert re.search(r"About \d+ % of the boxes carry the right number: \d+ to \d+ %\.", page)
    assert re.search(
        rf'<a href="{re.escape(address_of(out))}#frame=\d+&amp;ids=[\d,]+" target="review">frame \d+', page
    )


def test_the_page_of_other_tracks_says_nothing_of_it(tmp_path, crossing):
    out = with_page(Result([*crossing], frame_rate=25.0, size=SIZE)).save(tmp_path / "result")
    assert "How good" not in (out / "report.html").read_text()
