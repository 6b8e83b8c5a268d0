"""What would run without end or fill the memory is refused in a line, before anything is done."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tsuiseki.tracking.arguments import check_sensible
from tsuiseki.tracking.cli import main
from tsuiseki.tracking.errors import RequestError


@pytest.mark.parametrize(
    ("value", "default"),
    [(1299.0, 1.3), (-12, 0.5), (1e6 - 1, None), (5, 0), (float("inf"), float("inf")), ([9.0, 12.0], [10.0, 45.0])],
)
def test_what_is_sensible_is_taken(value: object, default: object) -> None:
    check_sensible("option", value, default)


@pytest.mark.parametrize(
    ("value", "default"),
    [(1300.0, 1.3), (-500.0, 0.5), (1e6, None), (float("nan"), 1.0), (float("inf"), 0.0), ([9.0, 1e9], [10.0, 45.0])],
)
def test_numbers_out_of_hand_are_refused(value: object, default: object) -> None:
    with pytest.raises(RequestError, match=r"`group\.option`: expected a number below"):
        check_sensible("group.option", value, default)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            "track people CLIP --flow.costs.link.miss 1e9",
            "--flow.costs.link.miss: expected a number below 15",
        ),
        ("simulate sphere --radius 100", "--radius: expected a number below 100, 1000 times the default, got 100"),
        ("simulate goldfish --frame-rate 1e300", "--frame-rate: expected a number below 1e+06, got 1e+300"),
        ("simulate drone --people 100000", "--people: expected a number below 9000"),
        ("simulate fisheye --people 100000", "--people: expected a number below 6000"),
        ("simulate sphere --radius 5", "--radius: expected at most 0.5, got 5"),
        ("simulate goldfish --frame-rate 1e5", "--frame-rate: expected at most 240, got 100000"),
        ("simulate street --people 5000", "--people: expected at most 100, got 5000"),
        ("simulate street --occluders 10000000", "--occluders: expected a number below 7000"),
        ("track people CLIP --config /dev/zero", "--config: expected a file or a folder, but /dev/zero is a device"),
        ("track people CLIP --config PIPE", "--config: expected a file or a folder, but PIPE is a device or a pipe"),
        ("track people CLIP --detections PIPE", "--detections: expected a file or a folder, but PIPE is a device"),
        (
            "track people CLIP --detector /dev/zero",
            "--detector: expected a file or a folder, but /dev/zero is",
        ),
        ("track people PIPE", "expected a file or a folder, but PIPE is a device or a pipe"),
    ],
)
def test_requests_without_end(words: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe, out = tmp_path / "pipe", tmp_path / "o"
    os.mkfifo(pipe)
    named = words.replace("PIPE", str(pipe)).replace("CLIP", str(tmp_path))
    assert main([*named.split(), "--out", str(out)]) == 2
    (said,) = [each for each in capsys.readouterr().err.splitlines() if each.startswith("tsuiseki:")]
    assert said.startswith("tsuiseki: " + line.replace("PIPE", str(pipe)))
    assert not out.exists()
