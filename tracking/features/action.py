"""Actions of people by exported networks, and the inputs of their streams (thesis 5.2.1).

The streams take square crops of the image and of the optical flow; training and inference share them. Flow is kept as
uint8 pictures of two channels: clipped to ``±FLOW_LIMIT`` pixels, one grey level is ``FLOW_LIMIT / 127`` pixels and no
motion is `NO_MOTION`. So crops, padding and normalisation are those of images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.optical_flow import FLOW_METHODS, FlowName, optical_flow
from tsuiseki.tracking.network_trial import most_at_once, noise
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.preprocessing import FARTHEST, MOST_PIXELS, normalise
from tsuiseki.tracking.types import FloatArray, ImageArray

StreamName = Literal["rgb_local", "rgb_global", "flow_local", "flow_global"]
STREAMS: tuple[StreamName, ...] = get_args(StreamName)
LOCAL_STREAMS: tuple[StreamName, ...] = ("rgb_local", "flow_local")
# Grey level of a pixel that does not move.
NO_MOTION = 128
# Grey levels either side of it.
LEVELS = 127
# Every channel of the flow is brought to [-1, 1]; see ModelCard.mean.
FLOW_MEAN = NO_MOTION / 255
# See ModelCard.std.
FLOW_STD = LEVELS / 255
# Outside the image: the mean colour, RGB of 255, which normalisation turns into 0.
RGB_FILL = (124, 116, 104)
# Side of the global crop in sides of the local one, μ of the thesis.
ENLARGEMENT = 3.0
# Pixels a frame to which flow is clipped.
FLOW_LIMIT = 20.0
# What every file has in its settings: the two, and that the flow of one pair of frames is taken.
FIXED = {"enlargement": ENLARGEMENT, "flow_limit": FLOW_LIMIT, "stack": 1}
# Most crops of one inference call.
BATCH = 32


@dataclass(frozen=True)
class ActionInput:
    """What one stream takes.

    Attributes:
        stream: ``rgb`` or ``flow``, and ``local`` or ``global``.
        size: side of the square input, pixels.
        flow: how flow is estimated.
    """

    stream: StreamName
    size: int = 64
    flow: FlowName = "dis"

    def __post_init__(self) -> None:
        if self.stream not in STREAMS:
            raise ValueError(f"expected a stream of {', '.join(STREAMS)}; got {self.stream!r}")
        if self.flow not in FLOW_METHODS:
            raise ValueError(f"expected flow of {', '.join(FLOW_METHODS)}; got {self.flow!r}")
        if self.size < 8:
            raise ValueError(f"expected a size of 8 pixels or more, got {self.size}")

    @property
    def is_flow(self) -> bool:
        """Whether it takes optical flow."""
        return self.stream.startswith("flow")

    @property
    def channels(self) -> int:
        """2 of optical flow, 3 of a picture."""
        return 2 if self.is_flow else 3

    @property
    def scale(self) -> float:
        """Side of the crop in longer sides of the box."""
        return ENLARGEMENT if self.stream.endswith("global") else 1.0

    @classmethod
    def from_card(cls, card: ModelCard) -> ActionInput:
        """What an exported stream says that it takes.

        Raises:
            KeyError, TypeError, ValueError: its settings are incomplete or impossible.
        """
        settings = card.settings
        if (got := {name: settings[name] for name in FIXED}) != FIXED:
            raise ValueError(f"expected {FIXED}, got {got}")
        if settings.get("compensate"):
            raise ValueError("expected flow with the camera's motion left in, got one without")
        return cls(settings["stream"], card.input_height, settings["flow"])

    def card(self, name: str, class_names: tuple[str, ...]) -> ModelCard:
        """The contract of a stream's ONNX file."""
        values = {
            "stream": self.stream,
            "crop": "square with the longer side of the box" + (", enlarged" if self.scale > 1 else ""),
            **FIXED,
            "padding": "mean colour" if not self.is_flow else "no motion",
            "flow": self.flow,
            "flow_channels": "x and y from t-1 to t, pixels clipped to flow_limit and divided by it; camera included",
        }
        card = ModelCard("action", name, class_names, self.size, self.size, settings=values)
        count = self.channels
        return replace(card, mean=(FLOW_MEAN,) * count, std=(FLOW_STD,) * count) if self.is_flow else card


def flow_to(previous: ImageArray, image: ImageArray, method: FlowName) -> ImageArray:
    """``(H, W, 2)`` uint8 levels of the motion from t-1 to t, seen from t.

    What shows at a pixel of ``image`` has moved that far since ``previous``: the flow from t to t-1 is computed and
    turned round, so that it lies where people are in ``image``, even when the camera jerks by more than their size.

    Args:
        previous: ``(H, W, 3)`` uint8 RGB, frame t-1.
        image: frame t.
        method: how flow is estimated.
    """
    return flow_picture(-optical_flow(image, previous, FLOW_METHODS[method]))


def flow_picture(flow: NDArray[np.float32]) -> ImageArray:
    """``(H, W, 2)`` flow in pixels as uint8 levels, clipped to ``±FLOW_LIMIT``.

    >>> flow_picture(np.array([[[0.0, 30.0]]], np.float32)).tolist()
    [[[128, 255]]]
    """
    # One pass of OpenCV that scales, rounds and saturates: much faster than numpy on a whole frame.
    levels = cv2.addWeighted(flow, LEVELS / FLOW_LIMIT, flow, 0.0, NO_MOTION, dtype=cv2.CV_8U)
    return np.asarray(np.maximum(levels, NO_MOTION - LEVELS), dtype=np.uint8)


def square_boxes(boxes: FloatArray, scale: float = 1.0) -> FloatArray:
    """Squares around the centres of ``(N, 4)`` boxes, ``scale`` times their longer side.

    >>> square_boxes(np.array([[0, 0, 2.0, 4.0]]), 3.0).tolist()
    [[-5.0, -4.0, 7.0, 8.0]]
    """
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    half = scale * (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0, keepdims=True) / 2
    return np.concatenate([middle - half, middle + half], axis=1)


def crop_squares(image: ImageArray, squares: FloatArray, size: int) -> ImageArray:
    """``(N, size, size, C)`` crops of ``(N, 4)`` squares of an ``(H, W, C)`` uint8 image.

    What lies outside the image is filled: with the mean colour where C is 3, else with `NO_MOTION`. A crop is never
    squeezed.
    """
    rows, columns, channels = image.shape
    fill = RGB_FILL if channels == 3 else (NO_MOTION,) * channels
    crops = np.empty((len(squares), size, size, channels), dtype=np.uint8)
    for crop, square in zip(crops, squares, strict=True):
        x, y = np.rint(np.clip(square[:2], -FARTHEST, FARTHEST)).astype(int).tolist()
        side = max(1, round(min(float(square[2] - square[0]), FARTHEST)))
        left, top, right, bottom = max(x, 0), max(y, 0), min(x + side, columns), min(y + side, rows)
        if right <= left or bottom <= top:
            crop[:] = fill
            continue
        inner = image[top:bottom, left:right]
        if side * side > MOST_PIXELS + rows * columns:
            crop[:] = fill
            a, b, c, d = (round(v * size / side) for v in (left - x, top - y, right - x, bottom - y))
            if c > a and d > b:
                crop[b:d, a:c] = cv2.resize(inner, (c - a, d - b), interpolation=cv2.INTER_AREA).reshape(
                    d - b, c - a, -1
                )
            continue
        if (right - left, bottom - top) != (side, side):
            margins = (top - y, y + side - bottom, left - x, x + side - right)
            inner = _padded(inner, margins, fill)
        # Area averaging avoids aliasing when shrinking; bilinear when enlarging.
        cv2.resize(inner, (size, size), dst=crop, interpolation=cv2.INTER_AREA if side > size else cv2.INTER_LINEAR)
    return crops


def _padded(image: ImageArray, margins: tuple[int, int, int, int], fill: tuple[int, ...]) -> ImageArray:
    """``image`` with margins top, bottom, left and right of one colour; of any number of channels."""
    top, bottom, left, right = margins
    rows, columns, channels = image.shape
    padded = np.empty((rows + top + bottom, columns + left + right, channels), dtype=np.uint8)
    padded[:] = fill
    padded[top : top + rows, left : left + columns] = image
    return padded


class ActionRecogniser:
    """The streams of an action network exported to ONNX, each in its own file or all in one.

    Attributes:
        names: of the A actions.
        streams: that the S files take, in their order.
        history: number of frames before the current one that the flow needs, 1 or 0.

    Args:
        paths: of the files, one a stream, or one of streams that were trained jointly.
        threads: CPU threads; 0 takes all cores.
        device: what to run on, see `opened_on`; afterwards what they run on.

    Raises:
        RequestError: a file is no action stream (see `OnnxModel`), or the files do not belong together.
    """

    def __init__(self, paths: Sequence[str | Path], threads: int = 0, device: Device = "auto") -> None:
        if not paths:
            raise RequestError("expected the file of at least one action stream, got none")
        self.models = [OnnxModel(path, "action", threads, device) for path in paths]
        self.device = self.models[0].device
        self._taken = [_inputs(model) for model in self.models]
        self.inputs = [stream for inputs in self._taken for stream in inputs]
        self.names = self.models[0].card.class_names
        self.streams: tuple[StreamName, ...] = tuple(stream.stream for stream in self.inputs)
        self._check_together()
        self._most = [
            most_at_once(model.try_out, [_noise(stream) for stream in inputs], BATCH, model.path, "crops")
            for model, inputs in zip(self.models, self._taken, strict=True)
        ]
        self._flow = next((stream for stream in self.inputs if stream.is_flow), None)
        self.history = 1 if self._flow else 0

    def _check_together(self) -> None:
        for model in self.models:
            if model.card.class_names != self.names:
                raise RequestError(
                    f"{model.path}: expected the actions of {self.models[0].path.name}, {', '.join(self.names)}; got "
                    f"{', '.join(model.card.class_names)}"
                )
        if len(set(self.streams)) < len(self.streams):
            raise RequestError(
                f"{self.models[-1].path}: expected one file a stream, or one of all, got {', '.join(self.streams)}"
            )
        flows = {stream.flow for stream in self.inputs if stream.is_flow}
        if len(flows) > 1:
            raise RequestError(f"expected flow streams that take the same flow, got {' and '.join(sorted(flows))}")

    def recognise(self, images: Sequence[ImageArray], boxes: FloatArray) -> FloatArray:
        """``(S, N, A)`` float32 probabilities of the people in ``(N, 4)`` boxes, by file.

        Args:
            images: ``(H, W, 3)`` uint8 RGB, the current frame last, before it the one before, where flow is taken;
                where it is missing, as at the start of a video, that counts as no motion.
            boxes: in the current frame.
        """
        result = np.zeros((len(self.models), len(boxes), len(self.names)), dtype=np.float32)
        if len(boxes) == 0:
            return result  # type: ignore[return-value]
        flow = None if self._flow is None else self.flow(images)
        for model, inputs, most, probabilities in zip(self.models, self._taken, self._most, result, strict=True):
            pictures = [images[-1] if not stream.is_flow or flow is None else flow for stream in inputs]
            squares = [square_boxes(boxes, stream.scale) for stream in inputs]
            for start in range(0, len(boxes), most):
                batch = slice(start, start + most)
                crops = [
                    normalise(crop_squares(picture, square[batch], stream.size), stream.card("", ()))
                    for picture, square, stream in zip(pictures, squares, inputs, strict=True)
                ]
                probabilities[batch] = model.run(*crops)[0]
        return result  # type: ignore[return-value]

    def flow(self, images: Sequence[ImageArray]) -> ImageArray:
        """``(H, W, 2)`` uint8 levels of the flow that leads to the last of ``images``."""
        assert self._flow is not None
        if len(images) < 2:
            return np.full((*images[-1].shape[:2], 2), NO_MOTION, dtype=np.uint8)
        return flow_to(images[-2], images[-1], self._flow.flow)


def _noise(stream: ActionInput) -> NDArray[np.float32]:
    """Two normalised crops of noise, as a stream takes them."""
    return normalise(noise(stream.size, stream.size, stream.channels), stream.card("", ()))


def averaged(streams: FloatArray) -> FloatArray:
    """``(N, A)`` float64 mean of ``(S, N, A)``: the single-frame action feature."""
    return np.asarray(streams.mean(axis=0), dtype=np.float64)


def _inputs(model: OnnxModel) -> list[ActionInput]:
    card = model.card
    try:
        settings = card.settings.get("streams", [card.settings])
        streams = [ActionInput.from_card(replace(card, settings=stream)) for stream in settings]
    except (KeyError, TypeError, ValueError) as error:
        raise RequestError(
            f"{model.path}: expected stream, enlargement, flow_limit, flow and stack in the metadata, got {error!r}; "
            "export the action network again"
        ) from error
    if not model.card.class_names:
        raise RequestError(f"{model.path}: expected names of actions in the metadata, got none; export it again")
    return streams
