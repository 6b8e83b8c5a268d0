"""Okutama-Action, VisDrone-MOT, MARS and Drone-Action: read in their exact layouts, and refused with one line."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.action_crops import action_sequences
from tsuiseki.datamodules.identity_crops import crops_from_folder, training_crops
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.box_labels import read_visdrone
from tsuiseki.tracking.formats.drone_action import find_drone_action, read_drone_action_boxes
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.okutama import check_frames, okutama_truth, read_okutama, write_okutama
from tsuiseki.tracking.formats.person_crops import read_mars

ROWS = """\
0 1200 600 1290 810 0 0 0 0 "Person" "Walking"
0 1206 600 1296 810 1 0 0 1 "Person" "Carrying" "Walking"
1 0 0 60 90 1 0 1 0 "Person"
1 -30 0 60 90 2 1 0 0 "Person" "Standing"
0 1212 600 1302 810 2 0 0 1 "Person" "Hand Shaking" "Standing"
2 3780 2100 3900 2190 2 0 0 0 "Person" "Sitting"
"""


def picture(path: Path, width: int = 64, height: int = 36) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((height, width, 3), 90, dtype=np.uint8))


@pytest.fixture
def okutama(tmp_path: Path) -> Path:
    """The published layout, with frames of 64x36 in place of 1280x720."""
    labels = tmp_path / "Labels" / "SingleActionTrackingLabels" / "3840x2160"
    labels.mkdir(parents=True)
    (labels / "1.1.1.txt").write_text(ROWS)
    for frame in range(12):
        picture(tmp_path / "Drone1" / "Morning" / "Extracted-Frames-1280x720" / "1.1.1" / f"{frame}.jpg")
    return tmp_path


def test_okutama_rows_become_pixels_of_the_frames(okutama):
    (sequence,) = action_sequences(okutama)
    assert sequence.name == "1.1.1"
    assert [p.name for p in sequence.files[8:12]] == ["8.jpg", "9.jpg", "10.jpg", "11.jpg"]
    labels = sequence.labels
    assert labels.frames.tolist() == [0, 1, 1, 2, 2, 2]
    np.testing.assert_allclose(labels.boxes[0], [20, 10, 21.5, 13.5])
    np.testing.assert_allclose(labels.boxes[5], [63, 35, 64, 36])  # cut off at the border
    names = [[labels.class_names[c] for c in np.flatnonzero(row)] for row in labels.actions]
    assert names == [["Walking"], ["Carrying", "Walking"], [], ["Standing"], ["Handshaking", "Standing"], ["Sitting"]]
    assert labels.lost.tolist() == [False, False, False, True, False, False]


def test_the_frames_that_come_with_the_data_are_taken_of_several_sizes(okutama):
    for size in ("3840x2160", "1920x1080"):
        for frame in range(12):
            picture(okutama / "Drone1" / "Morning" / f"Extracted-Frames-{size}" / "1.1.1" / f"{frame}.jpg")
    (sequence,) = action_sequences(okutama)
    assert {path.parent.parent.name for path in sequence.files} == {"Extracted-Frames-1280x720"}


def test_the_published_protocol_drops_lost_and_occluded_rows_and_the_first_frame(okutama):
    labels = action_sequences(okutama)[0].labels
    published, actions = okutama_truth(labels, "published")
    assert list(zip(published.frames.tolist(), published.ids.tolist(), strict=True)) == [(1, 0), (2, 0), (2, 2)]
    assert published.evaluated.all()
    assert actions.shape == (3, 12)
    lenient, _ = okutama_truth(labels, "lenient")
    assert len(lenient) == 5
    assert lenient.ids[lenient.ignored].tolist() == [1]


def test_okutama_folders_train_detectors(okutama):
    images = labelled_images(okutama, (2, 3))
    assert [len(i.boxes) for i in images] == [2, 2]
    assert images[0].ignored.tolist() == [False, True]


def test_written_labels_are_read_back(okutama, tmp_path):
    labels = action_sequences(okutama)[0].labels
    labels = labels.select(~labels.lost)
    write_okutama(tmp_path / "again.txt", labels, (64, 36))
    again = read_okutama(tmp_path / "again.txt", (64, 36))
    np.testing.assert_array_equal(again.actions, labels.actions)
    # The file holds whole pixels of 3840x2160.
    np.testing.assert_allclose(again.boxes, labels.boxes, atol=64 / 3840)


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("0 1 1 9 9 0 0 0 0 Person Walking", "expected names in double quotes"),
        ('0 1 1 9 9 0 0 0 0 "Person" Walking', "expected names in double quotes"),
        ('0 1 1 9 9 0 0 0 0 "Person" "Walking', "expected names in double quotes"),
        ('0 1 1 9 9 0 0 0 0 "Person" "Flying"', "unknown action 'Flying'; known are Handshaking, Hugging"),
        ('0 1 1 9 9 0 0 2 0 "Person" "Walking"', "expected lost, occluded and generated as 0 or 1"),
        ('-1 1 1 9 9 0 0 0 0 "Person"', "expected a whole number from 0 to 9223372036854775807 in column track_id"),
        ('0 1 1 9 9 1.5 0 0 0 "Person"', "expected a whole number from 0 to 9999999 in column frame"),
        ("0,1,1,9,9,0,0,0", "expected track_id xmin ymin xmax ymax frame"),
    ],
)
def test_broken_okutama_rows_are_named(tmp_path, row, complaint):
    path = tmp_path / "1.1.1.txt"
    path.write_text('0 1 1 9 9 7 0 0 0 "Person"\n' + row + "\n")
    with pytest.raises(RequestError, match=f"1.1.1.txt:2: {complaint}") as caught:
        read_okutama(path, (1280, 720))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("box", ["5000 10 5050 90", "90 10 50 90"])
def test_okutamas_boxes_that_show_nothing_are_left_out(tmp_path, box):
    path = tmp_path / "1.1.1.txt"
    path.write_text(f'0 1 1 9 9 7 0 0 0 "Person"\n0 {box} 8 0 0 0 "Person" "Walking"\n')
    with pytest.warns(InputWarning, match=r"1 of 2 rows are left out: 1 without an area in 3840x2160.* .line 2"):
        labels = read_okutama(path, (1280, 720))
    assert (labels.frames.tolist(), labels.actions.shape) == ([7], (1, 12))


def test_visdrones_boxes_that_span_nothing_are_left_out(tmp_path):
    # Regions in which results are neither right nor wrong may be as thin as a line.
    text = VISDRONE + "2,9,10,20,0,40,1,1,0,0\n2,10,nan,20,9,40,1,4,0,0\n2,0,10,20,0,40,0,0,0,0\n"
    path = visdrone(tmp_path, text) / "annotations" / "uav0000013_00000_v.txt"
    reasons = "1 without finite corners .line 7., 1 without an area .line 6."
    with pytest.warns(InputWarning, match=f"2 of 8 rows are left out: {reasons}"):
        truth = read_visdrone(path)
    assert truth.evaluated.tolist() == [True, True, False, False, False]


@pytest.mark.parametrize(
    ("length", "size", "complaint"),
    [
        (2, (1280, 720), "labels reach frame 2, but the video ends with frame 1"),
        (9, (3840, 2160), "the 3840x2160 video has 9 frames, the labels 3: Okutama's 4K videos"),
        (9, (640, 480), "expected frames of the aspect 16:9"),
    ],
)
def test_frames_that_labels_cannot_belong_to_are_refused(okutama, length, size, complaint):
    labels = action_sequences(okutama)[0].labels
    with pytest.raises(RequestError, match=complaint):
        check_frames(labels, length, size, "1.1.1")


VISDRONE = """\
1,0,10,20,30,40,1,1,0,0
1,1,50,20,30,40,1,2,0,2
1,2,90,20,30,40,0,1,0,0
2,0,100,100,200,50,0,0,0,0
2,3,11,20,30,40,1,4,1,1
"""


def visdrone(folder: Path, text: str = VISDRONE, frames: int = 2) -> Path:
    (folder / "annotations").mkdir()
    (folder / "annotations" / "uav0000013_00000_v.txt").write_text(text)
    for frame in range(frames):
        picture(folder / "sequences" / "uav0000013_00000_v" / f"{frame + 1:07d}.jpg")
    return folder


def test_visdrone_categories_decide_what_counts(tmp_path):
    truth = read_visdrone(visdrone(tmp_path) / "annotations" / "uav0000013_00000_v.txt")
    assert truth.evaluated.tolist() == [True, True, False, False, False]
    assert truth.ignored.tolist() == [False, False, True, True, False]
    assert truth.boxes[0].tolist() == [10, 20, 40, 60]
    assert truth.visibility.tolist() == [1.0, 0.25, 1.0, 1.0, 0.75]
    images = labelled_images(tmp_path)
    assert [len(i.boxes) for i in images] == [3, 1]
    # The pictures' folders may lie beside the labels, or be missing.
    (tmp_path / "sequences" / "uav0000013_00000_v").rename(tmp_path / "uav0000013_00000_v")
    (tmp_path / "sequences").rmdir()
    assert [len(i.boxes) for i in labelled_images(tmp_path)] == [3, 1]
    alone = labelled_images(tmp_path)[0].picture.parent.rename(tmp_path / "elsewhere").parent
    (video,) = open_labelled(alone)
    assert (video.files, video.people().evaluated.tolist()) == ((), truth.evaluated.tolist())


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("1,0,10,20,30,40,1,1,0\n", "txt:1: expected frame,id,left"),
        ("1,0,10,20,30,40,1,44,0,0\n", "txt:1: expected a category of 0-11"),
        ("1,0,10,20,0,40,1,1,0,0\n", "1 of 1 cannot: 1 without an area .line 1"),
        ("1,0,10,20,30,40,1,4,0,0\n", "no usable box"),
        ("9,0,10,20,30,40,1,1,0,0\n", "labels reach frame 9, but the clip has 2 images"),
    ],
)
def test_broken_visdrone_rows_are_named(tmp_path, text, complaint):
    with pytest.raises(RequestError, match=complaint):
        labelled_images(visdrone(tmp_path, text))


def mars(folder: Path) -> Path:
    for person, camera, tracklet, frames in (("0001", 1, 1, 20), ("0001", 2, 2, 3), ("0003", 1, 1, 3)):
        for frame in range(frames):
            picture(folder / "bbox_train" / person / f"{person}C{camera}T{tracklet:04d}F{frame + 1:03d}.jpg", 16, 32)
    picture(folder / "bbox_train" / "0000" / "0000C1T0001F001.jpg")
    picture(folder / "bbox_train" / "00-1" / "00-1C1T0001F001.jpg")
    return folder


def test_mars_names_say_who_and_where(tmp_path):
    crops = read_mars(mars(tmp_path))
    assert sorted({c.person for c in crops}) == [0, 1, 3]
    second = [c for c in crops if c.person == 1 and c.camera == 2]
    assert [(c.tracklet, c.frame) for c in second] == [(2, 1), (2, 2), (2, 3)]
    chosen = training_crops(tmp_path)
    assert len(chosen) == 8 + 3 + 3
    assert {c.person for c in chosen} == {1, 3}
    assert np.unique(crops_from_folder(tmp_path, None).ids).tolist() == [1, 3]


def test_foreign_names_among_mars_are_named(tmp_path):
    picture(mars(tmp_path) / "bbox_train" / "0001" / "holiday.jpg")
    with pytest.raises(RequestError, match=r"expected a name of MARS such as 0001C1T0001F001\.jpg"):
        read_mars(tmp_path)


def test_drone_action_clips_carry_their_class(tmp_path):
    for frame in range(3):
        picture(tmp_path / "running_sideview" / "S8_running_toRight_sideView_HD" / f"{frame:04d}.jpg")
    labels = tmp_path / "running_sideview" / "S8_running_toRight_sideView_HD.txt"
    labels.write_text("11,21,30,40\nnan,nan,nan,nan\n12,21,30,40\n")
    (clip,) = find_drone_action(tmp_path)
    assert (clip.action, clip.name) == ("running_sideview", "S8_running_toRight_sideView_HD")
    truth = read_drone_action_boxes(labels, 3)
    assert truth.frames.tolist() == [0, 2]
    assert truth.boxes[0].tolist() == [10, 20, 40, 60]
    with pytest.raises(RequestError, match="expected a row for each of 4 frames, got 3"):
        read_drone_action_boxes(labels, 4)
    labels.write_text("11,21,30,40\n11\n")
    with pytest.raises(RequestError, match=r"HD.txt:2: expected x,y,width,height, separated by commas, got 11"):
        read_drone_action_boxes(labels)
    # Cut at different places of one take; names of folders may have dots.
    for name in ("S8.1", "S8.2"):
        picture(tmp_path / "kicking" / name / "0000.jpg")
    assert [clip.name for clip in find_drone_action(tmp_path)][:2] == ["S8.1", "S8.2"]
    picture(tmp_path / "punching" / "S8.1" / "0000.jpg")
    with pytest.raises(RequestError, match=r"different names, got \S*kicking/S8\.1 and \S*punching/S8\.1"):
        find_drone_action(tmp_path)
    (tmp_path / "dancing").mkdir()
    with pytest.raises(RequestError, match="dancing: unknown action; expected a folder of clapping"):
        find_drone_action(tmp_path)
