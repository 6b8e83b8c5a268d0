"""Videos are watched once, evenly; what cannot be learnt from is refused with one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.trainers.adapt import watch as module
from tsuiseki.trainers.adapt.foreground import difference
from tsuiseki.trainers.adapt.watch import Watched, refuse_other_sizes, refuse_two_cameras, watch, with_empty_view


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return street.write_video(tmp_path_factory.mktemp("camera") / "street")


def test_pictures_are_spread_over_the_stretch(video: Path, tmp_path: Path) -> None:
    watched = watch(str(video), FrameRange(5, 108), tmp_path / "kept", 20)
    assert (watched.length, watched.size, watched.fixed) == (104, street.SIZE, True)
    assert watched.frames[0] == 5
    assert len(watched.frames) == 20
    steps = np.diff(watched.frames)
    assert steps.max() - steps.min() <= 4
    assert np.abs(watched.picture(3).astype(int) - street.picture(watched.frames[3])).mean() < 4
    # A tenth of the stretch is held out: its last ten frames.
    assert watched.frames[watched.learnt(0.1) - 1] < 5 + 0.9 * 104 <= watched.frames[watched.learnt(0.1)]


def test_what_is_finished_is_not_read_again(video: Path, tmp_path: Path) -> None:
    first = watch(str(video), EVERY_FRAME, tmp_path / "kept", 10)
    assert watch("gone", EVERY_FRAME, tmp_path / "kept", 10) == first


def test_the_plain_view_is_without_people(video: Path, tmp_path: Path) -> None:
    empty = with_empty_view(watch(str(video), EVERY_FRAME, tmp_path / "kept", 60)).empty
    assert empty is not None
    expected = street.view()
    x1, y1, x2, y2 = street.DECOY.astype(int)
    expected[y1:y2, x1:x2] = (240, 240, 40)
    assert np.abs(empty.astype(int) - expected).mean() < 4


def test_a_short_video_is_refused(tmp_path: Path) -> None:
    short = street.write_video(tmp_path / "short", frames=99)
    with pytest.raises(RequestError, match="expected at least 100 frames to learn a camera from, got 99"):
        watch(str(short), EVERY_FRAME, tmp_path / "kept", 20)


def test_the_frame_of_a_turn_is_kept(tmp_path: Path) -> None:
    video = street.write_video(tmp_path / "turned")
    for frame in range(60, street.FRAMES):
        image = street.picture(frame, moved=50)
        cv2.imwrite(str(video / "img1" / f"{frame + 1:06d}.jpg"), image[..., ::-1])
    watched = watch(str(video), EVERY_FRAME, tmp_path / "kept", 40)
    assert (watched.motion, watched.fixed) == ("moves", False)
    assert watched.turned is not None
    assert 60 <= watched.turned < 60 + street.FRAMES / 8


def test_two_cameras_are_refused(video: Path, tmp_path: Path) -> None:
    one = watch(str(video), EVERY_FRAME, tmp_path / "one", 20)
    other = watch(str(street.write_video(tmp_path / "other", seed=1)), EVERY_FRAME, tmp_path / "two", 20)
    views = (street.view(), (0.6 * street.view()).astype(np.uint8), street.view(1))
    first, darker, elsewhere = (replace(v, empty=view) for v, view in zip((one, one, other), views, strict=True))
    refuse_two_cameras([first, darker, replace(other, empty=None)])
    with pytest.raises(RequestError, match="show different places"):
        refuse_two_cameras([first, elsewhere])


def test_videos_of_one_camera_have_one_size_and_move_alike(tmp_path: Path) -> None:
    one = watch(str(street.write_video(tmp_path / "one")), EVERY_FRAME, tmp_path / "kept", 20)
    refuse_other_sizes([one, one])
    with pytest.raises(RequestError, match=r"got 160x120 pixels in .* and 320x240"):
        refuse_other_sizes([one, replace(one, size=(320, 240))])
    with pytest.raises(RequestError, match="it stands still in one and moves in other; adapt to one camera"):
        refuse_other_sizes([replace(one, source="one"), replace(one, source="other", motion="moves")])
    refuse_other_sizes([one, replace(one, motion="unknown")])


@pytest.fixture
def still(tmp_path: Path) -> Watched:
    return with_empty_view(watch(str(street.write_video(tmp_path / "street")), EVERY_FRAME, tmp_path / "kept", 20))


def test_pictures_are_compared_once(still: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(module, "difference", lambda *pair: calls.append(1) or difference(*pair))
    for _ in range(3):
        for number in (0, 7, 19):
            found = still.difference(number)
            assert found is not None
            assert still.empty is not None
            different, bright = difference(still.picture(number), still.empty)
            np.testing.assert_array_equal(found.different, different)
            np.testing.assert_array_equal(found.bright, bright)
            assert 0 < bright.sum() <= different.sum()
    assert len(calls) == 3


def test_half_a_picture_is_made_again(still: Watched) -> None:
    whole = still.difference(3)
    file = Path(still.folder) / "foreground" / "000004.png"
    file.write_bytes(file.read_bytes()[:40])
    again = still.difference(3)
    assert whole is not None
    assert again is not None
    np.testing.assert_array_equal(again.different, whole.different)
