"""A network that knows the target leads the particles where the filter has lost it without a doubt."""

import cv2
import numpy as np

from tsuiseki.tracking.geometry import iou_pairs
from tsuiseki.tracking.single import recognised
from tsuiseki.tracking.single.combined import Combined, CombinedSettings
from tsuiseki.tracking.single.recognised import Recognised, RecognitionSettings

HEIGHT, WIDTH = 36, 24
# A filter that never doubts: where it has lost the target only the network can say so.
SURE = CombinedSettings(doubt=0.0, reach=2)
EVERY = RecognitionSettings(every=2, upright=1.0)


def jump(frames=12):
    """A textured target that stands still, jumps four of its widths, and stands still again."""
    rng = np.random.default_rng(0)
    background = cv2.resize(rng.integers(0, 255, (20, 25, 3), dtype=np.uint8), (200, 160))
    sprite = cv2.resize(rng.integers(0, 255, (9, 6, 3), dtype=np.uint8), (WIDTH, HEIGHT))
    images, boxes = [], []
    for x in [38] * frames + [133] * frames:
        image = background.copy()
        image[62 : 62 + HEIGHT, x : x + WIDTH] = sprite
        images.append(image)
        boxes.append([x, 62, x + WIDTH, 62 + HEIGHT])
    return images, np.array(boxes, dtype=float)


def describe(image, boxes):
    """Small pictures of the boxes, without their mean."""
    found = []
    for x1, y1, x2, y2 in np.round(boxes).astype(int):
        cut = image[max(y1, 0) : max(y2, 1), max(x1, 0) : max(x2, 1)]
        small = (
            cv2.resize(cut, (6, 9), interpolation=cv2.INTER_AREA).astype(float).ravel() if cut.size else np.ones(162)
        )
        found.append(small - small.mean())
    return np.array(found)


def blind(_, boxes):
    """Nothing to tell boxes apart by, so that the combined tracker's own witness finds nothing."""
    return np.ones((len(boxes), 1))


def follow(tracker, images, boxes):
    tracker.start(images[0], boxes[0])
    seen = [tracker.follow(image) for image in images[1:]]
    return iou_pairs(np.array([one.box for one in seen]), boxes[1:]), [one.status for one in seen]


def test_the_target_is_found_again_where_the_filter_alone_stays():
    images, boxes = jump()
    assert follow(Combined(SURE, describe=blind), images, boxes)[0][-1] == 0
    tracker = Recognised(Combined(SURE, describe=blind), describe, EVERY)
    overlaps, statuses = follow(tracker, images, boxes)
    assert overlaps[-1] > 0.6
    assert tracker.repeated_detections == 1
    assert set(statuses[:11]) == {statuses[-1]} == {"tracking"}


def test_where_nothing_is_alike_it_stays_and_says_lost():
    images, boxes = jump()
    gone = [image if t < 12 else images[0].copy() for t, image in enumerate(images)]
    for image in gone[12:]:
        image[62 : 62 + HEIGHT, 38 : 38 + WIDTH] = 90
    tracker = Recognised(Combined(SURE, describe=blind), describe, EVERY)
    _, statuses = follow(tracker, gone, boxes)
    assert tracker.repeated_detections == 0
    assert statuses[-1] == "lost"


def test_while_the_network_knows_the_box_it_changes_nothing():
    images, boxes = jump()
    plain, witnessed = (
        follow(tracker, images[:12], boxes[:12])
        for tracker in (Combined(SURE, describe=blind), Recognised(Combined(SURE, describe=blind), describe, EVERY))
    )
    np.testing.assert_array_equal(plain[0], witnessed[0])


def test_the_same_seed_gives_the_same_answers():
    images, boxes = jump()
    first, second = (follow(Recognised(Combined(SURE, 3), describe, EVERY), images, boxes)[0] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_of_what_is_not_upright_the_network_is_not_asked():
    def never(*_):
        raise AssertionError("asked")

    images, boxes = jump()
    lying = Recognised(Combined(SURE, describe=blind), never, RecognitionSettings(every=2, upright=1.6))
    plain, unasked = (follow(tracker, images, boxes) for tracker in (Combined(SURE, describe=blind), lying))
    assert not lying.asked
    np.testing.assert_array_equal(plain[0], unasked[0])
    assert plain[1] == unasked[1]


def test_a_place_too_far_for_the_time_is_not_taken(monkeypatch):
    """The target jumps four of its widths at once: it is alike there, but nobody moves so far in a look."""
    monkeypatch.setattr(recognised, "PACE", 0.0)
    images, boxes = jump()
    tracker = Recognised(Combined(SURE, describe=blind), describe, EVERY)
    assert follow(tracker, images, boxes)[0][-1] == 0
    assert tracker.repeated_detections == 0
