"""Rounds go on while they agree better, stop at a collapse, keep the best, and go on after a stop."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.trainers.adapt import rounds as module
from tsuiseki.trainers.adapt.rounds import (
    Adaptation,
    TrackedPeople,
    against_default,
    best_of,
    better,
    default_round,
    file_state,
    keep_round,
    kept_round,
    resumed,
    rounds,
)
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import Watched, open_camera

START = Path("start.onnx")
TEACHER: Any = Path("teacher.onnx")


def seeing(people: int, jitter: float) -> TrackedPeople:
    """What a detector finds that sees some of the people, with boxes off by so many pixels; tracks are smooth."""
    rng = np.random.default_rng(0)
    detections = []
    for frame in range(street.FRAMES):
        boxes = street.people(frame)[:people]
        detections.append(Detections(boxes + rng.normal(0, jitter, boxes.shape), np.full(len(boxes), 0.9)))
    return TrackedPeople(detections, [street.track_of(n) for n in range(people)], 1)


@pytest.fixture
def adaptation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[list[TrackedPeople]], Adaptation]:
    """Rounds whose detectors see what is given, one entry a round; nothing is trained."""

    def make(seen: list[TrackedPeople]) -> Adaptation:
        def find(_: Watched, detector: Path, *__: object) -> TrackedPeople:
            return seen[0 if detector == START else int(detector.parent.name.removeprefix("round-"))]

        def export(*given: Any) -> None:
            given[4].write_bytes(b"model")

        monkeypatch.setattr(module, "find", find)
        monkeypatch.setattr(module, "layout_of", lambda _: module)
        monkeypatch.setattr(module, "size", (1, 1), raising=False)
        monkeypatch.setattr(module, "fine_tune", lambda *_: Path("checkpoint"))
        monkeypatch.setattr(module, "export_calibrated", export)
        settings = AdaptSettings(rounds=len(seen) - 1 or 1, pictures=30)
        source = tmp_path / "street"
        if not source.exists():
            street.write_video(source)
        videos = open_camera([str(source)], EVERY_FRAME, tmp_path / "work", settings)
        return Adaptation(videos, START, tmp_path / "work", settings, START, tell=lambda _: None)

    return make


def test_the_best_round_is_kept(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    finished = list(rounds(adaptation([seeing(2, 3.0), seeing(2, 1.0), seeing(2, 2.0), seeing(2, 0.0)])))
    assert [here.number for here in finished] == [0, 1, 2]
    assert best_of(finished).number == 1
    assert finished[1].scores.agreement > finished[2].scores.agreement > finished[0].scores.agreement


def test_the_first_round_must_be_better_by_more(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    start, first = rounds(adaptation([seeing(2, 3.0), seeing(2, 1.0)]))
    for rise, kept in ((0.019, 0), (0.021, 1)):
        learnt = replace(first, scores=replace(first.scores, agreement=start.scores.agreement + rise))
        assert best_of([start, learnt]).number == kept
        again = replace(learnt, number=2, scores=replace(first.scores, agreement=learnt.scores.agreement + 0.003))
        assert better(again, learnt)


@pytest.mark.slow
def test_a_round_is_kept_where_it_beats_the_default(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    given = adaptation([seeing(2, 3.0), seeing(2, 1.0)])
    _, learnt = rounds(given)
    default = default_round(given)
    kept, line = against_default(learnt, default)
    assert kept
    assert line.startswith("round 1 beats start.onnx, which track people takes: agreement ")
    scores = default.scores
    for name, value, keeps in (
        ("agreement", learnt.scores.agreement - 0.01, False),
        ("rejected", -0.1 * scores.detections, False),
        ("boxes", 2 * learnt.scores.boxes, False),
        ("seconds", 1.0, True),
    ):
        other = replace(default, scores=replace(scores, **{name: value}))
        assert against_default(learnt, other)[0] is keeps, name
    slow = replace(learnt, scores=replace(learnt.scores, seconds=2.0))
    assert "it is slower: 2000 and 1000 ms a frame" in against_default(slow, other)[1]


def test_a_collapse_stops_and_is_not_kept(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    """One of two people agrees perfectly with its track, and yet it is one of two."""
    finished = list(rounds(adaptation([seeing(2, 3.0), seeing(1, 0.0), seeing(2, 0.0)])))
    assert len(finished) == 2
    assert "people a frame" in str(finished[1].scores.collapsed(finished[0].scores))
    assert best_of(finished).number == 0


def test_twice_the_people_are_kept(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    finished = list(rounds(adaptation([seeing(1, 3.0), seeing(2, 0.5)])))
    assert finished[1].scores.boxes == pytest.approx(2 * finished[0].scores.boxes)
    assert best_of(finished).number == 1


@pytest.mark.slow
def test_a_round_competes_with_the_start_and_not_with_its_teacher(
    adaptation: Callable[[list[TrackedPeople]], Adaptation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The teacher's boxes are its tracks', the learnt ones nearly; those of the start lie far off."""
    for start, best in ((seeing(2, 2.5), 1), (seeing(2, 0.0), 0)):
        given = replace(adaptation([seeing(2, 0.0), seeing(2, 1.0)]), teacher=TEACHER)
        look = module.find

        def find(
            watched: Watched, detector: Path, *rest: Any, start: TrackedPeople = start, look: Any = look
        ) -> TrackedPeople:
            return start if detector == START else look(watched, START if detector == TEACHER else detector, *rest)

        monkeypatch.setattr(module, "find", find)
        finished = list(rounds(replace(given, work=given.work / str(best))))
        assert finished[0].detector == TEACHER
        assert finished[0].scores.agreement < 1 or not best
        assert best_of(finished).number == best


def test_labels_of_a_round_teach_the_next(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    given = adaptation([seeing(1, 1.0), seeing(2, 0.5)])
    counted = [here.labels[0].people.evaluated.sum() for here in rounds(given)]
    assert counted == [30, 60]
    written = (Path(given.videos[0].folder) / "gt" / "gt.txt").read_text().splitlines()
    assert sum(row.split(",")[6] == "1" for row in written) == 30


def test_boxes_are_moved_onto_silhouettes_once(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    """Otherwise a part of the way becomes the whole way in a few rounds."""
    wide = seeing(2, 1.0)
    wide = replace(wide, tracks=[street.track_of(n, shift=0.4) for n in range(2)])
    finished = list(rounds(adaptation([wide, replace(wide, detections=seeing(2, 0.5).detections)])))
    assert [here.scores.offset > 0.01 for here in finished] == [True, False]


@pytest.mark.slow
def test_finished_rounds_are_not_made_again(
    adaptation: Callable[[list[TrackedPeople]], Adaptation], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = adaptation([seeing(2, 3.0), seeing(2, 1.0), seeing(2, 0.0)])
    stopped = rounds(given)
    first = [next(stopped), next(stopped)]
    stopped.close()
    calls = []
    look = module.find
    monkeypatch.setattr(module, "find", lambda *a: calls.append(a) or look(*a))
    assert list(rounds(given))[:2] == first
    assert [detector.parent.name for _, detector, *_ in calls] == ["round-2"]
    # What was learnt has other scores than the shipped costs know.
    assert [str(affinity) for *_, affinity in calls] == ["none"]


def test_nobody_is_refused(adaptation: Callable[[list[TrackedPeople]], Adaptation]) -> None:
    nobody = TrackedPeople([Detections.empty()] * street.FRAMES, [], 1)
    with pytest.raises(RequestError, match=r"expected people to learn from .* found no person"):
        next(rounds(adaptation([nobody])))


def test_people_in_the_held_out_end_alone_teach_nothing(
    adaptation: Callable[[list[TrackedPeople]], Adaptation],
) -> None:
    late = street.track_of(0)
    late = Track(1, late.frames[95:], late.boxes[95:], late.scores[95:])
    found = TrackedPeople([Detections.empty()] * street.FRAMES, [late], 1)
    with pytest.raises(RequestError, match="expected people before the last 25% of a video"):
        list(rounds(adaptation([found, found])))


def test_another_request_starts_anew(tmp_path: Path) -> None:
    work = tmp_path / "work"
    assert not resumed(work, {"steps": 1})
    (work / "round-0").mkdir()
    assert resumed(work, {"steps": 1})
    assert (work / "round-0").exists()
    assert not resumed(work, {"steps": 2})
    assert not (work / "round-0").exists()


@pytest.mark.slow
def test_two_cameras_are_refused(tmp_path: Path) -> None:
    sources = [str(street.write_video(tmp_path / f"street{seed}", seed=seed)) for seed in (0, 1)]
    with pytest.raises(RequestError, match="adapt to one camera at a time"):
        open_camera(sources, EVERY_FRAME, tmp_path / "work", AdaptSettings())


def test_a_moving_camera_has_no_empty_view(tmp_path: Path) -> None:
    source = str(street.write_video(tmp_path / "street", pan=1))
    (video,) = open_camera([source], EVERY_FRAME, tmp_path / "work", AdaptSettings())
    assert video.empty is None
    assert video.difference(0) is None


def test_a_video_that_was_written_anew(tmp_path: Path) -> None:
    folder = tmp_path / "sequence"
    (folder / "img1").mkdir(parents=True)
    picture = folder / "img1" / "1.jpg"
    picture.write_bytes(b"one")
    os.utime(picture, (100, 100))
    first = file_state(str(folder))
    assert first == file_state(str(folder)) == file_state(str(picture))
    os.utime(picture, (200, 200))
    assert file_state(str(folder)) != first
    (folder / "img1" / "2.jpg").write_bytes(b"two")
    assert file_state(str(folder))[:2] == [2, 6]
    assert file_state("rtsp://camera") == [0, 0, 0]


def test_a_finished_round_is_read_again_and_nothing_in_its_file_runs(
    adaptation: Callable[[list[TrackedPeople]], Adaptation], tmp_path: Path
) -> None:
    start = next(iter(rounds(adaptation([seeing(2, 3.0), seeing(2, 1.0)]))))
    folder = tmp_path / "round"
    folder.mkdir()
    keep_round(start, folder)
    assert [path.name for path in folder.iterdir()] == ["finished.npz"]
    again = kept_round(folder, start.detector)
    assert again == start
    assert again is not None
    assert again.labels[0].everyone == start.labels[0].everyone
    assert again.detections == start.detections
    (folder / "finished.npz").write_bytes(pickle.dumps(Path("harm")))
    with pytest.raises(RequestError, match=r"finished\.npz: expected a round of tsuiseki adapt"):
        kept_round(folder, start.detector)
