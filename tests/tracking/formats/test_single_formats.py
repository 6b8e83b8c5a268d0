"""Boxes of one target as data sets write them, quirks included."""

import json

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.single import (
    find_single_sequences,
    polygon_hulls,
    read_attributes,
    read_boxes,
    read_result,
    same_name,
    write_boxes,
)


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text", ["1,2,3,4\n5,6,7,8\n", "1\t2\t3\t4\n5\t6\t7\t8", " 1  2 3 4 \n\n5 6 7 8\n", "1;2;3;4\r\n5, 6, 7, 8\r\n"]
)
def test_any_separator(tmp_path, text):
    assert read_boxes(write(tmp_path / "gt.txt", text)).tolist() == [[0, 1, 3, 5], [4, 5, 11, 13]]


def test_a_hidden_target_is_a_row_of_nan(tmp_path):
    boxes = read_boxes(write(tmp_path / "gt.txt", "1,1,5,5\nNaN,NaN,NaN,NaN\n2,2,5,5\n"))
    assert np.isnan(boxes).all(axis=1).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty file"),
        ("1,2,3\n", "gt.txt:1: expected x,y,width,height or four corners, separated by commas, got 1,2,3"),
        ("1,2,3,4\na,b,c,d\n", "gt.txt:2: expected x,y"),
        ("1,2,3,4\n1,NaN,3,4\n", "gt.txt:2: expected finite numbers, or NaN in all of them"),
        ("1,2,3,inf\n", "gt.txt:1: expected finite numbers"),
        ("NaN,NaN,NaN,NaN\n1,1,2,2\n", "expected a box with an area in the first frame"),
        ("1,2,0,4\n", "expected a box with an area in the first frame"),
        ("1,2,3,4\n1,2,3,4,5,6,7,8\n", "gt.txt:2: expected 4 numbers as in every line"),
    ],
)
def test_broken_labels_are_one_clear_line(tmp_path, text, said):
    with pytest.raises(RequestError, match=said) as error:
        read_boxes(write(tmp_path / "gt.txt", text))
    assert "\n" not in str(error.value)


def test_a_polygon_becomes_its_hull():
    assert polygon_hulls(np.array([[5, 0, 9, 4, 4, 9, 0, 5.0]])).tolist() == [[0, 0, 9, 9]]


def test_written_boxes_read_the_same(tmp_path):
    boxes = np.random.default_rng(0).uniform([0, 0, 60, 60], [50, 50, 110, 110], (4, 4))
    write_boxes(tmp_path / "boxes.txt", boxes)
    np.testing.assert_allclose(read_boxes(tmp_path / "boxes.txt"), boxes, atol=1e-3)  # four decimals


@pytest.mark.parametrize("wrapped", [True, False])
def test_results_of_tracker_benchmark(tmp_path, wrapped):
    run = {"res": [[1, 1, 4, 4], [2, 2, 4, 4]], "resType": "rect"}
    path = write(tmp_path / "r.json", json.dumps([run] if wrapped else run))
    assert read_result(path).tolist() == [[0, 0, 4, 4], [1, 1, 5, 5]]


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"res": [[1,2]], "resType": "rect"}', '{"res": [[1,2,3,4]], "resType": "affine"}']
)
def test_broken_results_are_refused(tmp_path, content):
    with pytest.raises(RequestError, match=r"r\.json"):
        read_result(write(tmp_path / "r.json", content))


def sequence(folder, boxes, images, first=1, images_in="img"):
    write(folder / "groundtruth_rect.txt", "1,1,5,5\n" * boxes)
    for n in range(first, first + images):
        write(folder / images_in / f"{n:04d}.jpg", "")
    return folder


def test_more_images_than_boxes(tmp_path):
    found = find_single_sequences(sequence(tmp_path / "Diving", 3, 5))[0]
    assert [p.name for p in found.images] == ["0001.jpg", "0002.jpg", "0003.jpg"]


def test_labels_that_start_later(tmp_path):
    found = find_single_sequences(sequence(tmp_path / "BlurCar3", 4, 6))[0]
    assert found.images[0].name == "0003.jpg"


def test_the_sequence_s_own_start_wins(tmp_path):
    folder = sequence(tmp_path / "BlurCar3", 3, 6)
    write(folder / "cfg.json", '{"startFrame": 2}')
    assert find_single_sequences(folder)[0].images[0].name == "0002.jpg"


def test_fewer_images_than_boxes_is_an_error(tmp_path):
    with pytest.raises(RequestError, match="Cut: expected an image for each of its 4 boxes, found 3"):
        find_single_sequences(sequence(tmp_path / "Cut", 4, 3))


def test_two_targets_are_two_sequences(tmp_path):
    folder = tmp_path / "Jogging"
    for n in (1, 2):
        write(folder / f"groundtruth_rect.{n}.txt", f"{n},1,5,5\n")
    write(folder / "img" / "0001.jpg", "")
    assert [s.name for s in find_single_sequences(folder)] == ["Jogging-1", "Jogging-2"]


def test_a_vot_folder(tmp_path):
    write(tmp_path / "bag" / "groundtruth.txt", "0,0,4,0,4,6,0,6\n")
    write(tmp_path / "bag" / "color" / "00000001.jpg", "")
    found = find_single_sequences(tmp_path)[0]
    assert (found.name, found.boxes.tolist(), len(found.images)) == ("bag", [[0, 0, 4, 6]], 1)


def test_attributes_come_from_a_list_with_stray_spaces(tmp_path):
    path = write(tmp_path / "tb.txt", "Car4\tIV ,SV\nHuman4-2\tIV, DEF\n")
    assert read_attributes(path) == {"car4": {"IV", "SV"}, "human42": {"IV", "DEF"}}


def test_an_unknown_attribute_is_refused(tmp_path):
    with pytest.raises(RequestError, match=r"line 1: expected attributes of IV.*got 'XX'"):
        read_attributes(write(tmp_path / "tb.txt", "Car4\tXX\n"))


def test_spellings_of_a_name():
    assert same_name("BasketBall") == same_name("basketball")
    assert same_name("Human4.2") == same_name("human4-2")


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(RequestError, match="found none"):
        find_single_sequences(tmp_path)


@pytest.mark.parametrize(("data", "first"), [("UAV123", 775), ("UAV123_10fps", 259)])
def test_labels_of_uav123_lie_apart(tmp_path, data, first):
    images, labels = tmp_path / "data_seq" / data, tmp_path / "anno" / data
    for name, number in (("bike1", 1), ("bird1", 1), ("bird1", 2), ("bird1", first), ("bird1", first + 1)):
        write(images / name / f"{number:06d}.jpg", "")
    write(labels / "bike1.txt", "11,21,30,40\n")
    write(labels / "bird1_1.txt", "1,1,5,5\n1,1,5,5\n")
    write(labels / "bird1_2.txt", "2,2,5,5\n3,3,5,5\n")
    (bike,) = find_single_sequences(images / "bike1")
    assert bike.boxes.tolist() == [[10, 20, 40, 60]]
    found = find_single_sequences(images)
    assert [s.name for s in found] == ["bike1", "bird1_1", "bird1_2"]
    assert [[int(p.stem) for p in s.images] for s in found] == [[1], [1, 2], [first, first + 1]]
