"""What people labelled in a video: who is where, and what each is doing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.types import BoolArray, Columns, FloatArray, IntArray, ShortRepr


@dataclass(frozen=True, repr=False)
class GroundTruth(ShortRepr, Columns):
    """Labelled boxes of a sequence, ordered by frame.

    Attributes:
        frames: ``(N,)`` 0-based.
        ids: ``(N,)`` one number a person.
        boxes: ``(N, 4)`` pixels.
        evaluated: ``(N,)`` pedestrians that count.
        ignored: ``(N,)`` boxes on which a result is neither right nor wrong.
        visibility: ``(N,)`` visible share in [0, 1]; 1 where the file does not say.
    """

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    evaluated: BoolArray
    ignored: BoolArray
    visibility: FloatArray

    @classmethod
    def of_boxes(cls, frames: IntArray, ids: IntArray, boxes: FloatArray) -> GroundTruth:
        """Boxes that all count and are visible as a whole."""
        everyone = np.ones(len(frames), dtype=np.bool_)
        return cls(frames, ids, boxes, everyone, ~everyone, np.ones(len(frames)))

    def between(self, first: int, last: int) -> GroundTruth:
        """The rows of the 0-based frames ``first`` to ``last``, both included; frames keep their numbers."""
        return self.select((self.frames >= first) & (self.frames <= last))


@dataclass(frozen=True)
class ActionLabels(Columns):
    """The rows of a label file, in its order.

    Attributes:
        frames: ``(N,)`` 0-based.
        ids: ``(N,)`` one number a person.
        boxes: ``(N, 4)`` pixels of the frames, cut off at their borders; of lost rows it may be anything with an area.
        lost: ``(N,)`` the person is out of view.
        occluded: ``(N,)`` the person is hidden.
        generated: ``(N,)`` the box was interpolated.
        actions: ``(N, C)`` what each is doing.
        class_names: of the C actions.
    """

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    lost: BoolArray
    occluded: BoolArray
    generated: BoolArray
    actions: BoolArray
    class_names: tuple[str, ...]
