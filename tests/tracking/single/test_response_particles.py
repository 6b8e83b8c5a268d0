"""A network and particles: what they follow, what they say of it, and how they find it again."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, overlaps, run, walk
from tests.tracking.single.tiny_siamese import LAYOUTS, nanotrack
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.single.on_target import OTHERS, OWN, Weights, look, weights_of
from tsuiseki.tracking.single.response_particles import PARTICLES, ResponseParticles
from tsuiseki.tracking.single.settings import SingleChoice
from tsuiseki.tracking.single.siamese import SiameseNetwork, open_network
from tsuiseki.tracking.video.image_folder import read_image

BLACK = 20


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> SiameseNetwork:
    return open_network(nanotrack(tmp_path_factory.mktemp("nanotrack")))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_followed(layout: str, tmp_path: Path) -> None:
    images, boxes = clip(walk(20), height=32, width=32)
    seen = run(SingleChoice(network=tuple(LAYOUTS[layout](tmp_path))).tracker(), images, boxes[0])
    assert overlaps(seen, boxes).mean() > 0.7
    assert all(0 <= target.score <= 1 for target in seen)


def test_same_seed_same_answers(network: SiameseNetwork) -> None:
    images, boxes = clip(walk(8), height=32, width=32)
    answers = [run(ResponseParticles(network, 3), images, boxes[0]) for _ in "ab"]
    for first, second in zip(*answers, strict=True):
        np.testing.assert_array_equal(first.box, second.box)
        assert first.score == second.score


def test_twenty_black_frames_in_between_and_it_is_back_on_the_target(network: SiameseNetwork) -> None:
    images, boxes = clip(np.repeat(walk(15), [1] * 9 + [BLACK] + [1] * 5, axis=0), height=32, width=32)
    dark = slice(10, 10 + BLACK)
    images[dark] = [np.zeros_like(image) for image in images[dark]]
    seen = run(ResponseParticles(network), images, boxes[0])
    assert {target.status for target in seen[dark.start - 1 : dark.stop - 1]} == {"searching", "lost"}
    assert (overlaps(seen, boxes)[dark.stop - 1 :] > 0.5).all()


def test_a_black_picture_says_nothing(network: SiameseNetwork) -> None:
    images, boxes = clip(walk(2), height=32, width=32)
    tracker = ResponseParticles(network)
    tracker.start(images[0], boxes[0])
    target = tracker.follow(np.zeros_like(images[0]))
    assert (target.score, target.status) == (0.0, "searching")
    np.testing.assert_array_equal(target.box, boxes[0])


def test_both_of_two_peaks_keep_particles(network: SiameseNetwork) -> None:
    images, boxes = clip([(60, 80), (60, 80)], height=32, width=32)
    tracker = ResponseParticles(network)
    tracker.start(images[0], boxes[0])
    centre = np.array([60.0, 80.0])
    tracker._particles[:, :2] = centre + np.array([-20.0, 0]) * np.array([[-1.0], [1.0]]).repeat(PARTICLES // 2, axis=0)
    scores, peaks = np.zeros((16, 16)), np.zeros((16, 16, 4))
    scores[8, 6], scores[8, 10] = 0.9, 0.8
    half, apart = np.array([-16.0, -16, 16, 16]), np.array([20.0, 0, 20, 0])
    peaks[8, 6], peaks[8, 10] = np.tile(centre, 2) - apart + half, np.tile(centre, 2) + apart + half
    tracker._weigh(scores, peaks)
    left = (tracker._particles[:, 0] < centre[0]).mean()
    assert 0.5 < left < 0.7  # as 0.9 squared to 0.8 squared
    np.testing.assert_allclose(np.abs(tracker._particles[:, 0] - centre[0]), 20)


def test_it_is_searched_further_away_as_time_passes(network: SiameseNetwork) -> None:
    images, boxes = clip([(100, 80)], height=32, width=32)
    tracker = ResponseParticles(network)
    tracker.start(images[0], boxes[0])
    centre, size = np.array([100.0, 80.0]), np.array([8.0, 8.0])
    away = [
        float(np.linalg.norm(tracker._next_place(images[0], centre, size, np.zeros(2)) - centre)) for _ in range(40)
    ]
    assert away[0] == 0
    assert max(away[:4]) < max(away[:12]) < max(away)
    assert min(away[20:]) == 0  # the first place is looked at again


def test_a_target_that_left_is_searched_at_that_border(network: SiameseNetwork) -> None:
    images, boxes = clip([(100, 80)], height=32, width=32)
    tracker = ResponseParticles(network)
    tracker.start(images[0], boxes[0])
    places = [tracker._next_place(images[0], np.array([190.0, 80]), np.full(2, 30.0), np.array([4.0, 0]))]
    places += [
        tracker._next_place(images[0], np.array([190.0, 80]), np.full(2, 30.0), np.array([4.0, 0])) for _ in "ab"
    ]
    assert all(place[0] <= 200 for place in places)
    assert places[0][0] > 190


def test_a_look_is_a_unit_vector_of_the_middle() -> None:
    template = np.zeros((1, 2, 8, 8), dtype=np.float32)
    template[0, :, :2] = 100  # the surroundings
    template[0, 0, 3, 3], template[0, 1, 4, 4] = 1, 2
    vector = look(template)
    assert vector.shape == (2 * 4 * 4,)
    assert np.linalg.norm(vector) == pytest.approx(1)
    assert vector.sum() == pytest.approx(0, abs=1e-6)
    assert (look(np.zeros_like(template)) == 0).all()


@pytest.mark.parametrize("weights", [OWN, OTHERS])
def test_the_probability_rises_with_score_and_likeness(weights: Weights) -> None:
    on, off = np.array([8.0, -4, 0.1, 0.9, 0.3, 1.0, 1.0]), np.array([-4.0, 0.5, 0.3, 0.3, 0.5, 0.5, 0.7])
    assert weights.probability(on, on) > 0.9
    assert weights.probability(off, off) < 0.1
    assert weights.probability(off, off) < weights.probability(on, off) < weights.probability(on, on)


@pytest.mark.parametrize(("layout", "weights"), [("own", OWN), ("nanotrack", OTHERS)])
def test_a_kind_of_network_has_its_weights(layout: str, weights: Weights, tmp_path: Path) -> None:
    assert weights_of(open_network(LAYOUTS[layout](tmp_path))) is weights


@pytest.mark.slow
def test_the_command_writes_the_probability_of_every_frame(tmp_path: Path) -> None:
    images, boxes = clip(walk(8), height=32, width=32)
    (tmp_path / "clip").mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "clip" / f"{number:03d}.png"), image[..., ::-1])
    files, box = ",".join(map(str, LAYOUTS["own"](tmp_path))), ",".join(f"{v:g}" for v in (*boxes[0, :2], 32, 32))
    words = [
        "track",
        "single",
        str(tmp_path / "clip"),
        "--box",
        box,
        "--network",
        files,
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(words) == 0
    frames = json.loads((tmp_path / "out" / "run.json").read_text())["frames"]
    assert len(frames["score"]) == len(frames["status"]) == len(images)
    states = zip(frames["score"], frames["status"], strict=True)
    assert all((score >= 0.5) == (status == "tracking") for score, status in states)


@pytest.mark.integration
@pytest.mark.slow
@pytest.mark.parametrize("shipped", [True, False], ids=["shipped", "nanotrack"])
def test_a_network_is_back_on_a_real_target_after_twenty_black_frames(data_folder: Path, shipped: bool) -> None:
    files = () if shipped else tuple(sorted((data_folder / "peers" / "nanotrackv2").glob("*.onnx")))
    sequence = find_single_sequences(data_folder / "sot" / "otb" / "Crossing")[0]
    images, boxes = [read_image(path) for path in sequence.images[:70]], sequence.boxes[:70]
    images[30:50] = [np.zeros_like(image) for image in images[30:50]]
    seen = run(SingleChoice(network=files).tracker(), images, boxes[0])
    assert not any(target.status == "tracking" for target in seen[29:49])
    assert (overlaps(seen, boxes)[-10:] > 0.5).all()
