"""The contour likelihood (7) against distances that are known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.bodies.contour import (
    FARTHEST,
    HIDDEN_COST,
    ROWS_AT_ONCE,
    BodyView,
    EdgeImage,
    Extraction,
    point_distances,
)
from tsuiseki.tracking.features.colour_region import ColourRange

CENTRE, RADIUS = np.array([90.5, 70.5]), 30.0
PIXELS = 1.5
"""Edge pixels lie up to one pixel off the edge, and distances are approximated by steps of 0.955 and 1.369."""


def disc_mask(centre=CENTRE):
    rows, columns = np.mgrid[:160, :200]
    inside = (columns + 0.5 - centre[0]) ** 2 + (rows + 0.5 - centre[1]) ** 2 <= RADIUS**2
    return np.where(inside, 255, 0).astype(np.uint8)


def circle(radius, centre=CENTRE, points=40):
    angle = np.linspace(0, 2 * np.pi, points, endpoint=False)
    return (centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(np.float32)


@pytest.mark.parametrize("radius", [10.0, 22.0, 30.0, 37.0, 50.0])
def test_distance_of_a_circle_is_the_difference_of_the_radii(radius):
    found = point_distances(EdgeImage.of_mask(disc_mask()), circle(radius)[None]).max(axis=1)
    assert found[0] == pytest.approx(abs(radius - RADIUS), abs=PIXELS)


def test_the_largest_distance_counts_and_the_logarithm_is_as_printed():
    edges = EdgeImage.of_mask(disc_mask())
    points = np.stack([circle(RADIUS), circle(RADIUS)])
    points[1, 7] += 12.0 * (points[1, 7] - CENTRE) / RADIUS
    distance = point_distances(edges, points.astype(np.float32)).max(axis=1)
    assert distance[1] == pytest.approx(12.0, abs=PIXELS)
    np.testing.assert_allclose(BodyView(edges).log_likelihood(points, 25.0), -(distance**2) / 25.0)


def test_there_is_no_shift_between_contours_and_edges():
    rng = np.random.default_rng(0)
    shifts = np.arange(-1.5, 1.55, 0.1)
    best = []
    for centre in CENTRE + rng.uniform(-0.5, 0.5, (20, 2)):
        edges = EdgeImage.of_mask(disc_mask(centre))
        for axis in np.eye(2):
            moved = np.stack([circle(RADIUS, centre + shift * axis, 80) for shift in shifts])
            best.append(shifts[np.argmin((point_distances(edges, moved) ** 2).mean(axis=1))])
    # A wrong convention of pixel centres gives a quarter or more; rounding to pixels leaves 0.4 pixels a disc.
    assert abs(np.mean(best)) < 0.15


def test_without_the_colour_there_is_no_edge_and_nothing_breaks():
    image = np.full((40, 60, 3), 90, np.uint8)
    edges = EdgeImage.of(image, Extraction(ColourRange((15.0, 40.0))))
    assert not edges.has_edges
    logs = BodyView(edges).log_likelihood(circle(8.0, np.array([30.0, 20.0]))[None], 40.0)
    np.testing.assert_allclose(logs, -(FARTHEST**2) / 40.0)


def test_extraction_takes_the_colour_and_the_median_takes_specks():
    image = np.full((60, 80, 3), (40, 90, 90), np.uint8)
    cv2.rectangle(image, (20, 15), (49, 44), (255, 140, 20), -1)
    image[5, 5] = image[50, 70] = (255, 140, 20)
    colour = ColourRange((15.0, 42.0), (0.45, 1.0))
    assert np.count_nonzero(Extraction(colour, smooth=1).pixels(image)) == 902
    assert Extraction(colour, smooth=5).pixels(image)[5, 5] == 0
    assert np.count_nonzero(Extraction(colour, smooth=5).pixels(image)) == pytest.approx(900, abs=12)  # the corners


def test_off_the_image_a_point_is_as_far_as_it_lies_off():
    edges = EdgeImage.of_mask(np.pad(np.full((60, 40), 255, np.uint8), ((20, 20), (0, 60))))
    points = np.array([[[-30.0, 20.0], [-500.0, 20.0], [10.0, 20.0]]], dtype=np.float32)
    distance = point_distances(edges, points)[0]
    assert distance[0] == pytest.approx(30.0, abs=PIXELS)
    assert distance[1] == FARTHEST
    assert distance[2] <= PIXELS


def test_many_particles_are_looked_up_in_pieces():
    edges = EdgeImage.of_mask(disc_mask())
    points = np.random.default_rng(0).uniform(0, 150, (2 * ROWS_AT_ONCE + 5, 3, 2)).astype(np.float32)
    some = np.r_[0, ROWS_AT_ONCE - 1, ROWS_AT_ONCE, len(points) - 1]
    np.testing.assert_array_equal(point_distances(edges, points)[some], point_distances(edges, points[some]))


def test_hidden_points_take_no_part_and_cost_their_share():
    edges = EdgeImage.of_mask(disc_mask())
    points = circle(RADIUS)[None].copy()
    points[0, :10] += 25.0  # a quarter of the contour is far off, behind a neighbour
    neighbours = np.zeros(edges.mask.shape, np.uint8)
    for x, y in points[0, :10].astype(int):
        neighbours[y - 1 : y + 2, x - 1 : x + 2] = 255
    visible = point_distances(edges, points[:, 10:])[0].max()
    (log,) = BodyView(edges, neighbours).log_likelihood(points, 40.0)
    assert log == pytest.approx(-(visible**2) / 40.0 - HIDDEN_COST * 10 / 40)
    assert BodyView(edges).log_likelihood(points, 40.0)[0] < -10.0
