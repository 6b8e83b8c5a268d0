"""`tsuiseki scene`: the page on which the user draws, asked as a browser asks."""

import json
import queue
import threading
import urllib.error
import urllib.request

import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.counts.scene import read_scene
from tsuiseki.tracking.report import drawing

DRAWN = {
    "size": [64, 48],
    "lines": [{"name": "door", "from": [1, 2], "to": [30, 2.5]}],
    "zones": [{"name": "shop", "corners": [[0, 10], [20, 10], [20, 40]]}],
    "ignored": [],
}


def post(address, content):
    request = urllib.request.Request(f"{address}answer", json.dumps(content).encode(), method="POST")
    return urllib.request.urlopen(request, timeout=5).read().decode()


def test_the_command_writes_what_is_drawn(tmp_path, inputs, monkeypatch):
    addresses, refused = queue.Queue(), []
    monkeypatch.setattr(drawing, "_has_display", lambda: True)
    monkeypatch.setattr(drawing.webbrowser, "open", addresses.put)

    def browse():
        address = addresses.get(timeout=20)
        assert "image.png" in urllib.request.urlopen(address, timeout=5).read().decode()
        for wrong in ({**DRAWN, "size": [9, 9]}, [], {**DRAWN, "lines": DRAWN["lines"] * 2}, {**DRAWN, "camera": "a"}):
            try:
                post(address, wrong)
            except urllib.error.HTTPError as error:
                refused.append(error.read().decode())
        post(address, DRAWN)

    thread = threading.Thread(target=browse, daemon=True)
    thread.start()
    out = tmp_path / "scene.yaml"
    assert main(["scene", str(inputs.video), "--out", str(out)]) == 0
    thread.join(5)
    assert len(refused) == 4
    assert "door twice" in refused[2]
    scene = read_scene(out)
    assert scene.size == (64, 48)
    assert scene.lines[0].ends.tolist() == [[1, 2], [30, 2.5]]
    assert scene.zones[0].name == "shop"


@pytest.mark.parametrize("there", [True, False])
def test_what_cannot_be_written_or_read_is_refused_at_once(tmp_path, inputs, capsys, there):
    out = tmp_path / "scene.yaml"
    out.write_text("kept") if there else None
    assert main(["scene", str(inputs.video if there else tmp_path / "none.mp4"), "--out", str(out)]) == 2
    assert ("already exists" if there else "none.mp4") in capsys.readouterr().err
