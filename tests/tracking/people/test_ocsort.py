"""OC-SORT: each of its three parts against a slow or closed form of it, then what each does for a track."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.filters.kalman import BoxMotion, Gaussians, predict, start_boxes, update
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.people.contract import run_tracker
from tsuiseki.tracking.people.ocsort import History, OcSort, OcSortSettings, direction_costs, re_updated
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.types import Detections, FloatArray

HERE = np.array([100.0, 100.0, 140.0, 200.0])
ACROSS = np.array([1.0, 0.0, 1.0, 0.0])


def frame(*boxes: FloatArray, score: float = 0.9) -> Detections:
    return Detections(np.array(boxes).reshape(-1, 4), np.full(len(boxes), score))


def history(boxes: FloatArray, trail: FloatArray, ages: FloatArray) -> History:
    return History(start_boxes(boxes, BoxMotion()), boxes, trail, ages)


# The re-update (ORU).


def textbook(motion: BoxMotion) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Transition, its noise, observation and its noise of one coordinate."""
    noise = motion.acceleration**2 * np.array([[0.25, 0.5], [0.5, 1.0]])
    return np.array([[1.0, 1.0], [0.0, 1.0]]), noise, np.array([[1.0, 0.0]]), np.array([[motion.measurement**2]])


def test_re_update_is_the_filter_along_the_straight_way() -> None:
    """Three tracks with gaps of 0, 1 and 6 frames, each coordinate by the textbook's filter, one after the other."""
    motion, rng = BoxMotion(), np.random.default_rng(0)
    boxes = HERE + rng.uniform(0, 300, (3, 1))
    found, misses = boxes + rng.normal(0, 20, (3, 4)), np.array([0, 1, 6])
    past = history(boxes, np.zeros((3, 4, 2)), np.zeros((3, 4)))
    again = re_updated(past, np.arange(3), misses, found, motion, np.ones(9))
    transition, noise, observation, spread = textbook(motion)
    for track in range(3):
        for coordinate in range(4):
            first, last = boxes[track, coordinate], found[track, coordinate]
            state = Gaussians(
                np.array([[first, 0.0]]), np.diag([motion.measurement**2, motion.start_velocity**2])[None]
            )
            for passed in range(1, misses[track] + 1):
                virtual = first + passed / (misses[track] + 1) * (last - first)
                state = update(predict(state, transition, noise), np.array([[virtual]]), observation, spread)
            state = predict(state, transition, noise)
            assert again.boxes[track, coordinate] == pytest.approx(state.mean[0, 0])
            assert again.velocities[track, coordinate] == pytest.approx(state.mean[0, 1])
        covariance = state.covariance[0][[0, 0, 1], [0, 1, 1]]
        np.testing.assert_allclose(again.variance[track], covariance)


def test_re_update_mends_a_velocity_that_was_wrong() -> None:
    """Somebody stands still, jerks aside in the last frame before a gap, and is found at the old place.

    The plain filter believes in the jerk through the gap and its velocity is pulled far the other way by what it finds;
    the re-updated one was seen to walk back slowly.
    """
    jerk = [frame(HERE)] * 6 + [frame(HERE + 12 * ACROSS)]
    hidden = [Detections.empty()] * 8
    tracker = OcSort()
    for found in [*jerk, *hidden, frame(HERE)]:
        tracker.update(found)
    (velocity,) = tracker._belief.velocities
    assert abs(velocity[0]) < 1.5
    assert velocity[0] == pytest.approx(-12 / 9, abs=0.4)


# The momentum (OCM).


@pytest.mark.parametrize(
    ("aim", "cost"), [((1, 0), -0.5), ((1, 1), -0.25), ((0, 1), 0.0), ((0, -1), 0.0), ((-1, 1), 0.25), ((-1, 0), 0.5)]
)
def test_a_turn_costs_its_angle(aim: tuple[float, float], cost: float) -> None:
    """The track went to the right."""
    trail = np.array([[[50.0, 50.0], [45.0, 50.0], [40.0, 50.0], [0.0, 0.0]]])
    past = history(HERE[None], trail, np.array([[0.0, 1.0, 2.0, np.inf]]))
    assert direction_costs(past, trail[0, :1] + 7 * np.array([aim]))[0, 0] == pytest.approx(cost)


def test_the_direction_is_that_of_the_last_frames_only() -> None:
    """Δt is 3: an observation of five frames ago says nothing, one of three frames ago does."""
    trail = np.array([[[50.0, 50.0], [50.0, 40.0], [0.0, 50.0], [0.0, 0.0]]])
    down = np.array([[50.0, 60.0]])
    assert direction_costs(history(HERE[None], trail, np.array([[0.0, 3.0, 5.0, np.inf]])), down) == -0.5
    assert direction_costs(history(HERE[None], trail, np.array([[0.0, 1.0, 3.0, np.inf]])), down) == 0.0
    assert direction_costs(history(HERE[None], trail, np.array([[0.0, 4.0, 5.0, np.inf]])), down) == 0.0


def test_no_direction_costs_nothing() -> None:
    still = np.full((1, 4, 2), 50.0)
    past = history(HERE[None], still, np.array([[0.0, 1.0, 2.0, 3.0]]))
    assert direction_costs(past, np.array([[60.0, 50.0], [50.0, 50.0]])).tolist() == [[0.0, 0.0]]
    assert direction_costs(past, np.empty((0, 2))).shape == (1, 0)


@pytest.mark.parametrize(("weight", "taken"), [(0.2, 84), (0.0, 61)])
def test_the_momentum_decides_between_like_overlaps(weight: float, taken: float) -> None:
    """Somebody walks to the right, is at 66 and expected at 72; at 61, behind, is a box that overlaps a little more."""
    tracker = OcSort(OcSortSettings(direction_weight=weight))
    for step in range(12):
        tracker.update(frame(HERE + 6 * step * ACROSS))
    tracker.update(frame(HERE + 61 * ACROSS, HERE + 84 * ACROSS))
    person = int(np.flatnonzero(tracker._misses == 0)[0])
    np.testing.assert_array_equal(tracker._history.boxes[person], HERE + taken * ACROSS)


def test_history_follows_each_track_through_misses() -> None:
    """Against a list a track: three people, each detected at times of its own, in shuffled order."""
    rng = np.random.default_rng(1)
    homes = np.array([HERE, HERE + 300 * ACROSS, HERE + 600 * ACROSS])
    tracker = OcSort()
    seen: list[list[tuple[int, FloatArray]]] = [[], [], []]
    for time in range(40):
        present = rng.permutation(3)[: rng.integers(1, 4)] if time > 3 else rng.permutation(3)
        boxes = homes[present] + rng.normal(0, 2, (len(present), 4))
        for person, box in zip(present, boxes, strict=True):
            seen[person].append((time, box))
        tracker.update(frame(*boxes))
        known = tracker._history
        assert len(known.boxes) == 3
        for row, box in enumerate(known.boxes):
            person = int(np.abs(homes[:, 0] - box[0]).argmin())
            times = [t for t, _ in seen[person]]
            np.testing.assert_array_equal(box, seen[person][-1][1])
            count = min(4, len(times))
            assert known.ages[row, :count].tolist() == [times[-1] - t for t in times[::-1][:count]]
            assert np.isinf(known.ages[row, count:]).all()
            wanted = centres(np.array([b for _, b in seen[person][::-1][:count]]))
            np.testing.assert_allclose(known.trail[row, :count], wanted)


# The recovery (OCR).


def test_recovery_finds_who_stopped_while_hidden() -> None:
    """The prediction has walked on by two widths; the last observation is where the person still stands."""
    walk = [frame(HERE + 8 * step * ACROSS) for step in range(10)]
    stop = frame(HERE + 72 * ACROSS)
    video = [*walk, *[Detections.empty()] * 9, *[stop] * 5]
    (track,) = run_tracker(video, OcSort())
    assert track.frames.tolist() == [*range(10), *range(19, 24)]
    patient = SortSettings(max_age=30, start_score=0.6)
    assert len(run_tracker(video, Sort(patient))) == 2


# The rest.


def test_low_scores_take_part_in_nothing() -> None:
    video = [frame(HERE)] * 5 + [frame(HERE, score=0.5)] * 3 + [frame(HERE)] * 2
    (track,) = run_tracker(video, OcSort())
    assert track.frames.tolist() == [0, 1, 2, 3, 4, 8, 9]


@pytest.mark.parametrize("wrong", [{"min_iou": 0.0}, {"direction_weight": -1.0}, {"direction_span": 0}])
def test_settings_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        OcSortSettings(**wrong)  # type: ignore[arg-type]
