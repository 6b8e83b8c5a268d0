"""The configurations of the package are read by their commands, and each architecture is a network of its own."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import get_args

import pytest
import torch

from tsuiseki.tracking.cli.request import request_of
from tsuiseki.trainers.detector_network import FIXED_SIDES, STREET_ANCHORS, Architecture, build_detector
from tsuiseki.trainers.task_cli import ACTION, APPEARANCE, ASSOCIATION, DETECTOR, TRACKER, TaskCLI

# Networks by the first word of their configurations.
TASKS = {task.name: task for task in (ACTION, APPEARANCE, ASSOCIATION, DETECTOR, TRACKER)}
CONFIGS = Path(str(resources.files("tsuiseki.configs"))).glob("*.yaml")
# Anchors of three maps of people, and of three of a branch.
ANCHORS = STREET_ANCHORS[:3]


@pytest.mark.filterwarnings("ignore:(?s).*deprecated in v4")
@pytest.mark.parametrize("path", sorted(CONFIGS), ids=lambda path: path.stem)
def test_a_configuration_is_read_by_its_command(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command, out = path.stem.partition("_")[0], tmp_path / "out"
    words = ["--config", str(path), "--out", str(out)]
    if command not in TASKS:
        assert request_of(["train", command, *words]).settings["out"] == str(out)
        return
    # The data of a fine tuning is named by its caller.
    words += ["--data.train=[]"] if path.stem.endswith(("fine_tune", "_own")) else []
    monkeypatch.setattr(TaskCLI, "instantiate_classes", lambda _: None)
    assert TaskCLI(TASKS[command], words, run=False).out == out


@pytest.mark.slow
@pytest.mark.parametrize("architecture", get_args(Architecture))
def test_an_architecture_is_a_detector(architecture: Architecture) -> None:
    side = FIXED_SIDES.get(architecture, 64)
    anchors = 2 * ANCHORS if architecture == "branched" else ANCHORS
    network = build_detector(architecture, "mobilenet_v3_small", None, (side, side), anchors, 16).eval()
    with torch.no_grad():
        logits, offsets = network(torch.zeros(1, 3, side, side))
    assert logits.shape == (1, len(network.anchors), 2)
    assert offsets.shape == (1, len(network.anchors), 4)
