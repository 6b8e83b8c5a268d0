"""How many different people, where a number goes over to another person, and which tracks show nobody."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.papers.association import DATA_SETS, find_sequences, sequence_detections, sequence_labels
from tests.tracking.counts.true_people import Labelled, changes, detected_people, labelled_street
from tests.tracking.counts.walkers import walker
from tsuiseki.tracking.association.doubtful_tracks import doubtful_tracks
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.handovers import AROUND, Handovers, handovers_of
from tsuiseki.tracking.counts.page import summary, with_page
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.counts.visitors import count_visitors
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.overlay import Overlay
from tsuiseki.tracking.report.track_bars import followed
from tsuiseki.tracking.result import PageContent, Result
from tsuiseki.tracking.types import Frame, Track

SIZE = (640, 480)


def result_of(*tracks, length=100, **known):
    return Result(list(tracks), "", 10.0, SIZE, frames={"frame": list(range(length))}, **known)


def across(y, number, first=0, last=100, speed=6.0, x=20.0):
    """Somebody who walks to the right from a frame to before another."""
    frames = np.arange(first, last)
    return walker(np.column_stack([x + speed * frames, np.full(len(frames), float(y))]), number, frames)


def test_people_who_come_in_at_the_border_are_as_many_as_their_tracks():
    found = count_visitors(result_of(*(across(150 + 60 * k, k + 1) for k in range(5))))
    assert found.low <= 5 <= found.high
    assert found.estimate == 5
    assert (found.further > 0.9).all()
    assert not len(found.doubtful)


def test_a_track_that_goes_on_where_another_ended_is_no_further_person():
    parts = across(200, 1, 0, 40), across(200, 2, 48, 100)
    further = count_visitors(result_of(*parts)).further
    assert further[0] > 0.9
    assert further[1] < 0.3
    # Elsewhere in the picture it is one.
    assert count_visitors(result_of(parts[0], across(400, 2, 48, 100, x=-200.0))).further[1] > 0.6


def test_no_tracks_are_no_people():
    found = count_visitors(result_of())
    assert (found.estimate, found.low, found.high, str(found)) == (0, 0, 0, "0")


def test_other_targets_than_people_and_no_frame_rate_are_refused():
    with pytest.raises(RequestError, match="other targets"):
        count_visitors(result_of(across(200, 1), page=PageContent(("animal", "animals"))))
    with pytest.raises(RequestError, match="frame_rate"):
        count_visitors([across(200, 1)])


def met(turned):
    """Feet of two who cross, or who turn back where they meet."""
    frames = np.arange(100)
    ways = [
        np.column_stack([x, np.full(100, 300.0 + 2 * k)]) for k, x in enumerate((20 + 6.0 * frames, 614 - 6.0 * frames))
    ]
    return [np.where((frames < 50)[:, None], ways[k], ways[1 - k]) for k in (0, 1)] if turned else ways


def test_two_who_cross_may_be_exchanged_and_two_far_apart_are_not():
    likely, unlikely = (
        handovers_of([walker(way, k) for k, way in enumerate(met(turned), 1)], 10.0) for turned in (True, False)
    )
    assert sorted(likely.track) == [0, 1]
    assert likely.probability.max() > 2 * unlikely.probability.max(initial=0.0)
    assert abs(likely.first[0] - 48) < 5
    assert not len(handovers_of([across(100, 1), across(400, 2)], 10.0))


def test_66_2_the_headline_is_a_count_with_an_interval_and_stays_carry_the_chance_of_a_change(tmp_path):
    turned = [walker(way, k) for k, way in enumerate(met(turned=True), 1)]
    result = result_of(*turned, across(100, 3))
    everywhere = SceneZone("all", np.array([[0.0, 0], [640, 0], [640, 480], [0, 480]]))
    found = count(result, Scene((), [everywhere], SIZE))
    (people,), (tracks,) = found.tables["visitors"]["people"], found.tables["visitors"]["tracks"]
    assert tracks == 3
    assert found.tables["visitors"]["low"][0] <= people <= found.tables["visitors"]["high"][0]
    assert summary(found)[0] == f"about {found.visitors} different people, in 3 tracks"
    for table in ("people", "stays"):
        chance = dict(zip(found.tables[table]["id"], found.tables[table]["changed"], strict=True))
        assert min(chance[1], chance[2]) > chance[3] == 0
    page = (with_page(result).save(tmp_path / "o") / "report.html").read_text()
    assert f"About {count_visitors(result)} different people, in 3 tracks," in page


def test_the_chance_of_several_places_in_closed_form():
    one = np.array([0, 0, 1])
    places = Handovers(one, 1 - one, np.array([10, 50, 10]), np.array([12, 55, 12]), np.array([0.5, 0.2, 0.4]))
    tracks, zero = np.array([0, 0, 1, 7]), np.zeros(4)
    chance = places.chance(tracks, zero, np.array([100.0, 30.0, 30.0, 30.0]))
    assert chance == pytest.approx([1 - 0.5 * 0.8, 0.5, 0.4, 0.0])
    # The exchange in frame 10 is of both.
    assert places.marked.tolist() == [0, 1]


def test_a_short_track_that_scores_little_over_a_person_is_marked_everywhere():
    people = [across(150 + 60 * k, k + 1) for k in range(4)]
    low = people[1]
    ghost = Track(9, low.frames[50:54], low.boxes[50:54] + 2, np.full(4, 0.3))
    tracks = [*people, ghost]
    assert doubtful_tracks(tracks, 10.0, SIZE, 100).tolist() == [False] * 4 + [True]
    x = float(low.boxes[52, [0, 2]].mean())
    line = SceneLine("door", np.array([[x, 0.0], [x, 480.0]]))
    found = count(result_of(*tracks), Scene([line], (), SIZE))
    table = found.tables["crossings"]
    support = dict(zip(table["id"], table["support"], strict=True))
    assert support[2] == "observed"
    assert support.get(9, "doubtful") == "doubtful"
    assert found.tables["people"]["nobody"][-1] > 0.5
    assert followed(ghost, doubtful=True)[0] == "person 9?"
    blank = np.zeros((480, 640, 3), dtype=np.uint8)
    drawn = Overlay.of_people(tracks, 10.0, SIZE, 100)(Frame(52, 5.2, blank))
    assert (drawn != Overlay(tracks, 10.0).draw(Frame(52, 5.2, blank))).any()


def scores_of_intervals(videos):
    """Share of the intervals that hold the true number, and the mean errors of the estimate and of the tracks."""
    rows = []
    for video in videos:
        found, true = count_visitors(video.result), detected_people(video)
        tracks = len(video.result)
        rows.append((found.low <= true <= found.high, abs(found.estimate - true), abs(tracks - true)))
    return np.array(rows, dtype=np.float64)


@pytest.mark.slow
def test_intervals_hold_the_true_number_of_people_on_generated_streets():
    rows = scores_of_intervals(labelled_street(seed) for seed in range(1000, 1012))
    held, error, by_tracks = rows.mean(axis=0)
    assert held >= 0.85
    assert error < by_tracks


def labelled_videos(data, keys):
    for data_set in DATA_SETS:
        for sequence in find_sequences(data, data_set) if data_set.key in keys else ():
            detections, labels = sequence_detections(sequence), sequence_labels(sequence)
            yield sequence.name, Labelled.of(detections, labels, sequence.rate, sequence.size)


@pytest.mark.slow
@pytest.mark.integration
def test_intervals_hold_the_true_number_of_people_on_labelled_video(data_folder):
    videos = dict(labelled_videos(data_folder, ("mot17", "mot15", "tud")))
    # Of crowds that a camera drives through, most tracks pass over several people.
    crowds = ("ETH-Bahnhof", "ETH-Pedcross2")
    rows = scores_of_intervals(video for name, video in videos.items() if name not in crowds)
    assert rows[:, 0].mean() >= 0.85
    assert rows[:, 1].mean() <= 0.55 * rows[:, 2].mean()


@pytest.mark.slow
@pytest.mark.integration
def test_marked_places_hold_most_changes_of_labelled_video(data_folder):
    marks = true = held = 0
    for _, video in labelled_videos(data_folder, ("mot17", "mot15", "tud")):
        places = count_visitors(video.result).handovers
        places = places.select(places.marked)
        slack, happened = AROUND * video.result.frame_rate, changes(video)
        marks, true = marks + len(places), true + len(happened)
        held += sum(
            bool((((places.track == who) | (places.other == who)) & (places.first <= end + slack)
                  & (places.last >= begin - slack)).any())
            for who, begin, end in happened
        )  # fmt: skip
    assert held >= 0.7 * true
    assert marks <= 2.6 * true
