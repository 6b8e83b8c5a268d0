"""People on a floor while the cameras run: the same as from files, through outages, and what cannot be."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.tracking.video.cameras import Hours, ScriptedCamera, Sends, camera
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.cameras.camera_files import write_cameras
from tsuiseki.tracking.cameras.multicamera import PlacedTruth, read_floor_folder
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import InputWarning
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.features.exported import as_describer, as_detector
from tsuiseki.tracking.floor.delayed_floor import DelayedFloor
from tsuiseki.tracking.floor.live_floor import FloorLoop, SameCameras
from tsuiseki.tracking.floor.live_run import LiveFloor, floor_live
from tsuiseki.tracking.floor.measured_floor import CameraFeed
from tsuiseki.tracking.floor.moments import ComingMoments
from tsuiseki.tracking.floor.run import OneFloorSettings, track_floor
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import LiveOptions
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.tracking.types.live import LiveEvent, PeopleOnFloor
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.several import SeveralSources
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import shipped

from .conftest import FLOOR, RATE, World, make_world

DELAY = 2.0
ROLL = LiveOptions(roll=1.0)


@pytest.fixture(autouse=True)
def _unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each scripted camera has a clock of its own; all are waited for."""
    monkeypatch.setattr(SeveralSources, "now", lambda _: -np.inf)


def coded(number: int, camera_number: int, size: tuple[int, int]) -> ImageArray:
    """A picture that says which frame of which camera it is."""
    image = np.zeros((*size, 3), np.uint8)
    image[0, 0] = number % 256, number // 256, camera_number
    return image


@dataclass(frozen=True)
class Reader:
    """Detects and describes what was noted for the frame that a picture names."""

    world: World
    people: Mapping[tuple[int, int], FloatArray] | None = None

    def detect(self, images: Sequence[ImageArray]) -> list[Any]:
        return [self._standing(image).detections for image in images]

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """One direction a person, by the place in the truth that is next to the box."""
        camera_number = int(image[0, 0, 2])
        placed, number = self.world.feeds[camera_number].placed, int(image[0, 0, 0])
        features = np.zeros((len(boxes), 8))
        truth = self.world.truth
        rows = np.flatnonzero(np.isclose(truth.times, number / RATE))
        ends = placed.camera.project(np.column_stack([truth.places[rows], np.zeros(len(rows))]))[0]
        feet = np.column_stack([boxes[:, ::2].mean(axis=1), boxes[:, 3]])
        nearest = np.linalg.norm(feet[:, None] - ends[None], axis=2).argmin(axis=1)
        features[np.arange(len(boxes)), truth.ids[rows][nearest]] = 1.0
        return features

    def _standing(self, image: ImageArray) -> Any:
        number, camera_number = int(image[0, 0, 0]) + 256 * int(image[0, 0, 1]), int(image[0, 0, 2])
        return self.world.feeds[camera_number].people[number]


def small(world: World, count: int) -> World:
    return World(world.feeds[:count], world.truth)


def streams(world: World, frames: Sequence[Sequence[int]] | None = None) -> list[ScriptedCamera]:
    """A camera for each feed, that sends these of its frames, by default all, when they were taken."""
    made = []
    for number, feed in enumerate(world.feeds):
        lens = feed.placed.camera
        chosen = np.arange(len(feed.times)) if frames is None else np.asarray(frames[number])

        def image(k: int, n: int = number, at: IntArray = chosen, c: Any = lens) -> ImageArray:
            return coded(int(at[k]), n, (c.height, c.width))

        size, last = (lens.width, lens.height), len(chosen) - 1
        plan = [Sends(feed.times[chosen], image)]
        source = camera(plan, RATE, last, hours=Hours(), size=size, awaited=True)
        made.append(replace(source, name=feed.placed.name, address=f"fake://{number}"))
    return made


def opened(world: World, videos: Sequence[Any], described: bool = False, delay: float = DELAY) -> LiveFloor:
    reader = Reader(world)
    placed = [feed.placed for feed in world.feeds]
    detect: Any = [reader] * len(placed)
    describe: Any = reader if described else None
    return LiveFloor(placed, videos, detect, describe, FLOOR, delay, 0.5 / RATE)


def files(world: World, folder: Path) -> list[Any]:
    """The same as folders of pictures."""
    for number, feed in enumerate(world.feeds):
        lens, place = feed.placed.camera, folder / feed.placed.name
        place.mkdir(parents=True)
        for frame in range(len(feed.times)):
            image = coded(frame, number, (lens.height, lens.width))
            cv2.imwrite(str(place / f"{frame:06d}.png"), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return [open_source(folder / feed.placed.name) for feed in world.feeds]


def written(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.glob("*/world.csv"))}


def truth_of(people: Sequence[Any]) -> PlacedTruth:
    return PlacedTruth(
        np.concatenate([person.times for person in people]),
        np.concatenate([np.full(len(person), person.id) for person in people]),
        np.concatenate([person.positions for person in people]),
    )


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4, 5])
def test_streams_that_drop_nothing_give_the_bytes_of_the_files(count: int, tmp_path: Path) -> None:
    world = small(make_world(count), count)
    # A folder of pictures has 25 frames a second, and the file of the cameras says otherwise.
    stamps = np.arange(len(world.feeds[0].times)) / 25.0 * 25.0 / RATE
    world = World([replace(feed, times=stamps) for feed in world.feeds], world.truth)
    recorded, live = tmp_path / "recorded", tmp_path / "live"
    floor_live(Output(recorded), opened(world, files(world, tmp_path / "videos")), ROLL)
    floor_live(Output(live), opened(world, streams(world)), ROLL)
    assert written(live) == written(recorded)
    (part,) = recorded.glob("*/world.csv")
    people = Result.load(part.parent).tracks
    scores = evaluate_on_floor(world.truth, truth_of(people))
    assert scores.idf1 > 0.85
    record = json.loads((live / "run.json").read_text())
    assert all(state["dropped"] == 0 and state["frames"] == len(stamps) for state in record["facts"]["cameras"])


@pytest.mark.slow
def test_so_do_they_with_the_shipped_networks(tmp_path: Path) -> None:
    """Each camera shows a generated street; its people stand somewhere on the floor."""
    count, cameras = 6, make_world(7).feeds[:3]
    settings = StreetSettings(frames=3 * count, people=6, occluders=0, width=320, height=240, samples=1)
    pictures = [cv2.resize(image, (960, 720)) for (image,), _ in StreetClip(settings, 1).frames()]
    feeds = [CameraFeed(feed.placed, np.arange(count) / RATE, feed.people[:count]) for feed in cameras]
    recorded, folders = list[Source](), [tmp_path / feed.placed.name for feed in feeds]
    for number, folder in enumerate(folders):
        folder.mkdir()
        for frame in range(count):
            cv2.imwrite(str(folder / f"{frame:06d}.png"), pictures[number * count + frame][..., ::-1])
        recorded.append(open_source(folder))
    paced = [
        replace(source, plan=[Sends(feed.times, lambda k, n=number: pictures[n * count + k])])
        for number, (source, feed) in enumerate(zip(streams(World(feeds, make_world(7).truth)), feeds, strict=True))
    ]
    detector, describer = as_detector(shipped("detector_people"), 0.3, 1), as_describer(shipped("appearance_people"), 1)
    for out, videos in (("recorded", recorded), ("live", paced)):
        placed = [feed.placed for feed in feeds]
        live = LiveFloor(placed, videos, [detector] * 3, describer, 2 * FLOOR, DELAY, 0.5 / RATE)
        floor_live(Output(tmp_path / "out" / out), live, ROLL)
    tables = [written(tmp_path / "out" / out) for out in ("recorded", "live")]
    assert tables[0] == tables[1]
    (table,) = tables[0].values()
    assert table.count(b"\n") > count


def events_of(world: World, videos: Sequence[Any], described: bool = False) -> list[PeopleOnFloor]:
    events = opened(world, videos, described).events(SeveralSources(videos))
    return [event for event in events if isinstance(event, PeopleOnFloor)]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_camera_that_starts_late_stops_and_comes_back_leaves_the_ids() -> None:
    world = small(make_world(2, people=4, miss=0.0, false=0.0), 4)
    whole = range(len(world.feeds[0].times))
    events = events_of(world, streams(world, [whole, whole[10:], [*whole[:12], *whole[20:]], whole]))
    ids = {int(number) for event in events for number in event.ids}
    assert len(ids) == 4
    assert len(events) == len(whole)
    views = np.array([[frame is not None for frame in event.frames] for event in events])
    assert not views[:8, 1].any()
    assert not views[13:19, 2].any()
    assert views[22:, 2].any()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_after_an_outage_of_all_cameras_the_ids_are_those_of_the_appearance() -> None:
    world = small(make_world(3, people=4, miss=0.0, false=0.0), 4)
    steps = np.arange(len(world.feeds[0].times))
    # Longer than the window that is solved.
    times = (steps + 45 * (steps >= 20)) / RATE
    feeds = [replace(feed, times=times) for feed in world.feeds]

    def playing(described: bool) -> tuple[set[int], set[int]]:
        moments = events_of(World(feeds, world.truth), streams(World(feeds, world.truth)), described)
        before, after = (
            {int(n) for event in moments if (event.time < 8) == early for n in event.ids} for early in (True, False)
        )
        return before, after

    before, after = playing(described=True)
    assert before == after == {1, 2, 3, 4}
    before, after = playing(described=False)
    assert not before & after


@pytest.mark.slow
@pytest.mark.parametrize("delay", [1.0, 24.0])
def test_each_moment_is_answered_once_as_soon_as_the_delay_is_over(delay: float) -> None:
    """A delay of 24 seconds settles more at a time than the window keeps."""
    world = small(make_world(6, people=2, miss=0.0, false=0.0), 3)
    solver = DelayedFloor([feed.placed for feed in world.feeds], FLOOR, delay)
    answered = list[tuple[float, int]]()
    for second in range(len(world.feeds[0].times)):
        people = [feed.people[second] for feed in world.feeds]
        answered += [(second, answer.moment.number) for answer in solver.add(float(second), people)]
    answered += [(np.inf, answer.moment.number) for answer in solver.rest()]
    assert [number for _, number in answered] == [*range(40)]
    assert all(at in (number + delay, np.inf) for at, number in answered)
    assert solver.ids == 2


@pytest.mark.slow
def test_two_names_for_one_camera_are_told_and_the_run_goes_on() -> None:
    world = small(make_world(4, people=3), 3)
    twin = World([world.feeds[0], replace(world.feeds[0], placed=replace(world.feeds[0].placed, name="twin")),
                  *world.feeds[1:]], world.truth)  # fmt: skip
    videos = streams(twin)
    lens = world.feeds[0].placed.camera
    for row in (0, 1):
        plan = [Sends(twin.feeds[0].times, lambda k, c=lens: coded(k, 0, (c.height, c.width)))]
        videos[row] = replace(videos[row], plan=plan)
    with pytest.warns(InputWarning, match="twin gives the pictures of corner1: it is left out"):
        events = events_of(twin, videos)
    assert [frame is not None for frame in events[-1].frames] == [True, False, True, True]


@pytest.mark.parametrize("ahead", [0, 1, 7, 100])
@pytest.mark.parametrize("every", [1, 3])
def test_one_camera_under_two_names_is_told_however_far_its_streams_are_apart(ahead: int, every: int) -> None:
    pictures = np.random.default_rng(0).integers(0, 256, (ahead + 30, 16, 16), np.uint8)
    same, told = SameCameras(["first", "second"]), r"second gives the pictures of first: it is left out"
    for picture in pictures[:ahead]:
        same.add(1, picture)

    def go_on() -> None:
        for k in range(30):
            same.add(1, pictures[ahead + k])
            if k % every == 0:
                same.add(0, pictures[k])

    with pytest.warns(InputWarning, match=told):
        go_on()
    assert same.out == {1}


def test_cameras_that_show_one_still_picture_are_two(recwarn: pytest.WarningsRecorder) -> None:
    still, *moving = np.random.default_rng(0).integers(0, 256, (61, 16, 16), np.uint8)
    same = SameCameras(["first", "second"])
    for k in range(30):
        for number in (0, 1):
            same.add(number, still)
            same.add(number, moving[2 * k + number])
    assert not same.out
    assert not recwarn.list


def test_frames_that_come_when_their_moment_is_over_are_counted() -> None:
    moments = ComingMoments[str](2, 0.1, 0.5)
    assert moments.add(0, 1.0, "a")
    assert list(moments.ready((0, 1), 1.2)) == []
    (first,) = moments.ready((0, 1), 1.6)
    assert first.views == ("a", None)
    assert not moments.add(1, 1.0, "b")
    assert moments.late == [0, 1]
    assert moments.add(1, 2.0, "c")
    assert moments.add(0, 2.05, "d")
    (second,) = moments.ready((0, 1), 2.1)
    assert (second.time, second.views) == (pytest.approx(2.025), ("d", "c"))


def test_clocks_that_run_apart_are_told_in_one_line() -> None:
    world = small(make_world(5, people=3), 2)
    apart = World([world.feeds[0], replace(world.feeds[1], times=world.feeds[1].times - 100.0)], world.truth)

    class Ahead(SeveralSources):
        def now(self) -> float:
            return 1e9

    videos = streams(World(world.feeds, world.truth))
    sources = Ahead(videos)
    solver = DelayedFloor([feed.placed for feed in world.feeds], FLOOR, DELAY)
    reader: Any = Reader(apart)
    loop = FloorLoop([feed.placed for feed in world.feeds], sources, videos, [reader] * 2, None, solver, 0.1)
    loop.moments.add(0, 50.0, "ahead")  # type: ignore[arg-type]
    list(loop.moments.ready((), np.inf))
    events: list[LiveEvent] = []
    with pytest.warns(InputWarning) as told:
        events += loop.events()
    assert len(told) == 2
    assert "a frame came more than 1 s after those of the other cameras; such frames are left out" in str(
        told[0].message
    )


WILDTRACK_DELAY = 3.0


@pytest.mark.slow
@pytest.mark.integration
def test_wildtrack_as_seven_streams_scores_as_the_recording(data_folder: Path) -> None:
    """The first 50 s; IDF1 within a point of the recorded run with the same delay."""
    wildtrack = data_folder / "multicamera" / "wildtrack"
    data = read_floor_folder(wildtrack)
    length = 100
    world = World([], data.truth)

    times = np.arange(length) / 2.0
    world = World(
        [CameraFeed(c, times, p[:length]) for c, p in zip(data.cameras, data.people, strict=True)], data.truth
    )
    shown = data.truth.times < length / 2.0
    truth = PlacedTruth(data.truth.times[shown], data.truth.ids[shown], data.truth.places[shown])
    reader: Any = Reader(world)
    videos = streams(world)
    floor = np.asarray(data.cameras[0].floor)
    live = LiveFloor(data.cameras, videos, [reader] * 7, None, floor, WILDTRACK_DELAY, 0.25)
    moments = [event for event in live.events(SeveralSources(videos)) if isinstance(event, PeopleOnFloor)]
    found = PlacedTruth(
        np.concatenate([np.full(len(m.ids), m.moment / 2.0) for m in moments]),
        np.concatenate([m.ids for m in moments]),
        np.concatenate([m.places for m in moments]),
    )
    recorded = track_floor([wildtrack], settings=OneFloorSettings(delay=WILDTRACK_DELAY))
    tracks = truth_of(recorded.tracks)
    rows = tracks.times < length / 2.0
    same = PlacedTruth(tracks.times[rows], tracks.ids[rows], tracks.places[rows])
    assert abs(evaluate_on_floor(truth, found).idf1 - evaluate_on_floor(truth, same).idf1) < 0.01


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--roll", "1", "--positions", "p.csv"], "expected live cameras, or --roll, with the method flow"),
        (["--roll", "1", "--method", "lmb"], "expected live cameras, or --roll, with the method flow"),
        (["--roll", "1"], "expected one source for each camera, got 2 and 1 cameras"),
        (["--give-up", "5"], "--give-up: expected live sources"),
        (["--delay", "1", "--method", "lmb"], "--delay: expected it with the method flow"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(
    words: Sequence[str], said: str, world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cameras(tmp_path / "cameras.yaml", [replace(world.feeds[0].placed, floor=None)])
    (tmp_path / "p.csv").write_text("time,x,y\n0,0,0\n")
    arguments = [str(tmp_path / word) if word == "p.csv" else word for word in words]
    sources = [str(tmp_path / "a"), str(tmp_path / "b")]
    cameras = ["--cameras", str(tmp_path / "cameras.yaml"), "--out", str(tmp_path / "o")]
    assert main(["track", "floor", *sources, *cameras, *arguments]) == 2
    assert said in capsys.readouterr().err
