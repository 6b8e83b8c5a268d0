"""Bridging of missed detections: drawn people under a camera that jerks, whom a detector misses for some frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.drone.observations import Observation, Observers, observe
from tsuiseki.tracking.drone.settings import DRONE_FLOW, DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.geometry import centres, iou_pairs
from tsuiseki.tracking.people.bridging import Bridge, BridgingSettings
from tsuiseki.tracking.types import Detections, FloatArray, Frame, ImageArray

WIDTH, HEIGHT, MARGIN = 240, 180, 120
STILL = np.eye(3)[:2]


@dataclass(frozen=True)
class Clip:
    """What a camera over some people sees; ``steps`` are its motions, ``(T, 2, 3)``, ``boxes`` ``(T, N, 4)``."""

    images: list[ImageArray]
    steps: FloatArray
    boxes: FloatArray

    def seen(self, missed: dict[int, range]) -> list[Detections]:
        """The right detections but for the frames in which somebody is missed."""
        result = []
        for t, boxes in enumerate(self.boxes):
            kept = np.array([t not in missed.get(n, ()) for n in range(len(boxes))], dtype=np.bool_)
            result.append(Detections(boxes[kept], np.full(int(kept.sum()), 0.8)))
        return result


def draw(seed: int, frames: int = 24, jerk: int = 25, people: int = 2, gone: int = 1000) -> Clip:
    """Textured people of 12 x 30 pixels who walk a pixel a frame; from frame ``gone`` on nobody is drawn."""
    rng = np.random.default_rng(seed)
    size = (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, 3)
    ground = cv2.GaussianBlur(rng.integers(0, 255, size).astype(np.uint8), (0, 0), 3)
    looks = [cv2.resize(rng.integers(0, 255, (5, 2, 3)).astype(np.uint8), (12, 30)) for _ in range(people)]
    start = np.array([MARGIN + 60 + 100 * np.arange(people), np.full(people, MARGIN + 70)]).T
    camera = np.clip(np.cumsum(rng.integers(-jerk, jerk + 1, (frames, 2)), axis=0) + MARGIN, MARGIN - 50, MARGIN + 40)
    images, boxes = [], []
    for t, (left, top) in enumerate(camera):
        whole = ground.copy()
        corners = start + np.array([t, 0])
        for (x, y), look in zip(corners, looks, strict=True):
            if t < gone:
                whole[y : y + 30, x : x + 12] = look
        images.append(whole[top : top + HEIGHT, left : left + WIDTH])
        corner = corners - camera[t]
        boxes.append(np.concatenate([corner, corner + np.array([12, 30])], axis=1))
    moved = np.diff(camera, axis=0, prepend=camera[:1])
    return Clip(images, np.stack([np.column_stack([np.eye(2), -step]) for step in moved]), np.array(boxes, dtype=float))


def bridged(clip: Clip, seen: list[Detections], bridge: Bridge, *, compensate: bool = True) -> list[Detections]:
    steps = clip.steps if compensate else [None] * len(seen)
    return [bridge.step(*given) for given in zip(clip.images, seen, steps, strict=True)]


def looked_at(clip: Clip, seen: list[Detections], settings: BridgingSettings | None, first: int) -> list[Observation]:
    """The observations from ``first`` on, by somebody who starts as early as the history asks for."""
    observers = Observers(seen, bridging=settings)
    start = max(first - observers.history, 0)
    frames = (Frame(t, t / 30, clip.images[t]) for t in range(start, len(seen)))
    return list(observe(frames, observers, first=first))


@pytest.mark.parametrize("seed", range(4))
def test_who_is_missed_for_five_frames_is_found_in_them(seed: int) -> None:
    clip = draw(seed)
    missed = {0: range(8, 13), 1: range(10, 15)}
    found = bridged(clip, clip.seen(missed), Bridge(BridgingSettings(most_frames=5)))
    for t, extra in enumerate(found):
        truth = clip.boxes[t, [n for n in missed if t in missed[n]]]
        assert len(extra) == len(truth)
        order = np.argsort(extra.boxes[:, 0])
        assert (iou_pairs(extra.boxes[order], truth) > 0.5).all()
        assert np.isnan(extra.scores).all()


def test_without_the_cameras_motion_jerks_lose_them() -> None:
    right = {True: 0, False: 0}
    for seed in range(4):
        clip = draw(seed, jerk=60)
        seen = clip.seen({0: range(8, 13)})
        for compensate in right:
            found = bridged(clip, seen, Bridge(BridgingSettings()), compensate=compensate)
            hits = [(iou_pairs(found[t].boxes, clip.boxes[t, 0]) > 0.5).any() for t in range(8, 13)]
            right[compensate] += int(np.sum(hits))
    assert right[True] == 20
    assert right[False] <= 10


def test_where_nobody_is_missed_nothing_changes() -> None:
    clip = draw(5, jerk=2)
    seen = clip.seen({})
    plain, with_bridges = looked_at(clip, seen, None, 0), looked_at(clip, seen, BridgingSettings(), 0)
    assert len(plain) == len(seen)
    for a, b in zip(plain, with_bridges, strict=True):
        assert b.detections is a.detections


def test_a_filter_gives_up_after_its_longest_gap() -> None:
    clip = draw(6)
    found = bridged(clip, clip.seen({0: range(8, 20)}), Bridge(BridgingSettings(most_frames=3)))
    assert [t for t, extra in enumerate(found) if len(extra)] == [8, 9, 10]


def test_a_filter_gives_up_where_the_person_is_gone() -> None:
    clip = draw(7, gone=10)
    seen = clip.seen({0: range(10, 24), 1: range(10, 24)})
    found = bridged(clip, seen, Bridge(BridgingSettings(most_frames=10, least_peak=0.4)))
    assert sum(len(extra) for extra in found[11:]) == 0


def test_a_filter_gives_up_outside_the_image() -> None:
    clip = draw(8, jerk=0)
    away = [image if t < 10 else np.roll(image, 30 * (t - 9), axis=1) for t, image in enumerate(clip.images)]
    step = np.array([[1.0, 0, 30], [0, 1, 0]])
    bridge, counts = Bridge(BridgingSettings(most_frames=14, least_peak=0.0)), []
    for t, found in enumerate(clip.seen({0: range(10, 24), 1: range(10, 24)})):
        extra = bridge.step(away[t], found, step if t >= 10 else STILL)
        counts.append(len(extra))
        assert ((centres(extra.boxes) > 0) & (centres(extra.boxes) < [WIDTH, HEIGHT])).all()
    assert counts[10] == 2
    assert counts[-1] == 0


def test_two_filters_on_one_person_are_one() -> None:
    clip = draw(9, people=1)
    doubled = [
        Detections(np.concatenate([found.boxes, found.boxes + 2]), np.repeat(found.scores, 2))
        for found in clip.seen({0: range(8, 12)})
    ]
    found = bridged(clip, doubled, Bridge(BridgingSettings()))
    assert [len(extra) for extra in found[8:12]] == [1] * 4


def test_what_is_held_is_one_image_and_the_filters_of_the_missed() -> None:
    clip, bridge = draw(10), Bridge(BridgingSettings())
    held = []
    for image, found, step in zip(clip.images, clip.seen({0: range(8, 13)}), clip.steps, strict=True):
        bridge.step(image, found, step)
        held.append(len(bridge.followed))
    assert held == [0] * 8 + [1] * 5 + [0] * 11


@pytest.mark.parametrize("first", [9, 11, 14])
def test_a_stretch_looked_at_alone_says_the_same(first: int) -> None:
    clip = draw(11, jerk=3)
    seen = clip.seen({0: range(6, 13), 1: range(10, 16)})
    whole, part = (looked_at(clip, seen, BridgingSettings(), start) for start in (0, first))
    assert sum(len(one.detections) for one in part) > sum(len(found) for found in seen[first:])
    for a, b in zip(whole[first:], part, strict=True):
        np.testing.assert_array_equal(a.detections.boxes, b.detections.boxes)
        np.testing.assert_array_equal(a.detections.scores, b.detections.scores)


def tracker(cost: float | None, **changes: Any) -> DroneTracker:
    """That takes boxes of filters at a cost."""
    flow = replace(DRONE_FLOW, input=replace(DRONE_FLOW.input, unscored=cost), **changes)
    return DroneTracker(DroneSettings(flow))


@pytest.mark.parametrize(("cost", "used"), [(-4.0, True), (8.0, False)])
def test_the_flow_takes_boxes_of_filters_at_their_price(cost: float, used: bool) -> None:
    clip = draw(12, frames=60, jerk=2)
    seen = looked_at(clip, clip.seen({0: range(20, 25), 1: range(40, 44)}), BridgingSettings(), 0)
    linking = tracker(cost)
    for one, step in zip(seen, clip.steps, strict=True):
        linking.update(one.detections, CameraStep(step))
    tracks = linking.tracks()
    assert len(tracks) == 2
    for track in tracks:
        assert track.observed.all() == used
        assert len(track) == 60


def test_boxes_of_filters_make_no_track() -> None:
    linking = tracker(0.4)
    for t in range(40):
        box = np.array([[10.0 + t, 10, 22 + t, 40]])
        linking.update(Detections(box, np.array([0.9 if t == 0 else np.nan])))
    assert linking.tracks() == []


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="most_frames from 1 frame, got 0"):
        BridgingSettings(most_frames=0)
    for peak, overlap in ((1.5, 0.3), (-0.1, 0.3), (0.2, 0.0), (0.2, 1.0)):
        with pytest.raises(ValueError, match="expected least_peak from 0 to 1 and overlap between them, got"):
            BridgingSettings(least_peak=peak, overlap=overlap)
