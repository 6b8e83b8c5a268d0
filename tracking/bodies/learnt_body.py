"""A body from silhouettes: the mean outline of silhouettes and how it bends, the paper's closing wish.

`tsuiseki train body` learns it and saves one JSON file, which :func:`read_body` loads; :func:`parse_body` finds any
body by its name or file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from tsuiseki.tracking.bodies.body import Ball, Body, Contours, Goldfish, Stroke, placed, shape_limits, turning_basis
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.rows import read_learnt
from tsuiseki.tracking.types import FloatArray

FORMAT = "tsuiseki-body-1"


@dataclass(frozen=True, eq=False)
class LearntBody:
    """``mean + sum_m bend_m mode_m + (bend_m^2 - 1) curve_m`` about ``(a, b)``, turned by ``theta``.

    Points of a bent body move along arcs and not along lines, so each mode comes with its second-order term; bends have
    unit variance and mean zero over the silhouettes, and ``bend^2 - 1`` has mean zero too.

    Attributes:
        name: of the body.
        mean: ``(K, 2)`` pixels about the centroid, the heading on +x.
        modes: ``(M, K, 2)`` pixels for one standard deviation, the greatest first.
        curves: ``(M, K, 2)`` pixels.
        bends: ``(M, 2)`` least and greatest bend in the data.
    """

    name: str
    mean: FloatArray
    modes: FloatArray
    curves: FloatArray
    bends: FloatArray

    def __post_init__(self) -> None:
        count, points = self.modes.shape[0], self.mean.shape[0]
        shapes = {"mean": (points, 2), "modes": (count, points, 2), "curves": (count, points, 2), "bends": (count, 2)}
        for part, shape in shapes.items():
            values = getattr(self, part)
            if values.shape != shape or not np.isfinite(values).all():
                raise ValueError(f"expected finite {part} of shape {shape}, got shape {values.shape}")
        if count < 1 or points < 8 or np.any(self.bends[:, 0] >= self.bends[:, 1]):
            raise ValueError("expected at least one mode, eight points and a range of bends")

    @property
    def fields(self) -> tuple[str, ...]:
        return ("a", "b", "theta", *(f"bend{mode + 1}" for mode in range(len(self.modes))))

    @property
    def angles(self) -> tuple[int, ...]:
        return (2,)

    @cached_property
    def limits(self) -> FloatArray:
        return shape_limits(*self.bends.tolist())

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        return (Stroke(0, len(self.mean), closed=True),)

    @cached_property
    def radius(self) -> float:
        largest = np.abs(self.bends).max(axis=1)[:, None]
        mode, curve = (np.linalg.norm(part, axis=2) for part in (self.modes, self.curves))
        more = (largest * mode + np.maximum(largest**2 - 1, 1) * curve).sum(axis=0)
        return float((np.linalg.norm(self.mean, axis=1) + more).max())

    def contour(self, states: FloatArray) -> Contours:
        """See :class:`~tsuiseki.tracking.bodies.body.Body`; bends beyond the limits are drawn at the limit."""
        bends = np.clip(states[:, 3 : 3 + len(self.modes)], *self.bends.T).astype(np.float32)
        terms = np.concatenate([bends, bends**2 - 1, np.ones((len(bends), 1), np.float32)], axis=1)
        return placed(terms, states, self._turning)

    @cached_property
    def _turning(self) -> Contours:
        return turning_basis(np.concatenate([self.modes, self.curves, self.mean[None]]).astype(np.float32))


def write_body(path: Path, body: LearntBody) -> None:
    """Writes the file that :func:`read_body` reads."""
    arrays = {part: getattr(body, part).round(4).tolist() for part in ("mean", "modes", "curves", "bends")}
    values = {"format": FORMAT, "body": "learnt", "name": body.name, **arrays}
    path.write_text(json.dumps(values) + "\n", encoding="utf-8")


def read_body(path: Path) -> LearntBody:
    """The body in a file of `tsuiseki train body`.

    Raises:
        RequestError: it is no such file, or is broken.
    """
    values = read_learnt(path, "train body", FORMAT)
    try:
        parts = [np.array(values[part], dtype=np.float64) for part in ("mean", "modes", "curves", "bends")]
        return LearntBody(str(values["name"]), *parts)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise RequestError(f"{path}: broken body file ({error}); make it again with tsuiseki train body") from error


BODIES: Mapping[str, Callable[..., Body]] = {"goldfish": Goldfish, "ball": Ball}


def parse_body(text: str) -> Body:
    """A body by name, with its sizes where they differ from the usual ones, or a file of `tsuiseki train body`.

    >>> parse_body("goldfish,length=40,width=14").length
    40.0

    Raises:
        RequestError: there is no such body, size or file, or a size is no number.
    """
    if text.endswith(".json"):
        return read_body(Path(text))
    name, *given = (part.strip() for part in text.split(","))
    make = BODIES.get(name)
    if make is None:
        raise RequestError(
            f"expected a body of {', '.join(BODIES)} or a file .json of tsuiseki train body, got {name!r}"
        )
    known = {field.name: int if field.type == "int" else float for field in fields(make)}  # type: ignore[arg-type]
    sizes: dict[str, float] = {}
    for size in given:
        key, equals, value = (part.strip() for part in size.partition("="))
        if not equals:
            raise RequestError(f"expected sizes of a body as name=number, got {size!r} in {text!r}")
        if key not in known:
            raise RequestError(f"expected sizes of the {name} among {', '.join(known)}, got {key!r}")
        try:
            sizes[key] = known[key](value)
        except ValueError as error:
            raise RequestError(f"expected a number for {key} of the {name}, got {value!r}") from error
    return make(**sizes)
