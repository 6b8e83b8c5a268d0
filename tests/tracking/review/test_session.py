"""A result that is corrected: what is said holds, is on disk, and is taken back."""

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.tracking import track_people
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.review.session import Session

SIZE = (400, 200)


def people_who_cross(seed=0, frames=40):
    """Boxes of two people who pass each other, and of one who is hidden for a while."""
    rng = np.random.default_rng(seed)
    found = []
    for t in range(frames):
        places = [(20 + 6 * t, 50), (270 - 6 * t, 54)] + ([(330, 120 - t)] if not 15 <= t < 22 else [])
        boxes = [[x, y, x + 30, y + 80, 0.9] for x, y in places + rng.normal(0, 0.7, (len(places), 2))]
        found.append(np.array(boxes))
    return found


@pytest.fixture
def folder(tmp_path):
    images = [np.zeros((SIZE[1], SIZE[0], 3), np.uint8)] * 40
    track_people(images, detections=people_who_cross(), appearance="none", frame_rate=10.0).save(tmp_path / "result")
    return tmp_path / "result"


def rows(session):
    return [(t.id, t.frames.tolist(), t.boxes.round(3).tolist()) for t in session.tracks()]


def test_a_result_opens_as_it_is(folder):
    session = Session(folder)
    known = Result.load(folder)
    assert [t.id for t in session.tracks()] == [t.id for t in known]
    assert all(np.array_equal(a.boxes, b.boxes) for a, b in zip(session.tracks(), known, strict=True))
    assert (session.size, session.n_frames, session.frame_rate) == (SIZE, 40, 10.0)


def test_what_is_said_holds_and_is_on_disk_and_is_taken_back(folder):
    session = Session(folder)
    before = rows(session)
    one, two = (t.id for t in list(session.tracks())[:2])
    changes = session.correct(session.made("switch", [one, two], 20))
    assert set(changes.ids) == {one, two}
    switched = rows(session)
    assert switched != before
    session.correct(session.made("name", [one], 30, name="Anna"))
    session.close()
    session = Session(folder)
    assert rows(session) == switched
    assert session.names() == {one: "Anna"}
    assert [t.id for t in Result.load(folder)] == [row[0] for row in switched]
    session.undo()
    session.undo()
    assert rows(session) == before
    assert session.undo().notes
    session.redo()
    assert rows(session) == switched


def test_a_second_reviewer_is_refused(folder):
    session = Session(folder)
    with pytest.raises(RequestError, match="somebody reviews"):
        Session(folder)
    session.close()
    Session(folder).close()
