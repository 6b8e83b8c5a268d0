"""Appearance networks that people already have: any ONNX file from crops ``(N, 3, H, W)`` to features ``(N, D)``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.devices import Device, device_of
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.foreign_options import IMAGENET, AppearanceOptions
from tsuiseki.tracking.onnx import image_input, open_session, run_session
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray


class ForeignAppearance:
    """An appearance network of another project; its features are brought to unit length.

    Args:
        path: the ONNX file.
        threads: CPU threads; 0 takes all cores.
        batch_size: most crops of one inference call, where the file takes several.
        options: what the file does not tell.
        device: what to run on, see `opened_on`; afterwards what it runs on.

    Raises:
        RequestError: the file does not turn pictures into one row of numbers each.
    """

    def __init__(
        self,
        path: str | Path,
        threads: int = 0,
        batch_size: int = 32,
        options: AppearanceOptions | None = None,
        device: Device = "auto",
    ) -> None:
        options = options or AppearanceOptions()
        self.path = Path(path)
        self.session = open_session(path, threads, device)
        self.device = device_of(self.session)
        if len(self.session.get_inputs()) != 1:
            names = ", ".join(x.name for x in self.session.get_inputs())
            raise RequestError(f"{self.path}: expected one input, the crops, got {names}; export it with crops alone")
        self._wanted = image_input(self.session, self.path, floats=True)
        height, width = (x if isinstance(x, int) else None for x in self._wanted.shape[-2:])
        self.height, self.width = height or options.height, width or options.width
        if not self.height or not self.width:
            raise RequestError(
                f"{self.path}: height and width of its input are open; give `appearance_options.height` and "
                "`appearance_options.width`"
            )
        if len(self._wanted.shape) != 4 or len(self.session.get_outputs()) != 1:
            raise RequestError(
                f"{self.path}: expected crops (N, 3, H, W) in and one output of features, got "
                f"{len(self._wanted.shape)} axes and {len(self.session.get_outputs())} outputs"
            )
        self.batch_size = batch_size if isinstance(self._wanted.shape[0], str) else 1
        self.input = replace(IMAGENET, colour=options.colour, pixels=options.pixels, mean=options.mean, std=options.std)
        self.feature_length = self._try(self.height, self.width)

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features of the people in ``(N, 4)`` boxes of an ``(H, W, 3)`` uint8 RGB image.

        Raises:
            RunError: the features of a crop are zero or not finite.
        """
        assert self.height is not None
        assert self.width is not None
        parts = np.array_split(boxes, range(self.batch_size, len(boxes), self.batch_size))
        found = [self._rows(crop_boxes(image, part, self.height, self.width)) for part in parts if len(part)]
        rows = np.concatenate([np.empty((0, self.feature_length)), *found])
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        if not np.isfinite(length).all() or (length == 0).any():
            raise RunError(f"{self.path}: expected finite features, got zero or NaN; check its normalisation")
        return np.asarray(rows / length)

    def _try(self, height: int, width: int) -> int:
        """The length of the features, after a look at noise and at black."""
        noise = np.random.default_rng(0).integers(0, 256, (1, height, width, 3), dtype=np.uint8)
        rows = self._rows(noise)
        if np.array_equal(rows, self._rows(np.zeros_like(noise))):
            raise RequestError(
                f"{self.path}: expected features that depend on the crop, got the same for two crops; export it again"
            )
        return int(rows.shape[1])

    def _rows(self, crops: NDArray[np.uint8]) -> FloatArray:
        values = self.input.normalise(crops, self._wanted.dtype)
        output = run_session(self.session, self.path, {self._wanted.name: values})[0]
        if output.ndim < 2 or len(output) != len(crops) or output[0].size != output.shape[1]:
            raise RequestError(f"{self.path}: expected features (N, D), got {output.shape} for {len(crops)} crops")
        return output.reshape(len(crops), -1).astype(np.float64)
