"""`tsuiseki track single` where the target leaves the view for half a second and comes back, as a user runs it."""

import json

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.single import read_boxes
from tsuiseki.tracking.geometry import iou_pairs

HIGH, WIDE = 160, 200
TARGET = np.array([24, 36])
OUT, AWAY, BACK = 24, 16, 32  # frames


def texture(seed, height, width, tint):
    noise = np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(70 * smooth / smooth.std() + tint, 0, 255).astype(np.uint8)


def centres(side):
    """Where the target's centre is: out by the right side, away, and back by the ``side`` given, a bit lower."""
    back = {"same": (230, 130), "other": (-30, 125)}[side]
    x = np.concatenate([np.linspace(120, 230, OUT), np.full(AWAY, 300.0), np.linspace(*back, BACK)])
    return np.column_stack([x, np.where(np.arange(len(x)) < OUT, 80.0, 90.0)])


@pytest.fixture(scope="module", params=["same", "other"])
def left(request, tmp_path_factory):
    """A folder of images, the labelled boxes, which are partly and wholly outside, and the side of the return."""
    folder = tmp_path_factory.mktemp("leaving") / request.param
    folder.mkdir()
    background, target = texture(0, HIGH, WIDE, (150, 90, 60)), texture(1, *TARGET[::-1], (50, 80, 170))
    corners = np.round(centres(request.param) - TARGET / 2).astype(int)
    for t, (x, y) in enumerate(corners):
        wide = cv2.copyMakeBorder(background, 200, 200, 200, 200, cv2.BORDER_REPLICATE)
        wide[200 + y : 200 + y + TARGET[1], 200 + x : 200 + x + TARGET[0]] = target
        cv2.imwrite(str(folder / f"{t + 1:04d}.png"), wide[200 : 200 + HIGH, 200 : 200 + WIDE])
    return folder, np.concatenate([corners, corners + TARGET], axis=1).astype(float), request.param


def followed(left, out, *more):
    """Overlap with the truth, and the status, a frame each; and the boxes."""
    folder, truth, _ = left
    box = ",".join(str(round(value)) for value in (*truth[0, :2], *TARGET))
    assert main(["track", "single", str(folder), "--box", box, "--out", str(out), *more]) == 0
    boxes = read_boxes(out / "boxes.txt")
    assert len(boxes) == len(truth)
    return iou_pairs(boxes, truth), json.loads((out / "run.json").read_text())["frames"]["status"], boxes


def lost_outside(overlaps, statuses, boxes):
    """Check that it is tracked until it leaves, then lost within ten frames, and that the box stays in the picture."""
    gone = OUT - 1  # the first frame in which nothing of it is left
    assert set(statuses[: gone - 7]) == {"tracking"}
    assert overlaps[: gone - 7].min() > 0.7
    assert set(statuses[gone + 10 : OUT + AWAY]) == {"lost"}
    middle = (boxes[gone : OUT + AWAY, :2] + boxes[gone : OUT + AWAY, 2:]) / 2
    assert ((middle >= 0) & (middle <= [WIDE, HIGH])).all()


@pytest.mark.slow
def test_a_target_that_leaves_the_view_is_lost_and_found_on_either_side(left, tmp_path):
    overlaps, statuses, boxes = followed(left, tmp_path / "out")
    lost_outside(overlaps, statuses, boxes)
    assert set(statuses[-8:]) == {"tracking"}
    assert overlaps[-8:].min() > 0.7


@pytest.mark.slow
def test_without_a_network_it_is_found_where_it_left_and_stays_lost_elsewhere(left, tmp_path):
    overlaps, statuses, boxes = followed(left, tmp_path / "out", "--network", "none")
    lost_outside(overlaps, statuses, boxes)
    if left[2] == "same":
        assert set(statuses[-8:]) == {"tracking"}
        assert overlaps[-8:].min() > 0.7
    else:  # the windows that are searched do not reach across the picture: it says so, and does not make one up
        assert statuses[-8] == "lost"
        since = np.array(statuses[OUT + AWAY :]) == "tracking"
        assert (overlaps[OUT + AWAY :][since] > 0.6).all()
    assert json.loads((tmp_path / "out" / "run.json").read_text())["facts"]["constants"]["doubt"] == 0.6
