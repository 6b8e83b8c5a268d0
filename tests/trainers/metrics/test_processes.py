"""Two processes that score a part each give the scores of the whole."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

# Scores a share of the data; of an empty share nothing.
PROGRAM = """
import json, sys
import torch
import torch.distributed as distributed
from tests.trainers.metrics.conftest import crossing
from tests.trainers.metrics.test_detections import pictures
from tests.trainers.metrics.test_reidentification import views
from tsuiseki.trainers.metrics.actions import ActionPrecision
from tsuiseki.trainers.metrics.detections import AveragePrecision
from tsuiseki.trainers.metrics.reidentification import ReIdentification
from tsuiseki.trainers.metrics.tracks import CLEAR, HOTA, IDF1

rank, size, store, empty = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4] == "empty"
if size > 1:
    distributed.init_process_group("gloo", init_method=f"file://{store}", rank=rank, world_size=size)
shares = [(0, 1, 2, 3)] if size == 1 else [(0, 1, 2, 3), ()] if empty else [(0, 1), (2, 3)]
preds, target = pictures(1)
table = views(1)
names = ("person", "car", "dog")
strict = AveragePrecision(iou=0.75, class_names=names)
metrics = [HOTA(), CLEAR(), IDF1(), AveragePrecision(), strict, ReIdentification(), ActionPrecision()]
actions = torch.rand(88, 3, generator=torch.Generator().manual_seed(0)), torch.arange(264).view(88, 3) % 5 == 0
bare = [[{k: v for k, v in image.items() if k != "labels"} for image in side] for side in (preds, target)]
for part in shares[rank]:
    for metric in metrics[:3]:
        metric.update(*crossing(part, length=6 + part))
    images = slice(2 * part, 2 * part + 2)
    metrics[3].update(bare[0][images], bare[1][images])
    metrics[4].update(preds[images], target[images])
    rows = slice(22 * part, 22 * part + 22)
    metrics[5].update(**{name: column[rows] for name, column in table.items()})
    metrics[6].update(*(column[rows] for column in actions))
scores = [{name: value.item() for name, value in metric.compute().items()} for metric in metrics]
print(json.dumps(scores))
if size > 1:
    distributed.destroy_process_group()
"""


def scored(size: int, store: Path, share: str) -> list[list[dict[str, float]]]:
    repository = Path(__file__).resolve().parents[3]
    running = [
        subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", PROGRAM, str(rank), str(size), str(store), share],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=repository,
        )
        for rank in range(size)
    ]  # fmt: skip
    answers = []
    for process in running:
        output, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        answers.append(json.loads(output.strip().splitlines()[-1]))
    return answers


@pytest.mark.slow
@pytest.mark.parametrize("share", ["halves", "empty"])
def test_two_processes_give_the_scores_of_the_whole(tmp_path: Path, share: str) -> None:
    (whole,) = scored(1, tmp_path / "none", "halves")
    first, second = scored(2, tmp_path / "store", share)
    assert first == second
    assert len(whole) == 7
    for of_parts, of_whole in zip(first, whole, strict=True):
        assert of_parts == pytest.approx(of_whole, abs=1e-12, nan_ok=False)
