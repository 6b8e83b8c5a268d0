"""Tracks are drawn where they are, in colours that tell them apart, and the frames stay as they were."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.report.overlay import (
    NOISE_LEVELS,
    Overlay,
    draw_label,
    line_unit,
    track_colour,
    without_flicker,
    write_drawn,
)
from tsuiseki.tracking.types import Frame, ImageArray, Track
from tsuiseki.tracking.video.source import open_source


def grey(index: int) -> Frame:
    return Frame(index, index / 10, np.full((120, 160, 3), 128, dtype=np.uint8))


def still(identity: int, frames: range, x: float, observed: bool = True) -> Track:
    count = len(frames)
    box = np.tile([x, 40.0, x + 30, 100.0], (count, 1))
    return Track(identity, np.array(frames), box, np.ones(count), np.full(count, observed))


def coloured(image: ImageArray, identity: int) -> int:
    """Number of pixels in the colour of a track."""
    return int((np.abs(image.astype(int) - track_colour(identity)).max(axis=2) < 20).sum())


def test_neighbouring_ids_have_colours_apart() -> None:
    colours = np.array([track_colour(n) for n in range(1, 40)], dtype=float)
    near = [np.abs(a - b).max() for a, b in itertools.pairwise(colours)]
    assert min(near) > 100


def test_a_box_is_drawn_in_its_frames_only() -> None:
    overlay = Overlay([still(5, range(3, 6), 60)], frame_rate=10)
    for index in range(8):
        frame = grey(index)
        drawn = overlay.draw(frame)
        assert (coloured(drawn, 5) > 100) == (3 <= index < 6)
        assert (frame.image == 128).all()
    inside = drawn[55:85, 75:80]
    assert (inside == 128).all()


def test_trails_show_the_way_of_the_feet_or_nothing() -> None:
    track = still(5, range(2), 20)
    track.boxes[1] += [100, 0, 100, 0]
    between = slice(95, 106), slice(60, 110)
    for seconds, lines in ((1.0, True), (0.0, False)):
        drawn = Overlay([track], 10, trail_seconds=seconds).draw(grey(1))
        assert (coloured(drawn[between], 5) > 0) == lines


def test_a_box_without_detection_is_dashed() -> None:
    seen = Overlay([still(5, range(1), 60)], 10).draw(grey(0))
    filled_in = Overlay([still(5, range(1), 60, observed=False)], 10).draw(grey(0))
    left_edge = slice(50, 90), slice(58, 63)
    assert coloured(filled_in[left_edge], 5) < 0.75 * coloured(seen[left_edge], 5)
    assert coloured(filled_in[left_edge], 5) > 0.25 * coloured(seen[left_edge], 5)


def test_boxes_far_outside_the_image_do_no_harm() -> None:
    wild = [still(1, range(1), 1e6), still(2, range(1), -1e6, observed=False), still(3, range(1), 150, observed=False)]
    assert Overlay(wild, 10).draw(grey(0)).shape == (120, 160, 3)


def test_the_overlay_has_all_frames_and_no_tracks_are_fine(tmp_path: Path) -> None:
    write_drawn(tmp_path / "o.webm", (grey(n) for n in range(7)), 10, Overlay([], 10).draw)
    assert len(list(open_source(tmp_path / "o.webm").frames())) == 7


def test_noise_stands_still_and_movement_does_not() -> None:
    rng = np.random.default_rng(0)
    before = rng.integers(60, 180, (40, 60, 3), dtype=np.uint8)
    after = before + rng.integers(0, NOISE_LEVELS + 1, before.shape, dtype=np.uint8)
    after[10:20, 30:40] += 60
    calm = without_flicker(after, before)
    np.testing.assert_array_equal(calm[11:19, 31:39], after[11:19, 31:39])
    moved = np.zeros((40, 60), dtype=bool)
    moved[10:20, 30:40] = True
    np.testing.assert_array_equal(calm[~moved], before[~moved])
    np.testing.assert_array_equal(without_flicker(after, None), after)


def test_letters_and_lines_grow_with_the_picture() -> None:
    small, large = np.zeros((270, 480, 3), np.uint8), np.zeros((2160, 3840, 3), np.uint8)
    for image in (small, large):
        draw_label(image, "12", (20, image.shape[0] - 20), (255, 255, 255))
    heights = [int(image.any(axis=(1, 2)).sum()) for image in (small, large)]
    assert heights[1] == pytest.approx(4 * heights[0], abs=8)
    assert (line_unit(small), line_unit(large)) == (1.0, 4.0)
