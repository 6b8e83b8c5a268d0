"""Labels say of themselves which frames, boxes, people and classes they mean; what cannot be used is said."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import tsuiseki
from tsuiseki.datamodules.labelled_images import labelled_images
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.calls import evaluate_people
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.types import Track

FRAMES = 12
SIZE = (200, 100)


def tracks() -> list[Track]:
    """Two people, who move by more than their widths from frame to frame."""
    frames = np.arange(FRAMES)
    left = np.stack([10.0 * frames, 5.0 + 40 * (frames % 2)], axis=1)
    boxes = np.concatenate([left, left + np.array([8, 20])], axis=1)
    return [Track(number, frames, boxes + np.array([30, 0, 30, 0]) * number, np.ones(FRAMES)) for number in (1, 2)]


def coco() -> dict[str, Any]:
    """Both in each frame, as COCO's JSON with all that a file may say."""
    sides = {"width": SIZE[0], "height": SIZE[1]}
    images = [{"id": 50 + n, "file_name": f"a{n + 1:04d}.png", "frame_id": n, **sides} for n in range(FRAMES)]
    rows = [(t.id, n, box) for t in tracks() for n, box in enumerate(t.boxes.tolist())]
    annotations = [
        {"id": k, "image_id": 50 + n, "track_id": i, "category_id": 1, "bbox": [x, y, x2 - x, y2 - y]}
        for k, (i, n, (x, y, x2, y2)) in enumerate(rows, start=1)
    ]
    return {"images": images, "categories": [{"id": 1, "name": "person"}], "annotations": annotations}


Change = Callable[[dict[str, Any]], object]


def written(folder: Path, change: Change = len) -> Path:
    content = coco()
    change(content)
    path = folder / "labels.json"
    path.write_text(json.dumps(content))
    return path


def without(key: str) -> Change:
    return lambda content: [image.pop(key) for image in content["images"]]


def reversed_images(content: dict[str, Any]) -> None:
    content["images"].reverse()


def in_any_order(content: dict[str, Any]) -> None:
    without("frame_id")(content)
    reversed_images(content)


def by_id_alone(content: dict[str, Any]) -> None:
    in_any_order(content)
    without("file_name")(content)


def by_name_alone(content: dict[str, Any]) -> None:
    """Ids in another order than names."""
    without("frame_id")(content)
    for entry in [*content["images"], *content["annotations"]]:
        key = "image_id" if "image_id" in entry else "id"
        entry[key] = f"x{999 - entry[key]}"


def from_one(content: dict[str, Any]) -> None:
    for image in content["images"]:
        image["frame_id"] += 1


def from_one_without_names(content: dict[str, Any]) -> None:
    from_one(content)
    without("file_name")(content)


def text_ids(content: dict[str, Any]) -> None:
    for entry in content["annotations"]:
        entry["image_id"], entry["track_id"] = str(entry["image_id"]), str(entry["track_id"])


def frame_index(content: dict[str, Any]) -> None:
    for image in content["images"]:
        image["frame_index"] = image.pop("frame_id")
    reversed_images(content)


def decimal_times(content: dict[str, Any]) -> None:
    """Names are times, of which a text's order is another one."""
    without("frame_id")(content)
    for n, image in enumerate(content["images"]):
        image["file_name"] = f"1700000{n * 3 / 25 + 4:.2f}".rstrip("0").rstrip(".") + ".png"


@pytest.mark.parametrize(
    "change",
    [
        reversed_images,
        in_any_order,
        by_id_alone,
        by_name_alone,
        from_one,
        from_one_without_names,
        text_ids,
        frame_index,
        decimal_times,
    ],
)
def test_coco_images_have_their_frames_in_any_order_and_by_any_count(change: Change, tmp_path: Path) -> None:
    scores = evaluate_people(written(tmp_path, change), tracks())
    assert (scores.hota, scores.mota, scores.idf1) == (1, 1, 1)


def left_out(*frames: int, names_only: bool = False, first: int = 0) -> Change:
    """Without the images of some frames and what is labelled there."""

    def change(content: dict[str, Any]) -> None:
        gone = {50 + n for n in frames}
        content["images"] = [image for image in content["images"] if image["id"] not in gone]
        content["annotations"] = [entry for entry in content["annotations"] if entry["image_id"] not in gone]
        for image in content["images"]:
            image["frame_id"] += first
        if names_only:
            in_any_order(content)

    return change


@pytest.mark.parametrize("names_only", [False, True])
@pytest.mark.parametrize("frames", [(4, 5), (0,), (0, 1, 2), (11,), (0, 6, 7, 9)])
def test_coco_frames_that_are_left_out_shift_nothing_and_score_nothing(
    names_only: bool, frames: tuple[int, ...], tmp_path: Path
) -> None:
    path = written(tmp_path, left_out(*frames, names_only=names_only))
    expected = InputWarning if frames != (11,) else None
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        # Results go on to the last frame that is listed.
        scores = evaluate_people(path, tracks(), frames=f"1-{FRAMES - 1}" if frames == (11,) else None)
    assert (scores.hota, scores.mota) == (1, 1)
    lines = [str(line.message) for line in said if "have no image in it" in str(line.message)]
    assert len(lines) == (expected is not None)
    assert all(
        f"{len(frames)} of 12 frames have no image in it, the first is frame {frames[0] + 1};" in x for x in lines
    )


def test_coco_frames_from_one_with_some_left_out(tmp_path: Path) -> None:
    with pytest.warns(InputWarning, match="no image has the frame_id 0; it is taken to count frames from 1"):
        assert evaluate_people(written(tmp_path, left_out(0, 5, first=1)), tracks()).hota == 1


def picture(path: Path, size: tuple[int, int] = SIZE) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.zeros((size[1], size[0], 3), np.uint8))


def test_coco_pictures_beside_say_which_frame_an_image_is(tmp_path: Path) -> None:
    def from_five(content: dict[str, Any]) -> None:
        """Numbers in names begin in the middle of another count."""
        in_any_order(content)
        for image in content["images"]:
            image["file_name"] = f"{int(image['file_name'][1:5]) + 400}.png"

    path = written(tmp_path, from_five)
    with pytest.warns(InputWarning, match=r"401\.png is taken as the first frame"):
        assert evaluate_people(path, tracks()).hota == 1
    for n in range(FRAMES + 4):
        picture(tmp_path / "images" / f"{n + 398}.png")
    # Three pictures come before the first that is labelled.
    assert open_labelled(path)[0].people().frames.tolist() == [n for n in range(3, 15) for _ in range(2)]


def test_training_takes_the_images_that_the_json_names(tmp_path: Path) -> None:
    path = written(tmp_path, left_out(3, 4, names_only=True))
    for n in range(FRAMES):
        if n not in (3, 4):
            picture(tmp_path / "images" / f"a{n + 1:04d}.png")
    # Without numbers in the file the pictures that lie there are all the frames; with them, frames keep theirs.
    there = [n for n in range(FRAMES) if n not in (3, 4)]
    samples = labelled_images(path)
    assert [(sample.picture.name, sample.frame) for sample in samples] == [
        (f"a{n + 1:04d}.png", place) for place, n in enumerate(there)
    ]
    for n, sample in zip(there, samples, strict=True):
        np.testing.assert_allclose(sample.boxes, [t.boxes[n] for t in tracks()])
    with pytest.warns(InputWarning, match="2 of 12 frames have no image in it, the first is frame 4"):
        samples = labelled_images(written(tmp_path, left_out(3, 4)))
    assert [(sample.picture.name, sample.frame) for sample in samples] == [(f"a{n + 1:04d}.png", n) for n in there]


def test_a_turned_box_of_coco_is_the_upright_box_about_it(tmp_path: Path) -> None:
    def turn(content: dict[str, Any]) -> None:
        content["annotations"][0]["attributes"] = {"rotation": 90.0, "occluded": False}
        content["annotations"][1]["attributes"] = {"rotation": 360.0}

    with pytest.warns(InputWarning, match=r"1 turned, for which the upright boxes about them are taken .annotation 1"):
        boxes = open_labelled(written(tmp_path, turn))[0].people().boxes
    # 8 by 20 about 34, 15 is 20 by 8.
    np.testing.assert_allclose(boxes[0], [24, 11, 44, 19])
    np.testing.assert_allclose(boxes[2], tracks()[0].boxes[1])


def test_crowds_and_boxes_without_an_id_among_tracks_do_not_hide_the_tracks(tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        content["annotations"][0].pop("track_id")
        content["annotations"][1]["track_id"] = -1
        content["annotations"][2]["track_id"] = None
        content["annotations"].append({**content["annotations"][5], "id": 99, "iscrowd": 1, "bbox": [150, 50, 40, 40]})

    path = written(tmp_path, change)
    with pytest.warns(
        InputWarning, match=r"3 of 24 labelled boxes are left out: 3 without an id .the first in frame 1"
    ):
        truth = open_labelled(path)[0].people()
    assert (int(truth.evaluated.sum()), int(truth.ignored.sum())) == (21, 1)
    on_crowd = Track(7, np.array([5]), np.array([[150.0, 50, 190, 90]]), np.ones(1))
    scores = evaluate_people(path, [*tracks(), on_crowd])
    assert (scores.false_positives, scores.false_negatives, scores.labelled) == (3, 0, 21)
    # They teach a detector; and as a result there are the tracks alone.
    assert int(open_labelled(path)[0].people(single=True).evaluated.sum()) == 24
    with pytest.warns(InputWarning, match="4 of 25 boxes have no id of a track, or are crowds, and are left out"):
        assert {t.id: len(t) for t in tsuiseki.Result.load(path)} == {1: 9, 2: 12}


def bad_annotations() -> Iterator[tuple[str, str, object, str]]:
    """What is said, and which value does it."""
    for value in ([1, 2, 0, 4], [1, 2, 3, -4]):
        yield f"area-{value}", "bbox", value, "without an area"
    for value in ([1, 2, 3, float("nan")], [1, 2, float("inf"), 4], ["a", 1, 1, 1], [None, 1, 2, 3]):
        yield f"finite-{value}", "bbox", value, "without a finite number as bbox"
    for value in ([1, 2, 3], None, {}, "1,2,3,4"):
        yield f"four-{value}", "bbox", value, "without x, y, width and height in bbox"
    yield "category", "category_id", 7, "of category 7, which is not listed"
    yield "image", "image_id", 7, "of an image that is not listed"
    yield "id", "track_id", "Anna", "with 'Anna' as track_id, which is no whole number"
    yield "score", "score", "high", "without a finite number as score"
    yield "rotation", "attributes", {"rotation": "left"}, "without a finite number as rotation"


@pytest.mark.parametrize(("key", "value", "reason"), [pytest.param(*row, id=name) for name, *row in bad_annotations()])
def test_an_annotation_that_cannot_be_used_is_left_out_and_most_refuse(
    key: str, value: object, reason: str, tmp_path: Path
) -> None:
    path = written(tmp_path, lambda content: content["annotations"][4].update({key: value}))
    with pytest.warns(InputWarning, match=re.escape(f"1 of 24 annotations are left out: 1 {reason} (annotation 5)")):
        assert len(open_labelled(path)[0].people()) == 23
    path = written(tmp_path, lambda content: [entry.update({key: value}) for entry in content["annotations"][4:]])
    with pytest.raises(RequestError, match=re.escape(f"20 of 24 cannot: 20 {reason} (the first annotation 5); mend")):
        open_labelled(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("images"), "found no list of images"),
        (lambda c: c.update(categories={}), "found no list of categories"),
        (lambda c: c["annotations"].append(3), "got annotations that are no objects"),
        (
            lambda c: c["categories"].append({"name": "car"}),
            "expected a whole number as id and a name of each category",
        ),
        (
            lambda c: c["categories"].append({"id": 1, "name": "car"}),
            "expected one name a category, got person and car",
        ),
        (lambda c: c["images"][3].update(id=50), "expected an id of each image, got 50 twice"),
        (lambda c: c["images"][3].update(frame_id=0), "expected one image a frame, got 'a0001.png' and 'a0004.png'"),
        (lambda c: c["images"][3].update(frame_id="b"), "expected a whole number as frame_id, got 'b' of image 53"),
        (lambda c: c["images"][3].update(frame_id=-3), "expected frame_id from 0"),
        (
            lambda c: c["images"][3].pop("frame_id"),
            "frame_id of all images or of none, got it of 11 of 12, not of a0004",
        ),
        (lambda c: c["images"][3].update(video_id=2), "expected one video, got 2"),
        (lambda c: c["images"].clear(), "24 of 24 cannot: 24 of an image that is not listed"),
    ],
)
def test_a_broken_coco_file_is_refused_in_words(change: Change, message: str, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=message) as error:
        open_labelled(written(tmp_path, change))
    assert not re.search(r"Error|\n", str(error.value))


def test_a_track_of_several_classes_is_said(tmp_path: Path) -> None:
    def change(content: dict[str, Any]) -> None:
        content["categories"].append({"id": 2, "name": "car"})
        content["annotations"][11]["category_id"] = 2

    with pytest.warns(InputWarning, match=r"id 1 are of several classes \(11 person, 1 car\); all are taken as person"):
        assert evaluate_people(written(tmp_path, change), tracks()).hota == 1


def test_pictures_of_another_size_than_the_file_says_are_not_taken_for_theirs(tmp_path: Path) -> None:
    path = written(tmp_path)
    for n in range(FRAMES):
        picture(tmp_path / "images" / f"a{n + 1:04d}.png", (400, 200) if n == 2 else SIZE)
    with pytest.warns(
        InputWarning, match=r"1 of 12 images are left out: 1 of another size .*a0003.png of 400x200 for 200x"
    ):
        samples = labelled_images(path)
    assert [sample.frame for sample in samples] == [n for n in range(FRAMES) if n != 2]
    with pytest.warns(InputWarning, match="of another size"):
        assert evaluate_people(path, tracks()).hota == 1
    for n in range(FRAMES):
        picture(tmp_path / "images" / f"a{n + 1:04d}.png", (400, 200))
    with pytest.raises(
        RequestError, match=r"12 of 12 cannot: 12 of another size than the file says .*of 400x200 for 200x100"
    ):
        open_labelled(path)


def studio(*annotations: dict[str, Any], **more: Any) -> list[dict[str, Any]]:
    return [{"data": {"video": "a.mp4", "size": [*SIZE]}, "annotations": [*annotations], **more}]


def of_person(track: Track, **more: Any) -> dict[str, Any]:
    """What somebody labelled: one track."""
    shares = track.boxes / np.tile(SIZE, 2) * 100
    keys = [
        {"frame": n + 1, "x": x, "y": y, "width": x2 - x, "height": y2 - y}
        for n, (x, y, x2, y2) in enumerate(shares.tolist())
    ]
    value = {"framesCount": FRAMES, "sequence": keys, "labels": ["person"]}
    return {"result": [{"id": str(track.id), "type": "videorectangle", "value": value}], **more}


def studio_file(folder: Path, content: object) -> Path:
    path = folder / "labels.json"
    path.write_text(json.dumps(content))
    return path


def test_what_two_people_labelled_is_not_taken_of_one_in_silence(tmp_path: Path) -> None:
    first, second = (of_person(t, id=t.id, completed_by={"email": f"{t.id}@x.org"}) for t in tracks())
    with pytest.raises(RequestError, match=r"expected one annotation of the task, got 2 \(by 1@x.org, 2@x.org\)"):
        open_labelled(studio_file(tmp_path, studio(first, second)))
    marked = studio_file(tmp_path, studio(first, {**second, "ground_truth": True}))
    with pytest.warns(InputWarning, match="of 2 annotations the one that is marked as ground truth is read"):
        assert set(open_labelled(marked)[0].people().ids.tolist()) == {2}
    models = [of_person(t, model_version=f"m{t.id}") for t in tracks()]
    with pytest.raises(RequestError, match=r"expected one prediction of the task, got 2 \(by m1, m2\)"):
        open_labelled(studio_file(tmp_path, studio(predictions=models)))


def test_a_cancelled_annotation_is_left_out(tmp_path: Path) -> None:
    first, second = (of_person(t) for t in tracks())
    path = studio_file(tmp_path, studio({**first, "was_cancelled": True}, second))
    with pytest.warns(InputWarning, match="1 of 2 annotations were cancelled and are left out"):
        assert set(open_labelled(path)[0].people().ids.tolist()) == {2}
    alone = studio_file(tmp_path, studio({**first, "was_cancelled": True}))
    with pytest.warns(InputWarning), pytest.raises(RequestError, match="expected `videorectangle`"):
        open_labelled(alone)


def test_label_studios_other_results_and_bad_keys_are_counted(tmp_path: Path) -> None:
    entry = of_person(tracks()[0])
    sequence = entry["result"][0]["value"]["sequence"]
    sequence[3]["width"], sequence[5]["frame"], sequence[7]["x"] = 0, 0, None
    entry["result"].append({"id": "t", "type": "timelinelabels", "value": {}})
    with pytest.warns(InputWarning) as said:
        truth = open_labelled(studio_file(tmp_path, studio(entry)))[0].people()
    lines = [str(line.message) for line in said]
    assert any("1 of 2 results are no videorectangle (timelinelabels) and are left out" in line for line in lines)
    reasons = (
        "1 without an area (frame 4 of track 1), 1 without a frame from 1 to 10000000 (frame 0 of track 1), 1 with"
    )
    assert any(f"3 of 12 key frames are left out: {reasons}" in line for line in lines)
    # They are on the line between the keys about them.
    assert truth.frames.tolist() == list(range(FRAMES))


def test_a_turned_box_of_label_studio_turns_about_its_corner(tmp_path: Path) -> None:
    entry = of_person(tracks()[0])
    for key in entry["result"][0]["value"]["sequence"]:
        key["rotation"] = 90
    with pytest.warns(InputWarning, match="12 turned, for which the upright boxes about them are taken"):
        boxes = open_labelled(studio_file(tmp_path, studio(entry)))[0].people().boxes
    # 8 to the right and 20 down from 30, 5 becomes 8 down and 20 to the left.
    np.testing.assert_allclose(boxes[0], [10, 5, 30, 13])
    content = studio(entry)
    del content[0]["data"]["size"]
    with pytest.raises(RequestError, match="12 of 12 cannot: 12 turned, in a picture whose size is not known"):
        open_labelled(studio_file(tmp_path, content))


def cvat_box(track: Track, frame: int, **more: object) -> str:
    corners = dict(zip(("xtl", "ytl", "xbr", "ybr"), track.boxes[frame].tolist(), strict=True))
    values = {"frame": frame, "outside": 0, "occluded": 0, **corners, **more}
    attributes = " ".join(f'{key}="{value}"' for key, value in values.items())
    return f"<box {attributes}/>"


def cvat_file(folder: Path, *tracks_of_xml: str) -> Path:
    path = folder / "annotations.xml"
    path.write_text(f"<annotations>{''.join(tracks_of_xml)}</annotations>")
    return path


def test_a_turned_box_of_cvat_is_the_upright_box_about_it_and_turns_the_short_way(tmp_path: Path) -> None:
    track = tracks()[0]
    keys = [cvat_box(track, 0, rotation="350.0"), cvat_box(track, 4, rotation="10"), cvat_box(track, 6, rotation="90")]
    path = cvat_file(tmp_path, f'<track id="1" label="person">{"".join(keys)}</track>')
    with pytest.warns(
        InputWarning, match="3 turned, for which the upright boxes about them are taken .the first frame 0"
    ):
        boxes = open_labelled(path)[0].people().boxes
    widths, heights = (boxes[:, 2:] - boxes[:, :2]).T
    angle = np.radians(10)
    np.testing.assert_allclose(widths[0], 8 * np.cos(angle) + 20 * np.sin(angle))
    # Upright half way between -10 and 10 degrees, and on its side at 90.
    np.testing.assert_allclose([widths[2], heights[2], widths[6], heights[6]], [8, 20, 20, 8])
    np.testing.assert_allclose((boxes[6, :2] + boxes[6, 2:]) / 2, (track.boxes[6, :2] + track.boxes[6, 2:]) / 2)


def test_cvats_bad_keys_tracks_and_shapes_are_counted(tmp_path: Path) -> None:
    first, second = tracks()
    good = "".join(cvat_box(second, n) for n in range(FRAMES))
    bad = cvat_box(first, 0) + cvat_box(first, 1, xbr=0) + cvat_box(first, 2, ytl="nan") + '<polygon frame="3"/>'
    # What is outside needs no box.
    bad += cvat_box(first, 4, outside=1, xtl="nan")
    path = cvat_file(
        tmp_path, f'<track id="2" label="person">{good}</track>', f'<track id="1" label="person">{bad}</track>',
        '<track id="x" label="person"><box frame="0"/></track>', '<track id="3" label="person"/>',
    )  # fmt: skip
    with pytest.warns(InputWarning) as said:
        truth = open_labelled(path)[0].people()
    assert truth.frames[truth.ids == 1].tolist() == [0, 1, 2, 3]
    assert np.isfinite(truth.boxes).all()
    assert (truth.ids == 2).sum() == FRAMES
    (line,) = [str(line.message) for line in said]
    assert "5 of 19 key frames are left out: 1 without an area (frame 1 of track 1), 1 without a finite number" in line
    assert "1 of the shape polygon, which is no box (frame 3 of track 1), 1 without a whole number as id" in line
    with pytest.raises(RequestError, match="expected an id of each track, got '2' twice"):
        open_labelled(cvat_file(tmp_path, *[f'<track id="2">{good}</track>'] * 2))


def image_xml(number: object, name: str, *shapes: str) -> str:
    return f'<image id="{number}" name="{name}" width="200" height="100">{"".join(shapes)}</image>'


def test_cvats_images_are_frames_by_their_ids(tmp_path: Path) -> None:
    track = tracks()[0]
    images = [image_xml(n, f"{n}.png", cvat_box(track, n)) for n in (9, 4, 1)]
    (video,) = open_labelled(cvat_file(tmp_path, *images))
    truth = video.people(single=True)
    assert truth.frames.tolist() == [1, 4, 9]
    np.testing.assert_allclose(truth.boxes, track.boxes[[1, 4, 9]])
    for n in (9, 4, 1):
        picture(tmp_path / "images" / f"{n}.png")
    assert [(sample.picture.name, sample.frame) for sample in labelled_images(tmp_path)] == [
        ("1.png", 1),
        ("4.png", 4),
        ("9.png", 9),
    ]
    picture(tmp_path / "images" / "4.png", (64, 64))
    with pytest.warns(InputWarning, match=r"4\.png of 64x64 for 200x100"):
        assert [sample.frame for sample in labelled_images(tmp_path)] == [1, 9]


def test_cvats_images_without_a_number_are_refused_and_other_shapes_counted(tmp_path: Path) -> None:
    track = tracks()[0]
    with pytest.raises(RequestError, match="expected the number of a frame as id of an image, got 'x'"):
        open_labelled(cvat_file(tmp_path, image_xml("x", "1.png", cvat_box(track, 0))))
    images = (
        image_xml(0, "0.png", cvat_box(track, 0), "<points/>"),
        image_xml(1, "1.png", cvat_box(track, 1, rotation=90)),
    )
    with pytest.warns(InputWarning) as said:
        truth = open_labelled(cvat_file(tmp_path, *images))[0].people(single=True)
    assert "1 of the shape points, which is no box (in image 0.png)" in str(said[0].message)
    np.testing.assert_allclose(truth.boxes[1, 2:] - truth.boxes[1, :2], [20, 8])


def mot_folder(folder: Path, names: str | None, numbers: tuple[int, int] = (2, 1)) -> Path:
    """The first in one class, the second in another."""
    (folder / "S" / "gt").mkdir(parents=True, exist_ok=True)
    rows = [
        f"{n + 1},{t.id},{x + 1},{y + 1},{x2 - x},{y2 - y},1,{kind},1"
        for t, kind in zip(tracks(), numbers, strict=True)
        for n, (x, y, x2, y2) in enumerate(t.boxes.tolist())
    ]
    (folder / "S" / "gt" / "gt.txt").write_text("\n".join(rows))
    if names is not None:
        (folder / "S" / "gt" / "labels.txt").write_text(names)
    return folder / "S"


def test_cvats_export_as_mot_names_its_classes_in_labels_txt(tmp_path: Path) -> None:
    first, second = tracks()
    folder = mot_folder(tmp_path / "a", "car\nperson\n")
    for place in (folder, folder / "gt" / "gt.txt"):
        assert evaluate_people(place, [first]).hota == 1
        assert evaluate_people(place, [second], classes=["car"])["car"].hota == 1
    # The numbers of MOTChallenge without it: 2 is a person on a vehicle, on whom a result is neither right nor wrong.
    assert evaluate_people(mot_folder(tmp_path / "b", None), [first, second]).hota == 1
    # As datumaro writes MOTChallenge's own names.
    folder = mot_folder(tmp_path / "c", "static_person\npedestrian\ncar", (2, 1))
    truth = open_labelled(folder)[0].people()
    assert (set(truth.ids[truth.evaluated].tolist()), set(truth.ids[truth.ignored].tolist())) == ({1}, {2})
    # All count where no class is of people.
    assert evaluate_people(mot_folder(tmp_path / "d", "fly\nbee\n"), [first, second]).hota == 1
    with pytest.raises(RequestError, match=r"1 car, 2 person\), got bus"):
        evaluate_people(mot_folder(tmp_path / "e", "car\nperson\n"), [first], classes=["bus"])


def yolo_folder(folder: Path, **files: str) -> Path:
    """The first as class 0, the second as class 1, in shares of a picture."""
    (folder / "labels").mkdir(parents=True)
    for n in range(FRAMES):
        rows = []
        for kind, track in enumerate(tracks()):
            x, y, x2, y2 = track.boxes[n] / np.tile(SIZE, 2)
            rows.append(f"{kind} {(x + x2) / 2} {(y + y2) / 2} {x2 - x} {y2 - y} 1.0 {track.id}\n")
        (folder / "labels" / f"a_{n + 1}.txt").write_text("".join(rows))
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_dot_", ".")
        path.write_text(text)
    return folder


SIDES = f"width: {SIZE[0]}\nheight: {SIZE[1]}\n"


@pytest.mark.parametrize(
    "files",
    [
        {"data_dot_yaml": f"{SIDES}names: [car, person]\n"},
        {"data_dot_yaml": f"{SIDES}names: {{'0': car, '1': person}}\n"},
        {"data_dot_yaml": SIDES, "classes_dot_txt": "car\nperson\n"},
        {"data_dot_yaml": SIDES, "labels__classes_dot_txt": "car\r\nperson\r\n"},
        {"data_dot_yaml": SIDES, "obj_dot_names": "car\nperson"},
    ],
)
def test_yolos_classes_are_named_in_any_of_its_files(files: dict[str, str], tmp_path: Path) -> None:
    truth = open_labelled(yolo_folder(tmp_path / "y", **files))[0].people()
    assert set(truth.ids[truth.evaluated].tolist()) == {2}


def test_yolos_classes_without_a_name_are_said(tmp_path: Path) -> None:
    folder = yolo_folder(tmp_path / "y", data_dot_yaml=SIDES)
    with pytest.warns(InputWarning, match=r"no data.yaml or classes.txt names the classes 0, 1; they are called by"):
        assert set(open_labelled(folder)[0].people().ids.tolist()) == {1, 2}
    folder = yolo_folder(tmp_path / "z", data_dot_yaml=f"{SIDES}names: [person]\n")
    with pytest.warns(InputWarning, match=r"names the classes 1; they"):
        truth = open_labelled(folder)[0].people()
    assert set(truth.ids[truth.evaluated].tolist()) == {1}


def test_a_sequence_whose_pictures_are_of_another_size_than_it_says_goes_by_them(tmp_path: Path) -> None:
    folder = mot_folder(tmp_path, None)
    (folder / "seqinfo.ini").write_text(f"[Sequence]\nimWidth=1920\nimHeight=1080\nseqLength={FRAMES}\n")
    for n in range(FRAMES):
        picture(folder / "img1" / f"{n + 1:06}.png")
    with pytest.warns(
        InputWarning, match=r"seqinfo.ini says pictures of 1920x1080, but 000001.png has 200x100, which c"
    ):
        (video,) = open_labelled(folder)
    assert video.size == SIZE
    (folder / "seqinfo.ini").write_text(f"[Sequence]\nimWidth=200\nimHeight=100\nseqLength={FRAMES}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert open_labelled(folder)[0].size == SIZE


def test_boxes_of_larger_pictures_than_those_beside_them_are_refused(tmp_path: Path) -> None:
    (tmp_path / "annotations").mkdir()
    rows = "".join(f"{n + 1},1,{300 + n},150,40,40,1,1,0,0\n" for n in range(4))
    (tmp_path / "annotations" / "a.txt").write_text(rows)
    for n in range(4):
        picture(tmp_path / "sequences" / "a" / f"{n + 1:07}.jpg")
    with pytest.raises(RequestError, match="expected boxes in the picture of 200x100, got all 4 outside of it"):
        open_labelled(tmp_path)[0].people()
