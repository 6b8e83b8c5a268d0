from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.people.outfit import Outfit
from tsuiseki.datamodules.scenes.render.composing import Picture, Thing, compose, empty_picture, shadows
from tsuiseki.datamodules.scenes.render.shading import Light
from tsuiseki.datamodules.scenes.render.solids import Surface, boxes, cone_spheres, join
from tsuiseki.datamodules.scenes.render.tracing import silhouette_box, trace
from tsuiseki.tracking.cameras.projective import PinholeCamera

CAMERA = PinholeCamera.look_at(np.array([0, -10, 1.0]), np.array([0, 0, 1.0]), 300, 160, 120)
LIGHT = Light(*(np.array(v, dtype=np.float32) for v in ([0, 0, 1], [0.5] * 3, [0.5] * 3, [0.2] * 3)))
LOOK = Outfit(np.random.default_rng(0))


def ball(x: float, y: float, radius: float = 1.0, z: float = 1.0) -> Thing:
    surfaces = [Surface((0.5, 0.2, 0.2))]
    centre = np.array([[x, y, z]])
    return Thing(
        cone_spheres(centre, centre, np.full((1, 2), radius), np.array([[0.0, 1, 0]]), np.ones(1), surfaces), LOOK
    )


def slab(x: float, y: float, half: float) -> Thing:
    surfaces = [Surface((0.2, 0.2, 0.5))]
    return Thing(boxes(np.array([[x, y, 1.0]]), np.array([[half, 0.01, 3.0]]), np.zeros(1), surfaces))


def empty(samples: int = 2) -> Picture:
    return empty_picture(np.full((120, 160, 3), 0.3, dtype=np.float32), samples)


def test_half_hidden_is_half_visible() -> None:
    picture = empty()
    # A slab from the optical axis to far right hides the right half of a ball on the axis.
    _, (seen, _) = compose(picture, [ball(0, 0), slab(5, -3, 5)], CAMERA, LIGHT)
    _, (free,) = compose(picture, [ball(0, 0)], CAMERA, LIGHT)
    assert seen is not None
    assert free is not None
    assert free.visibility == 1
    assert seen.visibility == pytest.approx(0.5, abs=0.01)
    # The box is that of the whole silhouette all the same.
    np.testing.assert_array_equal(seen.box, free.box)


def test_what_stands_behind_hides_nothing() -> None:
    _, (seen, _) = compose(empty(), [ball(0, 0), slab(5, 3, 5)], CAMERA, LIGHT)
    assert seen is not None
    assert seen.visibility == 1


def test_static_things_hide_as_moving_ones_do() -> None:
    background, _ = compose(empty(), [slab(5, -3, 5)], CAMERA, LIGHT)
    _, (seen,) = compose(background, [ball(0, 0)], CAMERA, LIGHT)
    assert seen is not None
    assert seen.visibility == pytest.approx(0.5, abs=0.01)


def test_half_outside_the_image_is_half_visible() -> None:
    # The image ends 80 px, 8/3 m at 10 m, right of the axis; a small ball there keeps its shape.
    _, (seen,) = compose(empty(4), [ball(8 / 3, 0, 0.3)], CAMERA, LIGHT)
    assert seen is not None
    assert seen.visibility == pytest.approx(0.5, abs=0.03)
    assert seen.box[2] > 160 > seen.box[0]


def test_out_of_view_is_not_seen() -> None:
    _, sightings = compose(empty(), [ball(20, 0), ball(0, -20)], CAMERA, LIGHT)
    assert sightings == [None, None]


def test_edges_are_soft_and_the_rest_is_untouched() -> None:
    before = empty()
    after, (seen,) = compose(before, [ball(0, 0)], CAMERA, LIGHT)
    layer = trace(ball(0, 0).solids, CAMERA, 2)
    assert seen is not None
    assert layer is not None
    np.testing.assert_array_equal(seen.box, silhouette_box(layer, 2))
    share = 1 - after.open_ground
    np.testing.assert_array_equal(after.colour[share == 0], before.colour[share == 0])
    assert set(np.unique(share)) == {0, 0.25, 0.5, 0.75, 1}
    # Every subpixel that is gone from the background has been drawn: coverage adds up to the silhouette.
    assert share.sum() * 4 == layer.mask.sum()


def test_shading_once_per_pixel_keeps_the_edges() -> None:
    # A thing without a look is shaded once per pixel and solid; a flat colour must come out the same.
    plain = slab(0.3, 0, 0.71)
    once, _ = compose(empty(3), [plain], CAMERA, LIGHT)
    each, _ = compose(empty(3), [Thing(plain.solids, LOOK)], CAMERA, LIGHT)
    # The surface's random relief varies within a pixel by less than this.
    np.testing.assert_allclose(once.colour, each.colour, atol=0.01)


def test_shadow_lies_where_the_sun_throws_it() -> None:
    camera = PinholeCamera.look_at(np.array([0, 0.0, 20]), np.zeros(3), 500, 300, 300)
    sun = np.array([1, 0, 1], dtype=np.float32) / np.float32(np.sqrt(2))
    mask = shadows([ball(0, 0, 0.5, 2.0)], camera, sun, 0.0)
    rows, columns = np.nonzero(mask > 0.5)
    points = camera.ground(np.stack([columns + 0.5, rows + 0.5], axis=1))
    # At 45 degrees a ball 2 m up throws an ellipse 2 m away, as wide as the ball and longer by sqrt(2); 4 cm a pixel.
    np.testing.assert_allclose(points[:, :2].mean(axis=0), [-2, 0], atol=0.02)
    # An octagon stands for the circle, and filling adds up to half a pixel at the border.
    assert len(rows) * 0.04**2 == pytest.approx(np.pi * 0.5 * 0.5 * np.sqrt(2), rel=0.12)


def test_join_keeps_all_rows() -> None:
    both = join([ball(0, 0).solids, slab(1, 0, 1).solids])
    assert both.box.tolist() == [False, True]
    assert both.select(np.array([1])).box.tolist() == [True]
