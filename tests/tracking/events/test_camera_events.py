"""What people do becomes events: closed forms, each of the published schema, and the same of a recording as live."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import tsuiseki.tracking.events as events_package
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.scene import EventIntervals, Scene, SceneLine, SceneZone
from tsuiseki.tracking.events.event import SCHEMA, SCHEMA_FILE, TYPES, Event, public_name
from tsuiseki.tracking.events.observer import FLOOR, EventMaker, on_plan, seen_from_above
from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.live import CameraOutage, PeopleInFrame, PeopleOnFloor
from tsuiseki.tracking.types.tracks import targets_of_frames

RATE = 10.0
IMAGE = np.zeros((2, 2, 3), np.uint8)
SCENE = Scene(
    [SceneLine("door", np.array([[100.0, 0.0], [100.0, 200.0]]))],
    [SceneZone("shop", np.array([[150.0, 0], [250, 0], [250, 200], [150, 200]]), stay=2.0)],
    events=EventIntervals(counts=5.0),
)
SCHEMA_TEXT = Path(events_package.__file__).with_name(SCHEMA_FILE).read_text(encoding="utf-8")
VALID = jsonschema.Draft202012Validator(json.loads(SCHEMA_TEXT))


def walk(number: int, xs: list[float] | np.ndarray, first: int = 0) -> Track:
    """Somebody 40 pixels high whose feet are at ``xs`` from the ``first`` frame on."""
    x = np.asarray(xs, dtype=float)
    boxes = np.column_stack([x - 5, np.full(len(x), 60.0), x + 5, np.full(len(x), 100.0)])
    return Track(number, first + np.arange(len(x)), boxes, np.ones(len(x)))


def frames_of(tracks: list[Track], length: int, start: float = 1e9) -> list[PeopleInFrame]:
    people = targets_of_frames(tracks, range(length))
    return [PeopleInFrame(0, "gate", start + t / RATE, Frame(t, t / RATE, IMAGE), p) for t, p in enumerate(people)]


def events_of(happenings: list, scene: Scene | None = None, recorded: bool = False) -> list[Event]:
    maker = EventMaker(scene, recorded)
    events = [event for happening in happenings for event in maker.events(happening)] + maker.close()
    for event in events:
        VALID.validate(json.loads(event.line))
    assert len({event.id for event in events}) == len(events)
    return events


def told(events: list[Event], *types: str) -> list[tuple]:
    """Type, frame and person of events of these types."""
    return [(event.type, event.data.get("frame"), event.data.get("person")) for event in events if event.type in types]


def test_a_walk_through_a_line_and_a_zone_is_told_step_by_step() -> None:
    # 40 pixels a second: the line at 2.5 s, the zone from 3.75 s on, where the walk ends at 200.
    events = events_of(frames_of([walk(7, np.minimum(4.0 * np.arange(100), 200))], 120), SCENE)
    assert [event.type for event in events if event.type not in ("moved", "counted")] == [
        "appeared",
        "crossed",
        "entered",
        "stayed",
        "lost",
    ]
    appeared, crossed, entered, stayed, lost = (e for e in events if e.type not in ("moved", "counted"))
    assert appeared.data == {"frame": 1, "seconds": 0.0, "person": 7, "box": [-5.0, 60.0, 5.0, 100.0]}
    assert (crossed.data["line"], crossed.data["direction"]) == ("door", "out")
    # The band is a fifth of the height, 8 pixels: beyond it, at 108 and 158, a side is settled.
    assert (crossed.data["seconds"], entered.data["seconds"]) == (2.8, 4.0)
    assert (stayed.data["zone"], stayed.data["stay"]) == ("shop", 2.0)
    assert stayed.data["seconds"] == 6.0
    assert (lost.data["frame"], lost.data["seconds"]) == (100, 9.9)


def test_66_5_an_event_says_what_no_detection_supports_and_who_is_rather_nobody() -> None:
    person = walk(1, 4.0 * np.arange(60))
    hidden = replace(person, observed=(person.frames < 22) | (person.frames > 32))
    ghost = walk(2, 4.0 * np.arange(24, 30), first=24)
    support = {
        (event.type, event.data["person"]): event.data.get("support")
        for event in events_of(frames_of([hidden, ghost], 70), SCENE)
        if event.type in ("appeared", "crossed", "entered")
    }
    assert support == {("appeared", 1): None, ("crossed", 1): "filled", ("appeared", 2): "doubtful",
                       ("crossed", 2): "doubtful", ("entered", 1): None}  # fmt: skip


def test_moves_come_at_the_rate_and_while_somebody_moves() -> None:
    events = events_of(frames_of([walk(1, 4.0 * np.arange(35)), walk(2, 50 + 0.3 * (np.arange(35) % 2))], 35))
    assert told(events, "moved") == [("moved", 11, 1), ("moved", 21, 1), ("moved", 31, 1)]
    often = Scene(events=EventIntervals(moves=0.5))
    assert len(told(events_of(frames_of([walk(1, 4.0 * np.arange(35))], 35), often), "moved")) == 6


def test_somebody_who_comes_back_corrects_that_they_were_lost() -> None:
    events = events_of(frames_of([walk(1, np.arange(60)), walk(2, [10.0] * 5), walk(2, [12.0] * 5, 30)], 60))
    lost, back, again = (e for e in events if e.data.get("person") == 2 and e.type in ("lost", "correction"))
    assert back.data == {"corrects": lost.id, "person": 2, "withdrawn": True}
    assert again.data["frame"] == 35
    assert told(events, "appeared") == [("appeared", 1, 1), ("appeared", 1, 2)]


def test_a_gap_shorter_than_a_second_is_none() -> None:
    events = events_of(frames_of([walk(1, [10.0] * 30), walk(2, [50.0] * 5), walk(2, [50.0] * 5, 14)], 20))
    assert not told(events, "lost", "correction")


def test_somebody_who_goes_on_under_another_id_is_a_correction() -> None:
    events = events_of(frames_of([walk(1, np.arange(10.0)), walk(2, np.arange(10.0, 30.0), 10)], 45))
    (appeared,) = (event for event in events if event.type == "appeared")
    (correction,) = (event for event in events if event.type == "correction")
    assert correction.data == {"corrects": appeared.id, "person": 2, "was": 1}
    assert told(events, "lost") == [("lost", 30, 2)]


def test_counts_by_interval_are_those_of_a_finished_count() -> None:
    rng = np.random.default_rng(0)
    tracks = [walk(n + 1, rng.uniform(0, 60) + rng.uniform(2, 3) * np.arange(90), 10 * n) for n in range(8)]
    events = [event.data for event in events_of(frames_of(tracks, 190), SCENE) if event.type == "counted"]
    assert [(data["start"], data["end"]) for data in events] == [(0, 5), (5, 10), (10, 15), (15, 18.9)]
    assert sum(data["frames"] for data in events) == 190
    answers = count(tracks, SCENE, frame_rate=RATE)
    for way in ("in", "out"):
        assert sum(data["lines"]["door"][way] for data in events) == answers.count("door", way)[0]
    assert sum(data["zones"]["shop"]["entered"] for data in events) == answers.tables["zones"]["entries"][0] > 4
    in_view = sum(data["people"] * data["frames"] for data in events)
    assert in_view == pytest.approx(sum(len(track) for track in tracks), abs=0.2)


def test_an_outage_is_two_events_and_leaves_intervals_without_a_frame_out() -> None:
    before, after = frames_of([walk(1, [10.0] * 20)], 20), frames_of([walk(9, [10.0] * 20)], 20)
    later = [
        PeopleInFrame(0, "gate", 1e9 + 100 + t / RATE, Frame(20 + t, 100 + t / RATE, IMAGE), e.people)
        for t, e in enumerate(after)
    ]
    outages = CameraOutage(0, "gate", 1e9 + 2), CameraOutage(0, "gate", 1e9 + 100, 98.1)
    events = events_of([*before, outages[0], outages[1], *later], SCENE)
    lost, back = (event for event in events if event.type.startswith("camera"))
    assert (lost.type, lost.data, back.data) == ("camera_lost", {"seconds": 1.9}, {"gap": 98.1})
    assert [(e.data["start"], e.data["end"]) for e in events if e.type == "counted"] == [(0, 5), (100, 101.9)]
    assert told(events, "lost") == [("lost", 20, 1)]


def test_the_same_events_of_a_recording_as_live() -> None:
    rng = np.random.default_rng(1)
    tracks = [walk(n + 1, np.cumsum(rng.normal(2, 4, 80)), 5 * n) for n in range(3)]
    live, recorded = events_of(frames_of(tracks, 120), SCENE), events_of(frames_of(tracks, 120, 0.0), SCENE, True)
    assert [(e.camera, e.type, e.data) for e in live if e.type != "correction"] == [
        (e.camera, e.type, e.data) for e in recorded if e.type != "correction"
    ]
    assert {event.time for event in recorded} == {None}
    assert json.loads(live[0].line)["time"] == "2001-09-09T01:46:40.000Z"


def test_people_on_a_floor_have_places_and_cross_its_lines_as_seen_from_above() -> None:
    length, places = 40, np.column_stack([0.1 * np.arange(40), np.full(40, 1.0)])
    none = np.empty(0)
    moments = [
        PeopleOnFloor(1e9 + t / RATE, t, np.array([3]), places[t, None], none, none, np.ones(1), np.ones((1, 2), bool),
                      (), ())
        for t in range(length)
    ]  # fmt: skip
    gate = SceneLine("gate", np.array([[2.0, 0.0], [2.0, 3.0]]), ("east", "west"))
    events = events_of(moments, Scene([gate], unit="metres", scale=1.0))
    (crossed,) = (event for event in events if event.type == "crossed")
    # With y down, as in a picture, who walks from left to right crosses a line that leads down from its right.
    assert (crossed.camera, crossed.data["direction"]) == (FLOOR, "west")
    assert crossed.data["metres"] == [2.4, 1.0]
    assert on_plan(moments[5]).boxes[0, 2:].tolist() == [0.5, 1.0]
    assert seen_from_above(Scene([gate], unit="metres", scale=0.01)).scale == 1.0


@pytest.mark.parametrize("name", ["webcam 0", "rtsp://10.0.0.7/stream", "Eingang ü"])
def test_a_camera_is_named_without_its_password(name: str) -> None:
    assert public_name(name.replace("://", "://admin:secret@")) == name
    people = Targets.empty(0)
    assert public_name(name.replace("://", "://admin:s@c:ret@")) == name
    (line,) = (event.line for event in events_of([PeopleInFrame(0, name, 1e9, Frame(0, 0.0, IMAGE), people)]))
    assert "secret" not in line


def test_the_schema_is_valid_knows_every_type_and_refuses_what_is_none() -> None:
    schema = json.loads(SCHEMA_TEXT)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$id"] == SCHEMA == schema["properties"]["dataschema"]["const"]
    assert schema["properties"]["type"]["enum"] == [f"tsuiseki.{name}" for name in TYPES]
    event = json.loads(Event("a-1", "gate", "camera_back", {"gap": 1.0}).line)
    VALID.validate(event)
    for change in (
        {"dataschema": "urn:tsuiseki:events:2"},
        {"type": "tsuiseki.waved"},
        {"data": {"gap": -1.0}},
        {"data": {"gap": 1.0, "why": "rain"}},
        {"id": ""},
    ):
        assert not VALID.is_valid(event | change), change


def test_the_page_lists_the_types_of_the_schema() -> None:
    page = (Path(__file__).parents[3] / "docs/how-to/events.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == list(TYPES)
