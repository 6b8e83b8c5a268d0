"""Clips from a drone: what is in them, how they move, that labels say what is drawn."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tsuiseki.datamodules.action_crops import action_sequences
from tsuiseki.datamodules.scenes.clip import ClipSettings, write_clip
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings, fly
from tsuiseki.datamodules.scenes.people.activities import drinking, sip
from tsuiseki.datamodules.scenes.people.gait import Manner, running
from tsuiseki.datamodules.scenes.people.gathering import Gathering
from tsuiseki.datamodules.scenes.people.poses import lying, sitting
from tsuiseki.datamodules.scenes.people.posture import LEFT, RIGHT, Build, PersonSkeleton, Pose, reach
from tsuiseki.datamodules.scenes.render.composing import clusters
from tsuiseki.datamodules.scenes.render.ground import ground_homography, look_down
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.acting_tracks import OKUTAMA_ACTIONS, POSTURES
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence

SMALL = DroneSceneSettings(width=320, height=180, frames=6, people=4, clutter=1)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("drone") / "clip", DroneClip(SMALL, 3))


def test_a_clip_is_a_sequence_with_actions(clip):
    sequence = read_sequence(clip)
    assert (len(sequence.images), sequence.width, sequence.height, sequence.frame_rate) == (6, 320, 180, 30)
    truth = read_ground_truth(sequence.ground_truth_path)
    (acting,) = action_sequences(clip)
    labels = acting.labels
    assert list(zip(labels.frames, labels.ids, strict=True)) == list(zip(truth.frames, truth.ids, strict=True))
    # Whole pixels of 3840x2160 are twelfths of these.
    np.testing.assert_allclose(labels.boxes, truth.boxes, atol=2 / 12)
    postures = labels.actions[:, [OKUTAMA_ACTIONS.index(p) for p in POSTURES]]
    assert (postures.sum(axis=1) == 1).all()
    assert (labels.actions.sum(axis=1) <= 2).all()


def test_okutama_layout_holds_the_same_labels(clip, tmp_path):
    (tmp_path / "set").mkdir()
    folder = write_clip(tmp_path / "set", DroneClip(replace(SMALL, layout="okutama"), 3))
    (published,), (generated,) = action_sequences(folder), action_sequences(clip)
    assert published.name == "1.1.3"  # of seed 3
    assert published.files[5].name == "5.jpg"
    np.testing.assert_array_equal(published.labels.boxes, generated.labels.boxes)
    np.testing.assert_array_equal(published.labels.actions, generated.labels.actions)


def test_the_same_seed_makes_the_same_clip(clip):
    flight = DroneClip(SMALL, 3)
    (image,), truth = flight.draw_frame(4)
    (again,), _ = DroneClip(SMALL, 3).draw_frame(4)
    np.testing.assert_array_equal(image, again)
    rows = read_ground_truth(clip / "gt" / "gt.txt").between(4, 4)
    np.testing.assert_allclose(truth.boxes, rows.boxes, atol=1e-3)
    (other,), _ = DroneClip(SMALL, 4).draw_frame(4)
    assert np.abs(image.astype(int) - other).mean() > 5


def test_a_hard_sun_changes_the_light_and_nothing_else():
    plain, sunny = (DroneClip(replace(SMALL, sun=sun), 3) for sun in (0.0, 1.0))
    shade, light = (
        f.light.sky.mean() / (f.light.sky + f.light.sun * f.light.direction[2]).mean() for f in (plain, sunny)
    )
    assert light < 0.35 < shade
    ((before,), people), ((after,), others) = (flight.draw_frame(4) for flight in (plain, sunny))
    np.testing.assert_array_equal(people.boxes, others.boxes)
    assert np.abs(before.astype(int) - after).mean() > 1


def test_everybody_in_view_is_visible_in_its_box():
    settings = replace(SMALL, people=1, clutter=0, camera="still")
    flight = DroneClip(settings, 5)
    flight.grains.clear()
    (image,), truth = flight.draw_frame(0)
    flight.gathering.performers.clear()
    (empty,), _ = flight.draw_frame(0)
    changed = np.abs(image.astype(int) - empty).max(axis=2) > 40
    rows, columns = np.nonzero(changed)
    x1, y1, x2, y2 = truth.boxes[0]
    inside = (columns >= x1 - 1) & (columns < x2 + 1) & (rows >= y1 - 1) & (rows < y2 + 1)
    assert inside.sum() > 0.15 * (x2 - x1) * (y2 - y1)


@pytest.mark.slow
def test_all_twelve_actions_are_performed():
    arena = np.array([[0.0, 0.0], [6.0, 5.0]])
    seen: set[str] = set()
    for seed in range(6):
        performance = Gathering(
            np.random.default_rng(seed), ClipSettings(frames=200, frame_rate=30.0), 9, arena, np.empty((0, 3))
        )
        seen |= {a for p in performance.performers for m in p.states for a in m.activity.actions}
    assert seen == set(OKUTAMA_ACTIONS)


def test_nobody_jumps():
    clip, arena = ClipSettings(frames=240, frame_rate=30.0), np.array([[0.0, 0], [6, 5]])
    performance = Gathering(np.random.default_rng(1), clip, 8, arena, np.empty((0, 3)))
    assert len(performance.performers) == 8
    for performer in performance.performers:
        path = np.array([m.position for m in performer.states])
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 0.2  # 6 m/s


@pytest.mark.parametrize("hand", [LEFT, RIGHT])
@pytest.mark.parametrize("target", [(0.3, 0.0, -0.2), (0.05, -0.08, 0.15), (-0.2, 0.1, -0.4)])
def test_a_hand_reaches_its_target(hand, target):
    build = Build()
    skeleton = PersonSkeleton(build, reach(build, Pose(), hand, target), np.zeros(2), 0.0)
    palm = 0.5 * (skeleton.wrist[hand] + skeleton.fingers[hand])
    outward = np.array([target[0], (1 if hand == LEFT else -1) * target[1], target[2]])
    np.testing.assert_allclose(palm - skeleton.shoulder[hand], outward, atol=0.01)


def test_postures_have_their_heights():
    build, rng = Build(), np.random.default_rng(0)
    heads = {}
    for name, pose in (("lie", lying(rng, build)), ("ground", sitting(rng, True)), ("bench", sitting(rng, False))):
        heads[name] = PersonSkeleton(build, pose, np.zeros(2), 0.0).head[2]
    assert heads["lie"] < 0.35 < heads["ground"] < 1.0 < heads["bench"] < 1.45
    raised = [
        PersonSkeleton(build, drinking(build, Pose(), RIGHT, t), np.zeros(2), 0.0).wrist[RIGHT, 2] for t in (0.0, 1.4)
    ]
    assert raised[1] > raised[0] + 0.3
    assert (sip(0.0), sip(1.4)) == (0.0, 1.0)
    strides = [running(build, Manner(), phase, 3.5) for phase in (0.0, 0.25)]
    assert strides[0].hip[0] - strides[0].hip[1] > 1.0  # legs far apart
    assert strides[1].lift > 0.05  # in flight


def test_stronger_motion_moves_the_picture_more():
    def moves(strength):
        rng = np.random.default_rng(0)
        cameras = fly(rng, DroneSceneSettings(frames=90, camera=strength), 20.0, 1.0, 1280.0)
        middle = np.array([640.0, 360.0, 1.0])
        steps = [ground_homography(a, b) @ middle for a, b in itertools.pairwise(cameras)]
        return np.array([np.linalg.norm(s[:2] / s[2] - middle[:2]) for s in steps])

    assert moves("still").max() < 1e-6
    assert 0.5 < np.median(moves("calm")) < 12
    assert moves("violent").max() > 40
    assert np.median(moves("violent")) > 1.5 * np.median(moves("calm"))


def test_the_ground_moves_as_its_homography_says():
    flight = DroneClip(replace(SMALL, camera="calm", frames=30), 6)
    first, second = flight.cameras[0], flight.cameras[29]
    before, after = look_down(flight.ground, first), look_down(flight.ground, second)
    shift = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])
    matrix = shift @ ground_homography(first, second) @ np.linalg.inv(shift)
    moved = cv2.warpPerspective(before, matrix, (320, 180), borderValue=(0, 0, 0))
    covered = cv2.warpPerspective(np.full((180, 320), 255, np.uint8), matrix, (320, 180)) == 255
    still = np.abs(before.astype(int) - after)[covered].mean()
    assert np.abs(moved.astype(int) - after)[covered].mean() < 0.6 * still


def test_clusters_do_not_touch_and_hold_everything_in_view():
    rng = np.random.default_rng(0)
    low = rng.uniform(-60, 300, (40, 2))
    rects = np.concatenate([low, low + rng.uniform(5, 40, (40, 2))], axis=1)
    rects[3] = np.nan
    found = clusters(rects, 320, 180)
    members = np.concatenate([m for _, m in found])
    in_view = (rects[:, 0] < 320) & (rects[:, 1] < 180) & (rects[:, 2] > 0) & (rects[:, 3] > 0)
    assert sorted(members.tolist()) == np.flatnonzero(in_view).tolist()
    cover = np.zeros((180, 320), dtype=int)
    for (x1, y1, x2, y2), _ in found:
        cover[y1:y2, x1:x2] += 1
    assert cover.max() == 1


@pytest.mark.parametrize(
    "change",
    [{"altitude": (1.0, 20.0)}, {"tilt": (20.0, 60.0)}, {"people": 0}, {"width": 10}, {"clutter": -1}, {"sun": 2}],
)
def test_settings_out_of_range_are_refused(change):
    with pytest.raises(ValidationError, match=next(iter(change))):
        replace(SMALL, **change)


def test_the_command_writes_a_clip_and_refuses_nonsense(tmp_path, capsys):
    out = tmp_path / "clip"
    words = ["simulate", "drone", "--out", str(out), "--frames", "2", "--width", "160", "--height", "96"]
    assert main([*words, "--people", "2", "--camera", "calm"]) == 0
    assert len(read_sequence(out).images) == 2
    assert main([*words, "--people", "0", "--overwrite"]) == 2
    assert "--people: expected a number greater than 0" in capsys.readouterr().err
    assert main([*words, "--camera", "wild"]) == 2
    assert "--camera" in capsys.readouterr().err
