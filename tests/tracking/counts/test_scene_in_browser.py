"""`tsuiseki scene` in a real browser: a line and a zone are drawn with the mouse, a length by keys."""

from __future__ import annotations

import queue
import threading

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.scene import read_scene
from tsuiseki.tracking.report import drawing


def test_a_line_drawn_with_the_mouse_is_in_the_file(tmp_path, inputs, monkeypatch, browser, capsys):
    addresses, statuses, out = queue.Queue(), queue.Queue(), tmp_path / "scene.yaml"
    monkeypatch.setattr(drawing, "_has_display", lambda: True)
    monkeypatch.setattr(drawing.webbrowser, "open", addresses.put)
    command = ["scene", str(inputs.video), "--out", str(out)]
    threading.Thread(target=lambda: statuses.put(main(command)), daemon=True).start()
    page, wrong = browser.new_page(), []
    page.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.goto(addresses.get(timeout=20))
    box = page.locator("img").bounding_box()
    # As large as fits: the video is 64 pixels wide.
    assert box["width"] > 300
    for x, y in ((16, 12), (48, 36)):
        page.mouse.click(box["x"] + x * box["width"] / 64, box["y"] + y * box["height"] / 48)
    page.get_by_label("Draw a").select_option("zones")
    page.get_by_label("named").fill("shop")
    for x, y in ((2, 2), (30, 2), (30, 40)):
        page.mouse.click(box["x"] + x * box["width"] / 64, box["y"] + y * box["height"] / 48)
    page.get_by_text("Close the polygon").click()
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    ends = "[...document.querySelectorAll('text')].map(text => text.getBBox()).map(box => [box.y, box.y + box.height])"
    first, second = sorted(page.evaluate(ends))
    assert first[1] <= second[0]
    assert [row.split(" Remove")[0] for row in page.locator("li").all_inner_texts()] == ["line 1", "zone shop"]
    page.get_by_text("Turn").click()
    page.get_by_label("Draw a").select_option("length")
    page.get_by_label("metres").fill("0,5")
    page.locator("#frame").focus()
    for keys in (["ArrowDown", "Enter", "Escape", "Enter"], ["ArrowRight"] * 10, ["Enter"]):
        for key in keys:
            page.keyboard.press(key)
    page.get_by_text("Save the scene").click()
    page.get_by_text("The scene is saved").wait_for()
    assert statuses.get(timeout=20) == 0
    assert capsys.readouterr().out == f"1 line, 1 zone: {out}\n"
    assert wrong == []
    scene = read_scene(out)
    assert abs(scene.lines[0].ends - [[48, 36], [16, 12]]).max() <= 0.6
    assert abs(scene.zones[0].corners - [[2, 2], [30, 2], [30, 40]]).max() <= 0.6
    assert scene.scale == 0.05
