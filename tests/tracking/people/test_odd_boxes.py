"""Boxes that are none, and boxes that are not where the pictures are: left out, refused or reported."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.drone.drone_models import read_given_tracks
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import DeepSort, Sort
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.video.source import open_source

WIDTH, HEIGHT, FRAMES = 320, 240, 12


@pytest.fixture
def video(tmp_path: Path) -> Path:
    folder = tmp_path / "v"
    (folder / "img1").mkdir(parents=True)
    for t in range(FRAMES):
        cv2.imwrite(str(folder / "img1" / f"{t + 1:06}.png"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    write_sequence_info(folder, "v", 10, FRAMES, WIDTH, HEIGHT)
    return folder


def walker(t: int) -> list[list[float]]:
    """Two people, x1, y1, x2, y2, score."""
    return [[100.0 + t, 80, 130 + t, 170, 0.9], [200.0 - t, 90, 240 - t, 200, 0.8]]


def live(rows: Callable[[int], Any]) -> Callable[[Any], Any]:
    """A detector that gives rows by the number of the frame."""
    count = iter(range(1000))
    return lambda _: rows(next(count))


@pytest.mark.parametrize(
    "bad", [[5.0, 5, 5, 40, 0.9], [5.0, 40, 30, 40, 0.9], [np.nan] * 5, [5.0, 5, np.inf, 40, 0.9], [9.0, 9, 5, 5, 0.9]]
)
@pytest.mark.parametrize("alone", [False, True])
def test_a_bad_box_of_a_live_detector_is_left_out(video: Path, bad: list[float], alone: bool) -> None:
    def rows(t: int) -> Any:
        return ([] if alone else walker(t)) + [bad] if t in (4, 7) else walker(t)

    with pytest.warns(InputWarning, match="left out") as told:
        tracks = track_people(video, "sort", detector=live(rows))
    assert len([one for one in told if "left out" in str(one.message)]) == 1
    assert [len(track) for track in tracks] == [FRAMES - 2 * alone] * 2
    assert tracks.facts["bad_boxes"] == 2


@pytest.mark.parametrize("make", [Sort, lambda: FlowTracker(frame_rate=10)])
def test_a_tracker_leaves_one_out_too(make: Callable[[], Sort]) -> None:
    tracker = make()
    for t in range(5):
        tracker.update(walker(t))
    with pytest.warns(InputWarning, match="left out"):
        tracker.update([[5.0, 5, 5, 40, 0.9]])
    for t in range(6, FRAMES):
        tracker.update(walker(t))
    assert len(tracker.tracks()) == 2
    assert tracker.bad.bad == 1


@pytest.mark.parametrize("given", ["entries", "detector"])
def test_bad_boxes_alone_in_the_first_frames_are_counted(video: Path, tmp_path: Path, given: str) -> None:
    with pytest.warns(InputWarning, match="left out"):
        tracks = track_people(
            video, "sort", **source_of(given, lambda t: walker(t) if t > 1 else [[5.0, 5, 5, 9, 0.9]], tmp_path)
        )
    assert len(tracks) == tracks.facts["bad_boxes"] == 2
    assert "bad_boxes" not in track_people(video, "sort", **source_of(given, walker, tmp_path)).facts


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_few_entries_that_are_all_bad_are_refused(video: Path) -> None:
    with pytest.raises(RequestError, match="2 of 2 boxes"):
        track_people(video, "sort", detections=[[[5.0, 5, 5, 9, 0.9]], [], [[5.0, 5, 5, 9, 0.9]]])


def test_mostly_bad_boxes_are_refused(video: Path) -> None:
    for method in ("sort", "flow"):
        with pytest.raises(RequestError, match="x, y, width, height"):
            track_people(video, method, detector=lambda _: [[200.0, 100, 40, 90, 0.9]])  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="x1 < x2"):
        track_people(video, "sort", detector=live(lambda t: walker(t) if t < 2 else [[5.0, 5, 5, 9, 0.9]] * 3))


def shares(t: int) -> Any:
    return (np.array(walker(t)) / [WIDTH, HEIGHT, WIDTH, HEIGHT, 1]).tolist()


def as_corners(t: int) -> Any:
    """x1, y1, x1 + x2, y1 + y2: what corners become where width and height are expected."""
    return [[x, y, x + x2, y + y2, score] for x, y, x2, y2, score in walker(t)[1:]]


def elsewhere(t: int) -> Any:
    return [[x + 2000, y, x2 + 2000, y2, score] for x, y, x2, y2, score in walker(t)[1:]]


@pytest.mark.parametrize("given", ["file", "entries", "detector"])
@pytest.mark.parametrize(
    ("rows", "words"),
    [(as_corners, "fit as corners"), (elsewhere, "outside of it"), (shares, "look like shares of the picture")],
)
def test_boxes_that_do_not_fit_the_pictures_are_refused(
    video: Path, tmp_path: Path, given: str, rows: Callable[[int], Any], words: str
) -> None:
    with pytest.raises(RequestError, match=words):
        track_people(video, "sort", **source_of(given, rows, tmp_path))


def test_boxes_outside_a_video_file_are_refused_before_it_is_read(inputs: Any, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="in the picture of 64x48, got all 1 outside of it"):
        track_people(inputs.video, "sort", detections=[[[2000.0, 5, 2020, 40, 0.9]]])
    tracks = tmp_path / "tracks.txt"
    tracks.write_text("1,1,2000,5,20,35,0.9,-1,-1,-1\n")
    with pytest.raises(RequestError, match="in the picture of 64x48, got all 1 outside of it"):
        read_given_tracks(tracks, open_source(inputs.video))


@pytest.mark.parametrize("given", ["file", "entries", "detector"])
def test_boxes_that_fit_are_not(video: Path, tmp_path: Path, given: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(track_people(video, "sort", **source_of(given, walker, tmp_path))) == 2


def source_of(given: str, rows: Callable[[int], Any], folder: Path) -> Any:
    if given == "detector":
        return {"detector": live(rows)}
    if given == "entries":
        return {"detections": [rows(t) for t in range(FRAMES)]}
    text = "".join(
        f"{t + 1},-1,{x},{y},{x2 - x},{y2 - y},{s},-1,-1,-1\n" for t in range(FRAMES) for x, y, x2, y2, s in rows(t)
    )
    (folder / "det.txt").write_text(text)
    return {"detections": folder / "det.txt"}


def test_a_network_of_shares_where_pixels_are_expected(video: Path, data_folder: Path) -> None:
    with pytest.raises(RequestError, match=r"nms_norm.onnx.* look like shares of the"):
        track_people(video, "sort", detector=data_folder / "cases" / "onnx" / "nms_norm.onnx")


def test_who_sinks_down_faster_than_expected_has_the_detected_box() -> None:
    """The corners of the filter pass each other, and the box that was detected still has an area."""
    tracker, looks = DeepSort(), np.array([[1.0, 0.0]])
    for height in (100, 70, 40, 10, 5):
        detected = np.array([[0.0, 50 - height / 2, 20, 50 + height / 2]])
        people = tracker.update(Detections(detected, np.array([0.9]), looks))
    assert people.status.tolist() == ["tracking"]
    (track,) = tracker.tracks()
    np.testing.assert_array_equal(track.boxes[-1], detected[0])
    np.testing.assert_array_equal(people.boxes, detected)


def test_boxes_smaller_than_a_pixel_stay_as_small_beside_somebody_missed() -> None:
    tracker = Sort()
    boxes = np.array([[0.1, 0.1, 0.2, 0.4], [0.6, 0.1, 0.7, 0.4]])
    for _ in range(4):
        tracker.update(Detections(boxes, np.ones(2)))
    people = tracker.update(Detections(boxes[:1], np.ones(1)))
    assert people.status.tolist() == ["tracking", "searching"]
    np.testing.assert_allclose(people.boxes[0], boxes[0])
