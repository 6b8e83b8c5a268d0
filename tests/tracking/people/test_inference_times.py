"""Frames that nobody looked at, and times: what is no miss, and how filters step."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.people.families import LIFECYCLE
from tsuiseki.tracking.association.inference_times import inferred_frames, named_frames
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion, per_longer_frame, predict_boxes, start_boxes, update_boxes
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.tracking.people.api import follow_people, track_people
from tsuiseki.tracking.people.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.people.opening import open_people
from tsuiseki.tracking.people.people_result import people_result
from tsuiseki.tracking.people.settings import Linking, PeopleFinding
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import open_source

CLASSES = [*LIFECYCLE.values()]
METHODS = ["flow", *LIFECYCLE]


def at(time: float, people: int = 3) -> Detections:
    """People of 40 x 100 pixels who walk 40 pixels a second, one below the other."""
    left = 20 + 40.0 * time + 30 * np.arange(people)
    top = 120.0 * np.arange(people)
    return Detections(np.stack([left, top, left + 40, top + 100], axis=1), np.full(people, 0.9))


def counts(frames: list[int], length: int, each: int = 2) -> np.ndarray:
    found = np.zeros(length, dtype=np.int64)
    found[frames] = each
    return found


def video(tmp_path: Path, frames: int, looks: list[int]) -> tuple[Path, Path]:
    folder = tmp_path / "s"
    (folder / "det").mkdir(parents=True)
    (folder / "seqinfo.ini").write_text(
        f"[Sequence]\nname=s\nframeRate=25\nseqLength={frames}\nimWidth=640\nimHeight=480\n"
    )
    rows = [(t + 1, *box) for t in looks for box in at(t / 25).boxes.tolist()]
    text = "".join(f"{t},-1,{x + 1},{y + 1},{x2 - x},{y2 - y},0.9,-1,-1,-1\n" for t, x, y, x2, y2 in rows)
    (folder / "det" / "det.txt").write_text(text)
    return folder, folder / "det" / "det.txt"


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ([*range(0, 100, 10)], [*range(0, 100, 10)]),
        ([3, 13, 33, 43, 53, 73, 83], [*range(3, 100, 10)]),  # looked at, nobody there
        ([0, 9, 20, 31, 39, 50, 61, 69, 80, 91], [0, 9, 20, 31, 39, 50, 61, 69, 80, 91]),
        ([0, 10, 20, 30], None),  # too few to tell
        ([5, 6, 20, 21, 40, 60, 61, 62, 80], None),  # somebody comes and goes
        ([0, 40, 60, 61, 90, 95], None),
        ([*range(100)], None),
    ],
)
def test_a_stride_is_told_from_misses(frames: list[int], expected: list[int] | None) -> None:
    looked = inferred_frames(counts(frames, 100))
    assert expected == (None if looked is None else np.flatnonzero(looked).tolist())


def test_a_crowd_is_not_missed_as_a_whole() -> None:
    kept = np.sort(np.random.default_rng(0).choice(200, 100, replace=False))
    looked = inferred_frames(counts(kept.tolist(), 200, each=6))
    assert looked is not None
    assert set(np.flatnonzero(looked)) - set(kept) <= {*range(kept[0]), *range(kept[-1], 200)}
    assert inferred_frames(counts(kept.tolist(), 200, each=1)) is None


@pytest.mark.parametrize("given", [10, "every", [], [-1, 3], [0.5], [[1, 2]], None])
def test_looks_are_numbers_of_frames(given: object) -> None:
    with pytest.raises(RequestError, match="inference_frames"):
        named_frames(given)  # type: ignore[arg-type]


def test_a_range_may_be_longer_than_memory() -> None:
    without_end = named_frames(range(3, 10**15, 5))
    assert [n for n in range(20) if without_end.at(n)] == [3, 8, 13, 18]
    assert without_end.stride == named_frames([18, 3, 8, 13, 8]).stride == 5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("jitter", [0, 3])
def test_every_tenth_frame_is_enough(tmp_path: Path, method: str, jitter: int) -> None:
    rng = np.random.default_rng(1)
    looks = [t + int(rng.integers(-jitter, jitter + 1)) for t in range(5, 295, 10)]
    source, file = video(tmp_path, 300, looks)
    with pytest.warns(InputWarning, match="without inference"):
        tracks = track_people(source, method, detections=file)  # type: ignore[arg-type]
    assert len(tracks) == 3
    for track in tracks:
        assert set(looks) >= set(track.frames[track.observed].tolist())
        assert len(set(looks) - set(track.frames.tolist())) <= (0 if method == "flow" else 1)
        truth = np.array([at(t / 25).boxes[track.id - 1] for t in track.frames])
        assert np.abs(track.boxes - truth).max() < 4
    assert method != "flow" or all(np.diff(track.frames).max() == 1 for track in tracks)


@pytest.mark.parametrize("method", METHODS)
def test_a_stride_gives_what_the_slow_video_gives(tmp_path: Path, method: str) -> None:
    source, file = video(tmp_path, 300, [*range(0, 300, 10)])
    looked = track_people(source, method, detections=file, inference_frames=range(0, 300, 10))  # type: ignore[arg-type]
    slow = tmp_path / "slow"
    slow.mkdir()
    write_sequence_info(slow, "s", 2.5, 30, 640, 480)
    given = [at(t / 25) for t in range(0, 300, 10)]
    tracks = track_people(slow, method, detections=given)  # type: ignore[arg-type]
    assert len(tracks) == len(looked) == 3
    for one, other in zip(looked, tracks, strict=True):
        every = np.isin(one.frames, 10 * other.frames)
        np.testing.assert_array_equal(one.frames[every], 10 * other.frames)
        np.testing.assert_allclose(one.boxes[every], other.boxes, atol=1e-6)


def test_inference_frames_need_detections(tmp_path: Path) -> None:
    source, file = video(tmp_path, 300, [*range(0, 300, 10)])
    for given in (10, "1-5", [0.5]):
        with pytest.raises(RequestError, match="inference_frames"):
            track_people(source, "sort", detections=file, inference_frames=given)  # type: ignore[arg-type]


@pytest.mark.parametrize("start", [1000, 1.8e9], ids=["1000", "since 1970"])
@pytest.mark.parametrize("make", CLASSES)
def test_even_times_change_nothing_at_any_rate(make: Callable[[], Sort], start: float) -> None:
    plain, timed = make(), make()
    for t in range(40):
        found = at(t / 10).select(np.arange(3) != t % 7)
        plain.update(found)
        timed.update(found, time=start + t / 30)
    for one, other in zip(plain.tracks(), timed.tracks(), strict=True):
        np.testing.assert_array_equal(one.frames, other.frames)
        np.testing.assert_allclose(one.boxes, other.boxes, atol=1e-9 if start < 1e6 else 1e-3)


@pytest.mark.parametrize("make", [*CLASSES, lambda: FlowTracker(frame_rate=10)])
def test_who_walks_is_followed_through_uneven_times(make: Callable[[], Sort]) -> None:
    """At 30 a second, then two seconds of every third, then with gaps of up to half a second."""
    rng, tracker = np.random.default_rng(2), make()
    times = np.cumsum(np.concatenate([np.full(30, 1 / 30), np.full(20, 0.1), rng.uniform(0.03, 0.5, 20)]))
    for time in times:
        tracker.update(at(float(time)), time=float(time))
    tracks = tracker.tracks()
    assert [len(track) for track in tracks] == [70] * 3
    for track in tracks:
        truth = np.array([at(float(time)).boxes[track.id - 1] for time in times])
        assert np.abs(track.boxes - truth)[5:].max() < 3


def test_gaps_are_filled_by_time() -> None:
    """Half a second between the third look and the fourth, who is missed in both."""
    tracker = FlowTracker(FlowSettings(smoothing=False), frame_rate=10.0)
    times = [0.0, 0.1, 0.2, 0.3, 0.8, 0.9, 1.0, 1.1]
    for look, time in enumerate(times):
        tracker.update(at(time).select(np.full(3, look not in (3, 4))), time=time)
    for track in tracker.tracks():
        truth = np.array([at(time).boxes[track.id - 1] for time in times])
        np.testing.assert_allclose(track.boxes, truth, atol=1e-6)


@pytest.mark.parametrize("make", [*CLASSES, FlowTracker, lambda: FlowTracker(delay=1.0)])
@pytest.mark.parametrize("bad", ["0.5", float("nan"), float("inf"), True, [1.0], 0.2])
def test_bad_times_are_refused(make: Callable[[], Sort], bad: object) -> None:
    tracker = make()
    tracker.update(at(0.0), time=0.5)
    with pytest.raises(RequestError, match="time"):
        tracker.update(at(0.1), time=bad)  # type: ignore[arg-type]
    with pytest.raises(RequestError, match="with every frame or with none"):
        tracker.update(at(0.1))
    tracker.update(at(0.1), time=0.5)


@pytest.mark.parametrize("make", CLASSES)
def test_in_a_frame_that_nobody_looked_at_people_are_expected(make: Callable[[], Sort]) -> None:
    tracker = make()
    for t in range(0, 60, 2):
        tracker.update(at(t / 25))
        here = tracker.skip()
    assert here.frame == 59
    assert set(here.status) == {"searching"}
    assert not here.scores.any()
    assert np.abs(here.boxes - at(59 / 25).boxes).max() < 2


@pytest.mark.parametrize("method", ["sort", "flow"])
def test_all_frames_are_followed(tmp_path: Path, method: str) -> None:
    import cv2

    (tmp_path / "img1").mkdir()
    for t in range(60):
        cv2.imwrite(str(tmp_path / "img1" / f"{t + 1:06}.png"), np.zeros((48, 64, 3), np.uint8))
    found = [at(t / 25) if t % 5 == 0 else Detections.empty() for t in range(60)]
    options = {"appearance": "none", "delay": 1.0} if method == "flow" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        answers = [*follow_people(tmp_path, method, detections=found, **options)]  # type: ignore[arg-type]
    assert [frame.index for frame, _ in answers] == [here.frame for _, here in answers] == [*range(60)]
    assert len(answers[42][1]) == len(answers[45][1]) == 3


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("method", METHODS)
def test_a_detector_on_every_fifth_frame_gives_what_its_detections_give(method: str, workers: int) -> None:
    pictures = [np.full((480, 640, 3), t, dtype=np.uint8) for t in range(60)]
    searched = list[int]()

    def detect(picture: np.ndarray) -> Detections:
        searched.append(int(picture[0, 0, 0]))
        return at(searched[-1] / 25)

    looks = {"appearance": "none"} if method in ("flow", "deepsort") else {}
    common = {"method": method, "frames": "4-60", "frame_rate": 25.0, "threads": workers, **looks}
    tracked = track_people(pictures, detector=detect, inference_frames=range(3, 60, 5), **common)  # type: ignore[call-overload,arg-type]
    assert searched == [*range(3, 60, 5)]
    rows = [at(t / 25) if t in searched else Detections.empty() for t in range(60)]
    given = track_people(pictures, detections=rows, inference_frames=range(3, 60, 5), **common)  # type: ignore[call-overload,arg-type]
    source = open_source(pictures, parse_frames("4-60"), 25.0)
    every = PeopleFinding(detector=detect, detect_every=5, threads=workers, **looks)  # type: ignore[arg-type]
    opened = open_people(source, every, Linking(method=method), 0)  # type: ignore[arg-type]
    searched.clear()
    result, _ = people_result(opened, opened.inputs.detections(), StageTimes(), {"method": method})
    assert searched == [*range(3, 60, 5)]
    assert len(tracked) == len(given) == len(result) == 3
    for track, other, third in zip(tracked, given, result, strict=True):
        assert np.array_equal(track.frames, other.frames)
        assert np.array_equal(track.frames, third.frames)
        np.testing.assert_array_equal(track.boxes, other.boxes)
        np.testing.assert_array_equal(track.boxes, third.boxes)


def test_every_nth_frame_is_of_a_detector() -> None:
    with pytest.raises(ValueError, match="`detect_every` with a detector, got it with `detections`"):
        PeopleFinding(detect_every=2, detections="det.txt")
    with pytest.raises(ValueError, match="greater than 0"):
        PeopleFinding(detect_every=0)


def test_two_predictions_are_one_over_both_times() -> None:
    motion = BoxMotion()
    boxes = np.array([[10.0, 20, 50, 120]])
    start = update_boxes(predict_boxes(start_boxes(boxes, motion), motion), boxes + 4, motion)
    one = predict_boxes(start, motion, 5.0)
    other = start
    for _ in range(5):
        other = predict_boxes(other, motion)
    np.testing.assert_allclose(one.boxes, other.boxes)
    np.testing.assert_allclose(one.variance, other.variance, rtol=1e-12)
    # In frames of twice the length it is the same belief.
    there = predict_boxes(per_longer_frame(start, 2.0), BoxMotion(acceleration=0.0), 1.5)
    np.testing.assert_allclose(there.boxes, predict_boxes(start, motion, 3.0).boxes)


@pytest.mark.parametrize(
    ("box", "score", "step", "why"),
    [
        ((40, 100), 0.1, 1, "a track starts from 0.5 on"),
        ((0.01, 0.02), 0.9, 1, "expected pixels"),
        ((40, 100), 0.9, 60, "hardly overlap"),
    ],
)
def test_detections_without_a_track_are_never_silent(
    tmp_path: Path, box: tuple[float, float], score: float, step: float, why: str
) -> None:
    source, _ = video(tmp_path, 30, [0])
    given = [[[step * t, 50, step * t + box[0], 50 + box[1], score]] for t in range(30)]
    with pytest.warns(InputWarning, match=f"30 of 30 detections belong to no track: .*{why}"):
        result = track_people(source, Sort(), detections=given)
    assert len(result) == 0
    assert why in result.facts["detections_without_track"]


def test_boxes_without_scores_start_tracks() -> None:
    for make in CLASSES:
        tracker = make()
        for t in range(10):
            tracker.update(Detections(at(t / 25).boxes, np.full(3, np.nan)))
        assert [len(track) for track in tracker.tracks()] == [10] * 3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("stride", [2, 4, 8, 12, 25])
def test_six_slow_people_on_every_nth_frame(method: str, stride: int, data_folder: Path) -> None:
    folder = data_folder / "cases" / "mot" / "nth" / f"n{stride:02}"
    with pytest.warns(InputWarning, match=f"every {stride}th one"):
        tracks: list[Track] = [*track_people(folder, method, detections=folder / "det" / "det.txt")]  # type: ignore[arg-type]
    assert len(tracks) == 6
