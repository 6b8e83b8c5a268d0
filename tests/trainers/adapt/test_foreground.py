"""Each kept picture is compared with the empty view once; what was found then is found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.trainers.adapt import foreground as module
from tsuiseki.trainers.adapt.foreground import Foreground, foreground_of
from tsuiseki.trainers.adapt.silhouettes import difference
from tsuiseki.trainers.adapt.watch import watch


@pytest.fixture
def foreground(tmp_path: Path) -> Foreground:
    watched = watch(str(street.write_video(tmp_path / "street")), EVERY_FRAME, tmp_path / "kept", 20)
    return foreground_of(watched)


def test_pictures_are_compared_once(foreground: Foreground, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(module, "difference", lambda *pair: calls.append(1) or difference(*pair))
    for _ in range(3):
        for number in (0, 7, 19):
            found = foreground.picture(number)
            different, bright = difference(foreground.watched.picture(number), foreground.empty)
            np.testing.assert_array_equal(found.different, different)
            np.testing.assert_array_equal(found.bright, bright)
            assert 0 < bright.sum() <= different.sum()
    assert len(calls) == 3


def test_half_a_picture_is_made_again(foreground: Foreground) -> None:
    whole = foreground.picture(3)
    file = Path(foreground.watched.folder) / "foreground" / "000004.png"
    file.write_bytes(file.read_bytes()[:40])
    np.testing.assert_array_equal(foreground.picture(3).different, whole.different)
