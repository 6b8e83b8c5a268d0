"""Tiles over a frame: they cover it, doubles at seams become one, and only as many are taken as find more people."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.features.tiles import TiledDetector, busy_tiles, merge, parse_view, view_of
from tsuiseki.tracking.features.view_choice import ViewedDetector, choose_view
from tsuiseki.tracking.types import Detections, Frame

INPUT = (60, 80)
BRIGHT = 200


class MarkDetector:
    """Finds bright rectangles apart, if they are high enough once the picture is shrunk to the input."""

    input_size: tuple[int, int] | None = INPUT

    def __init__(self, smallest=8.0):
        self.smallest = smallest
        self.calls = []

    def detect(self, images):
        self.calls.append(len(images))
        return [self._found(image) for image in images]

    def _found(self, image):
        scale = min(INPUT[0] / image.shape[0], INPUT[1] / image.shape[1])
        _, _, marks, _ = cv2.connectedComponentsWithStats(np.uint8(image[..., 0] > BRIGHT // 2), connectivity=4)
        boxes = [[x, y, x + wide, y + high] for x, y, wide, high, _ in marks[1:] if high * scale >= self.smallest]
        return Detections(np.array(boxes, dtype=float).reshape(-1, 4), np.full(len(boxes), 0.9))


def frame_with(boxes, size=(240, 320)):
    image = np.zeros((*size, 3), np.uint8)
    for x1, y1, x2, y2 in boxes:
        image[y1:y2, x1:x2] = BRIGHT
    return image


@pytest.mark.parametrize("size", [(240, 320), (1080, 1920), (100, 300), (300, 100)])
@pytest.mark.parametrize("columns", [1, 2, 3, 5])
def test_tiles_cover_the_frame_overlap_and_have_the_shape_of_the_input(size, columns):
    view = view_of(size, columns, 4 / 3)
    covered = np.zeros(size, dtype=int)
    for x1, y1, x2, y2 in view.tiles[1:]:
        assert 0 <= x1 < x2 <= size[1]
        assert 0 <= y1 < y2 <= size[0]
        covered[y1:y2, x1:x2] += 1
    assert view.tiles[0].tolist() == [0, 0, size[1], size[0]]
    if columns == 1:
        assert len(view) == 1
        return
    assert covered.min() == 1
    assert covered.max() >= 2
    width, height = (view.tiles[1:, 2:] - view.tiles[1:, :2]).T
    whole_height = np.isclose(height, size[0])
    assert (whole_height | (np.abs(width / height - 4 / 3) < 1.5 / height)).all()  # pixels are whole


def test_rows_can_be_asked_for():
    assert len(view_of((100, 200), 3, 4 / 3, rows=2)) == 7
    assert parse_view("3x2") == (3, 2)
    assert parse_view("4") == (4, None)
    assert parse_view("auto") is None
    # An input of 80 pixels shows tiles of six across 1.67 times as large, and of seven across 1.95 times.
    viewed = ViewedDetector(MarkDetector(), parse_view("tiles"))
    assert viewed.prepare([frame_with([], size=(180, 240))]).view.columns == 6
    assert len(ViewedDetector(MarkDetector(), parse_view("tiles")).prepare([frame_with([], size=(60, 80))]).view) == 1


@pytest.mark.parametrize("text", ["", "0", "9", "3x0", "two", "3x2x1", "-1", "3,2"])
def test_other_views_are_refused(text):
    with pytest.raises(RequestError, match=r"expected auto, tiles, tiles across such as 2"):
        parse_view(text)


@pytest.mark.parametrize("columns", [1, 2, 3, 4])
def test_people_anywhere_are_found_once_and_whole(columns):
    rng = np.random.default_rng(columns)
    corners = [(x, y) for x in range(4, 300, 60) for y in range(4, 190, 62)]
    boxes = [(x + int(rng.integers(0, 30)), y, 0, 0) for x, y in corners]
    boxes = [(x, y, x + 16, y + int(rng.integers(34, 50))) for x, y, _, _ in boxes]
    large = (290, 20, 316, 236)
    image = frame_with([*boxes[:-4], large])
    detector = TiledDetector(MarkDetector(smallest=8), view_of(image.shape[:2], columns, 4 / 3))
    found = detector.detect([image])[0]
    expected = np.array(sorted([*boxes[:-4], large]), dtype=float)
    np.testing.assert_allclose(found.boxes[np.lexsort(found.boxes.T[::-1])], expected)


@pytest.mark.parametrize(("score", "kept"), [(0.1, [0.9, 0.1]), (0.5, [0.5])])
def test_a_box_at_a_seam_goes_for_a_larger_one_only_where_that_scores_half_as_much(score, kept):
    tiles = np.array([[0, 0, 200, 100], [0, 0, 100, 100], [60, 0, 200, 100]])
    nobody = Detections(np.empty((0, 4)), np.empty(0))
    person, around = np.array([[70.0, 40, 100, 70]]), np.array([[0.0, 10, 60, 100]])
    merged = merge([nobody, Detections(person, np.array([0.9])), Detections(around, np.array([score]))], tiles)
    assert merged.scores.tolist() == kept


def test_small_people_are_found_in_tiles_only_and_calls_are_batched():
    image = frame_with([(30, 30, 36, 50), (200, 150, 206, 172)])
    assert len(TiledDetector(MarkDetector(), view_of((240, 320), 1, 4 / 3)).detect([image])[0]) == 0
    marks = MarkDetector()
    found = TiledDetector(marks, view_of((240, 320), 2, 4 / 3)).detect([image, image])
    assert [len(d) for d in found] == [2, 2]
    assert marks.calls == [4, 4, 2]


class MiddleDetector:
    """Finds one person in the middle half of each picture, and keeps what it saw."""

    def __init__(self, input_size):
        self.input_size = input_size
        self.seen = []

    def detect(self, images):
        self.seen += images
        shares = np.array([0.25, 0.25, 0.75, 0.75])
        return [Detections((shares * np.tile(i.shape[1::-1], 2))[None], np.array([0.9])) for i in images]


@pytest.mark.parametrize(
    ("large", "small", "columns"),
    [
        ((8, 40), (30, 20), 1),  # who stands is seen; what more tiles bring is wide
        ((8, 40), (8, 20), 2),
        ((40, 40), (30, 20), 2),  # nobody stands
    ],
)
def test_where_people_stand_those_who_stand_tell_the_view(large, small, columns):
    rows = [(*large, 100), (*small, 180)]
    boxes = [(x, y, x + wide, y + high) for wide, high, y in rows for x in range(10, 300, 60)]
    choice = choose_view([frame_with(boxes)] * 5, MarkDetector())
    assert choice.view.columns == columns


# Tiles of 47 x 35 pixels, and of 33 x 63 where three stand side by side.
@pytest.mark.parametrize(
    ("across", "input_size", "shape"),
    [
        ((2, None), (54, 72), None),
        ((2, None), (59, 80), None),
        ((2, None), (60, 81), (60, 81)),
        ((2, None), (240, 320), (238, 320)),
        ((2, None), None, None),
        ((3, 1), (240, 320), (240, 126)),
        ((3, 1), (100, 320), None),
    ],
)
def test_tiles_that_the_input_shows_large_are_enlarged_smoothly(across, input_size, shape):
    image = np.random.default_rng(0).integers(0, 256, (63, 85, 3), dtype=np.uint8)
    view = view_of(image.shape[:2], across[0], 4 / 3, across[1])
    detector = MiddleDetector(input_size)
    found = TiledDetector(detector, view).detect([image])[0]
    np.testing.assert_array_equal(detector.seen[0], image)  # the whole frame stays as it is
    x1, y1, x2, y2 = view.tiles[1]
    tile = image[y1:y2, x1:x2]
    if shape is not None:
        tile = cv2.resize(tile, shape[::-1], interpolation=cv2.INTER_CUBIC)
    np.testing.assert_array_equal(detector.seen[1], tile)
    sizes = np.tile(view.tiles[:, 2:] - view.tiles[:, :2], 2)
    middles = view.tiles[:, [0, 1, 0, 1]] + sizes * [0.25, 0.25, 0.75, 0.75]
    np.testing.assert_allclose(sorted(found.boxes.tolist()), sorted(middles.tolist()))


@pytest.mark.parametrize(("height", "columns"), [(40, 1), (20, 2), (14, 3)])
def test_as_many_tiles_are_taken_as_find_more_people(height, columns):
    boxes = [(x, 100, x + 8, 100 + height) for x in range(10, 300, 40)]
    choice = choose_view([frame_with(boxes)] * 5, MarkDetector())
    assert choice.view.columns == columns
    assert choice.people[columns] > 1
    assert len(choice.view) == 1 or "tiles a frame, about" in str(choice)


def test_a_frame_that_the_input_shows_large_is_not_cut():
    marks = MarkDetector()
    image = frame_with([(10, 10, 20, 20)], size=(24, 32))
    assert ViewedDetector(marks).detect([image])[0].boxes.tolist() == [[10, 10, 20, 20]]
    assert marks.calls == [1]
    anything = MarkDetector()
    anything.input_size = None
    assert len(choose_view([frame_with([(10, 10, 20, 50)])], anything).view) == 1


LARGE = [(x, 10, x + 4, 40) for x in (2, 8, 14, 20, 26)]
TINY = [(x, 20, x + 2, 24) for x in (36, 42, 48, 54)]
# The input shows the whole frame 1.3 times as large, and two tiles across 2.4 times.
LOW = (45, 60)


@pytest.mark.parametrize(
    ("people", "columns"),
    [
        (LARGE[:1] + TINY[:3], 2),  # four for one
        (LARGE[:3] + TINY[:2], 2),  # five for three
        (LARGE + TINY[:2], 1),  # seven for five are few for what it costs
        (LARGE[:1] + TINY[:1], 1),  # twice as many, but only one more
        (TINY, 1),  # nobody to tell that this is a place with people
    ],
)
def test_a_frame_is_enlarged_in_tiles_where_these_find_clearly_more(people, columns):
    choice = choose_view([frame_with(people, size=LOW)], MarkDetector())
    assert choice.view.columns == columns
    # One more is tried than is taken, if anybody is there.
    assert list(choice.people) == ([1] if people == TINY else list(range(1, columns + 2)))
    assert re.fullmatch(r"(the whole frame|5 tiles a frame), about \d+ ms a frame", str(choice))


def test_enlarged_tiles_come_with_somebody_and_can_be_ruled_out():
    empty, crowd = frame_with([], size=LOW), frame_with(LARGE[:1] + TINY[:3], size=LOW)
    columns, viewed = seen([empty] * 3 + [crowd] * 5)
    assert columns == [1] * 3 + [2] * 5
    assert re.fullmatch(r"the whole frame, .*, from frame 4 on 5 tiles a frame, about \d+ ms a frame", viewed.summary)
    assert ViewedDetector(MarkDetector(), enlarge=False).prepare([crowd]).view.columns == 1


SMALL = [(30, 30, 36, 50), (200, 150, 206, 172), (100, 100, 106, 121)]


def seen(frames, rate=1.0):
    """Tiles across in which each of ``frames`` was looked at, and what is said of it."""
    viewed = ViewedDetector(MarkDetector(), frame_rate=rate)
    return [viewed.prepare([frame]).view.columns for frame in frames], viewed


def test_an_empty_street_is_looked_at_again_until_somebody_comes():
    empty, busy = frame_with([]), frame_with(SMALL)
    columns, viewed = seen([empty] * 4 + [busy] * 8)
    # Inference at the seconds 0, 0.15, 0.45, 1.05, … as soon as there is a frame.
    assert columns == [1] * 5 + [2] * 7
    assert re.fullmatch(r"the whole frame, .*from frame 6 on 5 tiles a frame, about \d+ ms a frame", viewed.summary)
    assert seen([empty] * 12)[1].summary.endswith("no person was detected at any scale")
    assert "no person" not in viewed.summary


def test_looks_end_with_the_third_that_shows_somebody_and_are_a_minute_apart_at_most():
    busy = frame_with(SMALL)
    looks = seen([busy] * 3)[1].histories[240, 320]
    assert (len(looks.peopled), looks.due) == (2, 3)
    looks = seen([busy] * 4)[1].histories[240, 320]
    assert (len(looks.peopled), looks.due) == (3, None)
    empty, dues = ViewedDetector(MarkDetector(), frame_rate=1.0), []
    for _ in range(240):
        empty.prepare([frame_with([], size=(70, 130))])
        dues.append(empty.histories[70, 130].due)
    waits = np.diff(np.unique(dues))
    assert (waits[1:5] > waits[:4]).all()
    np.testing.assert_allclose(waits[-1], 60, atol=1)  # looks come with whole frames


def test_one_look_that_misleads_is_outvoted():
    crowd = frame_with([(x, 100, x + 8, 114) for x in range(10, 300, 20)])
    busy = frame_with(SMALL)
    assert seen([crowd])[0] == [3]
    assert seen([crowd, busy, busy, busy, crowd])[0] == [3, 2, 2, 2, 2]


def test_the_view_does_not_depend_on_the_number_of_workers():
    frames = [frame_with([])] * 6 + [frame_with(SMALL)] * 30
    frames = [Frame(n, n / 25, image) for n, image in enumerate(frames)]
    one, many = (
        [
            len(found)
            for _, found in stream(
                frames, ViewedDetector(MarkDetector(), frame_rate=4.0), batch_size=2, workers=workers
            )
        ]
        for workers in (1, 3)
    )
    assert one == many
    assert one == [0] * 8 + [3] * 28


def test_several_calls_at_a_time_find_the_same():
    rng = np.random.default_rng(0)
    images = [
        frame_with([(x, y, x + 16, y + 40) for x, y in rng.integers(0, (300, 190), (12, 2)).tolist()]) for _ in range(3)
    ]
    view = view_of((240, 320), 3, 4 / 3)
    one, many = (TiledDetector(MarkDetector(), view, workers=n).detect(images) for n in (1, 3))
    assert [len(d) > 3 for d in one] == [True] * 3
    for a, b in zip(one, many, strict=True):
        np.testing.assert_array_equal(a.boxes, b.boxes)
        np.testing.assert_array_equal(a.scores, b.scores)


def test_a_view_is_chosen_once_for_each_size():
    marks = MarkDetector()
    viewed = ViewedDetector(marks)
    small = frame_with([(30, 30, 36, 50), (200, 150, 206, 172)])
    assert len(viewed.detect([small])[0]) == 2
    before = len(marks.calls)
    viewed.detect([small])
    assert len(marks.calls) - before == 2  # five tiles in batches of four
    wanted = ViewedDetector(MarkDetector(), (3, 2))
    assert wanted.prepare([small]).view.tiles.shape == (7, 4)
    assert re.fullmatch(r"7 tiles a frame, about \d+ ms a frame", wanted.summary)
    assert viewed.detect([]) == []


def test_tiles_that_show_nobody_else_are_passed_over_and_looked_at_again_every_second():
    here, elsewhere = frame_with([(30, 30, 36, 50)]), frame_with([(300, 200, 306, 222)])
    marks = MarkDetector()
    viewed = ViewedDetector(marks, (2, None), frame_rate=4.0, sparing=True)

    def pictures(image):
        before = sum(marks.calls)
        found = viewed.detect([image])[0]
        return sum(marks.calls) - before, len(found)

    assert pictures(here)[1] == 1
    early = [pictures(here) for _ in range(7)]
    assert early == [(5, 1)] * 7  # all tiles, until three looks tell
    assert [pictures(here) for _ in range(8)] == [(5, 1), (2, 1), (2, 1), (2, 1)] * 2
    late = [pictures(elsewhere) for _ in range(8)]
    assert late[0] == (5, 1)  # the look of that second
    assert late[1:4] == [(3, 1)] * 3  # another tile is busy from then on
    assert ViewedDetector(MarkDetector(), (2, None)).detect([here] * 9)[-1].boxes.tolist() == [[30, 30, 36, 50]]


def test_with_tiles_passed_over_the_number_of_workers_changes_nothing():
    frames = [Frame(n, n / 4, frame_with(SMALL[: 1 + n % 3])) for n in range(30)]
    one, many = (
        [
            found.boxes.tolist()
            for _, found in stream(
                frames, ViewedDetector(MarkDetector(), frame_rate=4.0, sparing=True), batch_size=2, workers=workers
            )
        ]
        for workers in (1, 3)
    )
    assert one == many


def test_busy_tiles_are_the_fewest_that_show_nearly_everybody():
    shown = np.array([[0, 1, 1, 0], [0, 1, 0, 0], [1, 0, 0, 1], [0, 0, 0, 0]], dtype=bool)
    assert busy_tiles(shown, np.array([0.9, 0.9, 0.9, 0.0])).tolist() == [0, 1]
    assert busy_tiles(shown[1:3], np.array([0.04, 1.0])).tolist() == [0]
    assert busy_tiles(shown[1:3], np.array([0.4, 1.0])).tolist() == [0, 1]
    assert busy_tiles(shown[:0], np.empty(0)).tolist() == [0, 1, 2, 3]
