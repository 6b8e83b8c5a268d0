"""People cut out of a fixed camera's frames, changed, and pasted elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.composition import (
    Canvas,
    Cutout,
    SizeByRow,
    change_clothes,
    cut_out_people,
    empty_view,
    fit_size_by_row,
    generate_people,
    mirror,
    place_people,
)

GREEN, RED = (40, 120, 40), (190, 30, 30)
SIZES = SizeByRow(0.2, 10.0, 0.05, (40.0, 90.0))


def frame(boxes: list[list[float]]) -> Example:
    """A green field with red rectangles a pixel within their labels."""
    image = np.full((100, 120, 3), GREEN, dtype=np.uint8)
    for x1, y1, x2, y2 in np.array(boxes, dtype=int).reshape(-1, 4):
        image[y1 + 1 : y2 - 1, x1 + 2 : x2 - 2] = RED
    return Example(image, np.array(boxes, dtype=np.float64).reshape(-1, 4), np.zeros(len(boxes), dtype=np.bool_))


def nobody() -> Example:
    return frame([])


def walk(steps: int) -> list[Example]:
    """One who walks to the right."""
    return [frame([[2 + 4 * t, 30, 18 + 4 * t, 70]]) for t in range(steps)]


def test_the_empty_view_has_nobody_in_it() -> None:
    view = empty_view(walk(20))
    assert np.array_equal(view.image, nobody().image)
    assert len(view.boxes) == 0


def test_who_stands_most_of_the_time_leaves_no_ghost() -> None:
    standing = [frame([[50, 30, 66, 70]])] * 15 + walk(5)
    assert np.array_equal(empty_view(standing).image, nobody().image)


def test_who_never_leaves_is_ignored_in_the_empty_view() -> None:
    view = empty_view([frame([[50, 30, 66, 70]])] * 8)
    assert view.boxes.tolist() == [[50, 30, 66, 70]]
    assert view.ignored.tolist() == [True]


def test_a_cutout_put_back_gives_the_frame_again() -> None:
    example = walk(10)[5]
    person = cut_out_people(example, nobody().image)[0]
    assert person is not None
    canvas = Canvas(nobody())
    canvas.paste(person, example.boxes[0])
    result = canvas.finish()
    assert result.boxes.tolist() == example.boxes.tolist()
    # Soft edges let a little of the ground through at the border of the silhouette.
    assert np.abs(result.image.astype(int) - example.image).mean() < 1.0
    assert np.array_equal(result.image[40:60, 30:36], example.image[40:60, 30:36])


def test_people_who_overlap_or_are_hidden_are_not_cut_out() -> None:
    together = frame([[20, 30, 36, 70], [28, 30, 44, 70], [80, 30, 96, 70]])
    assert [c is not None for c in cut_out_people(together, nobody().image)] == [False, False, True]
    hidden = frame([[80, 30, 96, 70]])
    hidden.image[45:] = GREEN
    assert cut_out_people(hidden, nobody().image) == [None]


def test_size_by_row_is_the_line_through_the_labels() -> None:
    feet = np.linspace(40, 100, 30)
    boxes = np.column_stack([np.zeros(30), feet - (0.3 * feet + 5), np.full(30, 9.0), feet])
    sizes = fit_size_by_row(boxes)
    assert (sizes.slope, sizes.intercept) == pytest.approx((0.3, 5.0))
    assert sizes.rows == (40.0, 100.0)
    drawn = [sizes.draw(np.random.default_rng(s), 80.0) for s in range(200)]
    assert np.mean(drawn) == pytest.approx(29.0, rel=0.02)


def test_other_clothes_keep_the_silhouette() -> None:
    person = generate_people(np.random.default_rng(0), 1)[0]
    changed = [change_clothes(np.random.default_rng(s), person) for s in range(8)]
    assert all(np.array_equal(c.pixels[..., 3], person.pixels[..., 3]) for c in changed)
    assert any(np.abs(c.pixels[..., :3].astype(int) - person.pixels[..., :3]).mean() > 5 for c in changed)


def test_generated_people_fill_their_labels() -> None:
    people = generate_people(np.random.default_rng(1), 6)
    assert len(people) == 6
    for person in people:
        rows = np.flatnonzero((person.pixels[..., 3] > 100).any(axis=1))
        height = person.box[3] - person.box[1]
        assert rows[-1] - rows[0] + 1 == pytest.approx(height, rel=0.1)


def test_a_mirrored_label_stays_on_its_person() -> None:
    person = Cutout(np.zeros((40, 20, 4), dtype=np.uint8), np.array([3.0, 1.0, 15.0, 39.0]))
    assert mirror(person).box.tolist() == [5.0, 1.0, 17.0, 39.0]
    assert mirror(mirror(person)).box.tolist() == person.box.tolist()


def test_who_is_covered_is_ignored() -> None:
    person = cut_out_people(walk(10)[5], nobody().image)[0]
    assert person is not None
    canvas = Canvas(nobody())
    for box in ([20, 30, 36, 70], [60, 30, 76, 70], [61, 30, 77, 70]):
        canvas.paste(person, np.array(box, dtype=np.float64))
    assert canvas.finish().ignored.tolist() == [False, True, False]


def test_people_are_placed_at_their_rows_size() -> None:
    rng = np.random.default_rng(3)
    people = generate_people(rng, 4)
    canvas = Canvas(nobody())
    place_people(rng, canvas, [people], 12, SIZES)
    result = canvas.finish()
    inside = (result.boxes[:, 3] < 99) & (result.boxes[:, 1] > 1)
    heights = (result.boxes[:, 3] - result.boxes[:, 1])[inside]
    expected = 0.2 * result.boxes[inside, 3] + 10
    # Twelve draws that scatter by 5 %.
    assert np.abs(heights / expected - 1).max() < 0.25
    assert not np.array_equal(result.image, nobody().image)
