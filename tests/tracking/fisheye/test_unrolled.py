"""Detection in unrolled views: what is found there lies where the person model says, once for each person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tsuiseki.tracking.cameras.lens_fitting import EquidistantLens, fit_omnidirectional
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera
from tsuiseki.tracking.cameras.panorama import CylinderView
from tsuiseki.tracking.cameras.person_model import PersonModel, outlines
from tsuiseki.tracking.fisheye.unrolled import OVERLAP, RINGS, UnrolledDetector
from tsuiseki.tracking.geometry import rotated_iou
from tsuiseki.tracking.types import Detections

SIZE = (240, 320)
PERSON = PersonModel()


@pytest.fixture(scope="module")
def camera():
    lens = fit_omnidirectional(EquidistantLens(640, 480, np.full(2, 150.0), np.array([320.0, 240.0]), np.zeros(4)))
    return OmnidirectionalCamera(lens, np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.5, 3.0]))


class Seeing:
    """Finds the model of a person at given places in the tiles of a detector, as far as it lies in them."""

    def __init__(self, places):
        self.places, self.tiles, self.calls = places, [], 0

    def detect(self, images):
        found = []
        for image in images:
            assert image.shape == (*SIZE, 3)
            tile = self.tiles[self.calls % len(self.tiles)]
            self.calls += 1
            boxes = []
            for pixels in (shown for place in self.places for shown in self._shown(tile, place)):
                box = np.clip([*pixels.min(axis=0), *pixels.max(axis=0)], 0, [*SIZE[::-1], *SIZE[::-1]])
                boxes += [box] if (box[2:] - box[:2] > 2).all() else []
            found.append(Detections(np.array(boxes).reshape(-1, 4), np.linspace(0.9, 0.8, len(boxes))))
        return found

    def _shown(self, tile, place):
        """The outline in a tile; a cylinder of more than a turn shows it more than once."""
        outline = PERSON.outline() + np.array([*place, 0.0])
        if not isinstance(tile, CylinderView):
            return [tile.project(outline)[0]]
        azimuth = np.arctan2(*(place - tile.position[:2])[::-1])
        pixels = replace(tile, middle=azimuth).project(outline)[0]
        aside = (tile.middle - azimuth + np.pi) % (2 * np.pi) - np.pi
        return [pixels + np.array([tile.scale * (aside + 2 * np.pi * k), 0]) for k in (-1, 0, 1)]


def unrolled(camera, places):
    seeing = Seeing(places)
    detector = UnrolledDetector(seeing, camera, SIZE)
    seeing.tiles = detector.tiles
    return detector


def test_everybody_is_found_once_where_they_stand(camera):
    turn = np.linspace(0, 2 * np.pi, 9)[:-1] + 0.1
    reach = np.array([1.0, 1.6, 2.4, 4.0, 1.2, 3.0, 5.0, 2.0])
    places = camera.position[:2] + reach[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    found = unrolled(camera, places).detect([np.zeros((480, 640, 3), np.uint8)] * 2)
    _, expected, _ = outlines(camera, places, PERSON)
    for each in found:
        assert len(each) == len(places)
        half = (each.boxes[:, 2:] - each.boxes[:, :2]) / 2
        turned = np.column_stack([each.boxes[:, :2] + half, 2 * half, each.angles])
        overlap = rotated_iou(expected, turned)
        assert overlap.max(axis=1).min() > 0.6
        # Heads point outwards, as the model's do.
        which = overlap.argmax(axis=1)
        assert (np.cos(turned[which, 4] - expected[:, 4]) > 0.97).all()


def test_somebody_right_below_is_found_by_the_view_down(camera):
    places = camera.position[None, :2] + np.array([0.1, 0.05])
    image = [np.zeros((480, 640, 3), np.uint8)]
    detector = unrolled(camera, places)
    found = detector.detect(image)[0]
    assert len(found) == 1
    assert np.linalg.norm((found.boxes[0, :2] + found.boxes[0, 2:]) / 2 - [320, 240]) < 20
    for views in (detector.tiles, detector._maps):
        views.pop()
    assert len(detector.detect(image)[0]) == 0


def test_the_views_show_the_image(camera):
    image = np.zeros((480, 640, 3), np.uint8)
    # North of the camera's foot, which is up in the image: azimuth 90 degrees.
    image[:240, 310:330] = [200, 100, 50]
    tiles = unrolled(camera, []).unroll(image)
    assert len(tiles) == sum(RINGS) + 1
    near = tiles[RINGS.index(1)]
    scale = 320 * (1 - OVERLAP) / (2 * np.pi)
    column = int((160 - scale * np.pi / 2) % (2 * np.pi * scale))
    assert near[60:120, column].mean(axis=0) == pytest.approx([200, 100, 50], abs=20)
    assert near[60:120, 160].max() == 0


def test_what_is_no_height_of_people_is_left_out(camera):
    class Flat(Seeing):
        """Finds what lies on the floor."""

        def _shown(self, tile, place):
            return [p[p[:, 1] > p[:, 1].max() - 20] for p in super()._shown(tile, place)]

    places = camera.position[None, :2] + np.array([1.5, 0.5])
    detector = unrolled(camera, places)
    detector.detector = Flat(places)
    detector.detector.tiles = detector.tiles
    assert len(detector.detect([np.zeros((480, 640, 3), np.uint8)])[0]) == 0
