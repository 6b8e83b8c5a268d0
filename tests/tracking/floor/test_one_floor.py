"""Several cameras over one floor: places, groups, tracks, other sensors, and bad input."""

from __future__ import annotations

import csv
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cameras.camera_files import Placed, write_cameras
from tsuiseki.tracking.cameras.multicamera import PlacedTruth, StandingPeople, read_floor_folder
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.on_floor import evaluate_on_floor
from tsuiseki.tracking.floor.answers import counts_table, people_table
from tsuiseki.tracking.floor.delayed_floor import people_later
from tsuiseki.tracking.floor.foot_points import BOX_NOISE, FLOOR_NOISE, expected_boxes, on_floor
from tsuiseki.tracking.floor.grouping import ExpectedTracks, MomentPoints, group
from tsuiseki.tracking.floor.measured_floor import measured_floor
from tsuiseki.tracking.floor.online_floor import people_online
from tsuiseki.tracking.floor.run import track_floor
from tsuiseki.tracking.floor.tracker import flow_on_one_floor, tracks_in
from tsuiseki.tracking.formats.world_tables import read_floor_positions
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.sphere.settings import FrameTimes
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.measurements import PersonOnFloor
from tsuiseki.tracking.video.source import open_source

from .conftest import FLOOR, LENGTH, RATE, boxes_of, cameras, make_world


def as_truth(people):
    return PlacedTruth(
        np.concatenate([one.times for one in people]),
        np.concatenate([np.full(len(one), one.id) for one in people]),
        np.concatenate([one.positions for one in people]),
    )


def measured(world, positions=(), floor=FLOOR):
    return measured_floor(world.feeds, positions, floor)


def points_at(places, sensor, sensors=3, deviation=0.2, names=None):
    places = np.asarray(places, dtype=float)
    count = len(places)
    return MomentPoints(
        np.zeros(count, dtype=int),
        np.asarray(sensor),
        places,
        np.tile(deviation**2 * np.eye(2), (count, 1, 1)),
        np.full(count, np.log(0.8 / 0.01)),
        np.full((count, sensors), np.log(0.2)),
        np.full(count, -1) if names is None else np.asarray(names),
    )


@pytest.mark.parametrize("placed", cameras(), ids=lambda one: one.name)
def test_exact_boxes_lie_where_people_stand(placed):
    places = np.random.default_rng(0).uniform(-3, 3, (20, 2))
    found, covariance, _ = on_floor(
        placed.camera, StandingPeople.of(Detections(boxes_of(placed.camera, places), np.ones(20)))
    )
    np.testing.assert_allclose(found, places, atol=0.01)
    assert (np.linalg.eigvalsh(covariance) > FLOOR_NOISE**2 * 0.99).all()


def test_noisy_boxes_differ_as_the_covariance_says():
    """The squared Mahalanobis distance of a Gaussian in the plane is 2 in the mean."""
    rng, camera = np.random.default_rng(1), cameras()[0].camera
    places = np.tile([[1.0, -1.0]], (4000, 1))
    boxes = boxes_of(camera, places)
    boxes = boxes + BOX_NOISE * (boxes[:, 3:] - boxes[:, 1:2]) * rng.standard_normal(boxes.shape)
    found, covariance, _ = on_floor(camera, StandingPeople.of(Detections(boxes, np.ones(4000))))
    away = found - places
    square = np.einsum("ni,nij,nj->n", away, np.linalg.inv(covariance), away)
    # Heights are exact here, while a deviation of 0.12 m is allowed for, and so is that of the floor.
    assert 1.2 < square.mean() < 2.2


def test_ankles_count_instead_of_a_cut_box():
    camera, place = cameras()[0].camera, np.array([[0.5, 0.5]])
    box = boxes_of(camera, place)
    feet = camera.project(np.array([[0.5, 0.5, 0.0]]))[0]
    box[:, 3] -= 0.4 * (box[:, 3] - box[:, 1])
    with_feet = StandingPeople(Detections(box, np.ones(1)), feet)
    assert np.linalg.norm(on_floor(camera, with_feet)[0] - place) < 0.6
    alone = on_floor(camera, StandingPeople.of(Detections(box, np.ones(1))))[0]
    assert np.linalg.norm(alone - place) > 1.0


def test_an_edge_at_the_border_of_the_image_says_nothing():
    camera = cameras()[0].camera
    place = np.array([[-6.0, -6.0]])
    box = boxes_of(camera, place)
    assert box[0, 3] > camera.height
    box[0, 3] = camera.height
    found = on_floor(camera, StandingPeople.of(Detections(box, np.ones(1))))[0]
    assert np.linalg.norm(found - place) < 0.5


def test_expected_boxes_are_those_of_a_stick():
    camera, places = cameras()[0].camera, np.array([[0.0, 0.0], [2.0, -1.0]])
    np.testing.assert_allclose(expected_boxes(camera, places), boxes_of(camera, places), atol=6.0)


def test_groups_of_two_people_by_three_sensors():
    near = points_at([[0, 0], [0.1, 0], [0, 0.1], [2, 2], [2.1, 2], [2, 2.1]], [0, 1, 2, 0, 1, 2])
    label = group(near, 0.05)
    assert len(set(label[:3])) == len(set(label[3:])) == 1
    assert label[0] != label[3]


def test_a_group_has_one_of_each_sensor():
    label = group(points_at([[0, 0], [0.05, 0], [0.02, 0.02]], [0, 0, 1]), 0.05)
    assert label[0] != label[1]


def test_the_more_people_are_expected_the_sooner_two_points_are_two():
    pair = points_at([[0, 0], [0.6, 0]], [0, 1], sensors=2)
    assert [len(set(group(pair, density))) for density in (1e-3, 1e-2, 10.0, 100.0)] == [1, 1, 2, 2]


def test_certain_names_keep_apart():
    assert len(set(group(points_at([[0, 0], [0, 0]], [0, 1], names=[4, 7]), 0.05))) == 2
    assert len(set(group(points_at([[0, 0], [0, 0]], [0, 1], names=[4, 4]), 0.05))) == 1


def test_points_go_to_the_track_that_is_expected_there():
    expected = ExpectedTracks(
        np.zeros(2, dtype=int),
        np.array([[0.0, 0.0], [0.8, 0.0]]),
        np.tile(0.04 * np.eye(2), (2, 1, 1)),
        np.log(np.full((2, 3), 0.2)),
    )
    label = group(points_at([[0.1, 0], [0.7, 0], [0.75, 0.05]], [0, 0, 1]), 0.05, expected)
    assert label.tolist() == [0, 1, 1]


def test_moments_are_grouped_together_as_each_alone():
    rng = np.random.default_rng(0)
    sizes = [5, 0, 12, 9]
    moment = np.repeat(np.arange(4), sizes)
    points = points_at(rng.uniform(0, 2, (26, 2)), rng.integers(3, size=26), names=rng.integers(-3, 2, 26).clip(-1))
    points = replace(points, moment=moment)
    blocks = [rng.normal(0, 0.5, (size, size)) for size in sizes if size]
    places = rng.uniform(0, 2, (6, 2))
    due = ExpectedTracks(
        np.array([0, 0, 1, 2, 2, 3]), places, np.tile(0.04 * np.eye(2), (6, 1, 1)), np.log(np.full((6, 3), 0.2))
    )
    label = group(replace(points, affinities=blocks), 0.05, due)
    assert (label < 6).any()
    assert len(set(label[label >= 6])) < (label >= 6).sum()
    for number, block in zip((0, 2, 3), blocks, strict=True):
        own, tracks = np.flatnonzero(moment == number), np.flatnonzero(due.moment == number)
        rows = {name: getattr(points, name)[own] for name in ("moment", "sensor", "places", "covariances", "gain")}
        here = replace(points, **rows, missed=points.missed[own], names=points.names[own], affinities=[block])
        there = ExpectedTracks(due.moment[tracks], places[tracks], due.covariances[tracks], due.missed[tracks])
        numbers = np.concatenate([tracks, 6 + own])
        assert label[own].tolist() == numbers[group(here, 0.05, there)].tolist()


def test_everybody_is_followed(world):
    people = flow_on_one_floor(measured(world))
    scores = evaluate_on_floor(world.truth, as_truth(people))
    assert scores.idf1 > 0.95
    assert scores.mota > 0.93
    assert max(one.detected.sum(axis=1).max() for one in people) == 5


def test_the_same_input_gives_the_same_people(world):
    one, other = (flow_on_one_floor(measured(world)) for _ in range(2))
    assert one[0].positions.tolist() == other[0].positions.tolist()


def test_a_camera_that_runs_late_is_used_at_its_time():
    late = make_world(3, offset=0.04)
    found = measured(late)
    assert len(found.moments) == len(late.feeds[0].times)
    scores = evaluate_on_floor(late.truth, as_truth(flow_on_one_floor(found)))
    assert scores.idf1 > 0.9


def test_tracks_of_a_camera_bear_the_ids_of_the_floor(world):
    found = measured(world)
    people = flow_on_one_floor(found)
    tracks = tracks_in(found, people, 0)
    assert {track.id for track in tracks} <= {one.id for one in people}
    seen = {one.id: int(one.detected[:, 0].sum()) for one in people}
    assert all(int(track.observed.sum()) == seen[track.id] for track in tracks)


def write_positions(path, rows):
    path.write_text("time,x,y,sd,id\n" + "".join(",".join(str(v) for v in row) + "\n" for row in rows))
    return path


def test_a_certain_id_names_a_track_over_a_gap(tmp_path):
    rows = [(k * 0.5, 0.1 * k, 1.0, 0.1, 42) for k in [*range(8), *range(60, 68)]]
    rows += [(k * 0.5, 0.1 * k, -3.0, 0.1, "") for k in range(68)]
    result = track_floor(positions=[write_positions(tmp_path / "tags.csv", rows)])
    assert sorted(one.id for one in result) == [1, 42]
    assert result.by_id[42].times[[0, -1]].tolist() == [0.0, 33.5]


def test_positions_alone_are_tracked(tmp_path):
    rng = np.random.default_rng(0)
    rows, truth = [], []
    for k in range(40):
        for who, y in enumerate((-2.0, 0.0, 2.0), start=1):
            truth.append((k * 0.5, who, 0.3 * k, y))
            if rng.random() < 0.95:
                rows.append((k * 0.5, *(np.array([0.3 * k, y]) + 0.14 * rng.standard_normal(2)), 0.2, ""))
    result = track_floor(positions=[write_positions(tmp_path / "floor.csv", rows)])
    t = np.array(truth)
    scores = evaluate_on_floor(PlacedTruth(t[:, 0], t[:, 1].astype(int), t[:, 2:]), as_truth(result))
    assert scores.idf1 > 0.98


def test_one_id_of_two_people_at_once_is_refused(tmp_path):
    files = [
        write_positions(tmp_path / f"{k}.csv", [(0, x, 0, 0.1, 7), (1, x, 0, 0.1, 7)]) for k, x in enumerate((0, 9))
    ]
    with pytest.raises(RequestError, match=r"one place of id 7 at 0 s, got places 9.0 m apart"):
        track_floor(positions=files)


def test_positions_outside_the_plan_are_refused(world, tmp_path):
    path = write_positions(tmp_path / "far.csv", [(k / RATE, 500, 0, 0.1, "") for k in range(40)])
    with pytest.raises(RequestError, match=r"far.csv: expected people on the plan .*, got all 40 outside"):
        measured(world, [read_floor_positions(path)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: replace(f, placed=lowered(f.placed, -1.0)), "corner1: expected a camera over the floor"),
        (lambda f: replace(f, placed=turned_up(f.placed)), "corner1: expected a camera that sees the floor"),
        (
            lambda f: replace(f, times=f.times[:0], people=[]),
            "corner1: expected frames as of the other cameras, got none",
        ),
        (lambda f: replace(f, times=f.times + 100), "expected cameras that run at one time, got corner1 100.0"),
    ],
)
def test_feeds_that_do_not_fit_are_refused(world, change, message):
    feeds = [change(world.feeds[0]), *world.feeds[1:]]
    with pytest.raises(RequestError, match=message):
        measured_floor(feeds, [], FLOOR)


def lowered(placed: Placed, height: float) -> Placed:
    camera = placed.camera
    return replace(placed, camera=replace(camera, position=np.array([*camera.position[:2], height])))


def turned_up(placed: Placed) -> Placed:
    camera = placed.camera
    return replace(placed, camera=replace(camera, rotation=np.diag([1.0, 1.0, 1.0])))


def test_boxes_outside_a_cameras_picture_are_refused(tmp_path):
    write_cameras(tmp_path / "cameras.yaml", cameras())
    files = [tmp_path / f"{placed.name}.csv" for placed in cameras()]
    for path in files:
        path.write_text("frame,x1,y1,x2,y2,score\n1,9000,10,9040,90,1\n")
    with pytest.raises(RequestError, match=rf"{files[0].name}: .* in the picture of .*, got all 1 outside of it"):
        track_floor(cameras=tmp_path / "cameras.yaml", detections=files)


@pytest.mark.slow
def test_a_result_is_saved_and_loaded(world, tmp_path):
    names = written_detections(world, tmp_path)
    result = track_floor(cameras=tmp_path / "cameras.yaml", detections=names)
    result.save(tmp_path / "out")
    assert {"world.csv", "floor.png", "dwell.png", "report.html", "run.json", "corner1"} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }
    again = Result.load(tmp_path / "out")
    assert [one.id for one in again] == sorted(one.id for one in result)
    np.testing.assert_allclose(again.by_id[1].positions, result.by_id[1].positions, atol=1e-6)
    assert (tmp_path / "out/corner1/tracks.txt").read_text()


def test_shelf_keypoints_stay_with_both_people(data_folder):
    folder = data_folder / "multicamera/shelf"
    truth = read_floor_folder(folder).truth
    found = as_truth(track_floor([folder]))
    for who in np.unique(truth.ids):
        nearest = []
        for time, place in zip(truth.times[truth.ids == who], truth.places[truth.ids == who], strict=True):
            here = np.abs(found.times - time) < 0.01
            away = np.linalg.norm(found.places[here] - place, axis=1)
            nearest.append((away.min(), found.ids[here][away.argmin()]))
        assert np.mean([away < 0.3 for away, _ in nearest]) >= 0.95
        assert len({number for _, number in nearest}) == 1


@pytest.mark.slow
def test_the_filter_follows_them_as_they_come():
    world = make_world(0, people=3)
    people = people_online(measured(world))
    assert evaluate_on_floor(world.truth, as_truth(people)).recall > 0.8


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--overlay", "--positions", "{folder}/tags.csv"], "expected videos with images for --overlay, got none"),
        (["{folder}/none"], "expected videos, or a folder of WILDTRACK or Shelf, found no {folder}/none"),
        (["--positions", "{folder}/none.csv"], "expected a CSV of positions at {folder}/none.csv, found no such file"),
    ],
)
def test_what_is_missing_is_said_before_the_work(words, line, tmp_path, capsys):
    write_positions(tmp_path / "tags.csv", [(k / RATE, 0, 0, 0.1, "") for k in range(40)])
    given = [word.format(folder=tmp_path) for word in words]
    assert main(["track", "floor", *given, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith(f"tsuiseki: {line.format(folder=tmp_path)}")
    assert not (tmp_path / "out").exists()


def written_detections(world, folder):
    """cameras.yaml and a CSV for each camera, in its order."""
    names = []
    for feed in world.feeds:
        rows = [
            (k + 1, *box, 1.0)
            for k, people in enumerate(feed.people)
            for box in people.detections.boxes.round(3).tolist()
        ]
        names.append(folder / f"{feed.placed.name}.csv")
        names[-1].write_text("frame,x1,y1,x2,y2,score\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    write_cameras(folder / "cameras.yaml", cameras())
    return names


def test_frames_of_a_floor_are_those_of_each_camera(world, tmp_path):
    names = written_detections(world, tmp_path)
    write_positions(tmp_path / "tags.csv", [(k / RATE, 0, 0, 0.1, 7) for k in range(LENGTH)])
    part = {"detections": names, "positions": [tmp_path / "tags.csv"], "frames": "11-30"}
    result = track_floor(cameras=tmp_path / "cameras.yaml", **part)
    found = as_truth(result)
    assert (found.times.min(), found.times.max()) == (10 / RATE, 29 / RATE), "seconds of the whole video"
    within = (world.truth.times >= 10 / RATE) & (world.truth.times <= 29 / RATE)
    truth = PlacedTruth(world.truth.times[within], world.truth.ids[within], world.truth.places[within])
    assert evaluate_on_floor(truth, found).recall > 0.9
    assert result.frames["frame_of_each_video"][0] == [10] * len(names)
    result.files["corner1/tracks.txt"](tmp_path / "tracks.txt", tmp_path)
    rows = np.loadtxt(tmp_path / "tracks.txt", delimiter=",")
    assert (rows[:, 0].min(), rows[:, 0].max()) == (11, 30), "numbers of the whole video"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--frames", "5-99"], "expected frames within 1-40, got --frames 5-99"),
        (["--frames", "9-5"], "expected --frames FIRST-LAST with 1 <= FIRST <= LAST, got '9-5'"),
    ],
)
def test_frames_beyond_the_floor_are_refused(world, words, line, tmp_path, capsys):
    names = written_detections(world, tmp_path)
    given = ["--cameras", str(tmp_path / "cameras.yaml"), "--detections", ",".join(map(str, names)), *words]
    assert main(["track", "floor", *given, "--out", str(tmp_path / "out")]) == 2
    assert line in capsys.readouterr().err


def test_frames_of_positions_alone_are_refused(tmp_path):
    write_positions(tmp_path / "tags.csv", [(k / RATE, 0, 0, 0.1, "") for k in range(40)])
    with pytest.raises(RequestError, match="`frames`: expected videos or detections, got positions alone"):
        track_floor(positions=[tmp_path / "tags.csv"], frames="1-10")


@pytest.mark.parametrize("with_file", [False, True])
def test_times_of_some_frames_are_those_of_the_whole_video(with_file, tmp_path):
    images = [np.zeros((4, 4, 3), np.uint8)] * 12
    whole, part = ([open_source(images, wanted, 5.0)] for wanted in (None, FrameRange(3, 8)))
    stamps = tmp_path / "stamps.txt"
    stamps.write_text("".join(f"{0.2 * k + 0.01 * (k % 2)}\n" for k in range(12)))
    times = FrameTimes(offsets=[1.5], timestamps=[stamps] if with_file else None)
    np.testing.assert_array_equal(
        times.of_videos(part, cameras()[:1])[0], times.of_videos(whole, cameras()[:1])[0][3:9]
    )


@pytest.mark.slow
def test_the_page_of_a_floor_has_counts_a_table_and_pictures(world, tmp_path):
    folders = []
    for feed in world.feeds:
        folders.append(tmp_path / "video" / feed.placed.name)
        folders[-1].mkdir(parents=True)
        picture = np.full((feed.placed.camera.height, feed.placed.camera.width, 3), 90, np.uint8)
        for frame in range(LENGTH):
            cv2.imwrite(str(folders[-1] / f"{frame:06d}.jpg"), picture)
    names = written_detections(world, tmp_path)
    words = [*map(str, folders), "--cameras", str(tmp_path / "cameras.yaml"), "--tolerance", "0.05"]
    words += ["--detections", ",".join(map(str, names)), "--out", str(tmp_path / "out")]
    assert main(["track", "floor", *words]) == 0
    page, people = (tmp_path / "out/report.html").read_text(), Result.load(tmp_path / "out")
    for heading in ("People", "How many at a time", "Through the cameras", "Time", "How it was made"):
        assert f"<h2>{heading}</h2>" in page
    assert f"{len(people)} people before 5 cameras in {(LENGTH - 1) / RATE:.1f} seconds" in page
    assert len(people) <= page.count("data:image/jpeg") <= 3 * len(people)
    made = page.partition("How it was made")[2]
    assert "tolerance 0.05" in made
    assert "places that a camera supports" in made
    assert not re.search(r"None|\[|&#39;|overwrite", made)
    rows = list(csv.DictReader((tmp_path / "out/report/people.csv").read_text().splitlines()))
    assert [int(row["id"]) for row in rows] == sorted(one.id for one in people)
    counts = list(csv.DictReader((tmp_path / "out/report/counts.csv").read_text().splitlines()))
    here = [sum(one.scans[0] <= 0 <= one.scans[-1] for one in people)]
    assert int(counts[0]["most"]) >= here[0]
    assert [float(row["time"]) for row in counts] == list(range(int((LENGTH - 1) / RATE) + 1))


def test_a_table_of_people_says_how_long_and_how_far():
    way = np.column_stack([np.arange(5.0), np.zeros(5)])
    walker = PersonOnFloor(
        3, np.arange(5), 0.5 * np.arange(5), way, np.zeros((5, 2)), np.zeros((5, 4, 4)), np.ones(5),
        np.zeros((5, 0)), np.array([[True, False]] * 5),
    )  # fmt: skip
    table = people_table([walker], ("door", "hall"))
    assert {name: values[0] for name, values in table.items()} == {
        "id": 3, "first": 0.0, "last": 2.0, "seconds": 2.0, "metres": 4.0, "speed": 2.0, "cameras": "door",
    }  # fmt: skip
    counts = counts_table([walker, replace(walker, id=4, scans=np.array([4]))], 0.5 * np.arange(5))
    assert counts == {"time": [0.0, 1.0, 2.0], "people": [1.0, 1.0, 2.0], "most": [1, 1, 2]}
    assert counts_table([], np.empty(0)) == {"time": [], "people": [], "most": []}


def with_ghosts(world, count=8, cameras_of_place=4):
    """The first cameras of a world, each of which detects nobody at some places for .2 to 1.4 s."""
    rng, feeds = np.random.default_rng(7), [replace(feed, people=[*feed.people]) for feed in world.feeds]
    for ghost in range(count):
        feed = feeds[ghost % cameras_of_place]
        camera, first = feed.placed.camera, int(rng.integers(4, LENGTH - 12))
        # Far behind the plan, where no other camera looks, at the upper border of the image.
        x, y = rng.uniform(0.2, 0.8) * camera.width, rng.uniform(0.35, 0.5) * camera.height
        for moment in range(first, first + int(rng.integers(2, 8))):
            boxes = feed.people[moment].detections.boxes
            boxes = np.concatenate([boxes, [[x - 10, y - 40, x + 10, y]]])
            feed.people[moment] = StandingPeople.of(Detections(boxes, np.ones(len(boxes))))
    return replace(world, feeds=feeds[:cameras_of_place])


@pytest.mark.parametrize("later", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["flow", "delayed"])
def test_eight_people_before_four_cameras_are_eight_whatever_one_camera_alone_detects_for_a_moment(later):
    floor = measured(with_ghosts(make_world(1, people=8)), floor=np.array([-30.0, -30.0, 30.0, 30.0]))
    people = people_later(floor, 3.0) if later else flow_on_one_floor(floor)
    assert len(people) == pytest.approx(8, abs=1)


def test_who_one_camera_alone_detects_for_long_stays():
    world = make_world(1, people=1, miss=0.0, false=0.0)
    alone = [replace(feed, people=[StandingPeople.of(Detections.empty())] * LENGTH) for feed in world.feeds[1:]]
    assert len(flow_on_one_floor(measured(replace(world, feeds=[world.feeds[0], *alone])))) == 1


def test_the_plan_is_where_people_are_not_where_one_camera_detects_nobody(tmp_path):
    world = with_ghosts(make_world(1, people=8))
    names = written_detections(world, tmp_path)
    write_cameras(tmp_path / "cameras.yaml", [replace(feed.placed, floor=None) for feed in world.feeds])
    plan = np.array(track_floor(cameras=tmp_path / "cameras.yaml", detections=names).facts["floor"])
    truth = world.truth.places
    np.testing.assert_allclose(plan, [*truth.min(axis=0), *truth.max(axis=0)], atol=2.0)
    assert (truth >= plan[:2]).all()
    assert (truth <= plan[2:]).all()
