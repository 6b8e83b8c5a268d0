"""Siamese networks as ONNX: their layouts, what they say of a place, and OpenCV's own loop beside ours."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import save_constant
from tests.tracking.single.moving_texture import clip, overlaps, run, walk
from tests.tracking.single.tiny_siamese import LAYOUTS, nanotrack, own
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.single.settings import NONE, SingleChoice
from tsuiseki.tracking.single.siamese import Square, open_network
from tsuiseki.tracking.video.image_folder import read_image


@pytest.fixture(scope="session", params=LAYOUTS)
def files(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return LAYOUTS[request.param](tmp_path_factory.mktemp(request.param))


def test_a_square_inside_the_image_is_its_part() -> None:
    image = np.arange(60 * 80 * 3, dtype=np.uint8).reshape(60, 80, 3)
    square = Square.about(np.array([30.0, 20.0]), 16)
    assert (square.left, square.top, square.centre.tolist()) == (22, 12, [30.0, 20.0])
    np.testing.assert_array_equal(square.crop(image, 16), image[12:28, 22:38])


def test_outside_the_image_is_its_mean_colour() -> None:
    image = np.zeros((40, 40, 3), dtype=np.uint8)
    image[:, 20:] = 100
    crop = Square(-10, 30, 20).crop(image, 20)
    assert (crop[:, :10] == 50).all()
    assert (crop[10:] == 50).all()
    assert (crop[:10, 10:] == 0).all()
    assert (Square(500, 500, 20).crop(image, 20) == 50).all()


def test_every_layout_scores_highest_where_the_target_is(files: list[Path]) -> None:
    images, boxes = clip([(100, 80), (109, 73)], height=32, width=32)
    network = open_network(files[::-1])  # the order of the files says nothing
    middle, size = (boxes[0, :2] + boxes[0, 2:]) / 2, boxes[0, 2:] - boxes[0, :2]
    template = network.template(images[0], Square.about(middle, network.template_side(size)))
    square = network.search_square(middle, size)
    first, second = network.respond(images[1], square, [template, template])
    np.testing.assert_array_equal(first.scores, second.scores)
    best = np.unravel_index(int(np.argmax(first.scores)), first.scores.shape)
    assert 0.5 < first.scores[best] <= 1
    cell = square.side / first.scores.shape[0]
    np.testing.assert_allclose(network.boxes_in_image(first, square)[best], boxes[1], atol=cell)


def test_every_layout_is_followed_by_the_plain_loop(files: list[Path]) -> None:
    images, boxes = clip(walk(20), height=32, width=32)
    seen = run(SingleChoice("siamese", network=tuple(files)).tracker(), images, boxes[0])
    assert overlaps(seen, boxes).mean() > 0.7
    assert all(0.1 < target.score <= 1 for target in seen)


@pytest.mark.integration
@pytest.mark.parametrize("name", ["otb/Crossing", "uav-more/truck4"])
def test_the_plain_loop_has_the_boxes_of_opencv(data_folder: Path, name: str) -> None:
    """Equal to the last digit; the second clip has a target smaller than OpenCV's least box."""
    if not hasattr(cv2, "TrackerNano_create"):
        pytest.skip("this OpenCV has no TrackerNano")
    files = sorted((data_folder / "peers" / "nanotrackv2").glob("*.onnx"))
    sequence = find_single_sequences(data_folder / "sot" / name)[0]
    images, box = [read_image(path) for path in sequence.images[:40]], sequence.boxes[0]
    parameters = cv2.TrackerNano_Params()
    parameters.backbone, parameters.neckhead = map(str, files)
    peer = cv2.TrackerNano_create(parameters)
    corner, size = np.trunc(box[:2]).astype(int), np.trunc(box[2:] - box[:2]).astype(int)
    peer.init(images[0][..., ::-1].copy(), (*corner.tolist(), *size.tolist()))
    theirs = np.array([peer.update(image[..., ::-1].copy())[1] for image in images[1:]])
    ours = np.array([s.box for s in run(SingleChoice("siamese", network=tuple(files)).tracker(), images, box)])
    np.testing.assert_array_equal(ours, np.concatenate([theirs[:, :2], theirs[:, :2] + theirs[:, 2:]], axis=1))


@pytest.mark.parametrize("left", [-40, 40])
@pytest.mark.parametrize("top", [-40, 40])
def test_a_square_outside_the_image_shows_its_mean_colour(left: int, top: int) -> None:
    image = np.zeros((20, 30, 3), dtype=np.uint8)
    image[:10] = 100
    np.testing.assert_array_equal(Square(left, top, 12).crop(image, 8), np.full((8, 8, 3), 50))


def test_files_of_no_layout_are_refused(tmp_path: Path) -> None:
    detector = tmp_path / "detector.onnx"
    save_constant(detector, {"output": np.zeros((1, 5, 6), dtype=np.float32)})
    for files in ([detector], [detector, detector], nanotrack(tmp_path)[:1], [*own(tmp_path), detector]):
        with pytest.raises(RequestError, match="`network`: expected a tracker of one target: NanoTrack's backbone"):
            open_network(files)


def test_a_part_of_another_layout_is_refused(tmp_path: Path) -> None:
    (backbone, _), (template, search) = nanotrack(tmp_path), own(tmp_path)
    with pytest.raises(RequestError, match="expected a tracker of one target"):
        open_network([backbone, search])
    with pytest.raises(RequestError, match=re.escape(str(tmp_path / "absent.onnx"))):
        open_network([template, tmp_path / "absent.onnx"])


def test_files_belong_to_a_method_that_takes_them(tmp_path: Path) -> None:
    file = (tmp_path / "a.onnx",)
    with pytest.raises(ValueError, match="`network`: expected with `method` combined or siamese, got kcf"):
        SingleChoice("kcf", network=file)
    with pytest.raises(ValueError, match="`network`: expected the files of a network"):
        SingleChoice("siamese", network=NONE)
    for network in ((), file):
        with pytest.raises(ValueError, match="`scale`: expected with `network` none"):
            SingleChoice(network=network, scale=True)
