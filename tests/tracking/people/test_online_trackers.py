"""What online trackers of many keep to: the contract in `people.contract`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, get_type_hints

import numpy as np
import pytest
from pydantic import ValidationError

from tests.tracking.people.families import LIFECYCLE
from tsuiseki import (
    ByteTrack,
    ByteTrackSettings,
    FlowSettings,
    FlowTracker,
    OcSort,
    OcSortSettings,
)
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.contract import OnlineTracker
from tsuiseki.tracking.people.lifecycle import with_area
from tsuiseki.tracking.types import Targets, Track

LIFE: dict[str, Any] = {"min_hits": 3, "max_age": 2, "start_score": 0.5}
MAKERS = [partial(kind, seed=1, **LIFE) for kind in LIFECYCLE.values()]
EACH = pytest.mark.parametrize("make", MAKERS, ids=LIFECYCLE)
EACH_CLASS = pytest.mark.parametrize("make", LIFECYCLE.values(), ids=LIFECYCLE)


def walk(person: int, frame: int) -> list[float]:
    """A row of somebody who walks to the right in a lane of their own."""
    return [3.0 * frame, 100.0 * person, 3.0 * frame + 30, 100.0 * person + 80, 0.9]


def seen(seed: int = 0, length: int = 40, people: int = 3) -> list[np.ndarray]:
    """Detections of people who are missed now and then."""
    rng = np.random.default_rng(seed)
    return [
        np.array([walk(k, t) for k in range(people) if rng.random() > 0.25]).reshape(-1, 5) + rng.normal(0, 0.3)
        for t in range(length)
    ]


def answers(tracker: OnlineTracker, video: list[np.ndarray]) -> list[Targets]:
    return [tracker.update(found) for found in video]


def rows(tracks: list[Track]) -> dict[tuple[int, int], np.ndarray]:
    return {(t.id, int(f)): box for t in tracks for f, box in zip(t.frames, t.boxes, strict=True)}


@EACH
def test_each_frame_is_answered_at_once(make: Callable[[], OnlineTracker]) -> None:
    tracker = make()
    said = answers(tracker, seen())
    assert [targets.frame for targets in said] == list(range(40))
    assert max(len(targets) for targets in said) >= 3
    for targets in said:
        assert len(set(targets.ids.tolist())) == len(targets)
        assert set(targets.status) <= {"tracking", "searching", "lost"}
        assert (targets.scores[targets.status != "tracking"] == 0).all()


@EACH
def test_what_is_answered_is_what_the_tracks_say(make: Callable[[], OnlineTracker]) -> None:
    tracker = make()
    said = answers(tracker, seen())
    kept = rows(tracker.tracks())
    now = {(p.id, t.frame): p.box for t in said for p in t if p.status == "tracking"}
    assert len(now) > 50
    for key, box in now.items():
        np.testing.assert_array_equal(box, kept[key])
    # Only what made the tracker believe comes before the first answer.
    assert len(kept) - len(now) == (LIFE["min_hits"] - 1) * len({id for id, _ in kept})


@EACH
def test_somebody_who_leaves_is_searched_then_lost_once(make: Callable[[], OnlineTracker]) -> None:
    tracker = make()
    video = [np.array([walk(0, t)]) for t in range(5)] + [np.empty((0, 5))] * 5 + [np.array([walk(0, 30)])] * 4
    status = [[person.status for person in targets] for targets in answers(tracker, video)]
    assert status[:5] == [[], [], ["tracking"], ["tracking"], ["tracking"]]
    assert status[5:10] == [["searching"], ["searching"], ["lost"], [], []]
    ids = [person.id for person in tracker.update(video[-1])]
    assert ids == [2], "an id that was lost does not come back"


@EACH
def test_a_searched_person_is_where_they_are_expected(make: Callable[[], OnlineTracker]) -> None:
    tracker = make()
    answers(tracker, [np.array([walk(0, t)]) for t in range(20)])
    (person,) = tracker.update([])
    assert person.box[0] == pytest.approx(walk(0, 20)[0], abs=1.0)


@EACH
def test_forgetting_keeps_ids_and_holds_nothing(make: Callable[[], OnlineTracker]) -> None:
    forgetful, plain = make(), make()
    for found in seen():
        a, b = forgetful.update(found), plain.update(found)
        np.testing.assert_array_equal(a.ids, b.ids)
        np.testing.assert_array_equal(a.boxes, b.boxes)
        forgetful.forget()
    assert forgetful.tracks() == []
    forgetful.update(np.array([walk(k, 40) for k in range(3)]))
    assert {frame for _, frame in rows(forgetful.tracks())} == {40}


@EACH
def test_two_trackers_share_no_counter(make: Callable[[], OnlineTracker]) -> None:
    video = [np.array([walk(0, t)]) for t in range(4)]
    first, second = answers(make(), video)[-1], answers(make(), video)[-1]
    assert first.ids.tolist() == second.ids.tolist() == [1]


def test_a_box_that_shrank_to_nothing_keeps_a_pixel() -> None:
    boxes = np.array([[0, 0, 10, 10], [5, 5, 3, 9.0]])
    np.testing.assert_allclose(with_area(boxes), [[0, 0, 10, 10], [3.5, 5, 4.5, 9]])


@EACH_CLASS
@pytest.mark.parametrize("score", [0.75, 0.95])
def test_a_sure_detection_is_shown_within_three_frames(make: Callable[..., OnlineTracker], score: float) -> None:
    tracker = make()
    said = [tracker.update([] if t < 4 else [[*walk(1, t)[:4], score]]) for t in range(7)]
    assert [len(targets) for targets in said[:5]] == [0] * 5
    assert len(said[6]) == 1
    assert len(make(min_hits=1).update([walk(1, 0)])) == 1


@EACH_CLASS
def test_settings_by_name_are_those_of_the_settings(make: Callable[..., Any]) -> None:
    named = make(max_age=7, min_hits=4, start_score=0.4, boxes="detected")
    assert named.settings == type(named.settings)(min_hits=4, max_age=7, start_score=0.4, boxes="detected")
    assert make(named.settings, max_age=9).settings == replace(named.settings, max_age=9)
    for wrong in ({"min_hits": 0}, {"max_age": "a"}, {"boxes": "whole"}, {"max_age": 20_000}):
        with pytest.raises(ValidationError, match=next(iter(wrong))):
            make(**wrong)
    with pytest.raises(RequestError, match="Settings"):
        make(30)


@EACH_CLASS
def test_keywords_are_the_settings(make: Callable[..., Any]) -> None:
    """The keywords of a tracker have the names and types of the fields of its settings."""
    keywords = inspect.signature(make, eval_str=True).parameters
    fields = get_type_hints(type(keywords["settings"].default))
    assert keywords.keys() - fields.keys() == {"settings", "seed"}
    assert {name: keywords[name].annotation for name in fields} == {name: kind | None for name, kind in fields.items()}


def test_the_score_of_a_start_follows_the_score_of_a_match() -> None:
    assert ByteTrack(high_score=0.25, low_score=0.05).settings.start_score == pytest.approx(0.35)
    assert OcSort(min_score=0.25).settings.start_score == 0.25
    assert ByteTrack().settings == ByteTrackSettings()
    assert OcSort().settings == OcSortSettings()


def test_settings_of_the_flow_by_name() -> None:
    tracker = FlowTracker(frame_rate=10.0, fill=0.0, min_time=0.5, smoothing=False)
    assert tracker.settings == FlowSettings(fill=0.0, min_time=0.5, smoothing=False)
    with pytest.raises(RequestError, match="Settings"):
        FlowTracker(25.0)  # type: ignore[arg-type]
