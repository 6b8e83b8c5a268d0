"""Folders of images: their order, and what is missing or twice in it. Numbers such as 58.1 are those of the report."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.formats.mot_sequence import list_images
from tsuiseki.tracking.video.source import open_source


def make(folder: Path, *names: str, level: int = 90) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        cv2.imwrite(str(folder / name), np.full((20, 30, 3), level, np.uint8))
    return folder


@pytest.mark.parametrize(
    "names",
    [
        ("1.0", "1.04", "1.16", "1.2", "2.0"),  # seconds
        ("0.25", "0.5", "0.75", "1", "1.25"),
        ("frame_9.04", "frame_9.2", "frame_10.0"),
        ("1.8", "1.9", "1.10", "1.11"),  # a part that counts on
        ("-10", "-2", "0", "3", "12"),
        ("-0.5", "-0.25", "0", "0.25"),
        ("-1.5", "-1.25", "-1.0"),  # all of them negative
        ("t_-10", "t_-9", "t_-1"),
        ("frame_-1", "frame_0", "frame_1"),
        ("cam-0.25", "cam-0.5"),  # a hyphen behind a letter
        ("0.04s", "0.2s", "1.0s"),  # a unit
        ("1700000000.04_left", "1700000000.2_left"),
        ("0,04", "0,2", "1,0"),  # a decimal comma
        ("cam1_2", "cam1_10", "cam2_1"),
        ("a_2b", "a_10b"),
        ("img-2", "img-10"),  # a hyphen, no minus
        ("2024-01-05", "2024-01-10"),
        ("9", "10", "011"),
    ],
)
def test_58_9_names_are_ordered_by_their_numbers(names: tuple[str, ...], tmp_path: Path) -> None:
    make(tmp_path, *(f"{name}.png" for name in reversed(names)))
    assert [path.stem for path in list_images(tmp_path)] == list(names)


def test_58_9_two_files_of_one_number_are_refused(tmp_path: Path) -> None:
    make(tmp_path, "1.jpg", "1.png", "2.jpg")
    with pytest.raises(RequestError, match=r"1.jpg: expected one image a number, got 1.png, too"):
        open_source(tmp_path)


def test_58_9_numbers_that_are_left_out_are_said_or_refused(tmp_path: Path) -> None:
    numbers = [*range(1, 8), *range(12, 16)]
    plain = make(tmp_path / "plain", *(f"{n:06d}.png" for n in numbers))
    with pytest.warns(InputWarning, match=r"4 images are left out, the first after 000007.png"):
        assert open_source(plain).length == 11
    sequence = make(tmp_path / "sequence" / "img1", *(f"{n:06d}.png" for n in numbers)).parent
    with pytest.raises(RequestError, match=r"4 images are left out, the first after 000007.png; labels .* add them"):
        open_source(sequence)
    # Each tenth of a video leaves nothing out.
    open_source(make(tmp_path / "tenth" / "img1", *(f"{n:06d}.png" for n in range(1, 100, 10))).parent)


def test_58_9_a_sequence_whose_images_do_not_begin_with_1_says_which_frame_is_1(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    for first in (0, 1, 302):
        folder = make(tmp_path / f"{first}" / "img1", *(f"{n:06d}.png" for n in range(first, first + 5))).parent
        assert open_source(folder).length == 5
    (warning,) = recwarn
    assert str(warning.message).endswith("its first image, 000302.png, is taken as frame 1 of labels and detections")


def test_58_9_an_image_of_many_pixels_is_read_without_a_word(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    Image.fromarray(np.zeros((9_500, 9_500), np.uint8)).save(tmp_path / "1.png", compress_level=1)
    assert open_source(tmp_path).size == (9_500, 9_500)
    assert not list(recwarn)


def test_58_9_a_link_to_nothing_is_said(tmp_path: Path) -> None:
    make(tmp_path, "1.png")
    (tmp_path / "2.png").symlink_to("gone.png")
    with pytest.raises(RequestError, match=r"2.png: expected an image, got a link to gone.png, where nothing lies"):
        open_source(tmp_path)


def test_58_9_an_image_of_too_many_pixels_is_said(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((14_000, 14_000), np.uint8)).save(tmp_path / "1.png", compress_level=1)
    with pytest.raises(RequestError, match="expected at most 178 million pixels, got more"):
        open_source(tmp_path)


@pytest.mark.parametrize("kind", ["png", "tif"])
@pytest.mark.parametrize("depth", [10, 12, 14, 16])
@pytest.mark.parametrize("colour", [True, False])
@pytest.mark.filterwarnings("ignore::tsuiseki.tracking.errors.InputWarning")
def test_58_7_pictures_of_16_bits_are_scaled_by_those_in_use(
    kind: str, depth: int, colour: bool, tmp_path: Path
) -> None:
    levels = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    levels[0, 0] = 255
    levels = levels if colour else np.repeat(levels[..., :1], 3, axis=2)
    for number, image in enumerate((levels // 4, levels)):
        deep = image.astype(np.uint16) << (depth - 8)
        cv2.imwrite(str(tmp_path / f"{number}.{kind}"), deep[..., ::-1] if colour else deep[..., 0])
    for frame, image in zip(open_source(tmp_path).frames(), (levels // 4, levels), strict=True):
        np.testing.assert_array_equal(frame.image, image)


def test_58_7_floating_point_pictures_are_refused_in_words(tmp_path: Path) -> None:
    Image.fromarray(np.ones((20, 30), np.float32)).save(tmp_path / "1.tif")
    with pytest.raises(RequestError, match="expected 8 or 16 bits a colour, got 32; write it as PNG of 16"):
        open_source(tmp_path)
