"""The ball's commands from end to end on a small film, and one clear line for each wrong request."""

import csv
import json
import time

import cv2
import numpy as np
import pytest

from tsuiseki.datamodules.scenes.sphere_clip import ball_cameras
from tsuiseki.tracking.cameras.camera_files import PlacedCamera, read_projective_cameras, write_cameras
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.evaluation.space import distance_to_position
from tsuiseki.tracking.formats.world_tables import read_path3d
from tsuiseki.tracking.video import live as video

FRAMES = 8


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball") / "film"
    assert main(["simulate", "sphere", "--out", str(folder), "--frames", str(FRAMES), "--seed", "1"]) == 0
    return folder


@pytest.fixture
def track(film, tmp_path, capsys):
    """Runs `tsuiseki track sphere` on the film; returns exit status, standard error and the result folder."""

    def run(*words, sources=("camera1", "camera2"), cameras=None, radius="0.1"):
        where = [str(film / s) for s in sources]
        places = ["--cameras", str(cameras or film / "cameras.yaml"), "--radius", radius]
        status = main(["track", "sphere", *where, *places, "--out", str(tmp_path / "result"), *words])
        return status, capsys.readouterr().err, tmp_path / "result"

    return run


def start_of(film):
    return ",".join(f"{v:.4f}" for v in read_path3d(film / "truth.csv").points[0])


@pytest.mark.slow
def test_a_film_is_tracked_and_everything_is_written(film, track):
    status, _, result = track("--start", start_of(film), "--truth", str(film / "truth.csv"), "--overlay")
    assert status == 0
    names = {"track3d.csv", "path.png", "report.html", "run.json", "overlay1.webm", "overlay2.webm"}
    assert names <= {p.name for p in result.iterdir()}
    away = distance_to_position(read_path3d(result / "track3d.csv"), read_path3d(film / "truth.csv"))
    # The bar of the paper's experiment here: 1.5 cm.
    assert away.mean() < 0.015
    record = json.loads((result / "run.json").read_text())
    assert record["frames"]["frame_of_each_video"][0] == [1, 1]
    assert set(record["frames"]["status"]) == {"tracking"}
    page = (result / "report.html").read_text()
    assert page.count("data:video/webm") == 2
    assert "Distance to the truth" in page
    assert all(section.count("<table>") <= 1 for section in page.split("<section>")), "tables have a heading each"


@pytest.mark.slow
def test_the_preset_paper_walks_and_never_searches(film, track):
    status, _, result = track("--start", start_of(film), "--preset", "paper", "--particles", "100")
    assert status == 0
    found = read_path3d(result / "track3d.csv")
    # Eight frames of a ball that is carried 2 cm a frame: the plain sum leaves it behind slowly.
    assert distance_to_position(found, read_path3d(film / "truth.csv")).mean() < 0.3
    record = json.loads((result / "run.json").read_text())
    assert "lost" not in record["frames"]["status"]
    assert "search" not in record["seconds"]


@pytest.mark.slow
def test_an_offset_shifts_one_video_against_the_other(film, track):
    shift = str(2 / 15)
    status, _, result = track("--start", start_of(film), "--offsets", f"0,{shift}", "--particles", "50")
    assert status == 0
    record = json.loads((result / "run.json").read_text())
    assert record["frames"]["frame_of_each_video"][:3] == [[1, None], [2, None], [3, 1]]


@pytest.mark.parametrize(
    ("words", "options", "reason"),
    [
        ([], {"sources": ("camera1",)}, "at least two videos and one camera for each, got 1 videos and 2 cameras"),
        ([], {"sources": ("camera1", "camera2", "camera1")}, "got 3 videos and 2 cameras"),
        ([], {"radius": "0"}, "--radius: expected a number greater than 0"),
        (["--start", "9,0,1"], {}, "lies behind camera1"),
        (["--volume", "0,0,0,1,1,0"], {}, "--volume: expected two corners that differ along x, y and z"),
        (["--volume", "0.4,0,0,0.6,0.2,2"], {"radius": "0.001"}, "--volume: expected places where two cameras see"),
        (["--offsets", "0"], {}, "--offsets: expected 2 values"),
        (["--particles", "3"], {}, "--particles: expected a number greater than or equal to 10"),
        (["--backgrounds", "a.png,b.png"], {}, "--backgrounds: expected only with the likelihood background"),
        (["--truth", "nowhere.csv"], {}, "nowhere.csv, found no such file"),
        (["--motion", "flying"], {}, "--motion: expected 'constant-velocity', "),
        (["--preset", "paper"], {}, "--start: expected x, y, z with the preset paper"),
    ],
)
def test_a_wrong_request_is_one_clear_line(track, words, options, reason):
    status, error, result = track(*words, **options)
    assert status == 2
    assert error.startswith("tsuiseki: ")
    assert error.count("\n") == 1
    assert reason in error
    assert not result.exists()


@pytest.mark.slow
def test_videos_of_different_length_need_times(film, track, tmp_path):
    short = tmp_path / "short"
    short.mkdir()
    for number in range(1, 4):
        (short / f"{number:06d}.jpg").write_bytes((film / "camera2" / f"{number:06d}.jpg").read_bytes())
    status, error, _ = track(sources=("camera1", str(short)))
    assert status == 2
    assert "expected videos of one length, but short ends at 0.13 s and camera1 at 0.47 s" in error
    times = tmp_path / "first.txt", tmp_path / "second.txt"
    for path, stamps in zip(times, (np.arange(FRAMES) / 15, np.arange(3) / 15), strict=True):
        path.write_text("\n".join(f"{t:.5f}" for t in stamps))
    words = ("--timestamps", f"{times[0]},{times[1]}", "--start", start_of(film), "--particles", "50")
    assert track(*words, sources=("camera1", str(short)))[0] == 0


def test_images_of_another_size_than_the_cameras_are_refused(film, track, tmp_path):
    text = (film / "cameras.yaml").read_text().replace("[800, 600]", "[640, 600]")
    (tmp_path / "cameras.yaml").write_text(text)
    status, error, _ = track("--start", start_of(film), cameras=tmp_path / "cameras.yaml")
    assert status == 2
    assert "expected 640x600 pixels as in the camera file, got 800x600" in error


@pytest.mark.parametrize("words", [["--cameras", "1"], ["--cover", "3,1,2"], ["--frames", "0"], ["--radius", "-1"]])
def test_wrong_films_are_refused(words, tmp_path, capsys):
    assert main(["simulate", "sphere", "--out", str(tmp_path / "film"), *words]) == 2
    assert "expected" in capsys.readouterr().err


def write_points(path, cameras, points):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["camera", "x", "y", "z", "u", "v"])
        for k, camera in enumerate(cameras):
            writer.writerows([[f"view{k}", *p, *uv] for p, uv in zip(points, camera.project(points)[0], strict=True)])


def test_calibrating_from_points_gives_the_cameras_back(tmp_path, capsys):
    cameras = ball_cameras(2)
    points = np.random.default_rng(0).uniform([-1, -1, 0], [1, 1, 2], (8, 3))
    write_points(tmp_path / "points.csv", cameras, points)
    out = tmp_path / "cameras.yaml"
    words = ["calibrate", "points", str(tmp_path / "points.csv"), "--out", str(out)]
    assert main([*words, "--image-size", "800,600", "--frame-rate", "15"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("line ") == 16
    found = read_projective_cameras(out)
    assert [(p.name, p.frame_rate) for p in found] == [("view0", 15.0), ("view1", 15.0)]
    for placed, camera in zip(found, cameras, strict=True):
        np.testing.assert_allclose(placed.camera.position, camera.position, atol=1e-5)
    assert main([*words, "--image-size", "800,600"]) == 2
    assert "already exists" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("rows", "words", "reason"),
    [
        ("x,y,z,u,v\n" + "0,0,0,1,1\n" * 5, ["--image-size", "8,6"], "at least 6 points a camera, got 5"),
        ("x,y,z,u,v\n" + "".join(f"{k},{k * k},0,{k},{k}\n" for k in range(8)), ["--image-size", "8,6"], "coplanar"),
        ("x,y,z,u\n1,2,3,4\n", ["--image-size", "8,6"], "found no v"),
        ("x,y,z,u,v\n1,2,3,4,far\n", ["--image-size", "8,6"], ":2: expected a finite number in column v, got 'far'"),
        ("x,y,z,u,v\n", ["--image-size", "8,6"], "expected rows of points"),
        ("x,y,z,u,v\n1,2,3,4,5\n", [], "expected --image-size WIDTH,HEIGHT or --intrinsics"),
    ],
)
def test_wrong_points_are_one_clear_line(tmp_path, capsys, rows, words, reason):
    (tmp_path / "points.csv").write_text(rows)
    out = tmp_path / "cameras.yaml"
    assert main(["calibrate", "points", str(tmp_path / "points.csv"), "--out", str(out), *words]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not out.exists()


def test_a_camera_file_with_a_missing_field_is_one_clear_line(track, tmp_path):
    write_cameras(tmp_path / "broken.yaml", [PlacedCamera("a", c) for c in ball_cameras(2)])
    text = (tmp_path / "broken.yaml").read_text()
    (tmp_path / "broken.yaml").write_text("\n".join(row for row in text.splitlines() if "position" not in row))
    status, error, _ = track(cameras=tmp_path / "broken.yaml")
    assert status == 2
    assert "broken.yaml: camera 1: expected the field" in error


@pytest.mark.slow
def test_cameras_out_of_step_find_the_ball_without_a_start(film, track):
    x, y, z = read_path3d(film / "truth.csv").points[0]
    volume = f"{x - 0.3},{y - 0.3},{z - 0.3},{x + 0.3},{y + 0.3},{z + 0.3}"
    status, _, result = track("--offsets", "0,0.0333", "--volume", volume)
    assert status == 0
    record = json.loads((result / "run.json").read_text())
    # The first frame has no companion yet; from the second on frames come in turn.
    assert record["frames"]["frame_of_each_video"][:3] == [[None, 1], [2, None], [None, 2]]
    away = distance_to_position(read_path3d(result / "track3d.csv"), read_path3d(film / "truth.csv"))
    # The second camera's frames are said to be half a frame late, and the ball moves at up to 0.7 m/s.
    assert np.nanmean(away) < 0.03


class FakeCamera:
    """Stands for `cv2.VideoCapture` of a webcam: shows the first picture of the film eight times, then ends."""

    film = None

    def __init__(self, address):
        self.picture = cv2.imread(str(sorted((self.film / f"camera{address + 1}").rglob("*.jpg"))[0]))
        self.next = 0

    def isOpened(self):  # noqa: N802
        return True

    def get(self, _):
        return 15.0

    def grab(self):
        time.sleep(0.06)
        self.next += 1
        return self.next <= 8

    def retrieve(self):
        return True, self.picture

    def release(self):
        pass


@pytest.fixture
def webcams(film, monkeypatch):
    monkeypatch.setattr(FakeCamera, "film", film)
    monkeypatch.setattr(video.cv2, "VideoCapture", FakeCamera)


@pytest.mark.slow
@pytest.mark.usefixtures("webcams")
def test_two_webcams_are_followed_while_they_come(film, tmp_path):
    # A ball that rests: how many frames are seen depends on how busy the machine is, where the ball is does not.
    words = ["track", "sphere", "0", "1", "--cameras", str(film / "cameras.yaml"), "--radius", "0.1"]
    assert main([*words, "--start", start_of(film), "--tolerance", "5", "--out", str(tmp_path / "live")]) == 0
    truth, found = read_path3d(film / "truth.csv").points, read_path3d(tmp_path / "live/track3d.csv").points
    frames = json.loads((tmp_path / "live/run.json").read_text())["frames"]["frame_of_each_video"]
    assert len(frames) == len(found) >= 2
    assert all(None not in pair for pair in frames[:-1])
    assert np.linalg.norm(found - truth[0], axis=1).max() < 0.015


@pytest.mark.usefixtures("webcams")
def test_live_cameras_refuse_what_needs_a_recording(film, tmp_path, capsys):
    words = ["track", "sphere", "0", "1", "--cameras", str(film / "cameras.yaml"), "--radius", "0.1"]
    for more, text in (
        (["--overlay"], "--overlay: expected recorded videos"),
        (["--offsets", "0,1"], "--offsets and --timestamps: expected only with recorded videos"),
        (["--likelihood", "background"], "--backgrounds: expected pictures of the empty scene with live cameras"),
    ):
        assert main([*words, *more, "--out", str(tmp_path / "live")]) == 2
        assert text in capsys.readouterr().err
    mixed = ["track", "sphere", str(film / "camera1"), "1", *words[4:]]
    assert main([*mixed, "--out", str(tmp_path / "live")]) == 2
    assert "got a live camera" in capsys.readouterr().err


@pytest.mark.slow
def test_a_film_is_followed_as_it_is_tracked(film, tmp_path):
    import tsuiseki

    start = read_path3d(film / "truth.csv").points[0]
    films = [film / "camera1", film / "camera2"]
    settings = tsuiseki.SphereSettings(particles=100)
    asked = {"cameras": film / "cameras.yaml", "radius": 0.1, "start": start, "settings": settings}
    followed = list(tsuiseki.follow_sphere(films, **asked))
    tracked = tsuiseki.track_sphere(films, **asked)
    assert [p.time for p in followed] == [p.time for p in tracked]
    np.testing.assert_array_equal([p.point for p in followed], [p.point for p in tracked])
    saved = {path.name for path in tracked.save(tmp_path / "saved").iterdir()}
    assert saved == {"track3d.csv", "path.png", "report.html", "run.json"}
