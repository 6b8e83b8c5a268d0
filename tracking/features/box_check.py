"""Whether the boxes of a detector that runs fit its pictures, as `compare_with_picture` tells of files."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.formats.label_checks import compare_with_picture
from tsuiseki.tracking.types import FloatArray

# Boxes that tell.
ENOUGH = 20


@dataclass
class BoxCheck:
    """Takes the boxes of a video until there are enough, and says once what does not fit.

    Attributes:
        what: where they come from, for people to read.
        size: width and height of the pictures; None where not known.
    """

    what: str
    size: tuple[int, int] | None = None
    _boxes: list[FloatArray] | None = field(default_factory=list)

    def add(self, boxes: FloatArray) -> None:
        """Take the ``(N, 4)`` boxes of the next frame.

        Raises:
            RequestError: see `tell`.
        """
        if self._boxes is None:
            return
        self._boxes.append(boxes)
        if sum(map(len, self._boxes)) >= ENOUGH:
            self.tell()

    def tell(self) -> None:
        """Compare them, where that was not done before.

        Raises:
            RequestError: see `compare_with_picture`.
        """
        boxes, self._boxes = np.concatenate([np.empty((0, 4)), *(self._boxes or [])]), None
        compare_with_picture(self.what, boxes, self.size)
