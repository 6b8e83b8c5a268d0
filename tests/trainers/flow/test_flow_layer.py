"""The flow as a layer: gradients, batches, windows without detections, refusals, and the example of its page."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import pytest
import torch
from scipy.stats import norm
from torch import Tensor

from tests.trainers.flow.flows import all_flows
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.flow.flow_layer import FlowLayer, FlowWindows, WindowFlows
from tsuiseki.trainers.flow.flow_loss import FlowLoss, FlowLossName, cheapest

PAGE = Path(__file__).resolve().parents[3] / "docs" / "extending" / "flow-layer.md"
KINDS = ("detections", "entries", "exits", "links")
EMPTY = FlowWindows.of([], [])


def street(seed: int, frames: int = 4) -> FlowWindows:
    """Two people and, in half of the frames, a false positive."""
    rng = np.random.default_rng(seed)
    pairs = [(t, who) for t in range(frames) for who in (0, 1, -1) if who >= 0 or rng.random() < 0.5]
    return FlowWindows.of([t for t, _ in pairs], [who for _, who in pairs], reach=2)


def random_costs(windows: FlowWindows, seed: int = 0) -> dict[str, Tensor]:
    rng = np.random.default_rng(seed)
    count = len(windows.frames)
    return {
        kind: torch.tensor(rng.normal(0, 2, len(windows.tail) if kind == "links" else count), requires_grad=True)
        for kind in KINDS
    }


def solved(layer: FlowLayer, windows: FlowWindows, costs: dict[str, Any], seed: int = 0) -> WindowFlows:
    return layer(windows, np.random.default_rng(seed), **costs)


def gradients(costs: dict[str, Tensor]) -> FloatArray:
    """``(3 N + P,)`` of all costs in their order."""
    return np.concatenate([cost.grad.numpy() for cost in costs.values() if cost.grad is not None])


def flat(flows: WindowFlows) -> Tensor:
    return torch.cat(flows[1:])


class TestGradients:
    """Of the smoothed problem, in double precision."""

    # Detections of one person in two frames and a false positive in a third: 12 arcs.
    WINDOW = FlowWindows.of([0, 1, 2], [0, 0, -1], reach=2)
    EPSILON = 1.5
    # 1,000 antithetic pairs: a share deviates by 0.011 at most, its derivative along a unit vector by 0.02.
    LAYER = FlowLayer(FlowLoss("fenchel_young", EPSILON, 1000))
    LABELLED = np.array([1.0, 1, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0])

    def costs(self) -> dict[str, Tensor]:
        values = np.random.default_rng(5).normal(0, 1, 12)
        return {
            kind: torch.tensor(part, requires_grad=True) for kind, part in zip(KINDS, np.split(values, 4), strict=True)
        }

    def smoothed(self, values: FloatArray) -> tuple[float, FloatArray]:
        """L(c) and E[x̂(c + εZ)], the minima by brute force over all flows, the same 50,000 draws at any c."""
        flows = np.array(list(all_flows(3, self.WINDOW.tail, self.WINDOW.head)))
        noisy = values + self.EPSILON * np.random.default_rng(8).standard_normal((50_000, 12))
        totals = noisy @ flows.T
        flow = np.bincount(totals.argmin(axis=1), minlength=len(flows)) @ flows / len(noisy)
        return float(values @ self.LABELLED - totals.min(axis=1).mean()), flow

    def differences(self, step: float = 0.1) -> tuple[FloatArray, FloatArray]:
        """Central difference quotients of both: ``(12,)`` and ``(12, 12)``, a row a cost."""
        values = torch.cat(list(self.costs().values())).detach().numpy()
        rows = []
        for unit in step * np.eye(12):
            (loss, flow), (loss_before, flow_before) = self.smoothed(values + unit), self.smoothed(values - unit)
            rows.append(np.append(loss - loss_before, flow - flow_before) / (2 * step))
        quotients = np.array(rows)
        return quotients[:, 0], quotients[:, 1:]

    @pytest.mark.slow
    def test_loss_and_flow_have_the_derivatives_of_finite_differences(self) -> None:
        of_loss, of_flow = self.differences()
        costs = self.costs()
        flows = solved(self.LAYER, self.WINDOW, costs)
        expected_loss, expected_flow = self.smoothed(torch.cat(list(costs.values())).detach().numpy())
        assert flows.loss.item() == pytest.approx(expected_loss, abs=0.1)
        np.testing.assert_allclose(flat(flows).detach().numpy(), expected_flow, atol=0.04)
        flows.loss.sum().backward(retain_graph=True)
        np.testing.assert_allclose(gradients(costs), of_loss, atol=0.04)
        assert np.abs(of_loss).max() > 0.3
        # The unit vector along which the flow changes most.
        direction = np.linalg.eigh(of_flow + of_flow.T)[1][:, 0]
        for cost in costs.values():
            cost.grad = None
        (flat(flows) @ torch.tensor(direction)).backward()
        np.testing.assert_allclose(gradients(costs), of_flow @ direction, atol=0.08)
        assert np.abs(of_flow @ direction).max() > 0.2

    @pytest.mark.slow
    def test_one_detection_has_the_closed_form(self) -> None:
        """It is used with the probability that its sum of costs s, with noise of deviation √3 ε, is below 0."""
        total = torch.tensor([0.8], dtype=torch.float64, requires_grad=True)
        window, spread = FlowWindows.of([0], [0]), 1.5 * np.sqrt(3)
        costs = {"links": torch.zeros(0, dtype=torch.float64), "detections": total, "entries": 0.0, "exits": 0.0}
        flows = solved(self.LAYER, window, costs)
        used = norm.cdf(-0.8 / spread)
        # Of 1,000 pairs a share deviates by 0.011.
        assert flows.detections.item() == pytest.approx(used, abs=0.04)
        (by_loss,) = torch.autograd.grad(flows.loss.sum(), total, retain_graph=True)
        assert by_loss.item() == pytest.approx(1 - used, abs=0.04)
        (by_flow,) = torch.autograd.grad(flows.detections.sum(), total)
        assert by_flow.item() == pytest.approx(-norm.pdf(0.8 / spread) / spread, abs=0.03)

    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["fenchel_young", "hinge", "both"])
    def test_gradcheck_of_the_loss_over_the_same_draws(self, name: FlowLossName) -> None:
        """Over its own draws the loss is linear between costs at which a minimum changes; none changes within 0.001.

        The solver rounds some 40 costs to a millionth.
        """
        layer, windows = FlowLayer(FlowLoss(name, 1.0, 3)), FlowWindows.join([street(1, 3), EMPTY, street(2, 2)])

        def losses(*columns: Tensor) -> Tensor:
            return solved(layer, windows, dict(zip(KINDS, columns, strict=True))).loss

        assert torch.autograd.gradcheck(losses, tuple(random_costs(windows).values()), eps=1e-3, atol=0.02)

    def test_gradients_reach_what_made_the_costs(self) -> None:
        window = street(0)
        weight = torch.ones(2, requires_grad=True)
        features = torch.randn(len(window.tail), 2, generator=torch.Generator().manual_seed(0))
        costs = {"links": features @ weight, "detections": -1.0, "entries": 1.0, "exits": 1.0}
        solved(FlowLayer(FlowLoss(pairs=4)), window, costs).loss.sum().backward()
        assert weight.grad is not None
        assert weight.grad.abs().min() > 0


class TestBatches:
    @pytest.mark.parametrize("name", ["fenchel_young", "hinge", "both"])
    def test_a_batch_equals_its_windows_in_turn(self, name: FlowLossName) -> None:
        layer, parts = FlowLayer(FlowLoss(name, 0.7, 3)), [street(0), EMPTY, street(1, 2), street(2, 5), EMPTY]
        costs = [random_costs(part, seed) for seed, part in enumerate(parts)]
        together = {kind: torch.cat([part[kind] for part in costs]).detach().requires_grad_() for kind in KINDS}
        batch = solved(layer, FlowWindows.join(parts), together)
        rng = np.random.default_rng(0)
        alone = [layer(part, rng, **cost) for part, cost in zip(parts, costs, strict=True)]
        for whole, pieces in zip(batch, zip(*alone, strict=True), strict=True):
            torch.testing.assert_close(whole, torch.cat(pieces), rtol=0, atol=1e-12)
        assert batch.loss.shape == (5,)
        # A weight a window, so that a gradient in the wrong window shows; and the flow, where it has a gradient.
        weights = torch.arange(1.0, 6, dtype=torch.float64)
        for flows, some in ((batch, weights), *((one, weights[k : k + 1]) for k, one in enumerate(alone))):
            ((flows.loss * some).sum() + (flows.links.sum() if name != "hinge" else 0)).backward()
        for kind, column in together.items():
            expected = torch.cat([part[kind].grad for part in costs if part[kind].grad is not None])
            torch.testing.assert_close(column.grad, expected, rtol=0, atol=1e-12)

    def test_loss_and_gradient_are_those_of_the_minima(self) -> None:
        window, loss = street(3), FlowLoss("both", 0.7, 2)
        costs = random_costs(window)
        flows = solved(FlowLayer(loss), window, costs)
        flows.loss.sum().backward()
        values = torch.cat(list(costs.values())).detach().numpy()
        expected = loss.minima(values, next(window.arcs()), np.random.default_rng(0))
        assert flows.loss.item() == pytest.approx(expected.loss, abs=1e-12)
        np.testing.assert_allclose(gradients(costs), expected.gradient, atol=1e-12)

    def test_a_labelled_flow_of_ones_own_counts_in_its_window(self) -> None:
        """Windows of owners and windows of labelled flows in a batch are as each by itself."""
        parts = [street(0), EMPTY, street(1, 2)]
        own = [replace(part, labelled=np.roll(part.labelled_flow(), 1)) for part in parts]
        for mixed in ([own[0], parts[1], parts[2]], [parts[0], own[1], own[2]]):
            found = [arcs.labelled for arcs in FlowWindows.join(mixed).arcs()]
            expected = [next(part.arcs()).labelled for part in mixed]
            assert all(map(np.array_equal, found, expected))
        with pytest.raises(RequestError, match=r"labelled: expected \d+ numbers, got shape \(2,\)"):
            replace(parts[0], labelled=np.zeros(2))

    def test_windows_without_detections_cost_nothing(self) -> None:
        costs = {"links": torch.zeros(0, requires_grad=True), "detections": -1.0, "entries": 1.0, "exits": 1.0}
        for windows, count in ((EMPTY, 1), (FlowWindows.join([EMPTY, EMPTY]), 2)):
            flows = solved(FlowLayer(), windows, costs)
            flows.loss.sum().backward()
            assert flows.loss.tolist() == [0.0] * count
            assert flat(flows).shape == (0,)

    def test_frames_may_come_in_any_order(self) -> None:
        window = FlowWindows.of([2, 0, 1], [4, 4, 4])
        assert sorted(zip(window.tail.tolist(), window.head.tolist(), strict=True)) == [(1, 2), (2, 0)]
        (arcs,) = window.arcs()
        np.testing.assert_array_equal(arcs.labelled, [1, 1, 1, 0, 1, 0, 1, 0, 0, 1, 1])

    def test_tensors_make_windows_too(self) -> None:
        window = FlowWindows.of(torch.tensor([0, 1]), torch.tensor([3, 3]))
        assert window.tail.tolist() == [0]


class TestFlow:
    def test_the_flow_of_hinge_is_the_cheapest_and_has_no_gradient(self) -> None:
        window = street(0)
        costs = random_costs(window)
        flow = flat(solved(FlowLayer(FlowLoss("hinge")), window, costs))
        (arcs,) = window.arcs()
        values = torch.cat(list(costs.values())).detach().numpy()
        np.testing.assert_array_equal(flow.numpy(), cheapest(values, arcs.tail, arcs.head))
        assert not flow.requires_grad

    def test_little_noise_leaves_the_cheapest_flow(self) -> None:
        window = street(0)
        costs = random_costs(window)
        sharp, hard = (FlowLayer(FlowLoss(*loss)) for loss in (("fenchel_young", 1e-3, 2), ("hinge",)))
        torch.testing.assert_close(flat(solved(sharp, window, costs)), flat(solved(hard, window, costs)))

    def test_the_flow_is_conserved(self) -> None:
        """What enters a detection is what uses it and what leaves it."""
        windows = FlowWindows.join([street(0), street(1)])
        flows = solved(FlowLayer(FlowLoss(pairs=5)), windows, random_costs(windows))
        for ends, column in ((flows.entries, windows.head), (flows.exits, windows.tail)):
            through = ends.index_add(0, torch.as_tensor(column), flows.links)
            torch.testing.assert_close(through, flows.detections)

    @pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
    def test_single_and_half_precision_come_out_in_single(self, dtype: torch.dtype) -> None:
        window = street(0)
        links = torch.ones(len(window.tail), dtype=dtype, requires_grad=True)
        costs = {"links": links, "detections": -3.0, "entries": 5.0, "exits": 5.0}
        flows = solved(FlowLayer(), window, costs)
        flows.loss.sum().backward()
        assert {part.dtype for part in flows} == {torch.float32}
        assert links.grad is not None
        assert links.grad.dtype == dtype

    @pytest.mark.gpu
    @pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
    def test_costs_on_a_gpu(self) -> None:
        window = street(0)
        costs = {kind: cost.detach().cuda().requires_grad_() for kind, cost in random_costs(window).items()}
        flows = solved(FlowLayer(), window, costs)
        flows.loss.sum().backward()
        assert flows.loss.is_cuda
        assert costs["links"].grad is not None


REFUSED_WINDOWS = {
    "sizes that add up to their number": ([0, 1], [0], [0], [1], [2]),
    "a row of integers, got float64": ([0.5, 1], [0, 0], [0], [1], [2]),
    "indices of the 2 detections": ([0, 1], [0, 0], [0], [2], [2]),
    "as many tails as heads": ([0, 1], [0, 0], [0], [], [2]),
    "a later detection": ([1, 0], [0, 0], [0], [1], [2]),
    "of the same window": ([0, 1], [0, 0], [0], [1], [1, 1]),
    "one at most from a detection": ([0, 1], [0, 0], [0, 0], [1, 1], [2]),
    "one detection of a person in a frame": ([0, 0], [7, 7], [], [], [2]),
}


class TestRefusals:
    @pytest.mark.parametrize("message", REFUSED_WINDOWS)
    def test_windows_that_do_not_fit_are_refused(self, message: str) -> None:
        with pytest.raises(RequestError, match=message):
            FlowWindows(*(np.array(column) for column in REFUSED_WINDOWS[message]))

    def test_a_person_twice_in_a_frame_of_two_windows_is_right(self) -> None:
        assert FlowWindows(*map(np.array, ([0, 0], [7, 7], [], [], [1, 1]))).sizes.tolist() == [1, 1]

    def test_a_reach_below_one_frame_and_no_window_are_refused(self) -> None:
        with pytest.raises(RequestError, match="reach: expected a number of frames from 1, got 0"):
            FlowWindows.of([0], [0], reach=0)
        with pytest.raises(RequestError, match="windows: expected one at least"):
            FlowWindows.join([])

    @pytest.mark.parametrize("kind", KINDS)
    def test_costs_of_another_length_are_refused(self, kind: str) -> None:
        window = street(0)
        with pytest.raises(RequestError, match=rf"{kind}: expected \d+ costs or one number, got shape \(99,\)"):
            solved(FlowLayer(), window, random_costs(window) | {kind: torch.zeros(99)})

    @pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e7])
    @pytest.mark.parametrize("kind", ["links", "entries"])
    def test_costs_that_cannot_be_solved_are_refused(self, kind: str, value: float) -> None:
        window = street(0)
        costs = random_costs(window)
        costs[kind] = torch.full_like(costs[kind], value)
        with pytest.raises(RunError, match=rf"{kind}: expected costs within ±100000, got .*; lower the learning rate"):
            solved(FlowLayer(), window, costs)


def test_lightning_moves_and_trains_a_batch_of_features_and_windows() -> None:
    class Learner(lightning.LightningModule):
        def __init__(self) -> None:
            super().__init__()
            self.network, self.flow = torch.nn.Linear(4, 1), FlowLayer(FlowLoss("hinge"))
            self.losses: list[float] = []

        def training_step(self, batch: tuple[Tensor, FlowWindows], batch_index: int) -> Tensor:
            features, windows = batch
            costs = {"links": self.network(features)[:, 0], "detections": -3.0, "entries": 5.0, "exits": 5.0}
            loss: Tensor = self.flow(windows, np.random.default_rng(batch_index), **costs).loss.mean()
            self.losses.append(loss.item())
            return loss

        def configure_optimizers(self) -> torch.optim.Optimizer:
            return torch.optim.SGD(self.parameters(), lr=0.1)

    def example(window: FlowWindows) -> tuple[Tensor, FlowWindows]:
        wrong = (window.owners[window.tail] != window.owners[window.head]) | (window.owners[window.tail] < 0)
        return torch.tensor(wrong, dtype=torch.float32)[:, None].repeat(1, 4), window

    def collate(examples: list[tuple[Tensor, FlowWindows]]) -> tuple[Tensor, FlowWindows]:
        features, windows = zip(*examples, strict=True)
        return torch.cat(features), FlowWindows.join(windows)

    data = torch.utils.data.DataLoader([example(street(seed)) for seed in range(4)], 2, collate_fn=collate)
    torch.manual_seed(0)
    learner = Learner()
    lightning.Trainer(
        max_epochs=10, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    ).fit(learner, data)  # fmt: skip
    assert learner.losses[-1] < 0.5 * learner.losses[0]


class Linked(torch.nn.Module):
    """Costs of links from features, and the flow behind them."""

    def __init__(self) -> None:
        super().__init__()
        self.network, self.flow = torch.nn.Linear(3, 1), FlowLayer()

    def forward(self, features: Tensor, windows: FlowWindows, rng: np.random.Generator) -> Tensor:
        flows = self.flow(windows, rng, links=self.network(features)[:, 0], detections=-3.0, entries=5.0, exits=5.0)
        return (2 * flows.loss).sum()


@pytest.mark.slow
def test_a_compiled_network_has_the_same_loss_and_gradient() -> None:
    torch.manual_seed(0)
    plain, window = Linked(), street(0)
    features, compiled = torch.randn(len(window.tail), 3), torch.compile(plain, backend="eager")
    values = []
    for network in (plain, compiled):
        plain.zero_grad()
        loss = network(features, window, np.random.default_rng(0))
        loss.backward()
        assert plain.network.weight.grad is not None
        values.append((loss, plain.network.weight.grad.clone()))
    torch.testing.assert_close(values[0], values[1])


def test_windows_go_to_the_workers_of_a_data_loader() -> None:
    window = pickle.loads(pickle.dumps(street(0)))
    np.testing.assert_array_equal(window.tail, street(0).tail)


@pytest.mark.slow
def test_the_example_of_the_page_trains_an_appearance_network() -> None:
    """In ten lines the loss falls, and the flow then links people right who were not learnt from."""
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    training = block[block.index("network = ") :].splitlines()
    assert len(training) == 10
    torch.manual_seed(0)
    names: dict[str, Any] = {}
    exec(compile(block, PAGE.name, "exec"), names)
    assert np.mean(names["losses"][-10:]) < 0.15 * names["losses"][0]
    windows, crops = names["windows"], names["crops"]()
    exec(training[0].replace("network", "untrained"), names)
    right = np.concatenate([arcs.labelled[3 * arcs.count :] for arcs in windows.arcs()])
    wrong = []
    for network in (names["untrained"], names["network"]):
        features = torch.nn.functional.normalize(network(crops)).detach()
        links = 18 * (0.76 - (features[windows.tail] * features[windows.head]).sum(dim=1))
        costs = {"links": links, "detections": -3.0, "entries": 5.0, "exits": 5.0}
        chosen = solved(FlowLayer(FlowLoss("hinge")), windows, costs).links.numpy()
        wrong.append(np.abs(chosen - right).sum())
    assert wrong[1] < 0.4 * wrong[0]
