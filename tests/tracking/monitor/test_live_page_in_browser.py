"""The live page in a real browser: pictures that change, numbers, narrow screens, a run that ends and starts again."""

from __future__ import annotations

import threading
import time

import pytest

from tests.tracking.monitor.test_board import SCENE, shown
from tsuiseki.tracking.monitor.board import Board
from tsuiseki.tracking.monitor.server import application
from tsuiseki.tracking.report.page_server import listening, serving
from tsuiseki.tracking.types.live import CameraOutage

pytestmark = pytest.mark.timeout(120)


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_shows_what_happens_and_goes_on_after_a_restart(browser, width, scheme):
    board, over, errors = Board("gate", SCENE, ["entrance", "yard"]), threading.Event(), []

    def run():
        frame = 0
        while not over.wait(0.05):
            board(shown(frame, [8 * (frame % 18), 20, 8 * (frame % 18) + 10, 60]))
            frame += 1

    page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    page.on("pageerror", lambda error: errors.append(str(error)))
    opened = listening(0)
    port = opened.getsockname()[1]
    thread = threading.Thread(target=run, daemon=True)
    with serving(application(board, "token", port), opened):
        page.goto(f"http://127.0.0.1:{port}/token/")
        page.get_by_text("No picture yet").first.wait_for()
        thread.start()
        first = page.locator("section").first
        page.locator("section[data-frame]").wait_for()
        before = first.get_attribute("data-frame")
        page.locator(f'section[data-frame]:not([data-frame="{before}"])').wait_for()
        assert first.locator("img").evaluate("image => image.naturalWidth") == 160
        assert first.locator(".state").inner_text() == "live"
        assert first.locator(".zones tbody tr").count() == 1
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        board(CameraOutage(1, "yard", time.time()))
        page.locator("section.away").wait_for()
    page.locator("#gone").wait_for()
    with serving(application(board, "token", port), listening(port)):
        page.locator("#gone").wait_for(state="hidden")
    over.set()
    page.close()
    assert errors == []
