"""`tsuiseki review` in a real browser: questions, corrections, a killed server, and many people."""

from __future__ import annotations

import signal

import numpy as np
import pytest

from tests.tracking.review.conftest import FRAMES, PEOPLE, SIZE, walkers
from tsuiseki.tracking.result import Result

SCRUB = """async () => {
  const [scrub, boxes] = ["scrub", "boxes"].map((name) => document.getElementById(name)), frames = Number(scrub.max);
  const next = () => new Promise(requestAnimationFrame);
  const before = Number(boxes.dataset.drawn), begin = performance.now();
  for (let k = 1; performance.now() - begin < 2000; k++) {
    scrub.value = (k * 37) % frames;
    scrub.dispatchEvent(new Event("input"));
    await next();
  }
  return (Number(boxes.dataset.drawn) - before) / (performance.now() - begin) * 1000;
}"""


@pytest.fixture
def opened(browser):
    """Opens an address; returns the page, which may not meet an error."""
    wrong = []

    def open_page(address, **how):
        page = browser.new_page(**{"viewport": {"width": 1366, "height": 768}, **how})
        page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(address)
        page.locator("#boxes[data-drawn]").wait_for(state="attached")
        return page

    yield open_page
    # What Chromium says of a server that is killed: before an answer, or in the middle of one.
    killed = ("ERR_CONNECTION", "Failed to fetch", "ERR_CONTENT_LENGTH_MISMATCH")
    assert [line for line in wrong if not any(text in line for text in killed)] == []


def to_frame(page, frame):
    page.locator("#scrub").evaluate(
        "(scrub, to) => { scrub.value = to; scrub.dispatchEvent(new Event('input')); }", frame
    )
    page.locator(f'#boxes[data-frame="{frame}"]').wait_for(state="attached")


def place(page, x, y):
    """Where a point of the video is on the screen."""
    box = page.locator("#boxes").bounding_box()
    scale = min(box["width"] / SIZE[0], box["height"] / SIZE[1])
    left, top = ((box[side] - full * scale) / 2 for side, full in zip(("width", "height"), SIZE, strict=True))
    return box["x"] + left + x * scale, box["y"] + top + y * scale


def centre(track, frame):
    x1, y1, x2, y2 = track.boxes[track.frames.tolist().index(frame)]
    return (x1 + x2) / 2, (y1 + y2) / 2


def changed(page, act):
    """Do something that changes the tracks, and wait for the answer."""
    before = int(page.locator("#boxes").get_attribute("data-changes") or 0)
    act()
    page.locator(f'#boxes[data-changes="{before + 1}"]').wait_for(state="attached")


def ids_at(page, frame):
    """By id the left edges of the boxes in a frame, as the server has them."""
    rows = np.frombuffer(page.request.get(f"{page.url}boxes/{frame // 500}").body(), np.int32).reshape(-1, 7)
    here = rows[rows[:, 0] == frame]
    return dict(zip(here[:, 1].tolist(), here[:, 2:3].copy().view(np.float32)[:, 0].tolist(), strict=True))


def test_nothing_is_lost_when_the_server_is_killed(reviewable, started, opened):
    process, address = started(reviewable)
    page = opened(address)
    for number in range(1, 6):
        changed(page, lambda: page.keyboard.press("y"))
        assert page.locator("#progress").inner_text().startswith(f"{number} answered")
    one, two = walkers(PEOPLE, FRAMES, SIZE)[2:4]
    at = 70
    to_frame(page, at)
    page.keyboard.press("Escape")
    for track in (one, two):
        page.mouse.click(*place(page, *centre(track, at)))
    assert page.locator("#chosen").inner_text() == f"3 in frame {at + 1} and 4 in frame {at + 1}"
    earlier, before = ids_at(page, at - 5), ids_at(page, at + 5)
    changed(page, lambda: page.keyboard.press("x"))
    exchanged = ids_at(page, at + 5)
    assert (exchanged[3], exchanged[4]) == (before[4], before[3])
    assert ids_at(page, at - 5) == earlier
    changed(page, lambda: page.keyboard.press("Control+z"))
    assert ids_at(page, at + 5) == before
    changed(page, lambda: page.keyboard.press("Control+Shift+Z"))

    process.send_signal(signal.SIGKILL)
    process.wait()
    page.get_by_text("The server is gone").wait_for()
    _, again = started(reviewable)
    assert again == address
    page.get_by_text("The server is gone").wait_for(state="hidden")
    assert page.locator("#progress").inner_text().startswith("6 answered")
    assert ids_at(page, at + 5) == exchanged
    changed(page, lambda: page.keyboard.press("Control+z"))
    assert ids_at(page, at + 5) == before


def test_a_question_leads_to_its_place_and_a_track_is_parted_there(reviewable, started, opened):
    page = opened(started(reviewable)[1])
    to_frame(page, 0)
    page.locator("#loop-no").click()
    page.locator('#boxes[data-frame="0"]').wait_for(state="detached")
    at = 40
    to_frame(page, at)
    page.keyboard.press("Escape")
    page.mouse.click(*place(page, *centre(walkers(PEOPLE, FRAMES, SIZE)[4], at)))
    changed(page, lambda: page.keyboard.press("p"))
    assert (5 in ids_at(page, at - 1)) != (5 in ids_at(page, at))
    assert len(ids_at(page, at)) == PEOPLE


def test_the_bars_fit_a_telephone(reviewable, started, opened):
    page = opened(started(reviewable)[1], viewport={"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    bars = "[...document.querySelectorAll('header *, #transport *')].map(part => part.getBoundingClientRect().right)"
    assert max(page.evaluate(bars)) <= 390


def test_boxes_are_moved_added_and_named_with_a_finger(reviewable, started, opened):
    page = opened(started(reviewable)[1], viewport={"width": 820, "height": 1180}, has_touch=True)
    to_frame(page, 10)
    page.keyboard.press("Escape")
    track = walkers(PEOPLE, FRAMES, SIZE)[4]
    middle = place(page, *centre(track, 10))
    page.touchscreen.tap(*middle)
    assert page.locator("#chosen").inner_text() == "5 in frame 11"
    page.locator("#called").fill("Anna")
    changed(page, lambda: page.locator("#called").press("Enter"))
    assert page.locator("#here").inner_text().split("\n")[4] == "5 Anna"

    def drag():
        page.mouse.move(*middle)
        page.mouse.down()
        page.mouse.move(middle[0] + 10, middle[1])
        page.mouse.move(*place(page, centre(track, 10)[0] + 12, centre(track, 10)[1]))
        page.mouse.up()

    changed(page, drag)
    assert ids_at(page, 10)[5] == pytest.approx(track.boxes[10, 0] + 12, abs=2)
    page.keyboard.press("Escape")
    page.locator("#add").click()

    def draw():
        page.mouse.move(*place(page, 200, 105))
        page.mouse.down()
        page.mouse.move(*place(page, 210, 120))
        page.mouse.move(*place(page, 230, 175))
        page.mouse.up()

    changed(page, draw)
    assert len(ids_at(page, 10)) == PEOPLE + 1


def test_scrubbing_through_many_people_stays_quick(tmp_path, started, opened, record_property):
    known = {"frame_rate": 25.0, "size": SIZE, "frames": {"frame": [*range(10_000)]}}
    Result(walkers(30, 10_000, SIZE), **known).save(tmp_path / "result")
    page = opened(started(tmp_path / "result")[1])
    page.get_by_text("Boxes are on a plain background").wait_for()
    page.wait_for_timeout(2000)  # all boxes come by themselves
    rate = page.evaluate(SCRUB)
    record_property("frames_a_second", rate)
    print(f"{rate:.0f} frames a second")
    # On an idle laptop 60; other programs may take most of it.
    assert rate > 15
