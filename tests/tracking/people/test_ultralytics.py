"""Results of Ultralytics go into a tracker as they are; classes of the shape of its own stand in for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.sort import DeepSort, Sort

SHAPE = (480, 640)
NAMES = {0: "person", 2: "car"}


class Tensor:
    """On an accelerator: no array before it was brought to the memory."""

    def __init__(self, values: Any, where: str = "cuda") -> None:
        self.values, self.where = np.asarray(values, np.float32), where

    @property
    def shape(self) -> tuple[int, ...]:
        return self.values.shape

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, key: Any) -> Tensor:
        return Tensor(self.values[key], self.where)

    def cpu(self) -> Tensor:
        return Tensor(self.values, "cpu")

    def numpy(self) -> Any:
        if self.where != "cpu":
            raise TypeError("can't convert cuda:0 device type tensor to numpy")
        return self.values


class Boxes:
    """Rows x1, y1, x2, y2, confidence, class; with an identity before the confidence where they are tracked."""

    def __init__(self, data: Any) -> None:
        self.data, self.orig_shape = Tensor(np.reshape(data, (-1, np.shape(data)[-1])), "cuda"), SHAPE

    def __len__(self) -> int:
        return len(self.data)

    def __getitem__(self, key: Any) -> Boxes:
        return Boxes(self.data.values[key])

    @property
    def xyxy(self) -> Tensor:
        return self.data[:, :4]

    @property
    def conf(self) -> Tensor:
        return self.data[:, -2]

    @property
    def cls(self) -> Tensor:
        return self.data[:, -1]

    @property
    def id(self) -> Tensor | None:
        return self.data[:, 4] if self.data.shape[1] == 7 else None

    @property
    def xywh(self) -> Tensor:
        corners = self.xyxy.values
        return Tensor(np.hstack([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]]))


class Results:
    """Of one image; its length is that of what it holds, and an index chooses rows."""

    def __init__(self, boxes: Boxes | None = None, obb: Boxes | None = None, keypoints: Any = None) -> None:
        self.orig_img, self.orig_shape = np.zeros((*SHAPE, 3), np.uint8), SHAPE
        self.boxes, self.obb, self.masks, self.probs, self.keypoints = boxes, obb, None, None, keypoints
        self.names, self.path, self.speed = NAMES, "image0.jpg", {"inference": 1.0}

    def __len__(self) -> int:
        return next((len(part) for part in (self.boxes, self.obb) if part is not None), 0)

    def __getitem__(self, key: Any) -> Results:
        return Results(*(None if part is None else part[key] for part in (self.boxes, self.obb)))


def rows(frame: int, identity: bool = False) -> np.ndarray:
    """Two people who walk, and a car."""
    boxes = np.array([[10, 20, 50, 120], [200, 30, 240, 130], [400, 300, 500, 360.0]]) + 3 * frame
    columns = [boxes, [[7], [8], [9]]] if identity else [boxes]
    return np.hstack([*columns, [[0.95], [0.9], [0.85]], [[0], [0], [2]]])


FORMS = {
    "results": lambda frame: Results(Boxes(rows(frame))),
    "the list of an image": lambda frame: [Results(Boxes(rows(frame)))],
    "boxes": lambda frame: Boxes(rows(frame)),
    "tracked": lambda frame: Results(Boxes(rows(frame, identity=True))),
    "pose": lambda frame: Results(Boxes(rows(frame)), keypoints=np.zeros((3, 17, 3))),
    "turned": lambda frame: Results(obb=Boxes(rows(frame))),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("make", [Sort, DeepSort, ByteTrack, OcSort, FlowTracker])
def test_results_are_tracked_as_their_boxes_are(make: Any, form: str) -> None:
    plain, tracker = make(), make()
    for frame in range(12):
        expected, targets = plain.update(rows(frame)), tracker.update(FORMS[form](frame))
        if expected is not None:
            np.testing.assert_array_equal(targets.ids, expected.ids)
            np.testing.assert_allclose(targets.boxes, expected.boxes, atol=1e-4)
    tracks = tracker.tracks()
    assert [len(track) for track in tracks] == [12, 12, 12]
    for track, expected in zip(tracks, plain.tracks(), strict=True):
        np.testing.assert_allclose(track.boxes, expected.boxes, atol=1e-4)


def test_results_without_a_box_are_no_detections() -> None:
    tracker = Sort()
    for frame in range(5):
        tracker.update(Results(Boxes(rows(frame))))
    tracker.update(Results(Boxes(np.zeros((0, 6)))))
    assert len(tracker.tracks()) == 3


def test_classes_and_their_names_come_along() -> None:
    from tsuiseki.tracking.interchange import as_detections

    detections = as_detections(Results(Boxes(rows(0))))
    assert (detections.classes.tolist(), detections.names) == ([0, 0, 2], NAMES)  # type: ignore[union-attr]


def test_results_of_several_images_or_without_boxes_are_refused_in_a_line() -> None:
    with pytest.raises(RequestError, match=r"got the results of 2 images; give those of an image at a time$"):
        Sort().update([Results(Boxes(rows(0))), Results(Boxes(rows(1)))])
    with pytest.raises(RequestError, match=r"; got Results$"):
        Sort().update(Results())
