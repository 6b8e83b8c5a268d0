"""The minimum-cost flow as a layer: costs of several windows in, the loss of whole flows and the smoothed flow out.

Features of detections make costs, the layer solves, and gradients go back through the costs to whatever made the
features (docs/extending/flow-layer.md). The windows of a batch are one network in several parts. A window's
result does not depend on the others, except that they draw from one generator in turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from tsuiseki.tracking.association.network_flow import LARGEST_COST
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.trainers.flow.flow_loss import Arcs, FlowLoss, cheapest, difference_weights, labelled_flow


@dataclass(frozen=True)
class FlowWindows:
    """The networks of B windows: N detections and P links in all, window by window.

    Attributes:
        frames: ``(N,)`` number of the frame of each detection; counted anew in each window or not.
        owners: ``(N,)`` whose each detection is, below 0 for a false positive.
        tail: ``(P,)`` index among all N of the earlier detection of each link.
        head: ``(P,)`` of the later one, in the same window.
        sizes: ``(B,)`` number of detections of each window, which may be 0.
        labelled: ``(3 N + P,)`` the labelled flow, 0 or 1 an arc: uses, entries, exits, links. By default detections of
            an owner that follow each other in time are linked, and false positives are not used.

    Raises:
        RequestError: lengths that do not fit; a link that goes back in time, out of its window or stands twice; two
            detections of a person in a frame, where they are to tell the labelled flow.
    """

    frames: IntArray
    owners: IntArray
    tail: IntArray
    head: IntArray
    sizes: IntArray
    labelled: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("frames", "owners", "tail", "head", "sizes"):
            object.__setattr__(self, name, _integers(name, getattr(self, name)))
        count = len(self.frames)
        if len(self.owners) != count or self.sizes.sum() != count or (self.sizes < 0).any():
            raise RequestError(
                f"expected a frame and an owner a detection, and sizes that add up to their number; "
                f"got {count} frames, {len(self.owners)} owners and sizes of {self.sizes.sum()} in all"
            )
        self._check_links(count)
        if self.labelled is not None:
            arcs = 3 * count + len(self.tail)
            if np.shape(self.labelled) != (arcs,):
                raise RequestError(f"labelled: expected {arcs} numbers, got shape {np.shape(self.labelled)}")
            object.__setattr__(self, "labelled", np.asarray(self.labelled, dtype=np.float64))
            return
        labelled = self.owners >= 0
        views = np.stack([self.window, self.frames, self.owners], axis=1)[labelled]
        if len(np.unique(views, axis=0)) < len(views):
            raise RequestError("owners: expected one detection of a person in a frame at most, got two")

    def _check_links(self, count: int) -> None:
        if len(self.tail) != len(self.head):
            raise RequestError(f"expected as many tails as heads, got {len(self.tail)} and {len(self.head)}")
        ends = np.concatenate([self.tail, self.head])
        if ((ends < 0) | (ends >= count)).any():
            raise RequestError(f"links: expected indices of the {count} detections, got {ends.min()} to {ends.max()}")
        wrong = np.flatnonzero(
            (self.frames[self.tail] >= self.frames[self.head]) | (self.window[self.tail] != self.window[self.head])
        )
        if len(wrong):
            raise RequestError(
                f"links: expected a later detection of the same window at each head, got another at {len(wrong)} "
                f"of {len(self.tail)}; the first is link {wrong[0]}"
            )
        if len(np.unique(self.tail * count + self.head)) < len(self.tail):
            raise RequestError("links: expected one at most from a detection to another, got some twice")

    @classmethod
    def of(cls, frames: ArrayLike, owners: ArrayLike, reach: int = 1) -> FlowWindows:
        """One window with all links between detections that are up to ``reach`` frames apart.

        Args:
            frames: ``(N,)`` number of the frame of each detection, in any order.
            owners: ``(N,)`` whose each detection is, below 0 for a false positive.
            reach: frames that a link leads ahead at most; from 1.

        >>> window = FlowWindows.of([0, 0, 1, 2], [5, 6, 5, 5], reach=1)
        >>> window.tail.tolist(), window.head.tolist()
        ([0, 1, 2], [2, 2, 3])
        """
        if reach < 1:
            raise RequestError(f"reach: expected a number of frames from 1, got {reach}")
        times = _integers("frames", frames)
        ahead = times[None] - times[:, None]
        tail, head = np.nonzero((ahead >= 1) & (ahead <= reach))
        return cls(times, _integers("owners", owners), tail, head, np.array([len(times)]))

    @classmethod
    def join(cls, windows: Sequence[FlowWindows]) -> FlowWindows:
        """Several windows as one batch, as the collate function of a data loader needs it.

        >>> window = FlowWindows.of([0, 1], [5, 5])
        >>> FlowWindows.join([window, window]).tail.tolist()
        [0, 2]
        """
        if not windows:
            raise RequestError("windows: expected one at least, got none")
        offsets = np.cumsum([0, *(len(part.frames) for part in windows)])[:-1]
        columns = [
            (part.frames, part.owners, part.tail + offset, part.head + offset, part.sizes)
            for part, offset in zip(windows, offsets, strict=True)
        ]
        labelled = None
        if any(part.labelled is not None for part in windows):
            # All uses, then all entries, all exits and all links.
            kinds = zip(*(np.split(part.labelled_flow(), part.borders) for part in windows), strict=True)
            labelled = np.concatenate([of_window for kind in kinds for of_window in kind])
        frames, owners, tail, head, sizes = (np.concatenate(column) for column in zip(*columns, strict=True))
        return cls(frames, owners, tail, head, sizes, labelled)

    @property
    def borders(self) -> tuple[int, int, int]:
        """Where entries, exits and links begin among all arcs, which uses begin."""
        count = len(self.frames)
        return count, 2 * count, 3 * count

    def labelled_flow(self) -> FloatArray:
        """``(3 N + P,)`` the labelled flow."""
        if self.labelled is not None:
            return self.labelled
        # Owners of different windows are different people.
        people = len(self.owners) * self.window + np.unique(self.owners, return_inverse=True)[1]
        return labelled_flow(self.frames, np.where(self.owners < 0, -1, people), self.tail, self.head)

    def to(self, *device: Any, **options: Any) -> FlowWindows:
        """The same, for the solver runs on the CPU: so Lightning moves a batch of crops and windows."""
        del device, options
        return self

    @property
    def window(self) -> IntArray:
        """``(N,)`` number of the window of each detection, from 0."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @property
    def window_of_arc(self) -> IntArray:
        """``(3 N + P,)`` the same of each arc: uses, entries, exits, links."""
        window = self.window
        return np.concatenate([window, window, window, window[self.tail]])

    def arcs(self) -> Iterator[Arcs]:
        """The arcs of each window, counted anew."""
        labelled, window_of_arc = self.labelled_flow(), self.window_of_arc
        for number, offset in enumerate(np.cumsum(self.sizes) - self.sizes):
            links = self.window[self.tail] == number
            tail, head, owners = (
                self.tail[links] - offset,
                self.head[links] - offset,
                self.owners[self.window == number],
            )
            flow = labelled[window_of_arc == number]
            yield Arcs(tail, head, flow, difference_weights(owners, tail, head, flow))


def _integers(name: str, values: ArrayLike) -> IntArray:
    column = np.asarray(values)
    if column.ndim != 1 or (len(column) and column.dtype.kind not in "iu"):
        raise RequestError(f"{name}: expected a row of integers, got {column.dtype} of shape {column.shape}")
    return column.astype(np.int64)


class WindowFlows(NamedTuple):
    """The loss of each window, and the smoothed flow: of each arc, how often the cheapest flow takes it.

    Attributes:
        loss: ``(B,)``, summed over the arcs of a window.
        detections: ``(N,)`` in [0, 1], that a detection is in a track.
        entries: ``(N,)`` that a track starts there.
        exits: ``(N,)`` that one ends there.
        links: ``(P,)`` that a link is taken.
    """

    loss: Tensor
    detections: Tensor
    entries: Tensor
    exits: Tensor
    links: Tensor


class FlowLayer(nn.Module):
    """The minimum-cost flow of a batch of windows, with gradients to the costs.

    The gradients of loss and flow are those of the smoothed problem; more ``pairs`` of perturbations make them less
    noisy, and take as many more solutions. The flow of the loss ``hinge`` is the cheapest one and has no gradient.

    Args:
        loss: which loss, ε and pairs of perturbations; those smooth the flow, too.
    """

    def __init__(self, loss: FlowLoss = FlowLoss()) -> None:  # noqa: B008
        super().__init__()
        self.loss = loss

    def extra_repr(self) -> str:
        """The loss, for the summary of a model."""
        return repr(self.loss)

    # The solver is no graph of torch: a compiled network runs up to here, and goes on behind it.
    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def forward(
        self,
        windows: FlowWindows,
        rng: np.random.Generator,
        *,
        links: Tensor,
        detections: Tensor | float,
        entries: Tensor | float,
        exits: Tensor | float,
    ) -> WindowFlows:
        """The loss and the smoothed flow at these costs.

        Args:
            windows: B windows with N detections and P links in all.
            rng: draws the perturbations, window by window.
            links: ``(P,)`` cost of each link; what is cheaper is rather taken.
            detections: ``(N,)`` cost of using each detection, or the same of all; below 0 where it is worth a track.
            entries: ``(N,)`` cost of a track that starts there.
            exits: ``(N,)`` cost of a track that ends there.

        Raises:
            RequestError: a shape that does not fit the windows.
            RunError: a cost that is no number or too large to be solved.
        """
        count = len(windows.frames)
        dtype = torch.promote_types(links.dtype, torch.float32)
        costs = torch.cat([
            _column(part, name, length, dtype, links.device)
            for part, name, length in (
                (detections, "detections", count),
                (entries, "entries", count),
                (exits, "exits", count),
                (links, "links", len(windows.tail)),
            )
        ])  # fmt: skip
        here = costs.detach()
        solved = _solve(self.loss, windows, here.double().cpu().numpy(), rng)
        loss, gradient, flow, draws, changes = (torch.as_tensor(part).to(costs) for part in solved)
        window = torch.as_tensor(windows.window_of_arc, device=costs.device)
        # 0 everywhere: it carries the derivatives, by the chain rule.
        move = costs - here
        loss = loss.index_add(0, window, gradient * move)
        along = draws.new_zeros(len(draws), len(loss)).index_add(1, window, draws * move)
        if len(draws):
            flow = flow + (changes * along[:, window]).mean(dim=0) / (2 * self.loss.epsilon**2)
        return WindowFlows(loss, *torch.split(flow, [count, count, count, len(windows.tail)]))


def _column(part: Tensor | float, name: str, length: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """``(length,)`` costs of one kind, which may be the same number for all."""
    column = torch.as_tensor(part, dtype=dtype, device=device)
    if column.ndim and column.shape != (length,):
        raise RequestError(f"{name}: expected {length} costs or one number, got shape {tuple(column.shape)}")
    values = column.detach()
    wrong = values[~(values.abs() <= LARGEST_COST)]
    if len(wrong):
        raise RunError(
            f"{name}: expected costs within ±{LARGEST_COST:g}, got {wrong[0].item()}; "
            f"lower the learning rate, or scale the costs down"
        )
    return column.expand(length)


class _Solved(NamedTuple):
    """Losses ``(B,)``, their gradient and the flow ``(A,)``, the noise and what its sign changes ``(K, A)``."""

    loss: FloatArray
    gradient: FloatArray
    flow: FloatArray
    draws: FloatArray
    changes: FloatArray


def _solve(loss: FlowLoss, windows: FlowWindows, costs: FloatArray, rng: np.random.Generator) -> _Solved:
    pairs = 0 if loss.name == "hinge" else loss.pairs
    size, window = len(costs), windows.window_of_arc
    solved = _Solved(np.zeros(len(windows.sizes)), *np.zeros((2, size)), *np.zeros((2, pairs, size)))
    for number, arcs in enumerate(windows.arcs()):
        place = np.flatnonzero(window == number)
        minima = loss.minima(costs[place], arcs, rng)
        solved.loss[number], solved.gradient[place] = minima.loss, minima.gradient
        solved.flow[place] = minima.flows.mean(axis=0) if pairs else cheapest(costs[place], arcs.tail, arcs.head)
        solved.draws[:, place], solved.changes[:, place] = minima.draws, minima.flows[::2] - minima.flows[1::2]
    return solved
