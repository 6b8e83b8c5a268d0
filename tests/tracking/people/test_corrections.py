"""Corrections of an earlier result, done again on this one."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.result import Result, check_corrections
from tsuiseki.tracking.review.session import Session
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import open_source

IMAGES = [np.zeros((200, 400, 3), np.uint8)] * 30


def two_people(seed=0):
    rng = np.random.default_rng(seed)
    return [
        np.array([[x, y, x + 30, y + 80, 0.9] for x, y in np.array([(20 + 5 * t, 30), (340 - 5 * t, 110)])
                  + rng.normal(0, 0.5, (2, 2))])
        for t in range(30)
    ]  # fmt: skip


def tracked(detections, method="flow", **more):
    more |= {"appearance": "none"} if method == "flow" else {}
    return track_people(IMAGES, method, detections=detections, frame_rate=10.0, **more)


@pytest.fixture
def corrections(tmp_path):
    tracked(two_people()).save(tmp_path / "first")
    session = Session(tmp_path / "first")
    session.correct(session.made("switch", [1, 2], 15))
    session.correct(session.made("name", [1], 29, name="Anna"))
    session.close()
    return tmp_path / "first" / "corrections.jsonl"


@pytest.mark.parametrize("method", ["flow", "sort"])
def test_they_are_done_again_on_other_detections_of_the_same_people(corrections, tmp_path, method):
    result = tracked(two_people(seed=1), method).corrected(corrections)
    first = Result.load(tmp_path / "first")
    assert [t.frames.tolist() for t in result] == [t.frames.tolist() for t in first]
    assert all(np.abs(a.boxes - b.boxes).max() < 5 for a, b in zip(result, first, strict=True))
    assert result.facts["corrections"] == 2
    assert list(result.facts["track_names"].values()) == ["Anna"]
    result.save(tmp_path / "again")
    session = Session(tmp_path / "again")
    assert [t.boxes[-1].round(2).tolist() for t in session.tracks()] == [t.boxes[-1].round(2).tolist() for t in result]
    assert session.answered == 2


@pytest.mark.slow
def test_what_does_not_apply_is_listed_by_the_command(corrections, tmp_path, capsys):
    found = [boxes[:1] for boxes in two_people()]
    rows = [f"{t + 1},-1,{x},{y},{x2 - x},{y2 - y},{s}" for t, ((x, y, x2, y2, s),) in enumerate(found)]
    (tmp_path / "det.txt").write_text("\n".join(rows) + "\n")
    sequence = tmp_path / "img1"
    sequence.mkdir()
    import cv2

    for t, image in enumerate(IMAGES, 1):
        cv2.imwrite(str(sequence / f"{t:03}.png"), image)
    words = ["track", "people", str(sequence), "--fps", "10", "--detections", str(tmp_path / "det.txt")]
    words += ["--appearance", "none", "--out", str(tmp_path / "o"), "--corrections", str(corrections)]
    assert main(words) == 0
    err = capsys.readouterr().err
    assert "corrections: 0 of 2 done again" in err
    assert err.count("no detection is there") == 2


def test_those_of_another_video_are_refused_before_it_is_tracked(corrections, tmp_path):
    path = tmp_path / "short.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (400, 240))
    for _ in range(200):
        writer.write(np.zeros((240, 400, 3), np.uint8))
    writer.release()
    for frames in (None, "1-12"):
        with pytest.raises(RequestError, match=r"expected corrections of short\.avi"):
            check_corrections(corrections, open_source(path, parse_frames(frames)))


def test_those_of_another_video_and_of_corrected_tracks_are_refused(corrections):
    other = track_people([np.zeros((240, 400, 3), np.uint8)] * 30, detections=two_people(), appearance="none")
    with pytest.raises(RequestError, match="expected corrections of"):
        other.corrected(corrections)
    with pytest.raises(RequestError, match="cannot be read"):
        tracked(two_people()).corrected("nothing.jsonl")
    with pytest.raises(RequestError, match="as the tracker left them"):
        tracked(two_people()).corrected(corrections).corrected(corrections)


def test_a_result_that_was_loaded_is_corrected_as_the_one_that_was_tracked(corrections, tmp_path):
    result = tracked(two_people(seed=1))
    loaded = Result.load(result.save(tmp_path / "again")).corrected(corrections)
    right = result.corrected(corrections)
    for track, other in zip(loaded, right, strict=True):
        assert np.array_equal(track.frames, other.frames)
        assert np.allclose(track.boxes, other.boxes, atol=0.01)  # the text has hundredths of a pixel
    assert loaded.facts["track_names"] == right.facts["track_names"]
    assert loaded.frames["people"] == right.frames["people"]
    assert "flow.npz" in {path.name for path in loaded.save(tmp_path / "corrected").iterdir()}


def test_a_file_of_something_else_is_refused_before_anything_is_tracked(tmp_path, capsys):
    (tmp_path / "bad.jsonl").write_text("bad\n1\n")
    (tmp_path / "img1").mkdir()
    cv2.imwrite(str(tmp_path / "img1/000001.png"), IMAGES[0])
    words = ["track", "people", str(tmp_path / "img1"), "--corrections", str(tmp_path / "bad.jsonl")]
    assert main([*words, "--out", str(tmp_path / "o")]) == 2
    assert "bad.jsonl, line 1: expected a correction as JSON" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()
