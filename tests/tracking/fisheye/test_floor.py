"""Floor plan, dwell map and rotated boxes in the overlay."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from tsuiseki.tracking.fisheye.page import (
    camera_floor,
    corners,
    draw_floor_tracks,
    dwell_figure,
    dwell_seconds,
    floor_page,
)
from tsuiseki.tracking.formats.world_tables import FLOOR_HEADER, write_world
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import FloorTrack

FLOOR = np.array([0.0, 0.0, 4.0, 3.0])


def somebody(identity=1, frames=20):
    place = np.tile([1.05, 2.05], (frames, 1))
    rotated = np.tile([50.0, 60.0, 20.0, 40.0, np.pi / 2], (frames, 1))
    boxes = np.tile([30.0, 50.0, 70.0, 70.0], (frames, 1))
    return FloorTrack(Track(identity, np.arange(frames), boxes, np.ones(frames)), rotated, place)


def test_somebody_who_stands_spends_all_the_time_there():
    seconds = dwell_seconds([somebody()], FLOOR, 10.0)
    assert np.isclose(seconds.sum(), 2.0, rtol=1e-3)
    row, column = np.unravel_index(seconds.argmax(), seconds.shape)
    assert (row, column) == (20, 10)


def test_the_head_is_on_the_right_after_a_quarter_turn():
    head, _, feet, _ = corners(np.array([[50.0, 60.0, 20.0, 40.0, np.pi / 2]]))[0]
    assert np.isclose(head[0], 70)
    assert np.isclose(feet[0], 30)


def test_the_overlay_leaves_the_frame_alone_and_draws():
    image = np.zeros((100, 120, 3), dtype=np.uint8)
    drawn = draw_floor_tracks(image, [somebody()], 5, 10)
    assert not image.any()
    assert drawn[40:80, 28:72].any()
    assert not draw_floor_tracks(image, [somebody()], 50, 10)[:80].any()


def test_the_world_file(tmp_path):
    write_world(tmp_path / "world.csv", [somebody(2, 3), somebody(1, 3)], lambda frames: frames / 2.0)
    lines = (tmp_path / "world.csv").read_text().splitlines()
    assert lines[0] == FLOOR_HEADER
    assert lines[1] == "1,0.0000,1.0500,2.0500,31.00,51.00,40.00,20.00,50.00,60.00,20.00,40.00,90.00"
    assert [line.split(",")[:2] for line in lines[1:5]] == [
        ["1", "0.0000"],
        ["2", "0.0000"],
        ["1", "0.5000"],
        ["2", "0.5000"],
    ]


def test_names_on_the_page_are_escaped(tmp_path):
    placed = SimpleNamespace(name="<b>", camera=SimpleNamespace(position=np.array([2.0, 1.5, 3.0])))
    ceiling = SimpleNamespace(placed=placed, floor=FLOOR, rate=10.0)
    page = floor_page([camera_floor(ceiling, [somebody()], tmp_path)], {"detect": 0.1}, {"source": "<i>"}, {})
    assert "<b>" not in page
    assert "&lt;i&gt;" in page


def test_an_empty_dwell_map_says_so() -> None:
    (empty,) = dwell_figure([], FLOOR, 10.0).axes
    assert [text.get_text() for text in empty.texts] == ["no person was here"]
    assert not empty.images
    plan, bar = dwell_figure([somebody()], FLOOR, 10.0).axes
    assert plan.images
    assert not plan.texts
    assert "seconds" in bar.get_ylabel()
