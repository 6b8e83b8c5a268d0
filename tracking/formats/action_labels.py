"""People with the actions that they perform, whatever the layout on disk."""

from __future__ import annotations

from dataclasses import dataclass

from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class ActionLabels:
    """The labelled people of one clip, a row for each person and frame.

    Attributes:
        names: of the A actions.
        frames: ``(N,)`` 0-based.
        ids: ``(N,)`` one number a person.
        boxes: ``(N, 4)`` pixels of the images as they lie there.
        actions: ``(N, A)`` which are performed; none, one or several.
        visibility: ``(N,)`` visible share in [0, 1].
    """

    names: tuple[str, ...]
    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    actions: BoolArray
    visibility: FloatArray

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, which: BoolArray | IntArray) -> ActionLabels:
        """The rows at a mask or at indices."""
        return ActionLabels(
            self.names,
            self.frames[which],
            self.ids[which],
            self.boxes[which],
            self.actions[which],
            self.visibility[which],
        )
