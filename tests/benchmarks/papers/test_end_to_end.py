"""The experiment of costs learnt through the flow, on small generated sequences."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.papers.__main__ import main
from benchmarks.papers.association import (
    DATA_SETS,
    STREETS,
    find_sequences,
    sequence_detections,
    write_streets,
)
from benchmarks.papers.end_to_end import (
    FITS,
    fold_rows,
    fold_sums,
)
from benchmarks.papers.store import Store
from tests.trainers.flow.crossing import crossing
from tsuiseki.tracking.formats.mot_sequence import write_sequence_info
from tsuiseki.trainers.flow.flow_loss import FlowLoss

LENGTH = 40


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sequences of MOT15 in which two people meet, and one of MOT17."""
    home = tmp_path_factory.mktemp("data")
    for seed, name in enumerate(("mot15/ONE", "mot15/TWO", "mot17-val-half/THREE")):
        folder, video = home / "mot" / name, crossing(seed, LENGTH)
        rows = [(t, box, s) for t, f in enumerate(video.detections) for box, s in zip(f.boxes, f.scores, strict=True)]
        labels = zip(video.truth.frames, video.truth.ids, video.truth.boxes, strict=True)
        for part, lines in (
            ("gt", [f"{t + 1},{who},{_xywh(box)},1,-1,-1,-1" for t, who, box in labels]),
            ("det", [f"{t + 1},-1,{_xywh(box)},{score:.3f},-1,-1,-1" for t, box, score in rows]),
        ):
            (folder / part).mkdir(parents=True)
            (folder / part / f"{part}.txt").write_text("\n".join(lines) + "\n")
        write_sequence_info(folder, folder.name, 25.0, LENGTH, 640, 480)
    return home


def _xywh(box: np.ndarray) -> str:
    return ",".join(f"{value:.2f}" for value in (box[0] + 1, box[1] + 1, box[2] - box[0], box[3] - box[1]))


@pytest.mark.slow
def test_all_rows_and_again_from_the_store(data: Path, tmp_path: Path) -> None:
    words = ["end-to-end", "--data", str(data), "--parts", "given", "--sets", "mot15"]
    words += ["--cache", str(tmp_path / "cache")]
    assert main([*words, "--out", str(tmp_path / "one")]) == 0
    found = json.loads((tmp_path / "one" / "results.json").read_text())
    values = found["mot15"]
    assert list(values) == ["default", *FITS, "right links"]
    assert all(0 < row["hota"] <= 1 for row in values.values())
    assert values["right links"]["idf1"] >= values["default"]["idf1"]
    entries = sorted(path.name for path in (tmp_path / "cache").rglob("*.npz"))
    assert main([*words, "--out", str(tmp_path / "two")]) == 0
    assert sorted(path.name for path in (tmp_path / "cache").rglob("*.npz")) == entries
    assert json.loads((tmp_path / "two" / "results.json").read_text()) == found


@pytest.mark.slow
def test_each_group_is_tracked_by_what_the_others_taught(data: Path, tmp_path: Path) -> None:
    one = next(one for one in DATA_SETS if one.key == "mot15")
    sequences, fit = find_sequences(data, one), partial(fold_sums, FlowLoss(), 3)
    rows = fold_rows(Store(tmp_path), one, sequences, {"short": fit})
    expected = [fit(((b,), (a,)))[0] for a, b in (sequences, sequences[::-1])]
    np.testing.assert_allclose(rows["short"], expected)
    assert set(rows) == {"default", "short", "right links"}


@pytest.mark.slow
def test_streets_are_clips_with_detections(tmp_path: Path) -> None:
    for name in ("streets", "again"):
        write_streets(tmp_path / name, 2, 4)
    one, other = find_sequences(tmp_path, STREETS)
    assert one.length == 4
    assert one.rate != other.rate or one.size == other.size
    assert sum(len(found) for found in sequence_detections(one)) > 4
    assert not list((tmp_path / "streets").rglob("*.jpg"))
    for path in (tmp_path / "streets").rglob("*.txt"):
        assert path.read_bytes() == (tmp_path / "again" / path.relative_to(tmp_path / "streets")).read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--parts", "all"], '"all" for --parts. Choose from: "given"'),
        (["--sets", "tud"], '"tud" for --sets. Choose from: "mot15"'),
        (["--data", "nowhere"], "`data`: expected mot/"),
    ],
)
def test_what_is_not_there(words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["end-to-end", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
