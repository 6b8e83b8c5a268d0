"""The simulated annotator: what it is asked on a street, and what its answers do."""

import pytest

from tsuiseki.trainers.experiments.corrections import RANKINGS, reviewed
from tsuiseki.trainers.experiments.end_to_end import STREETS, write_streets
from tsuiseki.trainers.experiments.given_sequences import find_given


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    home = tmp_path_factory.mktemp("data") / "streets"
    write_streets(home, 1, 60)
    return reviewed(find_given(home.parent, STREETS)[0], 6)


def test_every_ranking_finds_errors_and_no_more_than_there_are(course):
    assert set(course.found) == set(RANKINGS)
    assert all(0 <= found <= course.errors for found in course.found.values())
    assert course.found["questions"] >= course.found["random"]


def test_answers_bring_the_tracks_nearer_to_what_the_detections_allow(course):
    assert 2 <= len(course.idf1) == len(course.hota) <= 7
    assert 0 < course.idf1[0] <= max(course.idf1)
    assert max(course.idf1) <= course.allowed + 0.1
