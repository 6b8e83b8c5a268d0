"""Python calls with the wrong kind of thing: one clear line each, or they work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki import (
    ByteTrack,
    ByteTrackSettings,
    Detections,
    Detector,
    Estimate,
    FlowSettings,
    FlowTracker,
    PointSettings,
    PointTracker,
    RequestError,
    Sort,
    SortSettings,
    Targets,
    Track,
    read_tracks,
    shipped,
    track_drone,
    track_people,
    track_sphere,
    write_tracks,
)
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.single.tracker import as_box

IMAGE = np.zeros((120, 160, 3), np.uint8)
ROWS = [[[10.0 + t, 20, 40 + t, 100, 0.9]] for t in range(8)]
NAN = float("nan")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    write_sequence_info(tmp_path, "s", 25, 8, 160, 120)
    return tmp_path


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"frames": 10}, "FIRST-LAST"),
        ({"seed": "a"}, "`seed`: expected a valid integer"),
        ({"seed": 1.5}, "`seed`: expected a valid integer"),
        ({"frames": (1, 40)}, "FIRST-LAST"),
        ({"threads": -1}, "threads"),
        ({"threads": "a"}, "threads"),
        ({"score_threshold": NAN}, "score_threshold"),
        ({"detections": 5}, "`detections`: expected a file, or boxes of each frame, got int"),
        ({"detections": {0: ROWS[0]}}, "expected a file, or boxes of each frame, got dict"),
        ({"view": 0}, "view"),
        ({"detections": None}, "no images"),
        ({"method": Sort}, "a tracker"),
        ({"method": SortSettings()}, "or a tracker, got SortSettings"),
    ],
)
def test_wrong_keywords_are_refused(source: Path, keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        track_people(source, **{"method": "sort", "detections": ROWS, **keywords})


def test_an_unknown_keyword_is_a_type_error_as_everywhere_in_python(source: Path) -> None:
    more: dict[str, Any] = {"thread": 1}
    with pytest.raises(TypeError, match="thread"):
        track_people(source, "sort", detections=ROWS, **more)


@pytest.mark.parametrize("wrong", [IMAGE, ["a.png"], None, 1.5])
def test_what_is_no_source_is_refused(wrong: Any) -> None:
    with pytest.raises(RequestError, match="expected a video file"):
        track_people(wrong, "sort", detections=ROWS)


def test_detections_may_come_from_a_generator_and_the_view_is_a_number_too(source: Path) -> None:
    assert [len(track) for track in track_people(source, "sort", detections=(row for row in ROWS), view=1)] == [8]


@pytest.mark.parametrize("images", [IMAGE, ["a.png"], [IMAGE.astype(float)], [IMAGE[..., 0]]])
def test_a_detector_takes_images(images: Any) -> None:
    with pytest.raises(RequestError, match="expected a list of"):
        Detector(shipped("detector_people"), threads=1).detect(images)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Sort(SortSettings(min_iou=NAN)),
        lambda: Sort(min_iou=NAN),
        lambda: Sort(SortSettings(start_score=NAN)),
        lambda: Sort(SortSettings(max_age=NAN)),  # type: ignore[arg-type]
        lambda: ByteTrack(ByteTrackSettings(high_score=NAN)),
        lambda: FlowTracker(FlowSettings(min_time=NAN)),
        lambda: FlowTracker(frame_rate="25"),  # type: ignore[arg-type]
        lambda: FlowTracker(frame_rate=NAN),
    ],
)
def test_settings_are_numbers(make: Callable[[], object]) -> None:
    with pytest.raises((ValueError, TypeError)):
        make()


@pytest.mark.parametrize("wrong", ["1,2,30,40", None, [1, 2, 3], [[1, 2, 3, 4]]])
def test_a_box_is_four_numbers(wrong: Any) -> None:
    with pytest.raises(RequestError, match="four numbers"):
        as_box(wrong)


def track(number: int = 1, x: float = 0.0) -> Track:
    return Track(number, np.array([0, 1]), np.array([[x, 0, 5, 5.0], [1, 0, 6, 5]]), np.array([1.0, 0.5]))


def test_tracks_are_compared_by_value() -> None:
    assert track() == track()
    assert track() != track(2)
    assert track() != track(x=0.5)
    assert track() in [track(2), track()]
    assert track() != "track"
    boxes = np.array([[0.0, 0, 1, 1]])
    assert Detections(boxes, np.ones(1)) == Detections(boxes.copy(), np.ones(1))
    assert Detections(boxes, np.ones(1)) != Detections(boxes, np.ones(1), features=np.ones((1, 2)))
    assert Targets.empty(3) == Targets.empty(3) != Targets.empty(4)
    assert Estimate(0, boxes[0], 1.0, "lost") == Estimate(0, boxes[0], 1.0, "lost")


def test_tracks_are_written_as_text_only(tmp_path: Path) -> None:
    write_tracks(tmp_path / "new" / "folder" / "tracks.txt", [track()])
    assert len(read_tracks(tmp_path / "new" / "folder" / "tracks.txt")) == 1
    for name in ("t.json", "t.csv", "t.parquet"):
        with pytest.raises(RequestError, match="text file"):
            write_tracks(tmp_path / name, [track()])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sort(5), "`settings`: expected SortSettings, got int"),  # type: ignore[arg-type]
        (lambda: FlowTracker(5), "`settings`: expected FlowSettings, got int"),  # type: ignore[arg-type]
        (lambda: PointTracker(PointSettings(), (NAN, 1)), "`extent`: expected width and height"),
        (lambda: track_drone(".", method="x"), "`method`: expected flow, flow-saf or"),  # type: ignore[arg-type]
        (lambda: read_tracks(5), "`path`: expected a path, got int"),  # type: ignore[arg-type]
        (lambda: Detector(None), "`path`: expected a path, got NoneType"),  # type: ignore[arg-type]
        (lambda: Detector(shipped("detector_street"), threads=-1), "`threads`: expected 0 or more, got -1"),
        (
            lambda: Detector(shipped("detector_street"), score_threshold=NAN),
            "expected a threshold in .0, 1., got nan",
        ),
        (lambda: track_sphere([], 5, 0.1), "`cameras`: expected a path, got int"),  # type: ignore[arg-type]
    ],
)
def test_wrong_arguments_are_refused_by_name(call: Callable[[], object], message: str) -> None:
    with pytest.raises(RequestError, match=message):
        call()
