"""What is known of a run: pictures, counts, health and numbers for Prometheus, and who may ask for them."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import psutil
import pytest
import requests
from PIL import Image
from starlette.testclient import TestClient

from tests.tracking.events.test_camera_events import SCENE
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.hiding.places import HOLD
from tsuiseki.tracking.monitor import board as board_module
from tsuiseki.tracking.monitor import window as window_module
from tsuiseki.tracking.monitor.board import Board, memory
from tsuiseki.tracking.monitor.metrics import metrics_text
from tsuiseki.tracking.monitor.pictures import Hidden, PictureMaker
from tsuiseki.tracking.monitor.server import application
from tsuiseki.tracking.monitor.window import Window, check_window
from tsuiseki.tracking.report import page_server
from tsuiseki.tracking.report.local_page import token_of
from tsuiseki.tracking.report.page_server import listening
from tsuiseki.tracking.types import Detections, Frame, ImageArray, Targets
from tsuiseki.tracking.types.live import CameraOutage, CameraState, PeopleInFrame, PeopleOnFloor

TOKEN, HOST = "t0ken", "127.0.0.1:8000"
SIZE = (120, 160)
NOISE = np.random.default_rng(0).integers(0, 255, (*SIZE, 3), dtype=np.uint8)


def people_in(frame: int, *boxes: Sequence[float], status: str = "tracking") -> Targets:
    count = len(boxes)
    rows = np.array(boxes, dtype=float).reshape(-1, 4)
    return Targets(frame, np.arange(count) + 1, rows, np.ones(count), np.full(count, status, dtype="U9"))


def shown(frame: int, *boxes: Sequence[float], camera: int = 0, age: float = 0.5) -> PeopleInFrame:
    picture = Frame(frame, frame / 10, NOISE)
    return PeopleInFrame(camera, f"camera {camera}", time.time() - age, picture, people_in(frame, *boxes))


@pytest.fixture
def board() -> Board:
    return Board("gate", SCENE, ["rtsp://user:secret@gate/1", "camera 1"])


@pytest.fixture
def client(board: Board) -> TestClient:
    return TestClient(application(board, TOKEN, 8000), base_url=f"http://{HOST}/{TOKEN}/")


# ---- Who may ask


@pytest.mark.parametrize("path", ["", "state", "picture/0", "main.js"])
@pytest.mark.parametrize("token", ["", "/t0ke", "/T0KEN", "/health"])
def test_without_the_token_nothing_of_the_page_is_given(client: TestClient, path: str, token: str) -> None:
    if (token, path) != ("/health", ""):
        assert client.get(f"http://{HOST}{token}/{path}").status_code == 403


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Sec-Fetch-Site": "cross-site"}],
    ids=str,
)
@pytest.mark.parametrize("path", ["/health", "/metrics", f"/{TOKEN}/state", f"/{TOKEN}/picture/0"])
def test_another_site_or_host_is_refused_everything(client: TestClient, headers: dict[str, str], path: str) -> None:
    assert client.get(f"http://{HOST}{path}", headers=headers).status_code == 403


def test_answers_forbid_to_keep_them_and_other_sites(client: TestClient) -> None:
    for path in (f"/{TOKEN}/", "/health"):
        headers = client.get(f"http://{HOST}{path}").headers
        assert headers["Cache-Control"] == "no-store"
        assert "default-src 'none'" in headers["Content-Security-Policy"]


# ---- What there is


def test_the_page_has_pictures_counts_and_the_state_of_each_camera(board: Board, client: TestClient) -> None:
    assert client.get("picture/0").status_code == 404
    for frame in range(20):
        board(shown(frame, [8 * frame, 20, 8 * frame + 10, 60]))
    first, second = client.get("state").json()["cameras"]
    assert first["name"] == "rtsp://gate/1"
    assert (first["frames"], first["frame"], first["people"], first["away"]) == (20, 20, 1, False)
    assert first["delay"] == pytest.approx(0.5, abs=0.3)
    assert first["lines"] == {"door": {"in": 0, "out": 1}}
    assert first["zones"] == {"shop": {"people": 1, "entered": 0, "left": 0}}
    assert (second["frames"], second["people"], second["delay"]) == (0, 0, None)
    picture = Image.open(BytesIO(client.get("picture/0").content))
    assert (picture.format, picture.size) == ("JPEG", SIZE[::-1])
    for path in ("picture/7", "picture/1001", "picture/x", "nothing"):
        assert client.get(path).status_code == 404
    assert "<title>Live</title>" in client.get("").text
    board.close()
    assert client.get("picture/0").status_code == 404


def test_a_large_picture_is_sent_smaller(board: Board, client: TestClient) -> None:
    large = Frame(0, 0.0, np.zeros((1080, 1920, 3), np.uint8))
    board(PeopleInFrame(0, "gate", time.time(), large, people_in(0)))
    assert Image.open(BytesIO(client.get("picture/0").content)).size == (960, 540)


def test_people_on_a_floor_are_shown_in_each_camera(board: Board, client: TestClient) -> None:
    boxes, none = people_in(3, [10, 20, 20, 60]), np.empty(0)
    picture = Frame(3, 0.3, NOISE)
    board(PeopleOnFloor(time.time(), 3, none, none, none, none, none, none, (None, picture), (None, boxes)))  # type: ignore[arg-type]
    assert [camera["people"] for camera in client.get("state").json()["cameras"]] == [0, 1]


# ---- Health


def test_health_says_waiting_ok_degraded_and_stalled(
    board: Board, client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def status() -> tuple[str, int]:
        answer = client.get(f"http://{HOST}/health")
        return answer.json()["status"], answer.status_code

    assert status() == ("waiting", 200)
    board(shown(0))
    assert status() == ("ok", 200)
    board(CameraOutage(1, "camera 1", time.time()))
    assert status() == ("degraded", 200)
    monkeypatch.setattr(board_module, "STALLED", -1.0)
    assert status() == ("stalled", 503)
    # All are away: the run waits for them, as it shall.
    board(CameraOutage(0, "gate", time.time()))
    assert status() == ("degraded", 200)
    monkeypatch.undo()
    board(CameraOutage(0, "gate", time.time(), 12.5))
    board(CameraOutage(1, "camera 1", time.time(), 3.0))
    assert status() == ("ok", 200)


def test_metrics_are_prometheus_text_of_every_camera(board: Board, client: TestClient) -> None:
    board(shown(0, [1, 2, 30, 40]))
    board(CameraOutage(0, "gate", time.time()))
    board(CameraOutage(0, "gate", time.time(), 12.5))
    answer = client.get(f"http://{HOST}/metrics")
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    # The grammar of the format: comments that name a metric, and samples with labels and a number.
    sample = r'[a-z_]+(\{camera="(\\.|[^"\\\n])*"\})? -?[\d.e+]+'
    for line in answer.text.splitlines():
        assert re.fullmatch(rf"# (HELP [a-z_]+ .+|TYPE [a-z_]+ (counter|gauge))|{sample}", line), line
    values = dict(line.rsplit(" ", 1) for line in answer.text.splitlines() if line[0] != "#")
    gate = '{camera="rtsp://gate/1"}'
    assert values[f"tsuiseki_frames_total{gate}"] == "1"
    assert values[f"tsuiseki_outage_seconds_total{gate}"] == "12.5"
    assert values[f"tsuiseki_outages_total{gate}"] == values[f"tsuiseki_people{gate}"] == "1"
    assert values['tsuiseki_camera_up{camera="camera 1"}'] == "1"
    names = re.findall(r"# TYPE (\w+)", answer.text)
    assert len(names) == len(set(names))


def test_names_of_cameras_are_escaped_in_metrics() -> None:
    assert 'camera="a\\"b\\\\c\\nd"' in metrics_text(Board("x", cameras=['a"b\\c\nd']))


def test_counts_of_a_loop_that_counts_itself_are_taken_over() -> None:
    state = CameraState("gate", frames=90, dropped=7, outages=2, away=True)
    (camera,) = Board("x", cameras=[state]).cameras()
    assert (camera["frames"], camera["dropped"], camera["outages"], camera["away"]) == (90, 7, 2, True)


def test_memory_is_that_of_this_process() -> None:
    assert memory() == pytest.approx(psutil.Process().memory_info().rss, rel=0.1)


def test_a_port_in_use_gives_another_one() -> None:
    with listening(0) as first, listening(first.getsockname()[1]) as second:
        assert second.getsockname()[1] not in (0, first.getsockname()[1])


# ---- Hidden people


def nobody(images: Sequence[ImageArray]) -> list[Detections]:
    return [Detections.empty() for _ in images]


def someone(images: Sequence[ImageArray]) -> list[Detections]:
    return [Detections(np.array([[100.0, 40, 120, 100]]), np.array([0.06])) for _ in images]


def finder(detect: Callable[[Sequence[ImageArray]], list[Detections]]) -> Detect:
    return SimpleNamespace(detect=detect)


def changed(board: Board) -> Any:
    """``(H, W)`` which pixels of the picture are not those of the camera."""
    picture = board.picture(0)
    assert picture is not None
    return (picture != NOISE).any(axis=2)


def test_people_of_tracks_and_of_a_second_detection_are_hidden() -> None:
    board = Board("gate", cameras=["gate"], pictures=PictureMaker(Hidden(finder(someone))))
    board(shown(0, [20, 30, 40, 90]))
    there = changed(board)
    # The box and a fifth around it; what is seen through a block of eight pixels by chance is none.
    assert there[18:102, 16:44].mean() > 0.98
    assert there[28:112, 96:124].mean() > 0.98
    assert not there[:100, 60:90].any()


def test_who_is_missed_stays_hidden_for_a_second() -> None:
    board = Board("gate", cameras=["gate"], pictures=PictureMaker(Hidden(finder(nobody))))
    board(shown(0, [20, 30, 40, 90]))
    board(shown(round(10 * HOLD)))
    assert changed(board)[30:90, 20:40].mean() > 0.98
    board(shown(round(10 * HOLD) + 1))
    assert not changed(board)[:90].any()


def test_heads_alone_are_hidden_and_whom_the_user_names_stays_visible() -> None:
    box, other = [20, 30, 40, 90], [100, 40, 120, 100]
    heads = Board("gate", cameras=["gate"], pictures=PictureMaker(Hidden(finder(nobody), heads=True)))
    heads(shown(0, box))
    assert changed(heads)[30:45, 22:38].mean() > 0.98
    assert not changed(heads)[62:88, 23:37].any()
    visible = Board("gate", cameras=["gate"], pictures=PictureMaker(Hidden(finder(someone), visible=frozenset({2}))))
    visible(shown(0, box, other))
    assert changed(visible)[30:90, 20:40].mean() > 0.98
    assert not changed(visible)[45:98, 103:117].any()


def test_a_picture_is_made_once_and_hides_before_it_draws() -> None:
    calls = []

    def counting(images: Sequence[ImageArray]) -> list[Detections]:
        calls.append(len(images))
        return nobody(images)

    board = Board("gate", cameras=["gate"], pictures=PictureMaker(Hidden(finder(counting))))
    board(shown(0, [20, 30, 40, 90]))
    assert board.picture(0) is board.picture(0)
    assert calls == [1]


# ---- A window


@pytest.mark.parametrize(("build", "words"), [("  GUI:  NONE", "needs an OpenCV that opens windows"), ("", "needs an")])
def test_a_build_without_windows_is_refused_in_a_line(build: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: build)
    with pytest.raises(RequestError, match=words):
        check_window()


def test_without_a_display_a_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "  GUI:   GTK3\n")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(window_module.sys, "platform", "linux")
    with pytest.raises(RequestError, match="needs a display"):
        check_window()
    monkeypatch.setenv("DISPLAY", ":0")
    check_window()


def test_a_window_shows_pictures_a_few_times_a_second_and_q_ends_the_run(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    images, raised, now = [], [], [0.0]
    monkeypatch.setattr(cv2, "imshow", lambda name, image: images.append((name, image)))
    monkeypatch.setattr(cv2, "waitKey", lambda _: ord("q") if now[0] > 1.95 else -1)
    monkeypatch.setattr(signal, "raise_signal", raised.append)
    window = Window(board, lambda: now[0])
    for frame in range(20):
        now[0] = frame / 10
        happening = shown(frame, [10, 20, 30, 60])
        board(happening)
        window(happening)
    window(CameraOutage(1, "camera 1", 0.0))
    assert len(images) == 10
    assert images[0][0] == "rtsp://gate/1"
    assert (images[0][1][65:90, 40:75] == NOISE[65:90, 40:75, ::-1]).all()
    assert raised == []
    now[0] = 3.0
    window(happening)
    assert raised == [signal.SIGINT]


# ---- The command


def clip(folder: Path) -> list[str]:
    """Words that track somebody who stands in four pictures, into the folder ``o``."""
    (folder / "clip").mkdir()
    for number in range(4):
        cv2.imwrite(str(folder / f"clip/{number}.png"), NOISE[..., ::-1])
    (folder / "det.txt").write_text("".join(f"{n},-1,20,20,20,60,0.9\n" for n in range(1, 5)))
    words = ["track", "people", str(folder / "clip"), "--detections", str(folder / "det.txt")]
    return [*words, "--out", str(folder / "o")]


@pytest.mark.parametrize("hide", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_run_serves_its_page_while_it_goes_on(
    hide: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers, call, opened = list[Any](), Board.__call__, page_server.listening
    ports = list[int]()

    def noting(port: int) -> Any:
        opened_here = opened(port)
        ports.append(opened_here.getsockname()[1])
        return opened_here

    def asking(board: Board, happening: Any) -> None:
        call(board, happening)
        if happening.frame.index == 3:
            base = f"http://127.0.0.1:{ports[0]}"
            answers.append(requests.get(f"{base}/health", timeout=10).json())
            picture = requests.get(f"{base}/{token_of(tmp_path / 'o')}/picture/0", timeout=10)
            assert picture.status_code == 200, picture.text
            answers.append(picture.content)

    monkeypatch.setattr(page_server, "listening", noting)
    monkeypatch.setattr(Board, "__call__", asking)
    more = ["--method", "sort", "--sort.min-hits", "1", "--fps", "10", "--page", "0"]
    assert main([*clip(tmp_path), *more, *(["--hide", "people"] if hide else [])]) == 0
    health, picture = answers
    assert (health["status"], health["cameras"][0]["name"], health["cameras"][0]["frames"]) == ("ok", "clip", 4)
    pixels = np.asarray(Image.open(BytesIO(picture)))
    same = np.abs(pixels[35:70, 25:35].astype(int) - NOISE[35:70, 25:35]).mean()
    # JPEG changes noise by about 30 levels, hiding it by about 64.
    assert (same > 50) == hide
    assert f"live page: http://127.0.0.1:{ports[0]}/" in capsys.readouterr().err
    with pytest.raises(requests.ConnectionError):
        requests.get(f"http://127.0.0.1:{ports[0]}/health", timeout=1)


@pytest.mark.parametrize(
    ("more", "line"),
    [
        (["--page", "8000", "--method", "flow"], "--page and --show need a method that answers while it runs"),
        (["--page", "99999", "--method", "sort"], "--page: expected"),
        (["--show", "--method", "sort"], "--show needs"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_a_line(
    more: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "")
    words = clip(tmp_path)
    more = [*more, "--affinity", "none", "--appearance", "none"] if "flow" in more else more
    assert main([*words, *more]) == 2
    assert line in capsys.readouterr().err
    assert not (tmp_path / "o").exists()
