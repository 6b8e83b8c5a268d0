"""`track_people` and `follow_people`: the shipped models, anybody's own, and what cannot be."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks
from tsuiseki.tracking.people.api import follow_people, track_people
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.sort import DeepSort, Sort
from tsuiseki.tracking.types import Detections, Targets, Track
from tsuiseki.tracking.types.tracks import targets_at
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped


def labelled(street: Path) -> list[np.ndarray]:
    """The true boxes of each frame, as a detector's ``(N, 5)``."""
    truth = read_ground_truth(street / "gt" / "gt.txt")
    rows = np.column_stack([truth.boxes, np.full(len(truth.boxes), 0.9)])[truth.evaluated]
    frames = truth.frames[truth.evaluated]
    return [rows[frames == frame] for frame in range(16)]


def same(a: Sequence[Track], b: Sequence[Track]) -> bool:
    return len(a) == len(b) and all(
        x.id == y.id and np.array_equal(x.frames, y.frames) and np.array_equal(x.boxes, y.boxes)
        for x, y in zip(a, b, strict=True)
    )


@pytest.mark.slow
def test_the_command_writes_what_the_function_gives(street: Path, tmp_path: Path) -> None:
    tracks = track_people(street, frames="3-14", threads=1)
    assert (
        main(["track", "people", str(street), "--out", str(tmp_path / "r"), "--frames", "3-14", "--threads", "1"]) == 0
    )
    written = read_tracks(tmp_path / "r" / "tracks.txt")
    assert [t.id for t in tracks] == [t.id for t in written]
    saved = tracks.save(tmp_path / "saved") / "tracks.txt"
    assert saved.read_text() == (tmp_path / "r" / "tracks.txt").read_text()
    for ours, theirs in zip(tracks, written, strict=True):
        np.testing.assert_array_equal(ours.frames, theirs.frames)
        np.testing.assert_allclose(ours.boxes, theirs.boxes, atol=0.02)
    assert min(int(t.frames[0]) for t in tracks) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "more", [("1-16",), ("1-6", "--view", "2"), ("3-9", "--method", "deepsort", "--batch-size", "3")]
)
def test_the_tracks_are_the_same_with_any_number_of_threads(
    street: Path, tmp_path: Path, more: tuple[str, ...]
) -> None:
    """To the last byte: batches are cut and networks run as with one."""
    written = []
    for threads in ("1", "3"):
        out = tmp_path / threads
        words = ["track", "people", str(street), "--out", str(out), "--threads", threads, "--frames", *more]
        assert main(words) == 0
        written.append((out / "tracks.txt").read_bytes())
    assert len(written[0]) > 200
    assert written[0] == written[1]


def following(people: Targets) -> Targets:
    return people.select(people.status == "tracking")


@pytest.mark.slow
def test_each_frame_is_answered_with_its_image(street: Path) -> None:
    given = labelled(street)
    seen = list(follow_people(street, "sort", detections=given))
    assert [frame.index for frame, _ in seen] == list(range(16))
    assert all(people.frame == frame.index for frame, people in seen)
    assert len(seen[-1][1]) >= 2
    tracks = {t.id: t for t in track_people(street, "sort", detections=given)}
    for person in following(seen[-1][1]):
        np.testing.assert_array_equal(person.box, tracks[person.id].boxes[tracks[person.id].frames == 15][0])


@pytest.mark.slow
def test_the_flow_with_a_delay_answers_frame_by_frame(street: Path) -> None:
    """And `track_people` says the same in the end."""
    given = labelled(street)
    seen = list(follow_people(street, "flow", detections=given, delay=0.3, threads=1))
    assert [frame.index for frame, _ in seen] == list(range(16))
    tracks = track_people(street, "flow", detections=given, delay=0.3, threads=1)
    assert tracks
    for frame, people in seen:
        expected = targets_at(tracks, frame.index)
        assert people.ids.tolist() == expected.ids.tolist()
        np.testing.assert_array_equal(people.boxes, expected.boxes)


@pytest.mark.parametrize(("method", "delay", "said"), [("sort", 1.0, "flow"), ("flow", -1.0, "0 seconds")])
def test_a_delay_is_for_the_flow_and_not_below_nothing(street: Path, method: Any, delay: float, said: str) -> None:
    with pytest.raises(RequestError, match=said):
        track_people(street, method, detections=labelled(street), delay=delay)


def test_a_detector_and_an_appearance_are_functions(street: Path) -> None:
    given = iter(labelled(street))
    crops: list[tuple[int, ...]] = []

    def appearance(images: Any) -> list[list[float]]:
        crops.extend(image.shape for image in images)
        return [[float(image.mean()), 1.0] for image in images]

    tracks = track_people(street, "deepsort", detector=lambda _: next(given), appearance=appearance)
    truth = read_ground_truth(street / "gt" / "gt.txt")
    assert evaluate_sequence(truth, tracks, 16).recall > 0.85
    assert len(crops) > 30


def test_a_tracker_with_settings_of_its_own_is_a_method(street: Path) -> None:
    given = labelled(street)
    assert same(track_people(street, Sort(), detections=given), track_people(street, "sort", detections=given))


def test_images_in_a_list_or_as_they_come_are_a_video(street: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images, given = [frame.image for frame in open_source(street).frames()], labelled(street)
    rate = open_source(street).frame_rate
    known = track_people(street, "sort", detections=given)
    from_list = track_people(images, "sort", detections=given, frame_rate=rate, progress=True)
    assert "tracking" in capsys.readouterr().err
    assert same(known, from_list)
    assert same(known, track_people(iter(images), "sort", detections=given))
    assert (from_list.frame_rate, from_list.size) == (rate, known.size)
    assert from_list.settings == {"method": "sort", "source": "images", "seed": 0, "frame_rate": rate}
    followed = list(follow_people((image for image in images), "sort", detections=given, progress=True))
    assert [frame.index for frame, _ in followed] == list(range(16))


@pytest.mark.slow
def test_what_is_read_from_files_is_what_is_given_as_objects(street: Path) -> None:
    detector, affinity = Detector(shipped(PEOPLE_DETECTOR), threads=1), Affinity(shipped("affinity_people"), 1)
    tracks = track_people(street, detector=detector, affinity=affinity, threads=1)
    assert same(tracks, track_people(street, threads=1))


def test_detections_of_a_folder_without_images_are_enough(tmp_path: Path) -> None:
    (tmp_path / "det").mkdir()
    rows = [f"{t},-1,{3 * t},20,30,80,0.9" for t in range(1, 21)]
    (tmp_path / "det" / "det.txt").write_text("\n".join(rows))
    (tmp_path / "seqinfo.ini").write_text("[Sequence]\nname=x\nimDir=img1\nframeRate=25\nseqLength=20\n")
    (track,) = track_people(tmp_path, "sort", detections=tmp_path / "det" / "det.txt")
    assert len(track) == 20


def test_deepsort_without_pictures_says_so_unless_it_shall_do_without(tmp_path: Path) -> None:
    (tmp_path / "det").mkdir()
    rows = [f"{t},-1,{3 * t},20,30,80,0.9" for t in range(1, 21)]
    (tmp_path / "det" / "det.txt").write_text("\n".join(rows))
    (tmp_path / "seqinfo.ini").write_text("[Sequence]\nname=x\nimDir=img1\nframeRate=25\nseqLength=20\n")
    given = tmp_path / "det" / "det.txt"
    said = r"^x has no images, so deepsort compares boxes alone and no appearance; give `appearance` none"
    for method in ("deepsort", DeepSort()):
        with pytest.warns(InputWarning, match=said):
            assert [len(track) for track in track_people(tmp_path, method, detections=given)] == [20]
    warnings.simplefilter("error")
    assert [len(track) for track in track_people(tmp_path, "deepsort", detections=given, appearance="none")] == [20]
    boxes = [np.array([[3.0 + 3 * t, 20, 33 + 3 * t, 100]]) for t in range(20)]
    described = [Detections(box, np.array([0.9]), features=np.array([[1.0, 0]])) for box in boxes]
    assert [len(track) for track in track_people(tmp_path, "deepsort", detections=described)] == [20]


def test_frames_that_wait_for_an_answer_get_it_at_the_end(street: Path) -> None:
    class Late:
        """SORT that answers three frames late."""

        delay = 3

        def __init__(self) -> None:
            self.sort, self.said = Sort(), []

        def update(self, detections: Any) -> Any:
            self.said.append(self.sort.update(detections))
            return self.said.pop(0) if len(self.said) > self.delay else None

        def tracks(self) -> list[Track]:
            return self.sort.tracks()

    given = labelled(street)
    late = list(follow_people(street, Late(), detections=given))  # type: ignore[arg-type]
    now = list(follow_people(street, "sort", detections=given))
    assert [frame.index for frame, _ in late] == [frame.index for frame, _ in now]
    assert any(len(people) for _, people in now)
    for (_, a), (_, b) in zip(late, now, strict=True):
        assert a.frame == b.frame
        seen = following(b)
        np.testing.assert_array_equal(np.sort(following(a).ids), np.sort(seen.ids))


def test_targets_of_a_frame_out_of_tracks() -> None:
    track = Track(4, np.array([2, 3]), np.array([[0, 0, 5, 5], [1, 0, 6, 5.0]]), np.ones(2), np.array([True, False]))
    (target,) = targets_at([track], 3)
    assert (target.id, target.score, target.status) == (4, 0.0, "searching")
    assert len(targets_at([track], 5)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "best"}, "`method`: expected 'flow', 'deepsort', "),
        ({"method": 7}, "expected the method flow, deepsort, .* or a tracker, got 7"),
        ({"detector": 7}, "a function from an image to boxes, got int"),
        ({"detector": lambda image: image.shape}, "what the detector <lambda> returned: expected detections"),
        ({"detector": lambda _: []}, None),
        ({"appearance": lambda crops: np.ones((len(crops) + 1, 3))}, "rows of numbers, one a crop, got an array"),
        ({"appearance": lambda _: "red"}, "rows of numbers, one a crop, got str"),
        ({"appearance": 3}, "a function from crops to rows, got int"),
        ({"method": "sort", "appearance": lambda _: 0}, "expected `appearance` with a method that compares it"),
        ({"method": "sort", "affinity": "none"}, "expected `affinity` with the method flow only"),
        ({"method": Sort(), "affinity": "none"}, "give it to the tracker"),
        ({"detections": [[]] * 17}, "expected detections for 16 frames, one entry a frame, got 17"),
        ({"detections": [[]], "detector": "x.onnx"}, "expected `detections` or `detector`, got both"),
    ],
)
def test_what_cannot_be_says_so_in_a_line(street: Path, options: dict[str, Any], message: str | None) -> None:
    if message is None:
        assert len(track_people(street, **options)) == 0
        return
    with pytest.raises(RequestError, match=message) as raised:
        track_people(street, **options)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("method", ["flow", FlowTracker()])
def test_a_method_that_decides_at_the_end_cannot_be_followed(street: Path, method: Any) -> None:
    with pytest.raises(RequestError, match="decides at the end; use track_people"):
        follow_people(street, method)
