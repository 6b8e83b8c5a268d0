"""A result that is corrected: what is said holds, is on disk, and is taken back."""

from contextlib import suppress

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.association.corrected_flow import CorrectedFlow
from tsuiseki.tracking.association.solved_network import SolvedNetwork
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.correction_log import Correction, boxes_of
from tsuiseki.tracking.people.api import track_people
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
    assert {n for n, *_ in changes.tracks} == {one, two}
    switched = rows(session)
    assert switched != before
    session.correct(session.made("name", [one], 30, name="Anna"))
    session.close()
    session = Session(folder)
    assert rows(session) == switched
    assert session.names == {one: "Anna"}
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


def test_questions_are_answered_and_not_asked_again(folder):
    session = Session(folder)
    questions = session.questions()
    assert questions
    before = session.answered
    session.answer(questions[0].key, yes=True)
    assert questions[0].key not in {question.key for question in session.questions()}
    assert session.answered == before + 1
    with pytest.raises(RequestError, match="key"):
        session.answer("nothing", yes=True)


def test_contradictions_are_named_with_both_sentences(folder):
    session = Session(folder)
    one = next(iter(session.tracks())).id
    session.correct(session.made("real", [one], 5))
    with pytest.raises(RequestError, match=r"is right.*is a false positive"):
        session.correct(session.made("not_person", [one], 5))
    session.correct(session.made("same", [one, one], 5, 30))
    with pytest.raises(RequestError, match=r"are the same.*are not the same"):
        session.correct(session.made("not_same", [one, one], 5, 30))
    assert len(session.corrections_file.read_text().splitlines()) == 3


def test_boxes_are_drawn_moved_and_their_tracks_deleted(folder):
    session = Session(folder)
    one = next(iter(session.tracks())).id
    moved = (100.0, 60.0, 30.0, 80.0)
    session.correct(session.made("box", [one], 10, box=moved))
    track = session.tracks().by_id[one]
    assert track.boxes[track.frames == 10].tolist() == [[100, 60, 130, 140]]
    changes = session.correct(session.made("box", frame=3, box=(5, 5, 20, 60)))
    ((drawn, *_),) = changes.tracks
    assert session.tracks().by_id[drawn].frames.tolist() == [3]
    session.correct(session.made("delete", [drawn]))
    assert drawn not in session.tracks().by_id


@pytest.mark.parametrize("frame", [18, 25])
def test_a_box_of_nobody_joins_no_person_until_it_is_said_of_whom(folder, frame):
    """In the gap of the person who is hidden, and where that person has a detection."""
    session = Session(folder)
    before = {track.id: len(track) for track in session.tracks()}
    changes = session.correct(session.made("box", frame=frame, box=(330, 120 - frame, 30, 80)))
    (drawn,) = {number for number, *_ in changes.tracks} - before.keys()
    assert session.tracks().by_id[drawn].frames.tolist() == [frame]
    assert {number: len(track) for number, track in session.tracks().by_id.items() if number != drawn} == before
    session.correct(session.made("same", [3, drawn], 10, frame))
    assert [len(track) for track in session.tracks()] == list(before.values()), "said by the user, it joins"


def owner(session, box):
    """Id of the track that has a box."""
    (found,) = [
        t.id
        for t in session.tracks()
        for f, (x, y, *_) in zip(t.frames.tolist(), t.boxes.tolist(), strict=True)
        if f == box.frame and abs(x - box.x) < 5 and abs(y - box.y) < 5
    ]
    return found


def test_two_boxes_are_parted_and_joined(folder):
    session = Session(folder)
    one = next(iter(session.tracks())).id
    parted = session.made("not_same", [one, one], 5, 35)
    changes = session.correct(parted)
    assert any("solved exactly" in note for note in changes.notes)
    early, late = parted.there
    assert owner(session, early) != owner(session, late)
    session.undo()
    assert owner(session, early) == owner(session, late)
    other = next(t for t in session.tracks() if t.id != one and t.frames[0] < 5 and t.frames[-1] > 35)
    crossed = session.made("same", [one, other.id], 5, 35)
    session.correct(crossed)
    early, late = crossed.there
    assert owner(session, early) == owner(session, late)


def test_a_track_is_parted_where_it_is_another(folder):
    session = Session(folder)
    one = next(iter(session.tracks())).id
    parted = session.made("not_same", [one], 20)
    assert [box.frame for box in parted.there] == [19, 20]
    session.correct(parted)
    early, late = parted.there
    assert owner(session, early) != owner(session, late)
    with pytest.raises(RequestError, match="expected a frame within track"):
        session.made("not_same", [one], 0)


def test_after_a_refusal_the_tracks_are_as_before_and_both_reasons_are_named(folder):
    session = Session(folder)
    network = session._flow.network
    box = dict(zip(network.frames.tolist(), boxes_of(network.frames.tolist(), network.boxes.tolist()), strict=True))
    session.correct(Correction("next", (box[10], box[14])))
    session.correct(session.made("name", [1], 20, name="Anna"))
    before = rows(session)
    with pytest.raises(RequestError, match=r"in frame 11 .* in frame 15 .* before that: .* in frame 13"):
        session.correct(Correction("same", (box[12], box[10])))
    assert rows(session) == before
    session.correct(session.made("name", [1], 20, name="Bea"))
    assert session.names == {1: "Bea"}


@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_said_is_done_or_refused(folder, seed):
    network = SolvedNetwork.read(folder / "flow.npz")
    flow, done, rng = CorrectedFlow(network), [], np.random.default_rng(seed)
    for kind in rng.choice(["same", "not_same", "not_same", "next"], 8):
        two = network.frames.argsort(kind="stable")[np.sort(rng.choice(len(network), 2, replace=False))]
        if network.frames[two[0]] != network.frames[two[1]]:
            said = Correction(str(kind), boxes_of(network.frames[two].tolist(), network.boxes[two].tolist()))
            with suppress(RequestError):
                flow.correct([*done, said])
                done.append(said)
            flow.correct(done)


def test_a_line_that_a_crash_cut_short_is_left_out_and_written_over(folder):
    session = Session(folder)
    one = next(iter(session.tracks())).id
    session.correct(session.made("name", [one], 5, name="Anna"))
    session.close()
    with session.corrections_file.open("a") as file:
        file.write('{"kind": "na')
    session = Session(folder)
    assert session.names == {one: "Anna"}
    session.correct(session.made("name", [one], 5, name="Bea"))
    session.close()
    session = Session(folder)
    assert session.names == {one: "Bea"}
    session.close()
    session.corrections_file.write_text('{"vid')
    Session(folder).close()


@pytest.mark.parametrize(
    "text",
    ["<html>", '{"vodeo": 1', "\0", "[" * 5000, '{"video": "x", "size": null, "frames": 0}\n' + "[" * 5000 + "\n"],
)
def test_what_is_no_file_of_corrections_is_one_line(folder, text):
    (folder / "corrections.jsonl").write_text(text)
    with pytest.raises(RequestError, match=r"line [12]: expected a correction as JSON"):
        Session(folder)


@pytest.mark.parametrize(("frame", "box"), [(5, (-60, 0, 50, 40)), (5, (1e9, 0, 50, 40)), (40, (10, 10, 50, 40))])
def test_a_box_beyond_the_video_is_refused(folder, frame, box):
    with pytest.raises(RequestError, match="expected a box in the picture of frame 1 to 40"):
        (session := Session(folder)).correct(session.made("box", [], frame, box=box))


@pytest.mark.parametrize("spoil", ["size", "frames"])
def test_corrections_of_another_video_are_refused(folder, spoil):
    session = Session(folder)
    session.correct(session.made("name", [next(iter(session.tracks())).id], 5, name="Anna"))
    session.close()
    text = session.corrections_file.read_text()
    swapped = {"size": ("[400, 200]", "[401, 200]"), "frames": ('"frames": 40', '"frames": 41')}[spoil]
    session.corrections_file.write_text(text.replace(*swapped))
    with pytest.raises(RequestError, match="expected corrections of"):
        Session(folder)


def test_a_result_without_its_network_can_be_corrected_by_hand(folder):
    (folder / "flow.npz").unlink()
    session = Session(folder)
    known = Result.load(folder)
    assert [t.frames.tolist() for t in session.tracks()] == [t.frames.tolist() for t in known]
    one, two = (t.id for t in list(session.tracks())[:2])
    assert session.correct(session.made("switch", [one, two], 20)).tracks == [(one, 20, 39), (two, 20, 39)]


def test_no_result_and_a_broken_network_are_one_line(folder, tmp_path):
    with pytest.raises(RequestError, match="expected the folder of a result"):
        Session(tmp_path / "nothing")
    (folder / "flow.npz").write_bytes(b"PK nothing")
    with pytest.raises(RequestError, match="expected the network of a result"):
        Session(folder)


def test_what_people_do_goes_with_their_corrected_tracks(folder):
    from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks, write_acting_tracks
    from tsuiseki.tracking.types.tracks import ActingTrack

    people = []
    for track in Result.load(folder):
        doing = np.full((len(track), 2), float(track.id % 2))
        people.append(ActingTrack(track, doing, doing))
    write_acting_tracks(folder / "tracks.json", people, ("walking", "standing"))
    session = Session(folder)
    one, two = (t.id for t in list(session.tracks())[:2])
    session.correct(session.made("switch", [one, two], 20))
    session.close()
    found, names = read_acting_tracks(folder / "tracks.json")
    assert names == ("walking", "standing")
    doing = next(person for person in found if person.id == one).single
    assert {0.0, 1.0} <= set(doing[:, 0].round(3).tolist())


@pytest.mark.parametrize(("size", "count", "complaint"), [((300, 200), 40, "400x200"), ((400, 200), 30, "40 frames")])
def test_a_video_of_another_size_or_length_is_refused(folder, tmp_path, size, count, complaint):
    video = tmp_path / "other"
    video.mkdir()
    for t in range(count):
        cv2.imwrite(str(video / f"{t:03}.png"), np.zeros((size[1], size[0], 3), np.uint8))
    with pytest.raises(RequestError, match=complaint):
        Session(folder, video)
    Session(folder).close()
