"""What the metrics have in common: states that add up over processes, and scores as tensors."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import Module
from torchmetrics import Metric

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.types import FloatArray, IntArray, as_numbers, check_boxes


class EvaluationMetric(Metric):
    """A metric whose states are the sums of an evaluation, or columns with a row an entry.

    Sums add up over processes, columns are joined. Both are float64 or int64, whatever the precision of a training.
    """

    is_differentiable = False
    full_state_update = False

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self._columns: dict[str, torch.dtype] = {}

    def add_sum(self, name: str, size: tuple[int, ...] = (), dtype: torch.dtype = torch.int64) -> None:
        """A state that is added up."""
        self.add_state(name, torch.zeros(size, dtype=dtype), dist_reduce_fx="sum")

    def add_column(self, name: str, dtype: torch.dtype = torch.float64) -> None:
        """A state of one dimension, whose rows are joined."""
        self.add_state(name, [], dist_reduce_fx="cat")
        self._columns[name] = dtype
        self._begin_columns()

    def reset(self) -> None:
        """Back to where nothing was updated."""
        super().reset()
        self._begin_columns()

    def _apply(self, fn: Callable[[Tensor], Tensor], exclude_state: Sequence[str] = "") -> Module:
        """Move the states to another device; they keep their type, as half precision cannot count."""
        device = device_of_states(fn(torch.empty(0, device=self.device)).device)
        return super()._apply(lambda state: state.to(device), exclude_state)

    def _begin_columns(self) -> None:
        # A process without data has no row, but must have the type that those of the others have.
        for name, dtype in self._columns.items():
            setattr(self, name, [torch.empty(0, dtype=dtype, device=self.device)])

    def add(self, sums: Mapping[str, Any]) -> None:
        """Add to the states by name."""
        for name, value in sums.items():
            state = getattr(self, name)
            setattr(self, name, state + torch.as_tensor(value, dtype=state.dtype, device=state.device))

    def append(self, columns: Mapping[str, Any]) -> None:
        """Append rows to the columns by name."""
        for name, rows in columns.items():
            getattr(self, name).append(torch.as_tensor(rows, dtype=self._columns[name], device=self.device))

    def sums(self, name: str) -> Any:
        """A state as an array, or as a number where it has no dimension."""
        value = getattr(self, name).cpu().numpy()
        return value if value.ndim else value.item()

    def column(self, name: str) -> Any:
        """A column as an array ``(N,)``."""
        state = getattr(self, name)
        # Joined already where processes were joined.
        return (state if isinstance(state, Tensor) else torch.cat(state)).cpu().numpy()

    def scored(self, values: Mapping[str, float]) -> dict[str, Tensor]:
        """Scores by name, each a float64 tensor without dimensions."""
        return {name: torch.tensor(value, dtype=torch.float64, device=self.device) for name, value in values.items()}

    def unscored(self, names: tuple[str, ...], missing: str) -> dict[str, Tensor]:
        """NaN by name, and a warning that says what is missing."""
        line = f"{type(self).__name__}: expected {missing}, got none: its scores are NaN; update it with more"
        warnings.warn(line, InputWarning, stacklevel=3)
        return self.scored(dict.fromkeys(names, float("nan")))


def device_of_states(device: torch.device) -> torch.device:
    """Where the states of a metric on a ``device`` lie: there, or on the CPU where that has no float64.

    >>> device_of_states(torch.device("mps"))
    device(type='cpu')
    """
    return torch.device("cpu") if device.type == "mps" else device


def numbers(values: Any, name: str) -> FloatArray:
    """A tensor on any device, an array or nested lists as float64.

    Raises:
        RequestError: they are none of numbers.
    """
    # Arrays know no bfloat16.
    return as_numbers(values.detach().cpu().double().numpy() if isinstance(values, Tensor) else values, name)


def boxes_in(values: Any, name: str) -> FloatArray:
    """``(N, 4)`` boxes x1, y1, x2, y2 in pixels, of a tensor on any device, an array or nested lists.

    Raises:
        RequestError: the shape is another, a value is not finite, or a box has no area.
    """
    rows = numbers(values, name)
    try:
        return check_boxes(rows if rows.size else rows.reshape(0, 4))
    except RequestError as error:
        raise RequestError(f"`{name}`: {error}") from error


def whole_numbers(values: Any, name: str, count: int) -> IntArray:
    """``(count,)`` whole numbers, of a tensor on any device, an array or a list.

    Raises:
        RequestError: they are others, or not as many.
    """
    rows = np.asarray(values.detach().cpu().numpy() if isinstance(values, Tensor) else values)
    if rows.size == 0:
        rows = rows.reshape(-1).astype(np.int64)
    if rows.dtype.kind not in "iufb" or (rows.dtype.kind == "f" and not np.array_equal(rows, np.floor(rows))):
        raise RequestError(f"`{name}`: expected whole numbers, got {rows.dtype.name}")
    if rows.shape != (count,):
        raise RequestError(f"`{name}`: expected shape ({count},), got {rows.shape}")
    return rows.astype(np.int64)
