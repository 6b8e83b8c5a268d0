"""The MOTChallenge layout: what is read, what is written back, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.mot import (
    read_detections,
    read_ground_truth,
    read_tracks,
    write_detections,
    write_ground_truth,
    write_tracks,
)
from tsuiseki.tracking.formats.mot_sequence import find_sequences, read_sequence, write_sequence_info
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.labels import GroundTruth

MOT15_ROW = "1,3,11,21,30,40,1,-1,-1,-1"
MOT16_ROW = "1,3,11,21,30,40,1,1,0.25"


def write(folder, text, name="gt.txt"):
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(("row", "visibility"), [(MOT15_ROW, 1.0), (MOT16_ROW, 0.25)])
def test_files_count_from_one_and_we_from_zero(tmp_path, row, visibility):
    truth = read_ground_truth(write(tmp_path, row))
    assert (truth.frames[0], truth.ids[0]) == (0, 3)
    np.testing.assert_array_equal(truth.boxes, [[10, 20, 40, 60]])
    assert truth.visibility[0] == visibility
    assert truth.evaluated.all()


def test_classes_decide_what_counts(tmp_path):
    classes = range(1, 13)
    rows = "\n".join(f"1,{c},11,21,30,40,1,{c},1" for c in classes)
    truth = read_ground_truth(write(tmp_path, rows))
    assert truth.ids[truth.evaluated].tolist() == [1]
    assert truth.ids[truth.ignored].tolist() == [2, 7, 8, 12]
    folder = tmp_path / "MOT20-01"
    folder.mkdir()
    assert read_ground_truth(write(folder, rows)).ids[5:6].tolist() == [6]
    assert read_ground_truth(write(folder, rows)).ignored[5]


def test_rows_marked_as_not_considered_do_not_count(tmp_path):
    truth = read_ground_truth(write(tmp_path, MOT16_ROW + "\n1,4,11,21,30,40,0,1,1"))
    assert truth.evaluated.tolist() == [True, False]


def test_ground_truth_survives_writing(tmp_path):
    truth = GroundTruth(
        np.array([0, 0, 4]),
        np.array([1, 2, 1]),
        np.array([[0.0, 0, 10, 20], [5.5, 6, 9, 30], [1, 2, 3, 4]]),
        np.array([True, False, True]),
        np.array([False, True, False]),
        np.array([1, 0.5, 0.25]),
    )
    write_ground_truth(tmp_path / "gt" / "gt.txt", truth)
    again = read_ground_truth(tmp_path / "gt" / "gt.txt")
    for name in ("frames", "ids", "boxes", "evaluated", "ignored", "visibility"):
        np.testing.assert_allclose(getattr(again, name), getattr(truth, name), atol=1e-9, err_msg=name)


def test_tracks_survive_writing(tmp_path):
    tracks = [
        Track(2, np.array([0, 1, 5]), np.array([[0.0, 0, 4, 8]] * 3), np.array([0.5, 1, 0.25])),
        Track(7, np.array([1]), np.array([[1.0, 2, 4, 8]]), np.array([1.0])),
    ]
    write_tracks(tmp_path / "tracks.txt", tracks)
    for got, expected in zip(read_tracks(tmp_path / "tracks.txt"), tracks, strict=True):
        assert got.id == expected.id
        np.testing.assert_array_equal(got.frames, expected.frames)
        np.testing.assert_allclose(got.boxes, expected.boxes)
        np.testing.assert_allclose(got.scores, expected.scores)


def test_an_empty_result_has_no_tracks(tmp_path):
    write_tracks(tmp_path / "tracks.txt", [])
    assert read_tracks(tmp_path / "tracks.txt") == []


def test_detections_survive_writing_with_empty_frames(tmp_path):
    found = [Detections.empty(), Detections(np.array([[0.0, 0, 2, 3], [4, 4, 6, 7]]), np.array([0.25, np.nan]))]
    write_detections(tmp_path / "det.txt", found)
    again = read_detections(tmp_path / "det.txt", length=4)
    assert [len(d) for d in again] == [0, 2, 0, 0]
    assert again[1].scores.tolist() == [0.25, 0]  # the second was scored by nobody
    np.testing.assert_allclose(again[1].boxes, found[1].boxes)


def make_sequence(folder, length=3, images=3):
    (folder / "img1").mkdir(parents=True)
    for n in range(images):
        (folder / "img1" / f"{n + 1:06d}.jpg").touch()
    write_sequence_info(folder, folder.name, 10, length, 64, 48)
    return folder


def test_labelled_images_count_frames_as_the_files_do(tmp_path):
    folder = make_sequence(tmp_path / "A")
    (folder / "gt").mkdir()
    write(folder / "gt", "1,1,1,1,9,9,1,1,1\n2,1,2,1,9,9,1,1,1\n2,5,2,1,9,9,1,8,1\n3,1,3,1,9,9,1,1,1")
    for image in (folder / "img1").iterdir():
        Image.new("RGB", (64, 48)).save(image)
    samples = labelled_images(tmp_path, (2, 3))
    assert [(s.picture.name, s.frame, len(s.boxes)) for s in samples] == [("000002.jpg", 1, 2), ("000003.jpg", 2, 1)]
    assert samples[0].ignored.tolist() == [False, True]
    with pytest.raises(RequestError, match="no frame"):
        labelled_images(tmp_path, (4, 9))


def test_a_folder_of_sequences_is_found_by_name(tmp_path):
    for name in ("B", "A"):
        make_sequence(tmp_path / name)
    (tmp_path / "notes").mkdir()
    assert [s.name for s in find_sequences(tmp_path)] == ["A", "B"]
    assert find_sequences(tmp_path / "A")[0].frame_rate == 10


def test_sequences_that_lie_are_refused(tmp_path):
    with pytest.warns(InputWarning, match="promises 5 frames"):
        read_sequence(make_sequence(tmp_path / "short", length=5))
    folder = make_sequence(tmp_path / "out")
    (folder / "seqinfo.ini").write_text("[Sequence]\nimDir=../../secret\n")
    with pytest.raises(RequestError, match="leads out"):
        read_sequence(folder)
    (folder / "seqinfo.ini").write_text("no section")
    with pytest.raises(RequestError, match="Sequence"):
        read_sequence(folder)
    with pytest.raises(RequestError, match="found none"):
        find_sequences(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("1,3,11,21,30,40,1,-1,1", "no usable box: expected class 1"),
        ("1,3,11,21,30,40,0,-1,-1,-1", "no usable box: column 7"),
        (MOT15_ROW + "\n" + MOT15_ROW, "id 3 stands twice in frame 1"),
        (MOT15_ROW + "\n1,2,3", ":2: expected 9 or 10 numbers"),
        (MOT15_ROW + "\n1,3,11,21,30,x,1,-1,-1,-1", ":2: expected numbers separated by commas, got 'x'"),
        ("1,3,11,21,nan,40,1,-1,-1,-1", "finite"),
        ("0,3,11,21,30,40,1,-1,-1,-1", "whole frame number from 1"),
        ("1,3,11,21,30,40,1,-1,-1,-1\n1000000000,3,11,21,30,40,1,-1,-1,-1", ":2: expected a whole frame number"),
    ],
)
def test_broken_ground_truth_is_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(RequestError, match=message) as caught:
        read_ground_truth(write(tmp_path, text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("9,-1,1,1,5,5,0.5", "video has 4 frames"),
        ("1,-1,1,1,-5,5,0.5", "positive width and height"),
        ("1,-1,1,nan,5,5,0.5", "finite"),
        ("1,-1,1,1,5,5,inf", "finite"),
        ("1,-1,1,1,5,5,0.5\n2,-1,1,1,5,5,abc", ":2: expected numbers separated by commas, got 'abc'"),
        ("1,-1,1,1,5,,0.5", ":1: expected numbers separated by commas, got ''"),
        ("1e18,-1,1,1,5,5,0.5", "a whole frame number from 1 to 10000000"),
    ],
)
def test_broken_detections_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(RequestError, match=message):
        read_detections(write(tmp_path, text, "det.txt"), length=4)


@pytest.mark.parametrize("missing", ["nan", ""])
def test_a_score_that_is_missing_is_not_known(tmp_path, missing):
    text = f"1,-1,1,1,5,5,0.5\n2,-1,1,1,5,5,{missing}\n2,-1,9,9,5,5,0.25\n"
    first, second = read_detections(write(tmp_path, text, "det.txt"), length=2)
    np.testing.assert_equal(first.scores, [0.5])
    np.testing.assert_equal(second.scores, [np.nan, 0.25])
    wide = f"1,-1,1,1,5,5,0.5,2\n1,-1,9,9,5,5,{missing},3\n"
    np.testing.assert_equal(read_detections(write(tmp_path, wide, "det.txt"))[0].scores, [0.5, np.nan])


def test_a_file_without_any_detection_is_a_video_without_people(tmp_path):
    with pytest.warns(InputWarning, match="nothing was detected"):
        found = read_detections(write(tmp_path, "", "det.txt"), length=3)
    assert [len(one) for one in found] == [0, 0, 0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3,-1,1,1,5,5,0.5\n1,-1,2,1,5,5,0.5\n3,-1,3,1,5,5,0.5\n", "not in the order of the frames; sorted"),
        ("frame,id,x,y,w,h,score\n1,-1,2,1,5,5,0.5\n3,-1,1,1,5,5,0.5\n3,-1,3,1,5,5,0.5\n", "is a heading"),
        ("1,-1,2,1,5,5,0.5\n3,-1,1,1,5,5,0.5\n3,-1,3,1,5,5,0.5\n9,-1,3,1,5,5,0.5\n", "last frame, 4, are left out"),
    ],
)
def test_what_can_be_mended_is_mended_and_said(tmp_path, text, said):
    with pytest.warns(InputWarning, match=said):
        found = read_detections(write(tmp_path, text, "det.txt"), length=4)
    assert [one.boxes[:, 0].tolist() for one in found] == [[1.0], [], [0.0, 2.0], []]


def test_a_mark_before_the_first_character_is_passed_over(tmp_path):
    (found,) = read_detections(write(tmp_path, "\ufeff1,-1,2,1,5,5,0.5\n", "det.txt"))
    assert found.boxes.tolist() == [[1, 0, 6, 5]]


def test_errors_name_the_line_of_the_file_below_a_heading(tmp_path):
    text = "frame,id,x,y,w,h,score\n2,-1,2,1,5,5,0.5\n1,-1,2,1,5,5,7\n"
    with pytest.warns(InputWarning), pytest.raises(RequestError, match=":3: expected a score"):
        read_detections(write(tmp_path, text, "det.txt"), score_range=(0, 1))


def test_a_frame_rate_of_nothing_is_refused(tmp_path):
    folder = make_sequence(tmp_path / "still")
    (folder / "seqinfo.ini").write_text("[Sequence]\nframeRate=0\n")
    with pytest.raises(RequestError, match="expected frameRate above 0, got '0'"):
        read_sequence(folder)


def test_a_detector_may_score_in_its_own_range(tmp_path):
    path = write(tmp_path, "1,-1,1,1,5,5,37.5", "det.txt")
    for score_range in (None, (-10, 100)):
        assert read_detections(path, score_range=score_range)[0].scores.tolist() == [37.5]
    with pytest.raises(RequestError, match=r":1: expected a score in \[0, 1\], got 37.5; .* `score_range`"):
        read_detections(path, score_range=(0, 1))


def test_detections_of_no_use_are_left_out_and_told(tmp_path):
    """One twice, two without an area; the same box of another score or another class is another detection."""
    lines = ["1,-1,1,1,5,5,0.5,1,-1,-1", "1,-1,1,1,5,5,0.6,1,-1,-1", "1,-1,1,1,5,5,0.5,2,-1,-1"]
    lines += [
        "2,-1,9,9,0,5,0.5,1,-1,-1",
        "2,-1,9,9,5,5,0.5,1,-1,-1",
        "2,-1,9,9,5,5,0.5,1,-1,-1",
        "4,-1,9,9,5,0,0.5,1,-1,-1",
    ]
    with pytest.warns(InputWarning) as told:
        found = read_detections(write(tmp_path, "\n".join(lines), "det.txt"), length=4)
    assert [len(frame) for frame in found] == [3, 1, 0, 0]
    texts = [str(one.message) for one in told]
    assert "2 detection(s) without an area, the first in line 4, are left out" in texts[0]
    assert "1 detection(s) repeated in the file, the first in line 6, are left out" in texts[1]


def test_classes_stand_in_column_8(tmp_path):
    path = write(tmp_path, "1,-1,1,1,5,5,0.5,3,-1,-1\n1,-1,9,1,5,5,0.5,1,-1,-1\n3,-1,1,1,5,5,0.5,1,-1,-1", "det.txt")
    found = read_detections(path, 4)
    assert [one.origin[:, 1].tolist() for one in found] == [[3, 1], [], [1], []]
    for none in ("1,-1,1,1,5,5,0.5", "1,-1,1,1,5,5,0.5,-1,-1,-1", "1,-1,1,1,5,5,0.5,3.5,-2.25,0"):
        assert read_detections(write(tmp_path, none, "det.txt"))[0].classes is None


def test_rows_that_are_left_out_count_among_those_of_the_frame(tmp_path):
    lines = [
        "2,-1,1,1,5,5,0.5,3",
        "1,-1,1,1,0,5,0.5,3",
        "1,-1,9,1,5,5,0.5,1",
        "1,-1,9,1,5,5,0.5,1",
        "1,-1,8,1,5,5,0.4,2",
    ]
    with pytest.warns(InputWarning):
        first, second = read_detections(write(tmp_path, "\n".join(lines), "det.txt"))
    assert (first.origin.tolist(), second.origin.tolist()) == ([[1, 1], [3, 2]], [[0, 3]])


def test_the_class_of_a_track_is_that_of_most_detections(tmp_path):
    origin = np.array([[0, 2], [5, 7], [-1, -1], [1, 7]])
    track = Track(1, np.arange(4), np.tile([0.0, 0, 5, 9], (4, 1)), np.ones(4), origin=origin, names={7: "truck"})
    assert (track.class_id, track.class_name, track.classes.tolist()) == (7, "truck", [2, 7, -1, 7])
    write_tracks(tmp_path / "t.txt", [track])
    (read,) = read_tracks(tmp_path / "t.txt")
    assert (read.class_id, read.detection.tolist()) == (7, [-1] * 4)


def test_real_sequences_are_read(data_folder):
    sequence = read_sequence(data_folder / "mot" / "PETS09-S2L1-first")
    truth = read_ground_truth(sequence.ground_truth_path)
    found = read_detections(sequence.detections_path, sequence.length)
    assert (sequence.length, len(sequence.images), len(truth), sum(map(len, found))) == (400, 400, 2396, 2252)


def test_boxes_may_have_no_score(tmp_path):
    file = tmp_path / "det.txt"
    file.write_text("1,-1,10,20,30,60\n1,-1,10,20,30,60\n2,-1,11,20,30,60\n")
    with pytest.warns(InputWarning, match="1 detection.*repeated"):
        found = read_detections(file)
    assert [len(one) for one in found] == [1, 1]
    assert all(np.isnan(one.scores).all() for one in found)


@pytest.mark.parametrize(
    ("scores", "told"),
    [
        ([0.4, 0.7, 0.9, 30.0, 60.0, 97.0], True),
        ([0.4, 0.7, 0.9, 0.5, 0.6, 0.97], False),
        ([0.5, 3.0, 4.0, 30.0, 60.0, 97.0], False),
        ([-2.0, 0.7, 0.9, 12.0, 14.0, 20.0], False),
    ],
)
def test_scores_of_two_scales_are_told(tmp_path, recwarn, scores, told):
    file = tmp_path / "det.txt"
    rows = [f"{t + 1},-1,{100 * k},20,30,60,{score}" for t in range(10) for k, score in enumerate(scores)]
    file.write_text("\n".join(rows))
    found = read_detections(file)
    assert [one.scores.tolist() for one in found] == [scores] * 10
    assert any("two scales" in str(warning.message) for warning in recwarn) == told
