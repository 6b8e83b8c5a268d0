"""The appearance network: unit length, shared weights, every trunk."""

from __future__ import annotations

import pytest
import torch

from tsuiseki.models.appearance import AppearanceNetwork
from tsuiseki.models.backbones import TrunkName


@pytest.mark.parametrize("trunk", ["mobilenet_v3_small", "resnet18"])
def test_features_have_unit_length(trunk: TrunkName) -> None:
    network = AppearanceNetwork(trunk, feature_length=16).eval()
    features = network(torch.randn(3, 3, 64, 32, generator=torch.Generator().manual_seed(0)))
    assert features.shape == (3, 16)
    torch.testing.assert_close(features.norm(dim=1), torch.ones(3))


def test_a_crop_is_described_alone() -> None:
    network = AppearanceNetwork().eval()
    images = torch.randn(4, 3, 128, 64, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(network(images)[2:3], network(images[2:3]), atol=1e-5, rtol=1e-4)


def test_stripes_see_where_a_colour_is() -> None:
    """A red jacket over blue trousers is not the same as blue over red, even for the coarsest trunk."""
    torch.manual_seed(0)
    network = AppearanceNetwork().eval()
    person = torch.zeros(1, 3, 128, 64)
    person[:, 0, :64], person[:, 2, 64:] = 1, 1
    upside_down = person.flip(2)
    mirrored = person.flip(3)
    features = network(torch.cat([person, upside_down, mirrored]))
    assert float(features[0] @ features[2]) > float(features[0] @ features[1]) + 0.1
