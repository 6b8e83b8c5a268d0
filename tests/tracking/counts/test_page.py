"""The page of tracks: what it shows, what lies beside it, and how it looks in a browser."""

from __future__ import annotations

import base64
import csv
import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.tracking.counts.walkers import down, walker
from tsuiseki.tracking.counts.answer_plots import heat_values
from tsuiseki.tracking.counts.counting import count
from tsuiseki.tracking.counts.page import TrackedPage, with_page
from tsuiseki.tracking.counts.scene import Scene, SceneLine, SceneZone
from tsuiseki.tracking.report import pictures
from tsuiseki.tracking.report.pictures import frames_to_show, pictures_of
from tsuiseki.tracking.result import PageContent, Result
from tsuiseki.tracking.types import Frame

LINE = SceneLine("<b>door", np.array([[0.0, 100.0], [200.0, 100.0]]))
SCENE = Scene([LINE], [SceneZone("shop", np.array([[0.0, 100], [200, 100], [200, 300], [0, 300]]))], (640, 480))
SIZE = (640, 480)
TRACKS = [walker(down(60 + 30 * k, range(60 + 5 * k, 350, 10)), k + 1) for k in range(4)]


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A folder of images in which a red square stands where the first track is."""
    folder = tmp_path_factory.mktemp("video")
    for number in range(29):
        image = np.full((480, 640, 3), 90, dtype=np.uint8)
        x1, y1, x2, y2 = TRACKS[0].boxes[number].astype(int).tolist()
        image[y1:y2, x1:x2] = (0, 0, 255)
        cv2.imwrite(str(folder / f"{number:04d}.png"), image)
    return folder


def result_of(video, **known):
    return Result(TRACKS, str(video), 10.0, SIZE, frames={"frame": list(range(29))}, **known)


def images_in(page):
    found = re.findall(r"data:image/jpeg;base64,([^\"]+)", page)
    return [cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), cv2.IMREAD_COLOR) for one in found]


def test_the_page_of_a_result_has_crops_paths_and_numbers_beside_it(tmp_path, video):
    out = with_page(result_of(video)).save(tmp_path / "o")
    page = (out / "report.html").read_text()
    assert re.search(r"About 4 \(3-\d\) different people, in 4 tracks, in 29 frames at 10 a second: 2.9 seconds.", page)
    crops = images_in(page)[:12]
    middles = [crop[crop.shape[0] // 2, crop.shape[1] // 2] for crop in crops]
    assert [middle[2] > 200 and middle[0] < 60 for middle in middles] == [True] * 3 + [False] * 9
    linked = set(re.findall(r'href="(report/[^"]+)"', page))
    assert linked == {path.relative_to(out).as_posix() for path in (out / "report").iterdir()}
    rows = list(csv.DictReader((out / "report/people.csv").read_text().splitlines()))
    assert (rows[0]["id"], rows[0]["first"], rows[0]["last"]) == ("1", "0.0", "2.9")
    assert float(rows[0]["path"]) == pytest.approx(290, abs=15)
    assert json.loads((out / "run.json").read_text())["files"]


@pytest.mark.slow
def test_answers_bring_their_tables_and_text_stays_text(tmp_path, video):
    found = count(result_of(video), SCENE)
    page = TrackedPage(result_of(video), answers=found)
    for name, write in page.files().items():
        write(tmp_path / name, tmp_path)
    assert json.loads((tmp_path / "answers.json").read_text())["lines"]["count"] == [4, 0]
    text = (tmp_path / "report.html").read_text()
    assert (tmp_path / "lines.csv").read_text().splitlines()[1].startswith("<b>door,in,4,")
    assert "&lt;b&gt;door" in text
    assert "<b>" not in text
    assert "shop, s" in text
    stayed = dict(zip(found.tables["stays"]["id"], found.tables["stays"]["seconds"], strict=True))
    assert f">{stayed[1]:.1f}</td>" in text
    written = {path.name for path in tmp_path.iterdir()}
    assert {"occupancy.png", "crossings.png", "places.png", "turns.csv"} <= written
    # A table that nobody is in has no section.
    unlinked = {name for name in written if name.endswith(".png")} - set(re.findall(r'href="([^"]+)"', text))
    assert unlinked <= {"turns.png"}


def test_nobody_is_a_page_too(tmp_path):
    out = with_page(Result([], "v", 10.0, SIZE, frames={"frame": [0, 1]})).save(tmp_path / "o")
    text = (out / "report.html").read_text()
    assert "No people were followed." in text
    assert "<svg" not in text
    assert images_in(text) == []


@pytest.mark.slow
def test_a_result_without_its_video_has_a_page_without_pictures(tmp_path, video):
    (tmp_path / "other.mp4").write_bytes(b"no video")
    for source in (str(tmp_path / "none.mp4"), str(tmp_path / "other.mp4"), ""):
        page = TrackedPage(replace(result_of(video), source=source)).html(tmp_path)
        assert len(images_in(page)) == 2
    (tmp_path / "other.mp4").write_bytes(b"no video")
    assert (
        len(images_in(TrackedPage(replace(result_of(video), source=str(tmp_path / "other.mp4"))).html(tmp_path))) == 2
    )


@pytest.mark.slow
def test_many_tracks_stay_below_the_size_of_a_page(tmp_path):
    rng = np.random.default_rng(0)
    every = [walker(np.array([300, 200]) + np.cumsum(rng.normal(0, 3, (60, 2)), axis=0), k + 1) for k in range(400)]
    noise = [Frame(n, n / 10, rng.integers(0, 256, (480, 640, 3)).astype(np.uint8)) for n in range(60)]
    page = TrackedPage(Result(every, "v", 10.0, SIZE))
    page.__dict__["pictures"] = pictures_of(noise, page.tracks)
    text = page.html(tmp_path)
    assert len(text) < 8_000_000
    assert text.count("<th scope=row>") < 150
    assert "and 300 more" in text


def test_heat_is_seconds_and_seconds_a_square_metre():
    standing = walker([(10, 10)] * 30, height=10)
    found = count(Result([standing], "v", 10.0, SIZE), Scene())
    seconds, unit = heat_values(found, found.paths.points)
    assert seconds.shape == (36, 48)
    assert (seconds[0, 0], seconds.sum(), unit) == (3, 3, "s in a cell")
    # A cell is 640 / 48 pixels wide, of 2 cm each.
    found = count(Result([standing], "v", 10.0, SIZE), Scene(scale=0.02))
    each, unit = heat_values(found, found.paths.points)
    assert each[0, 0] == pytest.approx(3 / (0.02 * 640 / 48) ** 2)
    assert unit == "s a square metre"


def test_the_view_is_what_does_not_move_and_frames_are_few():
    numbers = frames_to_show(TRACKS)
    assert len(numbers) <= 3 * len(TRACKS) + pictures.VIEWS
    frames = []
    for number in numbers:
        image = np.full((480, 640, 3), 90, dtype=np.uint8)
        image[:, 20 * number : 20 * number + 20] = 255
        frames.append(Frame(number, 0.0, image))
    found = pictures_of(frames, TRACKS)
    assert (found.view == 90).all()
    assert {key: len(crops) for key, crops in found.crops.items()} == {1: 3, 2: 3, 3: 3, 4: 3}


@pytest.mark.parametrize(("scheme", "width"), [("light", 1200), ("dark", 1200), ("light", 390)])
def test_a_browser_shows_it_without_errors_or_sideways_scrolling(tmp_path, video, browser, scheme, width):
    for name, write in TrackedPage(result_of(video), answers=count(result_of(video), SCENE)).files().items():
        write(tmp_path / name, tmp_path)
    page, wrong = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme), []
    page.on("console", lambda message: wrong.append(message.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto((tmp_path / "report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == width
    hidden = "[...document.querySelectorAll('.wide')].filter(part => part.scrollWidth > part.clientWidth)"
    assert page.evaluate(f"{hidden}.length") == 0
    assert page.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 0)")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", ground))) < 200) == (scheme == "dark")
    lines = page.locator("table").first.locator("tbody tr").all_inner_texts()
    assert [line.split("\t")[:3] for line in lines] == [["<b>door", "in", "4 (3-4)"], ["<b>door", "out", "0"]]
    focused = []
    for _ in range(12):
        page.keyboard.press("Tab")
        focused.append(page.evaluate("document.activeElement.className || document.activeElement.tagName"))
    assert {"wide", "A"} <= set(focused)
    assert wrong == []


def test_what_are_no_people_is_not_called_people(video):
    result = replace(result_of(video), page=PageContent(("fish", "fish")))
    page = TrackedPage(result, count(result, SCENE))
    assert "fish at a time" in page.headings("zones")
    assert [heading for table in page.answers.tables for heading in page.headings(table) if "people" in heading] == []
