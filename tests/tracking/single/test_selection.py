"""The page on which the user draws the target, asked as a browser asks."""

import json
import queue
import re
import threading
import urllib.error
import urllib.request

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.report import drawing
from tsuiseki.tracking.single import selection

IMAGE = np.zeros((60, 80, 3), np.uint8)
IMAGE[10:30, 20:40] = (200, 50, 0)


@pytest.fixture
def page(monkeypatch):
    """The address of the page that the browser is told, and the box once it is drawn."""
    addresses, drawn = queue.Queue(), []
    monkeypatch.setattr(drawing, "_has_display", lambda: True)
    monkeypatch.setattr(drawing.webbrowser, "open", addresses.put)
    thread = threading.Thread(target=lambda: drawn.append(selection.select_box(IMAGE)), daemon=True)
    thread.start()
    address = addresses.get(timeout=5)
    yield address, drawn, thread
    if thread.is_alive():
        post(f"{address}answer", [0, 0, 10, 10])
    thread.join(5)


def post(address, content):
    request = urllib.request.Request(address, json.dumps(content).encode(), method="POST")
    return urllib.request.urlopen(request, timeout=5).read().decode()


def test_the_page_shows_the_image_and_takes_the_box(page):
    address, drawn, thread = page
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\S{10,}/", address)
    assert "image.png" in urllib.request.urlopen(address, timeout=5).read().decode()
    content = np.frombuffer(urllib.request.urlopen(f"{address}image.png", timeout=5).read(), np.uint8)
    assert np.array_equal(cv2.imdecode(content, cv2.IMREAD_COLOR)[..., ::-1], IMAGE)
    assert post(f"{address}answer", [20, 10.5, 20, 20]) == ""
    thread.join(5)
    assert drawn[0].tolist() == [20, 10.5, 40, 30.5]


@pytest.mark.parametrize(
    ("content", "said"),
    [([1, 2], "four numbers"), ("a box", "four numbers"), ([1, 2, float("nan"), 4], "four numbers"),
     ([10, 10, 1, 30], "at least 2 x 2"), ([90, 10, 20, 20], "inside the image")],
)  # fmt: skip
def test_what_is_no_box_is_refused_and_can_be_drawn_again(page, content, said):
    address, _, thread = page
    with pytest.raises(urllib.error.HTTPError) as refused:
        post(f"{address}answer", content)
    assert refused.value.code == 400
    assert said in refused.value.read().decode()
    assert thread.is_alive()


def test_a_box_that_reaches_out_of_the_image_is_cut(page):
    address, drawn, thread = page
    post(f"{address}answer", [-5, 40, 30, 50])
    thread.join(5)
    assert drawn[0].tolist() == [0, 40, 25, 60]


def test_nobody_finds_the_page_by_its_port(page):
    address, _, thread = page
    root = re.match(r"http://[^/]+/", address)[0]
    for place in (root, f"{root}image.png"):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(place, timeout=5)
    with pytest.raises(urllib.error.HTTPError, match="403"):
        post(f"{root}answer", [1, 2, 30, 40])
    assert thread.is_alive()
