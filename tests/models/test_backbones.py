"""Trunks: maps at strides 8, 16 and 32, and clear words where weights cannot be had."""

from __future__ import annotations

from typing import get_args
from urllib.error import URLError

import pytest
import torch
import torchvision.models
from torch import nn

from tsuiseki.models.backbones import TrunkName, build_trunk


@pytest.mark.parametrize("name", get_args(TrunkName))
def test_every_trunk_has_the_maps_it_promises(name: TrunkName) -> None:
    with torch.device("meta"):
        trunk = build_trunk(name)
        maps = trunk(torch.zeros(2, 3, 64, 96))
    assert trunk.strides == (8, 16, 32)
    assert [tuple(x.shape) for x in maps] == [
        (2, c, 64 // s, 96 // s) for c, s in zip(trunk.channels, trunk.strides, strict=True)
    ]


def test_batch_statistics_from_scratch_follow_within_tens_of_steps() -> None:
    norms = [m for m in build_trunk("mobilenet_v3_small").modules() if isinstance(m, nn.BatchNorm2d)]
    assert norms
    assert {m.momentum for m in norms} == {0.1}


def test_no_connection_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(name: str, weights: str) -> None:
        assert (name, weights) == ("resnet18", "DEFAULT")
        raise URLError("no route to host")

    monkeypatch.setattr(torchvision.models, "get_model", unreachable)
    with pytest.raises(ConnectionError, match=r"ImageNet weights of resnet18.*no route to host") as caught:
        build_trunk("resnet18", "imagenet")
    assert "\n" not in str(caught.value)


def test_a_narrower_trunk_has_no_weights_to_start_from() -> None:
    with pytest.raises(ValueError, match="no ImageNet weights of mobilenet_v3_large_075"):
        build_trunk("mobilenet_v3_large_075", "imagenet")


def test_an_unknown_trunk_lists_the_known() -> None:
    with pytest.raises(ValueError, match="mobilenet_v3_small, mobilenet_v3_large"):
        build_trunk("alexnet")  # type: ignore[arg-type]
