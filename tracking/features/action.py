"""Actions of people by exported networks: the streams of thesis 5.2.1, batched over people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action_inputs import (
    NO_MOTION,
    ActionInput,
    StreamName,
    crop_squares,
    flow_to,
    square_boxes,
)
from tsuiseki.tracking.onnx import OnnxModel
from tsuiseki.tracking.preprocessing import normalise
from tsuiseki.tracking.types import FloatArray, ImageArray


class ActionRecogniser:
    """The streams of an action network exported to ONNX, each in its own file.

    Attributes:
        names: of the A actions.
        streams: of the S files, in their order.
        history: number of frames before the current one that the flow needs.

    Args:
        paths: of the files, one a stream.
        threads: CPU threads; 0 takes all cores.
        batch_size: most crops of one inference call.

    Raises:
        RequestError: a file is no action stream (see `OnnxModel`), or the files do not belong together.
    """

    def __init__(self, paths: Sequence[str | Path], threads: int = 0, batch_size: int = 32) -> None:
        if not paths:
            raise RequestError("expected the file of at least one action stream, got none")
        self.models = [OnnxModel(path, "action", threads) for path in paths]
        self.inputs = [_input(model) for model in self.models]
        self.batch_size = batch_size
        self.names = self.models[0].card.class_names
        self.streams: tuple[StreamName, ...] = tuple(one.stream for one in self.inputs)
        self._check_together()
        flows = [one for one in self.inputs if one.is_flow]
        self._flow = flows[0] if flows else None
        self.history = self._flow.stack if self._flow else 0

    def _check_together(self) -> None:
        for model, stream in zip(self.models, self.streams, strict=True):
            if model.card.class_names != self.names:
                raise RequestError(
                    f"{model.path}: expected the actions of {self.models[0].path.name}, {', '.join(self.names)}; got "
                    f"{', '.join(model.card.class_names)}"
                )
            if self.streams.count(stream) > 1:
                raise RequestError(f"{model.path}: expected one file a stream, got {stream} twice")
        flows = {(one.stack, one.flow_limit, one.flow, one.compensate) for one in self.inputs if one.is_flow}
        if len(flows) > 1:
            raise RequestError(
                "expected flow streams that take the same flow (stack, flow_limit, flow, compensate), got "
                f"{' and '.join(map(str, sorted(flows)))}"
            )

    def recognise(self, images: Sequence[ImageArray], boxes: FloatArray) -> FloatArray:
        """``(S, N, A)`` float32 probabilities of the people in ``(N, 4)`` boxes, by stream.

        Args:
            images: ``(H, W, 3)`` uint8 RGB, the current frame last, before it as many of the frames before as there
                are, at most ``history``; where one is missing, as at the start of a video, it counts as no motion.
            boxes: in the current frame.
        """
        found = np.zeros((len(self.models), len(boxes), len(self.names)), dtype=np.float32)
        if len(boxes) == 0:
            return found  # type: ignore[return-value]
        flow = None if self._flow is None else self.flow(images)
        for model, stream, result in zip(self.models, self.inputs, found, strict=True):
            picture = images[-1] if not stream.is_flow or flow is None else flow
            squares = square_boxes(boxes, stream.scale)
            for start in range(0, len(boxes), self.batch_size):
                some = slice(start, start + self.batch_size)
                crops = crop_squares(picture, squares[some], stream.size)
                result[some] = model.run(normalise(crops, model.card))[0]
        return found  # type: ignore[return-value]

    def flow(self, images: Sequence[ImageArray]) -> ImageArray:
        """``(H, W, 2 * stack)`` uint8 levels of the flow that leads to the last of ``images``."""
        assert self._flow is not None
        pairs = [
            flow_to(before, image, self._flow.flow, self._flow.flow_limit, compensate=self._flow.compensate)
            for before, image in zip(images[-1 - self.history : -1], images[-self.history :], strict=False)
        ]
        missing = self.history - len(pairs)
        still = np.full((*images[-1].shape[:2], 2), NO_MOTION, dtype=np.uint8)
        return np.concatenate([still] * missing + pairs, axis=2)


def averaged(streams: FloatArray) -> FloatArray:
    """``(N, A)`` float64 mean of ``(S, N, A)``: the single-frame action feature."""
    return np.asarray(streams.mean(axis=0), dtype=np.float64)


def _input(model: OnnxModel) -> ActionInput:
    try:
        found = ActionInput.from_card(model.card)
    except (KeyError, TypeError, ValueError) as error:
        raise RequestError(
            f"{model.path}: expected stream, enlargement, flow_limit, flow and stack in the metadata, got {error!r}; "
            "export the action network again"
        ) from error
    if not model.card.class_names:
        raise RequestError(f"{model.path}: expected names of actions in the metadata, got none; export it again")
    return found
