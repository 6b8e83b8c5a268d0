"""Class and row of the source detection, from the detections to targets, tracks and files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from tests.tracking.people.families import LIFECYCLE
from tsuiseki.tracking.counts.page import with_page
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import as_detector
from tsuiseki.tracking.formats.mot import read_tracks
from tsuiseki.tracking.people.api import follow_people, track_people
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.people.tracker_choice import people_tracker
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.class_choice import ClassChoice

NAMES = {0: "person", 2: "car", 7: "truck"}
METHODS: dict[str, Callable[[], PeopleTracker]] = {
    **{method: partial(people_tracker, method) for method in LIFECYCLE},
    "flow": lambda: FlowTracker(frame_rate=10.0),
    "delayed": lambda: FlowTracker(frame_rate=10.0, delay=0.5),
}


def street(length: int = 24) -> list[Detections]:
    """A car that every fourth frame calls a truck, missed in frame 12, and a person, in any order; then clutter."""
    rng, video = np.random.default_rng(0), []
    for t in range(length):
        rows = [(7 if t % 4 == 1 else 2, 6.0 * t, 80.0), (0, 300 - 3.0 * t, 30.0)][int(t == 12) :]
        rows += [(-1, float(rng.integers(400, 900)), 10.0)]
        rows = [rows[k] for k in rng.permutation(len(rows))]
        boxes = np.array([[x, 10, x + width, 90] for _, x, width in rows])
        scores = np.where(boxes[:, 0] < 400, 0.9, 0.2)
        video.append(Detections(boxes, scores, classes=np.array([row[0] for row in rows]), names=NAMES))
    return video


@pytest.mark.parametrize("method", METHODS)
def test_a_class_that_flickers_ends_no_track(method: str) -> None:
    video, tracker = street(), METHODS[method]()
    answers = [tracker.update(found) for found in video]
    tracks = {track.class_name: track for track in tracker.tracks()}
    assert tracks.keys() == {"car", "person"}
    for name, track in tracks.items():
        assert len(track) >= 23
        assert (track.detection >= 0).tolist() == track.observed.tolist()
        for frame, row, kind, box in zip(track.frames, track.detection, track.classes, track.boxes, strict=True):
            assert kind == (video[frame].classes[row] if row >= 0 else -1)
            if row >= 0:
                assert np.abs(video[frame].boxes[row] - box).max() < 12
        assert set(track.classes.tolist()) - {-1} == ({2, 7} if name == "car" else {0})
    told = [people for people in answers if people is not None and len(people) == 2]
    assert len(told) > (-1 if method == "flow" else 10)
    for people in told:
        # The vote is of the detections so far: a car from its third one on.
        assert {target.class_name for target in people} == {"car", "person"}
        for target in people:
            assert (target.detection >= 0) == (target.status == "tracking")
            if target.detection >= 0:
                found = video[people.frame]
                assert np.abs(found.boxes[target.detection] - target.box).max() < 12


def test_boxes_that_are_left_out_shift_no_row() -> None:
    tracker = Sort()
    for t in range(4):
        with pytest.warns(InputWarning, match="is left out") if t == 0 else np.errstate():
            people = tracker.update([[5.0, 5, 5, 9, 0.9, 2], [t, 0, t + 20, 50, 0.9, 2], [90, 0, 99, 30, 0.9, 2]])
    assert people.detection.tolist() == [1, 2]


@pytest.fixture
def given(text_sequence: str) -> dict[str, Any]:
    return {"source": text_sequence, "method": "sort", "detections": street()}


@pytest.fixture
def text_sequence(tmp_path: Any) -> str:
    (tmp_path / "clip" / "gt").mkdir(parents=True)
    (tmp_path / "clip" / "gt" / "gt.txt").write_text("1,1,1,1,40,100,1,-1,-1,-1\n")
    return str(tmp_path / "clip")


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("wanted", [["person", "CAR", "truck"], [0, 2, 7], ["0", 2, "Truck"]])
def test_classes_apart_or_together(given: dict[str, Any], wanted: list[Any], tmp_path: Any) -> None:
    apart = track_people(**given, classes=wanted)
    assert {track.class_name for track in apart} == {"person", "car"}  # a truck is never there three times in a row
    assert max(len(track) for track in apart if track.class_name == "car") < 20
    together = track_people(**given, classes=wanted, across_classes=True)
    assert {track.class_name for track in together} == {"person", "car"}
    written = read_tracks(with_page(together).save(tmp_path / "out") / "tracks.txt")
    assert [track.class_name for track in written] == [track.class_name for track in together]
    assert "car 1" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_tracker_of_ones_own_is_copied_for_each_class(given: dict[str, Any]) -> None:
    tracks = track_people(**{**given, "method": FlowTracker(frame_rate=10.0)}, classes=[0, 2])
    assert sorted(track.class_id for track in tracks) == [0, 2]


@pytest.mark.parametrize(
    ("wanted", "line"),
    [
        (["dog"], "expected classes of `detections` \\(0 person, 2 car, 7 truck\\), got dog"),
        ([3], "expected classes of `detections` \\(0 person, 2 car, 7 truck\\), got 3"),
        (["car", "Car "], "expected each class once, got car twice"),
        (["car", 2], "expected each class once, got 2 by number and by name"),
        ([], "expected a list of numbers or names"),
    ],
)
def test_wrong_classes(given: dict[str, Any], wanted: Any, line: str) -> None:
    with pytest.raises(RequestError, match=line):
        track_people(**given, classes=wanted)


def test_classes_need_detections_that_have_some(given: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match="expected classes with the boxes of `detections`, got boxes without"):
        track_people(**{**given, "detections": [[[0, 0, 9, 9, 0.9]]] * 3}, classes=[1])
    with pytest.raises(RequestError, match="expected `across_classes` with `classes`"):
        track_people(**given, across_classes=True)


class Boxes:
    """As supervision holds them, with names of what is there."""

    def __init__(self, *numbers: int) -> None:
        self.xyxy = np.array([[10.0 * n, 0, 10 * n + 9, 20] for n in numbers]).reshape(-1, 4)
        self.confidence, self.class_id = np.full(len(numbers), 0.9), np.array(numbers)
        self.data = {"class_name": np.array([NAMES[n] for n in numbers])}


def test_functions_give_classes() -> None:
    image = np.zeros((40, 90, 3), np.uint8)
    detect = as_detector(lambda _: Boxes(7, 0), classes=ClassChoice(["car", "truck"]))
    (found,) = detect.detect([image])
    assert (found.origin.tolist(), found.names[7]) == ([[0, 7]], "truck")
    plain = as_detector(lambda _: [[0, 0, 9, 9, 0.9, 2]], classes=ClassChoice(["car"]))
    with pytest.raises(RequestError, match=r"expected classes of the detector \(2\), got car; it names none"):
        plain.detect([image])
    bare = as_detector(lambda _: [[0, 0, 9, 9, 0.9]], classes=ClassChoice([0]))
    with pytest.raises(RequestError, match="expected classes of the detector, got boxes without"):
        bare.detect([image])


def test_the_users_own_data_find_their_box(detected_folder: str) -> None:
    masks = []

    def detect(_: np.ndarray) -> list[list[float]]:
        masks.append(["tree", "walker"])
        return [[50, 5, 55, 30, 0.1, 3], [2 * len(masks), 5, 2 * len(masks) + 20, 45, 0.9, 0]]

    for frame, people in follow_people(detected_folder, "sort", detector=detect, classes=[0]):
        for target in people:
            assert masks[frame.index][target.detection] == "walker"
    assert [target.class_id for target in people] == [0]


@pytest.fixture
def detected_folder(tmp_path: Any) -> str:
    from PIL import Image

    for n in range(6):
        Image.fromarray(np.full((60, 90, 3), 10 * n, np.uint8)).save(tmp_path / f"{n}.png")
    return str(tmp_path)
