"""The long training of the tracker: what is compared, and where it begins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.filters.tracker_training import BEST, _gains, mean_area, training
from tsuiseki.tracking.types import FloatArray, ImageArray


def test_a_gain_has_its_interval_over_clips() -> None:
    """Equal gains have an interval of no width; the first tracker is compared with each other."""
    areas = np.array([[50.0, 40.0, 50.0], [60.0, 50.0, 61.0], [30.0, 20.0, 29.0]])
    first, second = _gains(areas, ["ours", "a", "b"])
    assert first == "ours over a: +10.0 [10.0, 10.0], better on 3 of 3"
    assert second.startswith("ours over b: +0.0 [")
    assert second.endswith("better on 1 of 3")


def test_the_area_is_the_mean_over_clips() -> None:
    truth, images = np.tile([10.0, 10.0, 30.0, 30.0], (5, 1)), [np.zeros((64, 64, 3), np.uint8)] * 5

    def still(images: list[ImageArray], box: FloatArray) -> FloatArray:
        return np.tile(box, (len(images) - 1, 1))

    moved = truth + np.array([0, 1, 1, 1, 1])[:, None] * 100
    area = mean_area(still, {"still": lambda: (truth, images), "gone": lambda: (moved, images)})
    # Overlap 1 lies above 20 of 21 thresholds; the first frame counts, too.
    assert np.isclose(area, 100 * (20 / 21 + 20 / 21 / 5) / 2)


def test_the_search_file_is_what_a_step_starts_from() -> None:
    assert BEST[0].name == "tracker_search.onnx"


@pytest.mark.slow
def test_a_step_trains_and_exports(tmp_path: Path) -> None:
    short = {"trainer.max_epochs": 1, "data.batches": 1, "data.batch_size": 2, "data.validation": 2}
    words = [word for name, value in short.items() for word in (f"--{name}", str(value))]
    work = tmp_path / "step"
    work.mkdir()
    files = training(tmp_path / "no data", words).fit(BEST, work, 1)
    assert [file.name for file in files] == [best.name for best in BEST]
    assert all(file.is_file() for file in files)
