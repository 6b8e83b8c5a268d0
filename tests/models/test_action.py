"""The streams of the action network, their loss and its weights."""

from __future__ import annotations

import math

import pytest
import torch

from tsuiseki.models.action import ActionNetwork, ActionStream, StreamProbability, action_loss, positive_weights


@pytest.mark.parametrize("channels", [2, 3, 6])
def test_a_stream_takes_its_channels_and_gives_a_logit_an_action(channels: int) -> None:
    torch.manual_seed(0)
    stream = ActionStream(5, channels, "mobilenet_v3_small").eval()
    crops = torch.randn(3, channels, 32, 32)
    logits = stream(crops)
    assert logits.shape == (3, 5)
    torch.testing.assert_close(StreamProbability(stream)(crops), logits.sigmoid())
    # Every channel counts: what is shown in the last one changes the answer.
    crops[:, -1] += 1
    assert (stream(crops) - logits).abs().max() > 0


def test_the_network_averages_probabilities_not_logits() -> None:
    network = ActionNetwork({"a": ActionStream(2, 3, "mobilenet_v3_small"), "b": ActionStream(2, 2)}).eval()
    crops = {"a": torch.randn(2, 3, 32, 32), "b": torch.randn(2, 2, 32, 32)}
    expected = (network.streams["a"](crops["a"]).sigmoid() + network.streams["b"](crops["b"]).sigmoid()) / 2
    torch.testing.assert_close(network(crops), expected)
    with pytest.raises(ValueError, match="at least one stream"):
        ActionNetwork({})


def test_dropout_is_the_thesis_s_and_off_when_it_counts() -> None:
    stream = ActionStream(4, 3, "mobilenet_v3_small")
    assert stream.dropout.p == 0.7
    crops = torch.randn(2, 3, 32, 32)
    stream.eval()
    torch.testing.assert_close(stream(crops), stream(crops))


def test_loss_is_equation_5_1() -> None:
    truth = torch.tensor([[1.0, 0.0, 1.0]])
    logits = torch.tensor([[0.3, -0.2, 1.5]])
    terms = [
        d * math.log(1 / (1 + math.exp(-z))) + (1 - d) * math.log(1 - 1 / (1 + math.exp(-z)))
        for d, z in zip(truth[0].tolist(), logits[0].tolist(), strict=True)
    ]
    assert float(action_loss(logits, truth)) == pytest.approx(-sum(terms) / 3, rel=1e-6)
    # A weight counts for performed actions only.
    weighted = action_loss(logits, truth, torch.tensor([2.0, 5.0, 1.0]))
    assert float(weighted) == pytest.approx(-(2 * terms[0] + terms[1] + terms[2]) / 3, rel=1e-6)


def test_weights_of_rare_actions() -> None:
    counts = torch.tensor([50.0, 10.0, 0.0, 100.0])
    weights = positive_weights(counts, 100, 0.5, 5.0)
    torch.testing.assert_close(weights, torch.tensor([1.0, 3.0, 5.0, 1.0]))
    torch.testing.assert_close(positive_weights(counts, 100, 0.0, 5.0), torch.ones(4))
