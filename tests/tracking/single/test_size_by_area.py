"""The number of the target's pixels tells the size of a target whose outline changes."""

import cv2
import numpy as np

from tsuiseki.tracking.single import regularised
from tsuiseki.tracking.single.regularised import RegularisedTracker

FRAMES = 40


def growing_ellipse():
    """``(images, areas)``: it turns from a wide into a tall ellipse while it grows by half; no box of it stays like."""
    noise = np.random.default_rng(0).normal(size=(160, 200, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    ground = np.clip(70 * smooth / smooth.std() + (40, 90, 170), 0, 255).astype(np.uint8)
    images, areas = [], []
    for t in range(FRAMES):
        size, turned = 1 + 0.5 * min(t / 25, 1), min(t / 15, 1)
        axes = (round(size * (22 - 5 * turned)), round(size * (18 + 5 * turned)))
        image = ground.copy()
        cv2.ellipse(image, (100, 80), axes, 0, 0, 360, (220, 60, 40), -1)
        images.append(image)
        areas.append(axes[0] * axes[1])
    return images, np.array(areas)


def test_a_target_that_grows_while_its_outline_changes_is_followed_by_the_area_of_its_colours(monkeypatch):
    images, areas = growing_ellipse()
    errors = {}
    for contrast in (0.45, 2.0):
        monkeypatch.setattr(regularised, "SIZE_BY_AREA", contrast)
        tracker = RegularisedTracker()
        tracker.start(images[0], np.array([78.0, 62, 122, 98]))
        for image in images[1:]:
            tracker.follow(image)
        errors[contrast] = abs(np.log(tracker.target.size / np.sqrt(areas[-1] / areas[0])))
    # Up to four steps of 3 % are left to the filter over sizes and to the contrast.
    assert errors[0.45] < 5 * np.log(1.03)
    assert errors[0.45] < errors[2.0] - np.log(1.03)
